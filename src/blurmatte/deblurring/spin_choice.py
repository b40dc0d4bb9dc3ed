"""The choice between a ball that shows one side and one that spins, by their evidence.

Both explain the same pixels under the same weights. Let Z be the evidence of the color in `gaussian`, Q
the inverse covariance (n, n) of the color of n nodes before the light is seen, without its constant,
and C and Σ the (k, k) covariances of the k parameters of motion and shape after and before. Then the
log evidence is

    log Z + (3/2) log |Q| + (1/2) log (|C| / |Σ|).

Path and shape have the same prior in both. That of colored light on a ball is normalized, too.
"""

from dataclasses import replace

import numpy as np

from blurmatte.calibration import with_noise
from blurmatte.deblurring.differences import Differences
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.refine import explained
from blurmatte.deblurring.sparse_prior import log_determinant
from blurmatte.deblurring.sphere import FIELD_STD, MAX_NODES, Sphere
from blurmatte.deblurring.spin import Spin
from blurmatte.deblurring.spin_fit import PRIOR, fit_spin
from blurmatte.deblurring.view import View
from blurmatte.errors import SpinError
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.sweep import Sweep


def likelier_spin(
    image: LinearImage, plate: LinearImage, sweep: Sweep, flat: Sweep, lattice: Lattice
) -> tuple[Spin | None, str]:
    """A spin that explains the light decisively better than a flat object, or None, and any doubt.

    `flat` is the sweep as it was refined with a flat object on the lattice, whose path is the start if
    the fit of `sweep` did not converge.
    """
    start = sweep if sweep.diagnostics.converged else replace(sweep, path=flat.path)
    try:
        spin, doubt = fit_spin(image, plate, start), ""
    except SpinError as error:
        if error.likeliest is None:
            return None, str(error)
        spin, doubt = error.likeliest, f"{error}; the likeliest spin is used"
    gain = log_bayes_factor(*with_noise(image, plate), spin, flat, lattice)
    if gain < DECISIVE_LOG_BAYES_FACTOR:
        return None, f"a ball that spins explains the light no better (log Bayes factor {gain:.1f})"
    return spin, doubt


def log_bayes_factor(
    image: LinearImage, plate: LinearImage, spin: Spin, flat: Sweep, lattice: Lattice
) -> float:
    """Of the spin over a flat object; the noise of the pictures is known."""
    still = View.of(image, plate, flat, margin=int(np.ceil(flat.radius)))
    turning = replace(still, sweep=spin.sweep or flat, spin=spin)
    sphere = Sphere.within(turning.sweep.radius, MAX_NODES)
    weights = [turning.weight(turning.blur(sphere).alpha, around=True)]
    total = -np.linalg.slogdet(PRIOR)[1] / 2 - 3 * (sphere.unknowns - sphere.size) * np.log(
        FIELD_STD
    )
    for view, nodes, sign in ((turning, sphere, 1), (still, lattice, -1)):
        differences = Differences.of(nodes)
        band = differences.band(
            differences.weights(np.eye(len(differences.orders))[0]), differences.width
        )
        evidence = explained([view], nodes, weights).fit.log_evidence
        evidence += 1.5 * log_determinant(band, differences)
        total += sign * (evidence + np.linalg.slogdet(view.covariance)[1] / 2)
    return float(total)

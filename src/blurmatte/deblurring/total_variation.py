"""The straight color under a prior of its total variation.

Paint has edges, which a Gaussian prior smooths. The prior exp(−ν TV(o)), with

    TV(o) = Σ |g|,   |g|² = Σ_c (oᵢ − oⱼ)_c² + ε²   over neighbors i, j,

has its edges in all channels at once. ε makes it quadratic for smaller differences. From a color with
differences g₀ it is bounded by a quadratic prior, |g| ≤ (|g|² / |g₀| + |g₀|) / 2, whose maximum is the
next color (iteratively reweighted least squares).

The prior's density is proportional to ν^(3 (n − 1)) exp(−ν TV(o)). ν maximizes its mean logarithm over
the Gaussian posterior, whose differences have means and variances (an EM step):

    ν = 3 (n − 1) / Σ √E|g|²,   E|g|² = |E g|² + Var g + ε².

The color is the mode for this ν. The covariance is that of the last quadratic prior at the strength of
its largest evidence, half to a third of ν: it counts differences that the data leave open as free.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.deblurring.gaussian import GaussianFit, fit_strength, refit_strength
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import Normal, NormalEquations, gradient_prior
from blurmatte.deblurring.sphere import Sphere

Array = npt.NDArray[np.float64]

_SMALLEST_EDGE = 0.01  # ε, linear light
_ITERATIONS = 7


def fit_total_variation(
    equations: NormalEquations, lattice: Lattice | Sphere, start: GaussianFit
) -> GaussianFit:
    """The most probable color, with the covariance of the last quadratic prior of largest evidence.

    `strength` is the precision ν of the prior, absolute.
    """
    precision, fit = _precision(start, lattice), start
    for _ in range(_ITERATIONS):
        Q = gradient_prior(lattice, edge_weights(fit.normal.mean, lattice), equations.band.shape[2])
        fit = fit_strength(equations, Q, precision * start.noise_scale)
    covariance = refit_strength(equations, Q, fit.strength)
    normal = Normal(fit.normal.mean, covariance.normal.factors)
    return GaussianFit(normal, precision, covariance.noise_scale, fit.log_evidence)


def edge_weights(color: Array, lattice: Lattice | Sphere, variance: Array | float = 0.0) -> Array:
    """(m,) weights 1 / |g| of the quadratic bound at a color (n, 3) with variances of differences."""
    i, j = lattice.edges.T
    square = ((color[i] - color[j]) ** 2).sum(axis=1) + variance
    return np.asarray(1 / np.sqrt(square + _SMALLEST_EDGE**2))


def _precision(fit: GaussianFit, lattice: Lattice | Sphere) -> float:
    """ν of the largest mean log prior over a Gaussian posterior."""
    i, j = lattice.edges.T
    C = fit.noise_scale * fit.normal.covariance_band()
    variance = (C[:, i, 0] + C[:, j, 0] - 2 * C[:, i, j - i]).sum(axis=0)
    return float(
        3 * (lattice.size - 1) / np.sum(1 / edge_weights(fit.normal.mean, lattice, variance))
    )

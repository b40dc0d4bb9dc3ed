"""Starts for the fit of a rotation: centers and angles.

Where an edge passed, alpha is a ramp of slope 1/ω along circles, for any outline and at all distances
from the center c:

    (x − c) × ∇α = ± 1/ω ,                                                                    (1)

which is linear in c and in 1/ω.
"""

from collections.abc import Iterator

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.errors import MotionError

# The random sample consensus that solves (1).
_SMOOTHING_PX = 2.0  # standard deviation of the Gaussian for gradients
_SAMPLES = 400  # of three pixels each
_TOLERANCE = 0.25  # of 1/ω, for (1) in a pixel that agrees
_MIN_GRADIENT_STD = 4.0  # standard deviations of the gradient of a pixel on a ramp
_SPACINGS = (0.85, 1.15, 1.7, 2.2)  # angles between blades: paths overlap


def starts(
    alpha: Array, std: Array, use: Bools, center: Array | None
) -> Iterator[tuple[Array, float, float | None]]:
    """Centers, angles in radians, and None or the angle in units of the angle between blades.

    The centroid of alpha, which is right for most fans, and the solution of (1). Where the paths of
    blades overlap (1) does not hold, and angles around the multiples of that between blades are tried.
    """
    c, slope = _start(alpha, std, use, center)
    if center is None:
        y, x = np.nonzero(use)
        middle = np.array([x, y]) @ alpha[use] / max(float(alpha[use].sum()), 1.0)
        yield middle, min(1 / _start(alpha, std, use, middle)[1], 2 * np.pi), None
    else:
        middle = center
    yield c, min(1 / slope, 2 * np.pi), None
    for spacings in _SPACINGS:
        yield middle, 0.0, spacings


def _start(alpha: Array, std: Array, use: Bools, center: Array | None) -> tuple[Array, float]:
    """The center and 1/ω for which (1) holds in the most pixels."""
    scale = _SMOOTHING_PX
    gy, gx = (scipy.ndimage.gaussian_filter(alpha, scale, order=o) for o in ((1, 0), (0, 1)))
    # Independent noise σ gives the derivative of a Gaussian the error σ / (√(8π) s²).
    noise = float(np.median(std[use])) / (np.sqrt(8 * np.pi) * scale**2) if use.any() else 1.0
    steep = use & (np.hypot(gx, gy) > _MIN_GRADIENT_STD * noise)
    y, x = np.nonzero(steep)
    if len(x) < 3:
        raise MotionError("alpha hardly varies: no rotation, or full turns; use a shorter exposure")
    gx, gy = gx[steep], gy[steep]
    # c_x g_y − c_y g_x + s/ω = x g_y − y g_x, s = ±1
    A, b = np.column_stack([gy, -gx]), x * gy - y * gx
    best, score = (np.zeros(2), 0.0), -1.0
    for c, slope in _candidates(A, b, center):
        d = np.abs(b - A @ c)
        agree = np.abs(d / slope - 1) < _TOLERANCE
        if agree.sum() > score:
            best, score = (c, slope), float(agree.sum())
    c, slope = best
    for _ in range(10):
        d = b - A @ c
        ramp = np.abs(np.abs(d) / slope - 1) < _TOLERANCE
        if ramp.sum() < 3:
            break
        signs = np.sign(d[ramp])
        if center is not None:
            slope = float(np.abs(d[ramp]).mean())
            continue
        rows = np.column_stack([A[ramp], signs])
        solved, *_ = np.linalg.lstsq(rows, b[ramp], rcond=None)
        if not solved[2] > 0:
            break
        c, slope = solved[:2], float(solved[2])
    return c, slope


def _candidates(A: Array, b: Array, center: Array | None) -> Iterator[tuple[Array, float]]:
    """Centers and 1/ω > 0 from three pixels each, or from one if the center is known; seeded."""
    rng = np.random.default_rng(0)
    for _ in range(_SAMPLES):
        if center is not None:
            i = int(rng.integers(len(b)))
            slope = abs(float(b[i] - A[i] @ center))
            if slope > 0:
                yield center, slope
            continue
        three = rng.integers(len(b), size=3)
        for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)):
            rows = np.column_stack([A[three], signs])
            if abs(np.linalg.det(rows)) > 1e-12:
                cx, cy, slope = np.linalg.solve(rows, b[three])
                if slope != 0:
                    yield np.array([cx, cy]), abs(float(slope))

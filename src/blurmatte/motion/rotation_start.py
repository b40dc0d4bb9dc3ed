"""Where the fit of a rotation begins: centers and angles.

Where an edge passed, alpha is a ramp of slope 1/ω along circles, whatever the outline, and the same at
all distances from the center c:

    (x − c) × ∇α = ± 1/ω ,                                                                    (1)

which is linear in c and in 1/ω.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import MotionError

Array = npt.NDArray[np.float64]

_SMOOTH = 2.0  # pixels, over which gradients are taken
_TRIALS = 400  # starts from three pixels each
_AGREE = 0.25  # of 1/ω, by which (1) may fail in a pixel that counts as a ramp
_STEEP = 4.0  # times its error, the gradient of a pixel on a ramp
_SPACINGS = 0.85, 1.15, 1.7, 2.2  # times the angle between blades, where their ways overlap


def starts(
    alpha: Array, std: Array, use: Bools, center: Array | None
) -> Iterator[tuple[Array, float, float | None]]:
    """Centers and angles to begin with, or these in times the angle between blades.

    The middle of alpha, right for most fans, and what (1) says. Where the ways of blades overlap (1)
    holds nowhere, and angles around those after which all looks alike are tried.
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
    """A center, and 1/ω, for which (1) holds in the most pixels."""
    from scipy.ndimage import gaussian_filter

    gy, gx = (gaussian_filter(alpha, _SMOOTH, order=o) for o in ((1, 0), (0, 1)))
    # Noise of one pixel in a Gaussian's derivative: σ / (√(8π) s²).
    noise = float(np.median(std[use])) / (np.sqrt(8 * np.pi) * _SMOOTH**2) if use.any() else 1.0
    steep = use & (np.hypot(gx, gy) > _STEEP * noise)
    y, x = np.nonzero(steep)
    if len(x) < 3:
        raise MotionError(
            "alpha hardly changes anywhere; nothing turned, or by full turns: expose shorter"
        )
    gx, gy = gx[steep], gy[steep]
    # c_x g_y − c_y g_x + s/ω = x g_y − y g_x, s = ±1
    A, b = np.column_stack([gy, -gx]), x * gy - y * gx
    best, score = (np.zeros(2), 0.0), -1.0
    for c, slope in _candidates(A, b, center):
        d = np.abs(b - A @ c)
        agree = np.abs(d / slope - 1) < _AGREE
        if agree.sum() > score:
            best, score = (c, slope), float(agree.sum())
    c, slope = best
    for _ in range(10):
        d = b - A @ c
        ramp = np.abs(np.abs(d) / slope - 1) < _AGREE
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
    """Centers and 1/ω > 0 that three pixels say, or one if the center is known; always the same."""
    rng = np.random.default_rng(0)
    for _ in range(_TRIALS):
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

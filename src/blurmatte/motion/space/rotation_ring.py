"""The ring in which a whole rotating object is visible, and starts for the fit of its rotation.

Where an edge passed, alpha is a ramp of slope 1/ω along circles, for any outline and at all distances
from the center c:

    (x − c) × ∇α = ± 1/ω ,                                                                    (1)

which is linear in c and in 1/ω.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.errors import MotionError

GRID = 720  # angles of a full turn
NO_VARIATION = (
    "alpha does not vary along circles around the center. The object may be round, or have turned by a "
    "multiple of 360°, of 180° if it is a stick with two ends, or of 360°/n if it has n blades; the "
    "picture does not show which. Expose shorter"
)


# Where the whole object is visible, and when alpha varies around the center.
_MIN_RADIUS_PX = 4.0  # smaller circles have too few pixels to resolve angles
_MIN_WIDTH = 0.4  # of the median sum of alpha along a circle: the object is still there
_END_MARGIN_PX = 2.5  # left out at both ends of the object
_MAX_BLADES = 12
_MIN_VARIATION_STD = 16.0  # standard deviations of alpha around the center
_MIN_VARIATION = 0.1  # of the largest alpha around the center
_MAX_SMOOTHING = 32.0  # of `GRID` angles: a wider Gaussian would hide blades
# The random sample consensus that solves (1).
_SMOOTHING_PX = 2.0  # standard deviation of the Gaussian for gradients
_SAMPLES = 400  # of three pixels each
_TOLERANCE = 0.25  # of 1/ω, for (1) in a pixel that agrees
_MIN_GRADIENT_STD = 4.0  # standard deviations of the gradient of a pixel on a ramp
_SPACINGS = (0.85, 1.15, 1.7, 2.2)  # angles between blades: paths overlap


@dataclass(frozen=True, eq=False)
class RingPixels:
    """Alpha of pixels (n,) at x, y, and its standard deviation."""

    x: Array
    y: Array
    alpha: Array
    std: Array


def pixels_at(
    alpha: Array, std: Array, y: npt.NDArray[np.intp], x: npt.NDArray[np.intp]
) -> RingPixels:
    """Pixels of a picture at indices y and x, (n,) both."""
    return RingPixels(x.astype(float), y.astype(float), alpha[y, x], std[y, x])


def ring_around(alpha: Array, use: Bools, c: Array) -> tuple[tuple[float, float], Bools]:
    """Inner and outer radius between which the whole object is visible, and the mask of the ring."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    rho = np.hypot(x - c[0], y - c[1])
    widths = np.bincount(np.rint(rho).astype(int).ravel(), weights=alpha.ravel())
    present = widths > _MIN_WIDTH * np.median(widths[widths > _MIN_WIDTH * widths.max()])
    present[: int(_MIN_RADIUS_PX)] = False
    first, last = _longest(present)
    low, high = first + _END_MARGIN_PX, last - _END_MARGIN_PX
    mask = use & (rho >= low) & (rho <= high)
    if high - low < 2 * _END_MARGIN_PX or not mask.any():
        raise MotionError(
            "no circle around the center of rotation shows the whole object: it is too small, or does "
            "not turn about one point; give its center"
        )
    return (low, high), mask


def _longest(present: Bools) -> tuple[int, int]:
    """First and last index of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(int), [0]])))
    if len(edges) == 0:
        return 0, 0
    runs = edges.reshape(-1, 2)
    first, end = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(first), int(end) - 1


def blades_of(pixels: RingPixels, c: Array, ring: tuple[float, float]) -> list[tuple[float, float]]:
    """Middle and width, radians, of each blade in the mean over the ring."""
    profile = _profile(pixels, c, ring)
    level = (profile.max() + max(profile.min(), 0)) / 2
    inside = profile > level
    turned = int(np.flatnonzero(~inside)[0])
    inside, profile = np.roll(inside, -turned), np.roll(profile, -turned)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]]))).reshape(-1, 2)
    if len(edges) > _MAX_BLADES:
        raise MotionError(f"{len(edges)} blades on a circle cannot be distinguished from noise")
    found, step = [], 2 * np.pi / GRID
    for k, (a, b) in enumerate(edges):
        before = (edges[k - 1][1] + a) // 2 if k else 0
        after = (b + edges[k + 1][0]) // 2 if k + 1 < len(edges) else GRID
        width = float(profile[before:after].sum()) * step
        found.append(((a + b) / 2 * step + turned * step, max(width, step)))
    return found


def _profile(pixels: RingPixels, c: Array, ring: tuple[float, float]) -> Array:
    """(720,) mean of alpha over the ring at each angle, with the least smoothing that is significant.

    Raises MotionError if alpha does not vary.
    """
    rho = np.hypot(pixels.x - c[0], pixels.y - c[1])
    phi = np.arctan2(pixels.y - c[1], pixels.x - c[0])
    which = np.floor((phi / (2 * np.pi)) * GRID).astype(int) % GRID
    weight = 1 / rho
    # Alpha varies more between circles than along them: subtract the mean of each circle.
    relative = pixels.alpha - _circle_means(rho, pixels.alpha)
    mean = np.average(pixels.alpha, weights=weight)
    sums = [
        np.bincount(which, weights=w, minlength=GRID)
        for w in (weight * relative, weight, (weight * pixels.std) ** 2)
    ]
    smooth = max(1.5 * GRID / (2 * np.pi * ring[1]), 2)  # 1.5 pixels at the outer radius
    while smooth < _MAX_SMOOTHING:
        above, below = (scipy.ndimage.gaussian_filter1d(s, smooth, mode="wrap") for s in sums[:2])
        profile = np.asarray(mean + above / np.maximum(below, 1e-12))
        # The sum of squared Gaussian weights is 1 / (2 √π s).
        variance = sums[2].mean() / (2 * np.sqrt(np.pi) * smooth)
        error = float(np.sqrt(variance)) / max(float(below.mean()), 1e-12)
        least = max(_MIN_VARIATION * float(profile.max()), _MIN_VARIATION_STD * error)
        if float(np.ptp(profile)) > least:
            return profile
        smooth *= 2
    raise MotionError(NO_VARIATION)


def _circle_means(rho: Array, alpha: Array) -> Array:
    """(n,) mean of alpha over the circle of each pixel."""
    ring = np.rint(rho).astype(int)
    count = np.maximum(np.bincount(ring), 1)
    where, mean = (np.bincount(ring, weights=v) / count for v in (rho, alpha))
    some = where > 0
    return np.interp(rho, where[some], mean[some])


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

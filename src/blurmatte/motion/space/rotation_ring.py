"""The ring around a center in which the whole object is visible, and its blades on that ring."""

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

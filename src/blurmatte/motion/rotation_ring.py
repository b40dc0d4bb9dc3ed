"""The circles around a center that show the whole of what turns, and the parts of it on them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import MotionError

Array = npt.NDArray[np.float64]

_NEAREST = 4.0  # pixels from the center: nearer ones see all angles at once
_PRESENT = 0.4  # of its usual width along a circle, where the thing is still there
_TIP = 2.5  # pixels at both ends of it that are left out
_GRID = 720  # angles
_MOST_BLADES = 12
_CLEAR = 16.0  # times its error, what alpha varies by around the center: noise then makes no parts
_COARSEST = 32.0  # of 720 angles: smoother than that, blades would be lost
_UNEVEN = 0.1  # of its largest, what it varies by at least
ALIKE = (
    "alpha is the same all around the center. So it is of something round, and after any number of "
    "full turns, of a stick with two ends also of half turns, of n blades of nths of a turn: all of "
    "them look alike, and which it was the picture does not tell. Expose shorter"
)


@dataclass(frozen=True, eq=False)
class Pixels:
    """Alpha of some pixels (n,) at x, y."""

    x: Array
    y: Array
    alpha: Array
    std: Array


def pixels_at(alpha: Array, std: Array, y: npt.NDArray[np.intp], x: npt.NDArray[np.intp]) -> Pixels:
    """Of some places in a picture."""
    return Pixels(x.astype(float), y.astype(float), alpha[y, x], std[y, x])


def ring_around(alpha: Array, use: Bools, c: Array) -> tuple[tuple[float, float], Bools]:
    """Between which distances from the center the whole of something turns; the pixels there."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    rho = np.hypot(x - c[0], y - c[1])
    widths = np.bincount(np.rint(rho).astype(int).ravel(), weights=alpha.ravel())
    present = widths > _PRESENT * np.median(widths[widths > _PRESENT * widths.max()])
    present[: int(_NEAREST)] = False
    first, last = _longest(present)
    low, high = first + _TIP, last - _TIP
    mask = use & (rho >= low) & (rho <= high)
    if high - low < 2 * _TIP or not mask.any():
        raise MotionError(
            "no circle around the center of the turn shows all of the thing: it is too small, or does "
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


def blades_of(pixels: Pixels, c: Array, ring: tuple[float, float]) -> list[tuple[float, float]]:
    """Middle and width, radians, of what turns, as the mean over the ring has it."""
    profile = _profile(pixels, c, ring)
    level = (profile.max() + max(profile.min(), 0)) / 2
    inside = profile > level
    turned = int(np.flatnonzero(~inside)[0])
    inside, profile = np.roll(inside, -turned), np.roll(profile, -turned)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]]))).reshape(-1, 2)
    if len(edges) > _MOST_BLADES:
        raise MotionError(f"{len(edges)} parts on a circle are too many to tell from noise")
    found, step = [], 2 * np.pi / _GRID
    for k, (a, b) in enumerate(edges):
        before = (edges[k - 1][1] + a) // 2 if k else 0
        after = (b + edges[k + 1][0]) // 2 if k + 1 < len(edges) else _GRID
        width = float(profile[before:after].sum()) * step
        found.append(((a + b) / 2 * step + turned * step, max(width, step)))
    return found


def _profile(pixels: Pixels, c: Array, ring: tuple[float, float]) -> Array:
    """(720,) alpha around the center, the mean over the ring; as smooth as makes it clear of noise.

    Raises
    ------
    MotionError
        If it is even.
    """
    from scipy.ndimage import gaussian_filter1d

    rho = np.hypot(pixels.x - c[0], pixels.y - c[1])
    phi = np.arctan2(pixels.y - c[1], pixels.x - c[0])
    which = np.floor((phi / (2 * np.pi)) * _GRID).astype(int) % _GRID
    weight = 1 / rho
    # Circles differ by far more than angles: which pixels of which circle a bin has must not show.
    uneven, usual = (
        pixels.alpha - _around(rho, pixels.alpha),
        np.average(pixels.alpha, weights=weight),
    )
    sums = [
        np.bincount(which, weights=w, minlength=_GRID)
        for w in (weight * uneven, weight, (weight * pixels.std) ** 2)
    ]
    smooth = max(1.5 * _GRID / (2 * np.pi * ring[1]), 2)  # 1.5 pixels at the outer rim
    while smooth < _COARSEST:
        above, below = (gaussian_filter1d(s, smooth, mode="wrap") for s in sums[:2])
        profile = np.asarray(usual + above / np.maximum(below, 1e-12))
        # The sum of squared Gaussian weights is 1 / (2 √π s).
        variance = sums[2].mean() / (2 * np.sqrt(np.pi) * smooth)
        error = float(np.sqrt(variance)) / max(float(below.mean()), 1e-12)
        varies = float(np.ptp(profile))
        if varies > max(_UNEVEN * float(profile.max()), _CLEAR * error):
            return profile
        smooth *= 2
    raise MotionError(ALIKE)


def _around(rho: Array, alpha: Array) -> Array:
    """(n,) the mean of alpha over the circle that each pixel lies on."""
    ring = np.rint(rho).astype(int)
    count = np.maximum(np.bincount(ring), 1)
    where, mean = (np.bincount(ring, weights=v) / count for v in (rho, alpha))
    some = where > 0
    return np.interp(rho, where[some], mean[some])

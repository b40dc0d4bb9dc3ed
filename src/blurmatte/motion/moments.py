"""Motion from the moments of alpha, where no sweep explains the streak.

A silhouette of area A that goes straight for L at constant speed has Σα = A, and the variance of
alpha is V across the path and L²/12 + V along it, if the silhouette is about as long as it is wide;
V = r²/4 for a disc. Pixels, which are squares of light, add 1/12 to both. No color enters.

Each of these sums is linear in alpha, or a ratio of sums, so that an error δα of a pixel at x changes
the mean by (x − mean) δα / Σα, and the covariance by ((x − mean)(x − mean)ᵀ − covariance) δα / Σα.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.matting import Solution
from blurmatte.motion.motion import Motion
from blurmatte.motion.propagation import propagated
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_PIXEL = 1 / 12  # variance of a square pixel
_SIGMAS = 3.0  # by which a sum must be above its error
_SPREAD = 1.5  # times as wide as the area says: the path bends, or there is more than one thing
_PART = 0.05  # of all alpha: what lies apart and has less is noise
_FAINT = 0.15  # of the largest alpha
_NEIGHBORHOOD = 2.0  # pixels, over which alpha is averaged to see what hangs together
_UNKNOWN = 0.02  # of the streak's pixels


def motion_of_alpha(solution: Solution) -> Motion:
    """What sum, mean and covariance of alpha say.

    Raises
    ------
    MotionError
        If alpha does not add up to more than its error.
    """
    use = solution.streak & solution.known
    parameters, covariance = _moments(solution, use)
    values, covariance = propagated(_told, parameters, covariance, slice(2, 3))
    center, angle, length = values[:2], values[2], values[3]
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    motion = Motion(
        trajectory=Trajectory.line(center - half, center + half),
        values=values,
        covariance=covariance,
        speeds=np.array([length]),
        speeds_std=np.sqrt(covariance[3:4, 3]),
        source="moments",
        path="line",
        silhouette="",
        size=solution.size,
        at_border=_touches_border(solution, use),
        exposure_time=solution.stats.get("exposure_time"),
    )
    return replace(motion, doubts=tuple(_doubts(solution, use, motion)))


def alike(solution: Solution) -> float:
    """How many pixels err as one: the variance of the sum over the sum of the variances, 1 or more."""
    stats, use = solution.stats, solution.streak & solution.known
    alone = float(np.sum(np.asarray(solution.alpha_std[use], float) ** 2))
    together = stats.get("sum_alpha_std", 0.0) ** 2
    return max(float(together / alone), 1.0) if alone > 0 else 1.0


def _moments(solution: Solution, use: Bools) -> tuple[Array, Array]:
    """(6,) area, mean x and y, variances xx, xy, yy; and their covariance (6, 6)."""
    y, x = np.nonzero(use)
    alpha = np.asarray(solution.alpha[use], float)
    variance = alike(solution) * np.asarray(solution.alpha_std[use], float) ** 2
    total, scale = float(alpha.sum()), solution.stats.get("alpha_scale_std", 0.0)
    std = float(np.hypot(np.sqrt(variance.sum()), total * scale))
    if not total > _SIGMAS * std:
        raise MotionError(
            f"alpha adds up to {total:.1f} ± {std:.1f} pixels, no more than nothing: no motion can be "
            "measured; choose the object with a region, or give its color, and solve again"
        )
    dx, dy = x - alpha @ x / total, y - alpha @ y / total
    seconds = np.stack([dx * dx, dx * dy, dy * dy])
    moments = seconds @ alpha / total
    by_alpha = np.stack([np.ones(len(x)), dx / total, dy / total])
    by_alpha = np.concatenate([by_alpha, (seconds - moments[:, None]) / total])
    covariance = (by_alpha * variance) @ by_alpha.T
    covariance[0, 0] += (total * scale) ** 2
    middle = alpha @ x / total, alpha @ y / total
    pixel = _PIXEL * np.array([1, 0, 1])
    return np.array([total, *middle, *(moments - pixel)]), covariance


def _told(moments: Array) -> Array:
    """`QUANTITIES` of area, mean and variances."""
    area, x, y, xx, xy, yy = moments
    apart = np.hypot(xx - yy, 2 * xy)  # of the two eigenvalues
    across = max((xx + yy - apart) / 2, 0.0)
    angle, length = 0.5 * np.arctan2(2 * xy, xx - yy), np.sqrt(12 * apart)
    radius = np.sqrt(max(area, 0.0) / np.pi)
    return np.array([x, y, angle, length, 4 * np.sqrt(across), radius, area, length])


def _touches_border(solution: Solution, use: Bools) -> bool:
    """Whether alpha along the border adds up to more than its error."""
    border = np.ones(use.shape, bool)
    border[1:-1, 1:-1] = False
    there = use & border
    alpha, std = (np.asarray(m[there], float) for m in (solution.alpha, solution.alpha_std))
    return bool(alpha.sum() > _SIGMAS * np.sqrt(alike(solution) * np.sum(std**2)))


def _doubts(solution: Solution, use: Bools, motion: Motion) -> list[str]:
    said = []
    parts = _parts(solution, use)
    if parts > 1:
        said.append(
            f"Alpha lies in {parts} parts that are apart: the moments are those of all of them; solve "
            "each with a region of its own."
        )
    if motion.width > _SPREAD * 2 * motion.radius:
        said.append(
            f"It is {motion.width:.0f} px wide, and a disc of its area {2 * motion.radius:.0f}: the "
            "path bends, or it is not round, or there are several things; length and direction are "
            "then those of no straight path."
        )
    unknown = float(np.mean(~solution.known[solution.streak]))
    if unknown > _UNKNOWN:
        said.append(f"In {unknown:.0%} of the streak alpha is not known, and not in the moments.")
    return said


def _parts(solution: Solution, use: Bools) -> int:
    """Of how many pieces the streak is."""
    from scipy.ndimage import gaussian_filter, label

    alpha = np.where(use, np.asarray(solution.alpha, float), 0)
    near = gaussian_filter(alpha, _NEIGHBORHOOD)
    pieces, count = label(near > _FAINT * near.max())
    sums = np.bincount(pieces.ravel(), alpha.ravel(), count + 1)[1:]
    return int(np.count_nonzero(sums > _PART * alpha.sum()))

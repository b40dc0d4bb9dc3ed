"""Motion from the moments of alpha, for a streak that no sweep explains.

A silhouette of area A that moves straight for a length L at constant speed has Σα = A. The variance
of alpha is V across the path and L²/12 + V along it, if the silhouette is about as long as it is wide;
V = r²/4 for a disc. The square pixels add 1/12 to both. No color is needed.

These sums are linear in alpha, or ratios of such sums. An error δα of a pixel at x changes the mean by
(x − mean) δα / Σα, and the covariance by ((x − mean)(x − mean)ᵀ − covariance) δα / Σα.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution
from blurmatte.motion.picture.error_budget import propagated
from blurmatte.motion.picture.motion import Motion
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class MomentSettings:
    """When alpha counts as present, and when a motion from moments gets a doubt."""

    min_sum_std: float = 3.0  # standard deviations: a smaller sum of alpha may be noise
    max_width: float = 1.5  # diameters of the disc of its area: a straight path is not wider
    max_unknown_fraction: float = 0.02  # of the streak's pixels
    part_smoothing_px: float = 2.0  # standard deviation of the Gaussian before parts are labeled
    min_part_alpha: float = 0.15  # of the largest smoothed alpha
    min_part_fraction: float = 0.05  # of the sum of alpha: a smaller part is noise


def motion_of_alpha(solution: Solution) -> Motion:
    """Motion from sum, mean and covariance of alpha.

    Raises
    ------
    MotionError
        If the sum of alpha is not above its error.
    """
    use = solution.streak & solution.known
    parameters, covariance = _moments(solution, use)
    values, covariance = propagated(_quantities, parameters, covariance, slice(2, 3))
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


def variance_inflation(solution: Solution) -> float:
    """Variance of the sum of alpha over the sum of the variances, at least 1."""
    stats, use = solution.stats, solution.streak & solution.known
    independent = float(np.sum(np.asarray(solution.alpha_std[use], float) ** 2))
    correlated = stats.get("sum_alpha_std", 0.0) ** 2
    return max(float(correlated / independent), 1.0) if independent > 0 else 1.0


def _moments(solution: Solution, use: Bools) -> tuple[Array, Array]:
    """(6,) area, mean x and y, variances xx, xy, yy; and their covariance (6, 6)."""
    y, x = np.nonzero(use)
    alpha = np.asarray(solution.alpha[use], float)
    variance = variance_inflation(solution) * np.asarray(solution.alpha_std[use], float) ** 2
    total, scale = float(alpha.sum()), solution.stats.get("alpha_scale_std", 0.0)
    std = float(np.hypot(np.sqrt(variance.sum()), total * scale))
    if not total > MomentSettings.min_sum_std * std:
        raise MotionError(
            f"alpha sums to {total:.1f} ± {std:.1f} pixels, which is not above its error: no motion "
            "can be measured; choose the object with a region, or give its color, and solve again"
        )
    dx, dy = x - alpha @ x / total, y - alpha @ y / total
    seconds = np.stack([dx * dx, dx * dy, dy * dy])
    moments = seconds @ alpha / total
    by_alpha = np.stack([np.ones(len(x)), dx / total, dy / total])
    by_alpha = np.concatenate([by_alpha, (seconds - moments[:, None]) / total])
    covariance = (by_alpha * variance) @ by_alpha.T
    covariance[0, 0] += (total * scale) ** 2
    middle = alpha @ x / total, alpha @ y / total
    pixel = 1 / 12 * np.array([1, 0, 1])
    return np.array([total, *middle, *(moments - pixel)]), covariance


def _quantities(moments: Array) -> Array:
    """`QUANTITIES` of area, mean and variances."""
    area, x, y, xx, xy, yy = moments
    difference = np.hypot(xx - yy, 2 * xy)  # of the two eigenvalues
    across = max((xx + yy - difference) / 2, 0.0)
    angle, length = 0.5 * np.arctan2(2 * xy, xx - yy), np.sqrt(12 * difference)
    radius = np.sqrt(max(area, 0.0) / np.pi)
    return np.array([x, y, angle, length, 4 * np.sqrt(across), radius, area, length])


def _touches_border(solution: Solution, use: Bools) -> bool:
    """True if the sum of alpha along the border is above its error."""
    border = np.ones(use.shape, bool)
    border[1:-1, 1:-1] = False
    there = use & border
    alpha, std = (np.asarray(m[there], float) for m in (solution.alpha, solution.alpha_std))
    error = np.sqrt(variance_inflation(solution) * np.sum(std**2))
    return bool(alpha.sum() > MomentSettings.min_sum_std * error)


def _doubts(solution: Solution, use: Bools, motion: Motion) -> list[str]:
    doubts = []
    parts = _part_count(solution, use)
    if parts > 1:
        doubts.append(
            f"Alpha has {parts} separate parts, and the moments are those of all of them; solve each "
            "with a region of its own."
        )
    if motion.width > MomentSettings.max_width * 2 * motion.radius:
        doubts.append(
            f"It is {motion.width:.0f} px wide, and a disc of its area {2 * motion.radius:.0f} px: the "
            "path bends, or it is not round, or there are several objects; length and direction are "
            "then not those of a straight path."
        )
    unknown = float(np.mean(~solution.known[solution.streak]))
    if unknown > MomentSettings.max_unknown_fraction:
        doubts.append(f"In {unknown:.0%} of the streak alpha is unknown and not in the moments.")
    return doubts


def _part_count(solution: Solution, use: Bools) -> int:
    """Number of separate parts of alpha."""
    from scipy.ndimage import gaussian_filter, label

    alpha = np.where(use, np.asarray(solution.alpha, float), 0)
    near = gaussian_filter(alpha, MomentSettings.part_smoothing_px)
    labels, count = label(near > MomentSettings.min_part_alpha * near.max())
    sums = np.bincount(labels.ravel(), alpha.ravel(), count + 1)[1:]
    return int(np.count_nonzero(sums > MomentSettings.min_part_fraction * alpha.sum()))

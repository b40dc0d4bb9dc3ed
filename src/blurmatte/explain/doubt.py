"""Warnings: why a large part of an answer is unknown or impossible, and what to do."""

import numpy as np

from blurmatte.explain.numbers import rounded_std
from blurmatte.explain.sweep import likeliest_shape
from blurmatte.matting.maps import Quality
from blurmatte.matting.solution import Solution

_ALL_SHADOW = (
    "Only light was lost: all of this may be a shadow, or an object that is black, or darker than the "
    "plate and of its hue; the picture does not show which. Alpha holds only if something of the "
    "given color was there."
)
_MIN_FLAGGED_FRACTION = 0.25  # of the streak's pixels, for a warning
_REMEDY = {
    Quality.SATURATED: "is clipped in the image or the plate and cannot be known; expose shorter",
    Quality.PLATE_IN_MODEL: "lies before a plate of the object's own colors: nothing can be known "
    "there; allow fewer colors, or take the pictures before another background",
    Quality.SHADOW: "is only darker than the plate: a shadow, or something black, which the picture "
    "does not separate; choose a region without it",
    Quality.MISFIT: "does not fit the color: pick the object's color where it is sharp or opaque, "
    "give two colors (rank 2), or choose a region that holds the object alone",
}


def doubts(solution: Solution) -> list[str]:
    """Warnings that a large part of the answer is unknown or impossible.

    One sentence each, with a remedy; none for a sound solution.
    """
    inside = solution.quality[solution.streak]
    if not inside.size:
        return []
    if solution.stats.may_be_shadow:
        return [_ALL_SHADOW]
    unknown = ~solution.known[solution.streak]
    shares = {
        flag: float(np.mean(((inside & flag) != 0) & (unknown | (flag != Quality.SATURATED))))
        for flag in _REMEDY
    }
    shape = likeliest_shape(solution)
    if shape is not None and shape.shadow is not None:
        del shares[Quality.SHADOW]  # `sweep_in_words` describes the object's own
    said = [f"{share:.0%} of the streak {_REMEDY[flag]}." for flag, share in shares.items()
            if share > _MIN_FLAGGED_FRACTION]  # fmt: skip
    return _no_object(solution) or [*said, *_impossible(solution)]


def _no_object(solution: Solution) -> list[str]:
    total = solution.stats.sum_alpha
    std = solution.sum_std_without_factor
    if total is None or total > 3 * std:
        return []  # a common factor of alpha that is open makes no object disappear
    return [
        f"Alpha adds up to {total:.0f} ± {rounded_std(std)}, which may be nothing: what moved here may "
        "not have this "
        "color; choose the object with a region, or give its own color."
    ]


def _impossible(solution: Solution) -> list[str]:
    """Warnings of alpha out of its range by more than noise."""
    known = solution.streak & solution.known
    alpha, margin = solution.alpha[known], 3 * solution.alpha_std[known]
    if not alpha.size:
        return []
    above, below = np.mean(alpha > 1.02 + margin), np.mean(alpha < -margin)
    said = []
    if above > 0.005:
        said.append(
            f"Alpha goes up to {alpha_peak(solution):.2f}, which cannot be (above 1 in {above:.1%} "
            "of the streak): the color is too near to the plate's, or the plate does not fit."
        )
    if below > 0.05:  # noise alone puts fewer pixels out of range
        said.append(
            f"Alpha is below 0 in {below:.0%} of the streak, which cannot be: a shadow or another "
            "thing is in it, or the color is wrong."
        )
    return said


def alpha_peak(solution: Solution) -> float:
    """The 99.5 % quantile of known alpha; 0 if no pixel is known."""
    alpha = solution.alpha[solution.streak & solution.known]
    return max(float(np.percentile(alpha, 99.5)), 0.0) if alpha.size else 0.0

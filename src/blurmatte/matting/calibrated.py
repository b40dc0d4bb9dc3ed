"""The calibrated error of an average of hypotheses: for each pixel, and for what pixels share.

In this file s is the claimed error of alpha over the streak and s' the calibrated one, root mean
squares. What s' has beyond s is shared out: a part is an error of the rim's place, in proportion to the
slope of alpha, a part is the same everywhere that the object may have been, and the rest is a common
factor of alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.matting.averaging import AlphaEstimate
from blurmatte.matting.solution import Grade
from blurmatte.sweep import Diagnostics
from blurmatte.sweep.assess.calibration import (
    COMPRESSED,
    UNCOMPRESSED,
    ErrorTerms,
    fitted_calibration,
)

Array = npt.NDArray[np.float64]

# Largest error of alpha, root mean square over the streak, and of its scale, relative.
MAX_CONFIRMED, MAX_PLAUSIBLE = (0.02, 0.03), (0.05, 0.1)
_RIM_SHARE, _EVEN_SHARE = 0.35, 0.1  # of the variance beyond the claim
_RIM_FLOOR_PX = 0.03  # by which no rim's place is known better, root mean square
_MIN_ALPHA = 0.004  # of the pixels of a streak
_MIN_CLAIM = 1e-4
_LARGE_CLAIM = 0.05  # of alpha, from which on claims are not too small


@dataclass(frozen=True)
class HypothesisSummary:
    """What the calibration asks of one hypothesis.

    Parameters
    ----------
    weight : float
    rank : int
        Of its colors.
    has_shape : bool
    inflation : float
        Of its residuals' variance.
    """

    weight: float
    rank: int
    has_shape: bool
    inflation: float


def claimed_error(estimate: AlphaEstimate) -> float:
    """s: root mean square over the streak of the error that an estimate claims."""
    std = np.hypot(estimate.alpha_std, estimate.scale_std * estimate.alpha)
    use = (estimate.alpha > _MIN_ALPHA) & np.isfinite(std)
    return max(float(np.sqrt(np.mean(std[use] ** 2))) if use.any() else 0.0, _MIN_CLAIM)


def error_terms(
    average: AlphaEstimate,
    estimates: Sequence[AlphaEstimate],
    summaries: Sequence[HypothesisSummary],
    diagnostics: Diagnostics,
) -> ErrorTerms:
    """The terms of the calibration.

    Parameters
    ----------
    average : AlphaEstimate
    estimates : sequence of AlphaEstimate
        The hypotheses.
    summaries : sequence of HypothesisSummary
        The same, in order; sweeps, the likeliest first, and then alphas without a shape.
    diagnostics : Diagnostics
        Of the likeliest sweep.
    """
    claim = claimed_error(average)
    terms = [float(np.log1p(rms_difference(average, one) / claim)) for one in estimates]
    best = int(np.argmax([one.weight for one in summaries]))
    others = [i for i in range(len(terms)) if i != best]
    counterpart = [i for i in others if summaries[i].has_shape != summaries[best].has_shape]
    if not summaries[best].has_shape:
        counterpart = counterpart[:1]
    one_paint = [terms[i] for i in others if summaries[i].rank == 1]
    return ErrorTerms(
        shapeless=terms[counterpart[-1]] if counterpart else 0.0,
        one_paint=min(one_paint, default=0.0),
        mean=float(np.mean([terms[i] for i in others])) if others else 0.0,
        least=min((terms[i] for i in others), default=0.0),
        correlation=float(np.log(summaries[best].inflation)),
        color_spread=min(diagnostics.color_spread, _MAX_SPREAD),
        color_angle=float(np.log1p(min(diagnostics.color_angle_std, _MAX_ANGLE_DEG))),
        radius=float(np.log1p(100 * min(diagnostics.radius_error, _MAX_RELATIVE))),
        blur=float(np.log1p(100 * min(diagnostics.blur_over_radius, _MAX_RELATIVE))),
        residuals=float(np.log(max(diagnostics.residual_excess, 1.0))),
        noise=float(np.log(max(min(diagnostics.noise_inflation, _MAX_INFLATION), 1.0))),
        without_shape=float(not summaries[best].has_shape),
        small_claim=float(np.log(max(_LARGE_CLAIM / claim, 1.0))),
    )


# Beyond these, terms say no more.
_MAX_SPREAD, _MAX_ANGLE_DEG, _MAX_RELATIVE, _MAX_INFLATION = 0.5, 20.0, 0.3, 1e3


def rms_difference(average: AlphaEstimate, other: AlphaEstimate) -> float:
    """Root mean square difference of alpha where either is."""
    a, b = (np.where(np.isfinite(one.alpha), one.alpha, 0) for one in (average, other))
    use = (a > _MIN_ALPHA) | (b > 5 * _MIN_ALPHA)
    return float(np.sqrt(np.mean((a - b)[use] ** 2))) if use.any() else 0.0


def calibrated(
    average: AlphaEstimate,
    estimates: Sequence[AlphaEstimate],
    terms: ErrorTerms,
    compressed: bool,
) -> AlphaEstimate:
    """An average with its calibrated error.

    Parameters
    ----------
    average : AlphaEstimate
    estimates : sequence of AlphaEstimate
        The hypotheses; the object may have been where any of them has it.
    terms : ErrorTerms
    compressed : bool
        Whether the image's file is.
    """
    claim = claimed_error(average)
    file_class = COMPRESSED if compressed else UNCOMPRESSED
    error = min(claim * fitted_calibration().factor(terms, file_class), 1.0)
    alpha = np.asarray(average.alpha, float)
    use = alpha > _MIN_ALPHA
    slope = np.hypot(*np.gradient(np.clip(alpha, 0, 1)))
    anywhere = np.any([np.nan_to_num(one.alpha) > _MIN_ALPHA for one in estimates], axis=0)
    beyond = max(error**2 - claim**2, 0.0)
    own = np.hypot(average.alpha_std, average.scale_std * alpha) * min(1.0, error / claim)
    slope_square, alpha_square = (
        max(float(np.mean(x[use] ** 2)) if use.any() else 0.0, _MIN_CLAIM**2)
        for x in (slope, alpha)
    )
    variance = own**2 + beyond * (_RIM_SHARE * slope**2 / slope_square + _EVEN_SHARE * anywhere)
    variance += (_RIM_FLOOR_PX * slope) ** 2
    scale_square = beyond * (1 - _RIM_SHARE - _EVEN_SHARE) / alpha_square
    return replace(
        average,
        alpha_std=np.where(np.isfinite(average.alpha_std), np.sqrt(variance), np.inf),
        sum_std=average.sum_std,
        scale_std=float(np.sqrt(scale_square)),
    )


def graded(estimate: AlphaEstimate) -> dict[str, Any]:
    """Grade, error of alpha and of its scale of a calibrated estimate."""
    error = claimed_error(estimate)
    total = max(float(np.nansum(np.where(np.isfinite(estimate.alpha), estimate.alpha, 0))), 1e-9)
    scale = float(np.hypot(estimate.scale_std, estimate.sum_std / total))
    return {"grade": grade_of(error, scale), "alpha_error": error}


def grade_of(error: float, scale: float) -> Grade:
    """The grade of an error of alpha, and of the relative error of its scale."""
    for grade, (most_error, most_scale) in (
        (Grade.CONFIRMED, MAX_CONFIRMED),
        (Grade.PLAUSIBLE, MAX_PLAUSIBLE),
    ):
        if error <= most_error and scale <= most_scale:
            return grade
    return Grade.ASSUMED

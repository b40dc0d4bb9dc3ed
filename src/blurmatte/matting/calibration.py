"""The calibrated error of an average of hypotheses: for each pixel, and for the scale of alpha.

In this file s is the claimed error of alpha over the streak and s' the calibrated one, root mean
squares. The excess variance s'² − s² has three parts: an error of the rim's position, in proportion to
the slope of alpha; a constant error wherever the object may have been; and an error of a factor common
to all alpha.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.matting.averaging import MIN_WEIGHT, AlphaEstimate, with_bounded_errors
from blurmatte.matting.maps import Grade
from blurmatte.statistics import UNKNOWN_FRACTION
from blurmatte.sweep.assess.calibration import (
    COMPRESSED,
    UNCOMPRESSED,
    ErrorTerms,
    fitted_calibration,
)
from blurmatte.sweep.sweep import Diagnostics

# Largest error of alpha, root mean square over the streak, and largest relative error of its scale.
GRADE_LIMITS = {Grade.CONFIRMED: (0.02, 0.03), Grade.PLAUSIBLE: (0.05, 0.1)}

MAX_REASONS = 3  # stated


# Settings of the calibrated error, and ranges of its terms.
_RIM_SHARE = 0.35  # of the excess variance: position of the rim
_CONSTANT_SHARE = 0.1  # of the excess variance: the same wherever the object may be
_MIN_RIM_ERROR_PX = 0.03  # smallest error of the rim's position, root mean square
_RIM_DOF = 3.0  # degrees of freedom: errors over claims of alpha spread by a factor of about 1.8
_MAX_RIM_SHIFT = 8.0  # standard deviations of the rim's position
_NEIGHBORS = np.ones((3, 3), bool), np.eye(3)[1] + np.eye(3)[1][:, None] > 0  # in turn: a disc
MIN_ALPHA = 0.004  # of the pixels that count as streak
_MIN_CLAIM = 1e-4  # smallest claimed error of alpha
_LARGE_CLAIM = 0.05  # claimed error of alpha from which on claims are not too small
_MAX_COLOR_SPREAD = 0.5  # radians
_MAX_COLOR_ANGLE_STD = 20.0  # degrees
_MAX_RELATIVE_SIZE = 0.3  # of the errors of radius and blur
_MAX_NOISE_INFLATION = 1e3


@dataclass(frozen=True)
class HypothesisSummary:
    """Properties of one hypothesis that enter the calibration."""

    weight: float
    rank: int  #: of its color model
    has_shape: bool
    inflation: float  #: variance inflation of its residuals


def claimed_error(estimate: AlphaEstimate) -> float:
    """s: root mean square over the streak of the standard deviation of an estimate.

    Where light changed and the estimate has no object, it knows of alpha only that it is a fraction.
    """
    std = np.hypot(estimate.alpha_std, estimate.scale_std * estimate.alpha)
    use = on_streak(estimate.alpha, std)
    return (
        max(float(np.sqrt(np.mean(std[use] ** 2))), _MIN_CLAIM) if use.any() else UNKNOWN_FRACTION
    )


def on_streak(alpha: Floats, std: Floats) -> Bools:
    """Pixels of the streak whose alpha is known: over these its error is a root mean square."""
    return np.asarray((alpha > MIN_ALPHA) & np.isfinite(std))


def error_terms(
    average: AlphaEstimate,
    estimates: Sequence[AlphaEstimate],
    summaries: Sequence[HypothesisSummary],
    diagnostics: Diagnostics,
    exact_color: bool = False,
) -> ErrorTerms:
    """The terms of the calibration.

    estimates: the hypotheses.
    summaries: of the same hypotheses: first sweeps in order of likelihood, then those without a
        shape.
    diagnostics: of the likeliest sweep.
    exact_color: whether the color was given without an error; then it has no direction to err in.
    """
    claim = claimed_error(average)
    terms = [float(np.log1p(rms_difference(average, one) / claim)) for one in estimates]
    best = int(np.argmax([one.weight for one in summaries]))
    others = [i for i in range(len(terms)) if i != best]
    counterpart = [i for i in others if summaries[i].has_shape != summaries[best].has_shape]
    if not summaries[best].has_shape:
        counterpart = counterpart[:1]
    one_paint = [terms[i] for i in others if summaries[i].rank == 1]
    angle_std = min(diagnostics.color_angle_std, _MAX_COLOR_ANGLE_STD)
    return ErrorTerms(
        shapeless=terms[counterpart[-1]] if counterpart else 0.0,
        one_paint=min(one_paint, default=0.0),
        mean=float(np.mean([terms[i] for i in others])) if others else 0.0,
        least=min((terms[i] for i in others), default=0.0),
        correlation=float(np.log(summaries[best].inflation)),
        color_spread=min(diagnostics.color_spread, _MAX_COLOR_SPREAD),
        color_angle=0.0 if exact_color else float(np.log1p(angle_std)),
        radius=float(np.log1p(100 * min(diagnostics.radius_error, _MAX_RELATIVE_SIZE))),
        blur=float(np.log1p(100 * min(diagnostics.blur_over_radius, _MAX_RELATIVE_SIZE))),
        residuals=float(np.log(max(diagnostics.residual_excess, 1.0))),
        noise=float(np.log(max(min(diagnostics.noise_inflation, _MAX_NOISE_INFLATION), 1.0))),
        without_shape=float(not summaries[best].has_shape),
        small_claim=float(np.log(max(_LARGE_CLAIM / claim, 1.0))),
    )


def reasons(
    terms: ErrorTerms, claim: float, weights: Array, compressed: bool, gray: bool = False
) -> list[str]:
    """Causes of the error that are true of the numbers, the largest first.

    claim: the claimed error, which noise alone leaves. weights (n,): of the hypotheses. gray: whether
    the pictures are: then alpha without a shape says nothing.
    """
    area_error = 2 * float(np.expm1(terms.radius)) / 100  # relative, by the radius
    true = {
        "file": compressed,
        "size": area_error > GRADE_LIMITS[Grade.CONFIRMED][1],
        "shape": not gray,
        "disagreement": len(weights) > 1 and float(np.sort(weights)[-2]) >= MIN_WEIGHT,
    }
    found = ["noise"] if claim > GRADE_LIMITS[Grade.CONFIRMED][0] else []
    found += [name for name in fitted_calibration().reasons(terms) if true.get(name, True)]
    return found[:MAX_REASONS]


def rms_difference(average: AlphaEstimate, other: AlphaEstimate) -> float:
    """Root mean square difference of alpha where either estimate has the object."""
    a, b = (np.where(np.isfinite(one.alpha), one.alpha, 0) for one in (average, other))
    use = (a > MIN_ALPHA) | (b > 5 * MIN_ALPHA)
    return float(np.sqrt(np.mean((a - b)[use] ** 2))) if use.any() else 0.0


def calibrated(
    average: AlphaEstimate,
    estimates: Sequence[AlphaEstimate],
    terms: ErrorTerms,
    compressed: bool,
    exact_color: bool = False,
) -> AlphaEstimate:
    """An average with its calibrated error.

    estimates: the hypotheses; the object may have been at any pixel that one of them covers.
    compressed: whether the image's file is compressed.
    exact_color: whether the color was given without an error.
    """
    claim = claimed_error(average)
    file_class = COMPRESSED if compressed else UNCOMPRESSED
    factor = fitted_calibration().factor(terms, file_class, exact_color)
    error = min(claim * factor, 1.0)
    alpha = np.asarray(average.alpha, float)
    use = alpha > MIN_ALPHA
    slope = np.hypot(*np.gradient(np.clip(alpha, 0, 1)))
    anywhere = np.any([np.nan_to_num(one.alpha) > MIN_ALPHA for one in estimates], axis=0)
    beyond = max(error**2 - claim**2, 0.0)
    own = np.hypot(average.alpha_std, average.scale_std * alpha) * min(1.0, error / claim)
    slope_square, alpha_square = (
        max(float(np.mean(x[use] ** 2)) if use.any() else 0.0, _MIN_CLAIM**2)
        for x in (slope, alpha)
    )
    variance = own**2 + beyond * (_RIM_SHARE * slope**2 / slope_square + _CONSTANT_SHARE * anywhere)
    variance += (_MIN_RIM_ERROR_PX * slope) ** 2
    variance[~use] = np.maximum(variance, _variance_outside(alpha, variance, slope, use))[~use]
    scale_square = beyond * (1 - _RIM_SHARE - _CONSTANT_SHARE) / alpha_square
    return replace(
        average,
        alpha_std=np.where(np.isfinite(average.alpha_std), np.sqrt(variance), np.inf),
        scale_std=float(np.sqrt(scale_square)),
    )


def _variance_outside(alpha: Array, variance: Array, slope: Array, use: Bools) -> Array:
    """Variance (h, w) of alpha that is 0 because the rim is at some distance.

    The rim's position has the variance that explains that of alpha by its slope, fitted to the streak
    `use`, and a Student-t distribution, since this variance is an estimate: the result is the mean of
    the square of alpha widened by whole pixels. The rim moves by at most the radius of a disc of the
    same sum of alpha.
    """
    rim = use & np.isfinite(variance) & (slope > 0)
    if not rim.any():
        return np.zeros(alpha.shape)
    by_position = slope[rim] ** 2
    std = np.sqrt(float(variance[rim] @ by_position / (by_position @ by_position)))
    distance = np.arange(min(_MAX_RIM_SHIFT * std, np.sqrt(alpha[use].sum() / np.pi)) + 1)
    scale = std * np.sqrt(1 - 2 / _RIM_DOF)
    farther = scipy.special.stdtr(_RIM_DOF, -(distance + 0.5) / scale)  # that the rim moves by more
    farther[-1] = 0.0
    widened, mean_square = np.asarray(alpha), np.zeros(alpha.shape)
    for i in range(1, len(distance)):
        widened = scipy.ndimage.maximum_filter(widened, footprint=_NEIGHBORS[i % 2])
        mean_square += (farther[i - 1] - farther[i]) * widened**2
    return mean_square


def calibrated_alone(
    estimate: AlphaEstimate, solver: str, compressed: bool, exact_color: bool
) -> AlphaEstimate:
    """The estimate of a solver that is not compared with other hypotheses, with its calibrated error.

    solver: "Smooth" or "Pixelwise"; that of `Shaded` is also the error of single pixels.
    compressed, exact_color: as for `calibrated`.
    """
    file_class = COMPRESSED if compressed else UNCOMPRESSED
    factor = fitted_calibration().solver_factor(solver, file_class, exact_color)
    stds = factor * np.asarray(estimate.alpha_std, float), factor * estimate.sum_std
    scale = factor * estimate.scale_std
    return with_bounded_errors(AlphaEstimate(estimate.alpha, *stds, scale))


def graded(estimate: AlphaEstimate) -> tuple[Grade, float]:
    """Grade and error of alpha of a calibrated estimate."""
    error = claimed_error(estimate)
    total = max(float(np.nansum(np.where(np.isfinite(estimate.alpha), estimate.alpha, 0))), 1e-9)
    scale = float(np.hypot(estimate.scale_std, estimate.sum_std / total))
    return grade_of(error, scale), error


def grade_of(error: float, scale: float) -> Grade:
    """The grade of an error of alpha, and of the relative error of its scale."""
    for grade, (max_error, max_scale) in GRADE_LIMITS.items():
        if error <= max_error and scale <= max_scale:
            return grade
    return Grade.ASSUMED

"""How far an answer is from the truth, in alpha, light and motion, and in its own claims.

In this file z is (estimate − truth) / standard deviation, where the variance is the claimed one plus
that of the truth, which is rendered with a finite number of samples. The streak is where the true
alpha of all that moved is above `MIN_ALPHA`; `known` is where an answer claims to know alpha.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from benchmarks.cycles.pictures import Facts
from benchmarks.trials import direction_errors

from blurmatte.checks import Bools, Floats
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.metrics import calibration, false_alpha, trajectory_iou
from blurmatte.scenes import ProgramAnswer, score
from blurmatte.scenes.score import Truth
from blurmatte.sweep import Sweep

Array = npt.NDArray[np.float64]

MIN_ALPHA = 0.004  # of the truth; less may be sampling noise
# Bounds of |z| between which values are counted: eight to an octave, 1 and 2 among them.
Z_BOUNDS = 2.0 ** (np.arange(-40, 65) / 8)
_PATH_TIMES = 129


@dataclass(frozen=True)
class Deviations:
    """What many z look like.

    Parameters
    ----------
    count : int
    rms : float
        Root mean square; 1 if the claims are honest.
    robust : float
        Median of |z| over that of a normal distribution.
    within_1, within_2 : float
        Fractions of |z| below 1 and 2; 0.683 and 0.954 for honest normal errors.
    counts : tuple of int
        How many |z| lie below `Z_BOUNDS[0]`, between neighbors of `Z_BOUNDS`, and above the last.
    """

    count: int
    rms: float
    robust: float
    within_1: float
    within_2: float
    counts: tuple[int, ...]

    @classmethod
    def of(cls, z: Array) -> "Deviations | None":
        """None if there are no z."""
        if z.size == 0:
            return None
        found = calibration(z, np.ones_like(z), np.zeros_like(z))
        counts = np.bincount(np.searchsorted(Z_BOUNDS, np.abs(z)), minlength=len(Z_BOUNDS) + 1)
        return cls(
            found.count,
            float(np.hypot(found.mean, found.spread)),
            found.robust_spread,
            found.within_1,
            found.within_2,
            tuple(counts.tolist()),
        )


@dataclass(frozen=True)
class Errors:
    """The errors of one answer. None: the answer holds, or claims, no such thing.

    Parameters
    ----------
    alpha_rmse : float or None
        Of the raw estimate, where the streak is known.
    claimed : float or None
        Root mean square of the claimed standard deviation there, that of the color's scale included.
    truth_std : float
        Sampling noise of the true alpha.
    covered : float
        Part of the true alpha that lies where the answer sums its own.
    shown_rmse, shown_bias, color_degrees : float
        `alpha_rmse`, `alpha_sum_bias` and `color_degrees` of `blurmatte.scenes.Score`: of what is
        shown, which is nothing where alpha is not known.
    false_alpha : float
        Root mean square of what is shown where nothing ever was.
    sum_percent, sum_z : float or None
        Error of the sum of alpha over the known pixels of the answer's streak.
    alpha, light : Deviations or None
        z of all pixels of the known streak; of light, in all channels.
    color_z : tuple of float
        Of the mean color: two directions for a line of colors, one for a plane.
    iou : float or None
        Trajectory intersection over union, of round objects.
    path_z : tuple of float
        Of the mean position on the path, along the axes of its covariance.
    radius_percent, radius_z : float or None
    """

    alpha_rmse: float | None
    claimed: float | None
    truth_std: float
    covered: float
    shown_rmse: float
    shown_bias: float
    false_alpha: float
    color_degrees: float | None
    sum_percent: float | None = None
    sum_z: float | None = None
    alpha: Deviations | None = None
    light: Deviations | None = None
    color_z: tuple[float, ...] = ()
    iou: float | None = None
    path_z: tuple[float, ...] = ()
    radius_percent: float | None = None
    radius_z: float | None = None

    @property
    def ratio(self) -> float | None:
        """Error over claim, root mean squares; None where nothing is claimed."""
        if self.alpha_rmse is None or self.claimed is None:
            return None
        return self.alpha_rmse / max(float(np.hypot(self.claimed, self.truth_std)), 1e-12)

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> "Errors":
        """The inverse of `dataclasses.asdict`, after a journey through JSON."""
        tuples = {name: tuple(fields[name]) for name in ("color_z", "path_z")}
        deviations = {
            name: Deviations(**{**fields[name], "counts": tuple(fields[name]["counts"])})
            for name in ("alpha", "light")
            if fields[name] is not None
        }
        return cls(**{**fields, **tuples, **deviations})


def errors_of(
    answer: Solution | Layer, truth: Truth, layers: tuple[Layer, ...], facts: Facts
) -> Errors:
    """Compare an answer with the truth.

    Parameters
    ----------
    answer : Solution or Layer
        With or without claims of its own errors.
    truth : Truth
    layers : tuple of Layer
        Those that are right: of all that moved, or of one of two objects; the nearest counts.
    facts : Facts
    """
    streak = truth.layer.alpha > MIN_ALPHA
    solution = answer if isinstance(answer, Solution) else None
    shown = answer if isinstance(answer, Layer) else answer.layer
    known = streak if solution is None else streak & solution.known
    summed = shown.alpha > 0 if solution is None else solution.streak & solution.known
    near = min(layers, key=lambda layer: _rms((answer.alpha - layer.alpha)[known]) or 0.0)
    scored = score(ProgramAnswer(shown), replace(truth, layer=near))
    errors = Errors(
        alpha_rmse=_rms((answer.alpha - near.alpha)[known]),
        claimed=None,
        truth_std=facts.alpha_std,
        covered=float(near.alpha[summed].sum() / near.alpha.sum()),
        shown_rmse=scored.alpha_rmse,
        shown_bias=scored.alpha_sum_bias,
        false_alpha=false_alpha(shown.alpha, truth.layer.alpha),
        color_degrees=scored.color_degrees,
    )
    if solution is None:
        return errors
    errors = _with_claims(errors, solution, near, known, facts)
    if solution.sweep is None or not facts.round:
        return errors
    return _with_motion(errors, solution.sweep, truth)


def combined_std(solution: Solution) -> Floats:
    """(H, W) claimed standard deviation of alpha, that of the color's scale included."""
    scale = solution.stats.alpha_scale_std
    return np.asarray(np.hypot(solution.alpha_std, scale * solution.alpha))


def _with_claims(
    errors: Errors, solution: Solution, near: Layer, known: Bools, facts: Facts
) -> Errors:
    """With what compares alpha, its sum, light and color to their claims."""
    std, stats, summed = combined_std(solution), solution.stats, solution.streak & solution.known
    claims = (
        stats.sum_alpha_std,
        facts.alpha_std * np.sqrt(np.count_nonzero(summed)),
    )
    true_sum = float(near.alpha[summed].sum(dtype=float))
    sum_error, sum_std = stats.sum_alpha - true_sum, float(np.linalg.norm(claims))
    light_error = (solution.premultiplied - near.premultiplied)[known]
    return replace(
        errors,
        claimed=_rms(std[known]),
        sum_percent=100 * sum_error / true_sum if true_sum > 0 else None,
        sum_z=sum_error / sum_std if sum_std > 0 else None,
        alpha=_deviations((solution.alpha - near.alpha)[known], std[known], facts.alpha_std),
        light=_deviations(light_error, solution.premultiplied_std[known], facts.light_std),
        color_z=_color_z(solution.model, near.color),
    )


def _with_motion(errors: Errors, sweep: Sweep, truth: Truth) -> Errors:
    """With the errors of path and radius of a disc."""
    t = np.linspace(0, 1, _PATH_TIMES)
    xy, D = sweep.family.at(sweep.path, t)
    by_parameters, n = D.mean(axis=0), len(sweep.path)
    variances, axes = np.linalg.eigh(by_parameters @ sweep.covariance[:n, :n] @ by_parameters.T)
    offset = axes.T @ (xy.mean(axis=0) - truth.trajectory.at(t).mean(axis=0))
    wider = sweep.radius - truth.radius
    return replace(
        errors,
        iou=trajectory_iou(sweep.trajectory, truth.trajectory, truth.radius),
        path_z=_finite_z(offset, np.sqrt(np.maximum(variances, 0))),
        radius_percent=100 * wider / truth.radius,
        radius_z=next(iter(_finite_z(wider, sweep.radius_std)), None),
    )


def _color_z(model: ColorModel, color: Array) -> tuple[float, ...]:
    """Z of the directions in which a color leaves a line or a plane; none if all colors are in it."""
    if model.rank == 3 or not color.any():
        return ()
    if model.rank == 1:
        return _finite_z(*direction_errors(model, color))
    direction = color / np.linalg.norm(color)
    variance = float(direction @ model.covariance @ direction)
    return _finite_z(model.pole @ direction, np.sqrt(max(variance, 0.0)))


def _deviations(error: Floats, std: Floats, truth_std: float) -> Deviations | None:
    """Those of errors with finite claims above 0."""
    return Deviations.of(np.array(_finite_z(error, np.where(std > 0, np.hypot(std, truth_std), 0))))


def _finite_z(error: npt.ArrayLike, std: npt.ArrayLike) -> tuple[float, ...]:
    """Z of those whose standard deviation is finite and above 0."""
    x, s = np.asarray(error, float).ravel(), np.asarray(std, float).ravel()
    usable = np.isfinite(s) & (s > 0)
    return tuple((x[usable] / s[usable]).tolist())


def _rms(values: Floats) -> float | None:
    """Root mean square; None of nothing."""
    return float(np.sqrt(np.mean(values.astype(float) ** 2))) if values.size else None

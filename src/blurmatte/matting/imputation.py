"""Solutions before a plate that is a guess: one before its mean, one before each of its draws.

Errors of a guess are correlated over many pixels, so the solution before the mean claims too little. By
the rules of multiple imputation [Rubin 1987] the variance of any quantity q is

    Var q = V₀ + m / (m − 2) · Σ (q_k − q₀)² / m,    k = 1 … m,

with V₀ the variance before the mean, and the variance of Student's t of m degrees of freedom for the
few draws. The answer is that before the mean, from which draws differ by the error of a draw.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.background import PlateGuess
from blurmatte.checks import Array
from blurmatte.errors import BlurmatteError, PlateError
from blurmatte.matting.averaging import AlphaEstimate, with_bounded_errors
from blurmatte.matting.calibration import grade_of, on_streak
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SolutionStats, SweepSummary
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.sweep import Sweep

SolveBefore = Callable[[LinearImage], Solution]


@dataclass(frozen=True)
class QuickSolver:
    """A quick solver before the draws of a guess; its solutions may be of cells."""

    solve: SolveBefore
    size: FittingSize | None = None

    def in_pixels(self, values: Array) -> Array:
        """A map of one of the solutions in the picture."""
        return values if self.size is None else self.size.in_picture(values)

    def sweep(self, sweep: Sweep | None) -> Sweep | None:
        """The sweep of one of the solutions in the picture."""
        size = self.size
        if sweep is None or size is None:
            return sweep
        return sweep.enlarged(size.cell, size.origin, size.size)

    @property
    def area(self) -> int:
        """Of the pixels of the solutions, pixels of the picture."""
        return 1 if self.size is None else self.size.cell**2


def solve_before_guess(
    guess: PlateGuess, solve: SolveBefore, again: Callable[[Solution], QuickSolver]
) -> Solution:
    """The solution before the mean of a guess, with the errors that its draws show.

    again: a quick solver that starts from a solution; its answer before the mean is the one from which
        those before the draws differ.

    Raises PlateError if no solution is found before half of the draws.
    """
    plate, *draws = guess.plates
    found = solve(plate)
    drawn = again(found)
    return _with_scatter(found, _quick_solutions([plate, *draws], drawn.solve), drawn)


def _quick_solutions(plates: Sequence[LinearImage], solve: SolveBefore) -> list[Solution]:
    """The solutions before plates, without those that cannot be solved."""
    first, *rest = plates
    found = [solve(first)]
    for plate in rest:
        try:
            found.append(solve(plate))
        except BlurmatteError:
            continue
    if 2 * len(found) < len(plates):
        raise PlateError(
            "the scene behind the object cannot be guessed from its rough surroundings well enough to "
            "separate the two; photograph it without the object (--plate FILE)"
        )
    return found


def _with_scatter(found: Solution, every: Sequence[Solution], drawn: QuickSolver) -> Solution:
    """A solution with its variance and that of others about the first; alpha is a fraction."""
    alphas = [np.clip(np.asarray(one.alpha, float), 0, 1) for one in every]
    lights = [np.asarray(one.premultiplied, float) for one in every]
    sums = [np.asarray(drawn.area * (one.stats.sum_alpha or 0.0)) for one in every]
    variance = drawn.in_pixels(_variance(alphas))
    of_light = drawn.in_pixels(_variance(lights))
    use = on_streak(found.alpha, found.alpha_std) & found.known
    by_plate = float(np.sqrt(variance[use].mean())) if use.any() else 0.0
    estimate = with_bounded_errors(
        AlphaEstimate(
            np.where(found.known, found.alpha, np.nan),
            np.hypot(found.alpha_std, np.sqrt(variance)),
            float(np.sqrt(_variance(sums))),
        )
    )
    stats = _graded(found.stats, by_plate, estimate.sum_std)
    own = found.stats.alpha_error or by_plate
    factor = float(np.hypot(own, by_plate) / own) if own > 0 else 1.0
    model = replace(found.model, covariance=factor**2 * found.model.covariance)
    sweep = found.sweep
    if sweep is not None:
        sweep = _swept(sweep, [drawn.sweep(one.sweep) for one in every], factor)
        if stats.sweep is not None:
            stats = replace(stats, sweep=SweepSummary.of(sweep))
    return replace(
        found,
        alpha_std=np.asarray(estimate.alpha_std, found.alpha_std.dtype),
        premultiplied_std=np.asarray(
            np.hypot(found.premultiplied_std, np.sqrt(of_light)),
            found.premultiplied_std.dtype,
        ),
        model=model,
        stats=stats,
        sweep=sweep,
    )


def _variance(values: Sequence[Array]) -> Array:
    """Of the first of several arrays by the scatter of the others about it."""
    first, *others = values
    square = np.mean([(one - first) ** 2 for one in others], axis=0)
    m = len(others)
    return np.asarray(m / max(m - 2, 1) * np.where(np.isfinite(square), square, 0))


def _graded(stats: SolutionStats, by_plate: float, sum_by_plate: float) -> SolutionStats:
    """Statistics with the errors by the plate; the grade is plausible at best."""
    total = max(stats.sum_alpha or 0.0, 1e-9)
    error = float(np.hypot(stats.alpha_error or 0.0, by_plate))
    sum_std = float(np.hypot(stats.sum_alpha_std or 0.0, sum_by_plate))
    scale_std = float(np.hypot(stats.alpha_scale_std or 0.0, sum_by_plate / total))
    grades = stats.grade or Grade.ASSUMED, Grade.PLAUSIBLE, grade_of(error, sum_std / total)
    return replace(
        stats,
        match=None,  # image and guess are one picture where nothing is hidden
        alpha_error=error,
        sum_alpha_std=sum_std,
        alpha_scale_std=scale_std,
        grade=min(grades),
        grade_reasons=("plate", *stats.grade_reasons),
    )


def _swept(sweep: Sweep, fits: Sequence[Sweep | None], factor: float) -> Sweep:
    """A sweep with the scatter of fits of its kind, about the first of them, in its covariance.

    Fits of another kind have no common parameters: then errors grow by the factor of those of alpha.
    """
    kinds = {(one.family, type(one.silhouette), len(one.shape)) for one in (sweep, *fits) if one}
    if None in fits or len(kinds) > 1:
        return replace(sweep, covariance=factor**2 * sweep.covariance)
    about, *others = (np.concatenate([one.path, one.shape]) for one in fits if one)
    d, m = np.array(others) - about, len(others)
    return replace(sweep, covariance=sweep.covariance + d.T @ d / max(m - 2, 1))

"""A fitted shape and path in words, and how well they explain the streak."""

from collections.abc import Sequence

import numpy as np

from blurmatte.explain.numbers import rounded_std, with_article, with_error
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SweepSummary

_MIN_BLUR_PX = 1.0  # of the rim; less is not visible
_MAX_KNOWN_STD = 0.1  # of a part of the exposure that is worth a number


def likeliest_shape(solution: Solution) -> SweepSummary | None:
    """The fitted shape on a path, unless alpha without a shape has a larger weight."""
    return solution.stats.sweep if solution.stats.has_shape else None


def sweep_in_words(solution: Solution) -> list[str]:
    """The likeliest shape on a path, and whether it explains the streak; none if none was fitted."""
    sweep = solution.stats.sweep
    if sweep is None:
        return []
    if likeliest_shape(solution) is None:
        return _outweighed(sweep, solution.stats.weights or (0.0,))
    said = [*_explained(sweep, solution), *_presence(sweep, solution.stats.grade_reasons)]
    if sweep.softness >= _MIN_BLUR_PX:
        said.append(
            f"The lens blurs its rim by {sweep.softness:.1f} px: it was not in focus as the plate is."
        )
    if sweep.shadow is not None:
        away = float(np.hypot(*sweep.shadow.offset))
        taken = f"{100 * float(np.mean(sweep.shadow.strength)):.0f} %"
        said.append(
            f"Its shadow, {away:.0f} px from it, takes {taken} of the light behind; it is not in alpha."
        )
    return said


def _presence(sweep: SweepSummary, reasons: Sequence[str]) -> list[str]:
    """For how much of the exposure an object was there, unless certainly for all of it."""
    opacity, std = sweep.opacity, sweep.opacity_std
    if opacity == 1 and "duration" in reasons:
        return [
            "It is assumed to have been there for all of the exposure. On a path shorter than itself "
            "it may have been there for a part only; alpha is then smaller by that factor. A plate "
            "with texture or a given color would decide."
        ]
    if opacity == 1:
        return []
    fraction = with_error(opacity, std)
    if std > _MAX_KNOWN_STD:
        return [
            "It was at rest, and too little of the plate's texture shows through it to determine the "
            f"part of the exposure during which it was there ({fraction}): give its color."
        ]
    return [
        f"It was there for {fraction} of the exposure, or hides that part of the light behind it."
    ]


def _outweighed(sweep: SweepSummary, weights: Sequence[float]) -> list[str]:
    """The case in which alpha without a shape has a larger weight."""
    shape = _shape_on_path(sweep)
    return [
        f"Alpha without a shape explains the streak better: its weight is {max(weights):.2f}. "
        f"The likeliest shape has {weights[0]:.1g}: {shape[0].lower()}{shape[1:]}."
    ]


def _explained(sweep: SweepSummary, solution: Solution) -> list[str]:
    """How well the shape explains the streak."""
    shape = _shape_on_path(sweep)
    if solution.sweep is not None and solution.sweep.rejection:
        return [f"{shape} explains the streak only in part: the fit {solution.sweep.rejection}."]
    excess = sweep.diagnostics.residual_excess
    said = [
        f"{shape} explains the streak; residuals in it are correlated {excess:.2g} times as much as "
        "noise."
    ]
    if solution.model.rank == 3:
        said.append("Of any colors, shape and motion alone determine alpha.")
    return said


def _shape_on_path(sweep: SweepSummary) -> str:
    said = with_article(sweep.silhouette)
    of = "of radius" if sweep.is_disc else "with the area of a disc of radius"
    radius = f"{sweep.radius:.2f} ± {rounded_std(sweep.radius_std)} px"
    path = f"{sweep.path_in_words} of {sweep.length:.0f} px"
    return f"{said[0].upper()}{said[1:]} {of} {radius} on {path}"

"""A fitted shape and path in words, and how well they explain the streak."""

from collections.abc import Sequence

import numpy as np

from blurmatte.explain.numbers import rounded_std, with_article, with_error
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SweepSummary

_MIN_BLUR_PX = 1.0  # of the rim; less is not visible
_MAX_KNOWN_STD = 0.1  # of an opacity that is worth a number


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
    said = [*_explained(sweep, solution), *_opacity(sweep, solution.stats.grade_reasons)]
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


def _opacity(sweep: SweepSummary, reasons: Sequence[str]) -> list[str]:
    """How much of the light behind it an object hides, unless certainly all of it."""
    opacity, known = sweep.opacity, with_error(sweep.opacity, sweep.opacity_std)
    decide = "A plate with texture or a given color would decide."
    if opacity == 0:
        return [
            f"It only adds light (opacity {known}): alpha of its layer is 0, and the light is added to "
            "what is behind."
        ]
    if opacity == 1 and "opacity" in reasons:
        return [
            f"It is taken for solid (opacity {known}). If it lets light through, or was there for a "
            f"part of the exposure only, alpha is smaller by that factor. {decide}"
        ]
    if opacity == 1:
        return []
    if sweep.opacity_std > _MAX_KNOWN_STD:
        return [
            f"Which part of the light behind it it hides is uncertain ({known}), or for which part of "
            f"the exposure it was there. {decide}"
        ]
    return [f"It hides {known} of the light behind it, or was there for that part of the exposure."]


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

"""A fitted shape and path in words, and how well they explain the streak."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from blurmatte.explain.numbers import rounded_std, with_error
from blurmatte.matting.solution import Solution

_MIN_BLUR_PX = 1.0  # of the rim; less is not visible
_MAX_KNOWN_STD = 0.1  # of a part of the exposure that is worth a number
_PATHS = {"line": "a straight line", "arc": "an arc", "bounce": "a path that bounces"}
_VERBS = {"turning": "turns", "changing": "changes"}  # of silhouettes, by their names


def shape_is_likeliest(solution: Solution) -> bool:
    """True if a shape on a path was fitted and no alpha without a shape has a larger weight."""
    return "sweep" in solution.stats and not solution.solver.startswith("Smooth")


def sweep_in_words(solution: Solution) -> list[str]:
    """The likeliest shape on a path, and whether it explains the streak; none if none was fitted."""
    sweep = solution.stats.get("sweep")
    if sweep is None:
        return []
    if not shape_is_likeliest(solution):
        return _outweighed(sweep, solution.stats["weights"])
    said, softness, shadow = (
        _explained(sweep, solution),
        sweep.get("softness", 0),
        sweep.get("shadow"),
    )
    said += _presence(sweep)
    if softness >= _MIN_BLUR_PX:
        said.append(
            f"The lens blurs its rim by {softness:.1f} px: it was not in focus as the plate is."
        )
    if shadow is not None:
        away = float(np.hypot(*shadow["offset"]))
        taken = f"{100 * float(np.mean(shadow['strength'])):.0f} %"
        said.append(
            f"Its shadow, {away:.0f} px from it, takes {taken} of the light behind; it is not in alpha."
        )
    return said


def _presence(sweep: Mapping[str, Any]) -> list[str]:
    """For how much of the exposure an object at rest was there, unless for all of it."""
    opacity, std = sweep.get("opacity", 1.0), sweep.get("opacity_std", 0.0)
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


def _outweighed(sweep: Mapping[str, Any], weights: Sequence[float]) -> list[str]:
    """The case in which alpha without a shape has a larger weight."""
    shape = _shape_on_path(sweep)
    return [
        f"Alpha without a shape explains the streak better: its weight is {max(weights):.2f}. "
        f"The likeliest shape has {weights[0]:.1g}: {shape[0].lower()}{shape[1:]}."
    ]


def _explained(sweep: Mapping[str, Any], solution: Solution) -> list[str]:
    """How well the shape explains the streak."""
    shape = _shape_on_path(sweep)
    if solution.sweep is not None and solution.sweep.rejection:
        return [f"{shape} explains the streak only in part: the fit {solution.sweep.rejection}."]
    excess = sweep["diagnostics"]["residual_excess"]
    said = [
        f"{shape} explains the streak; residuals in it are correlated {excess:.2g} times as much as "
        "noise."
    ]
    if solution.model.rank == 3:
        said.append("Of any colors, shape and motion alone determine alpha.")
    return said


def _shape_on_path(sweep: Mapping[str, Any]) -> str:
    radius = f"{sweep['radius']:.2f} ± {rounded_std(sweep['radius_std'])} px"
    path = _PATHS.get(sweep["path"], "a curved path")
    return f"{_shape(sweep['silhouette'], radius)} on {path} of {sweep['length']:.0f} px"


def _shape(silhouette: str, radius: str) -> str:
    if silhouette == "disc":
        return f"A disc of radius {radius}"
    if silhouette == "growing disc":
        return f"A disc whose size changes, of radius {radius} in the middle of the exposure,"
    kind = "An ellipse" if silhouette.endswith("ellipse") else "A shape"
    does = " and ".join(verb for name, verb in _VERBS.items() if name in silhouette)
    return f"{kind}{' that ' * bool(does)}{does} with the area of a disc of radius {radius}"

"""What went where, as the shape of a streak told it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.explain.numbers import rounded_std
from blurmatte.matting import Solution

_SEEN = 1.0  # pixels: a rim that is softer is seen to be


def sweep_in_words(solution: Solution) -> list[str]:
    """What went where, if the shape of the streak told it."""
    sweep = solution.stats.get("sweep")
    if sweep is None:
        return []
    way = {"line": "a straight line", "arc": "an arc", "bounce": "a path that bounces"}
    kind = way.get(sweep["path"], "a curved path")
    radius = f"{sweep['radius']:.2f} ± {rounded_std(sweep['radius_std'])} px"
    return [
        f"{_shape(sweep['silhouette'], radius)} on {kind} of {sweep['length']:.0f} px explains the "
        f"streak; {_left(sweep, solution.model)}.",
        *_softness(sweep.get("softness", 0)),
        *_shadow(sweep.get("shadow")),
        *_highlight(sweep.get("highlight")),
    ]


def _softness(softness: float) -> list[str]:
    if softness < _SEEN:
        return []
    return [f"The lens blurs its rim by {softness:.1f} px: it was not in focus as the plate is."]


def _highlight(highlight: Mapping[str, Any] | None) -> list[str]:
    if highlight is None:
        return []
    away = float(np.hypot(*highlight["offset"]))
    return [
        f"Of one paint, {highlight['paint']}, with a highlight {away:.0f} px from its middle: colors "
        "are those of both."
    ]


def _shadow(shadow: Mapping[str, Any] | None) -> list[str]:
    if shadow is None:
        return []
    away = float(np.hypot(*shadow["offset"]))
    taken = f"{100 * float(np.mean(shadow['strength'])):.0f} %"
    return [
        f"Its shadow, {away:.0f} px from it, takes {taken} of the light behind; it is not in alpha."
    ]


def _left(sweep: Mapping[str, Any], model: ColorModel) -> str:
    """How well a sweep explains the streak; of any colors, whether the plate's texture says so, too."""
    texture = sweep["texture"]
    if texture is not None:
        return f"the plate's texture in it confirms alpha to {rounded_std(100 * texture)} %"
    left = f"what is left is {sweep['misfit']:.2g} times what noise leaves"
    if model.rank < 3:
        return left
    return f"{left}. No texture of the plate confirms alpha: shape and motion alone tell it"


def _shape(silhouette: str, radius: str) -> str:
    if silhouette == "disc":
        return f"A disc of radius {radius}"
    kind = "An ellipse" if silhouette.endswith("ellipse") else "A shape"
    turning = " that turns" if silhouette.startswith("turning") else ""
    return f"{kind}{turning} with the area of a disc of radius {radius}"

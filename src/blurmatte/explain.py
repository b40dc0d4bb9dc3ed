"""What a color model or a solution says, in plain words."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.matting import Quality, Solution
from blurmatte.radiometry import NoiseModel

_MEDIUM_LIGHT = np.full(3, 0.2)
_OPEN = 30.0  # degrees: evidence that leaves more than this tells nothing worth a number
_EVIDENCE = {
    "hue variation": "the hues of the plate behind the streak",
    "feasibility": "alpha between 0 and 1, and no negative light,",
    "samples": "the scatter of the sampled colors",
}
_AGAINST = {
    Quality.SATURATED: "clipped",
    Quality.PLATE_IN_MODEL: "plate of the object's color",
    Quality.OUT_OF_RANGE: "alpha out of range",
    Quality.MISFIT: "not explained by the color model",
}


def explain(thing: ColorModel | Solution) -> list[str]:
    """Sentences about a color model or a solution, for people who do not know the words.

    Parameters
    ----------
    thing : ColorModel or Solution

    Returns
    -------
    list of str
        One sentence each.

    Raises
    ------
    TypeError
        For anything else.
    """
    if isinstance(thing, ColorModel):
        return [_directions(thing), *_evidence(thing)]
    if isinstance(thing, Solution):
        peak = f"Alpha up to {alpha_peak(thing):.2f}."
        return [peak, *_area(thing), *_noise(thing.stats), *_flags(thing), *_others(thing.stats)]
    raise TypeError(f"can explain a ColorModel or a Solution, got {type(thing).__name__}")


def alpha_peak(solution: Solution) -> float:
    """How far alpha goes up where it is known, but for the topmost half percent; 0 if nowhere."""
    alpha = solution.alpha[solution.streak & solution.known]
    return max(float(np.percentile(alpha, 99.5)), 0.0) if alpha.size else 0.0


def _directions(model: ColorModel) -> str:
    told = " and ".join(
        f"({', '.join(f'{x:.3f}' for x in color)})" for color in np.round(model.rgb, 3) + 0.0
    )
    if model.rank == 1:
        return f"One paint and its shades: all multiples of the linear RGB color {told}."
    return f"Two paints and their mixtures: a plane of colors between linear RGB {told}."


def _evidence(model: ColorModel) -> list[str]:
    if not model.evidence:
        return ["The color was given, not measured."]
    sentences = []
    for name, std in model.evidence.items():
        source = _EVIDENCE.get(name, name)
        told = f"to {std:.2g}°" if std < _OPEN else "nothing"
        sentences.append(f"From {source} alone: {told}.")
    return sentences


def _area(solution: Solution) -> list[str]:
    total = solution.stats.get("sum_alpha")
    if total is None:
        return []
    std = math.hypot(
        solution.stats.get("sum_alpha_std", 0), total * solution.stats.get("alpha_scale_std", 0)
    )
    sure = "" if solution.model.evidence else ", if the given color is right"
    said = f"Sum of alpha {total:.0f} ± {_rounded_std(std)}{sure}: "
    if total > 3 * std:
        radius = math.sqrt(total / math.pi)
        error = _rounded_std(std / (2 * math.pi * radius))
        said += "the area of the silhouette in pixels, whatever the motion; "
        said += f"of a disc, the radius would be {radius:.1f} ± {error}."
    else:
        said += "no more than nothing. The color or the region must be wrong."
    sentences = [said]
    unknown = solution.stats.get("pixels", 0) - solution.stats.get("pixels_known", 0)
    if unknown:
        sentences.append(f"{unknown} pixels of the streak are unknown and not in the sum.")
    if _touches_border(solution):
        sentences.append("The streak touches the border; the sum lacks what lies beyond.")
    return sentences


def _rounded_std(std: float) -> str:
    return f"{std:.0f}" if std >= 1 else f"{std:.1g}"


def _touches_border(solution: Solution) -> bool:
    x0, y0, x1, y1 = solution.stats.get("streak_box", (1, 1, 1, 1))
    width, height = solution.size
    return bool(min(x0, y0) == 0 or x1 == width or y1 == height)


def _noise(stats: Mapping[str, Any]) -> list[str]:
    spoken = [
        f"{_noise_std(stats[f'{name}_noise']):.2g} in the {name}"
        for name in ("image", "plate")
        if f"{name}_noise" in stats
    ]
    return [f"Noise (std, white is 1): {', '.join(spoken)}."] if spoken else []


def _noise_std(fields: Mapping[str, Any]) -> float:
    if "median_std" in fields:
        return float(fields["median_std"])
    return float(np.sqrt(NoiseModel(**fields).variance(_MEDIUM_LIGHT).mean()))


def _flags(solution: Solution) -> list[str]:
    inside = solution.quality[solution.streak]
    shares = (
        {flag: float(np.mean((inside & flag) != 0)) for flag in _AGAINST} if inside.size else {}
    )
    said = [f"{_AGAINST[flag]} {share:.1%}" for flag, share in shares.items() if share >= 0.0005]
    if not said:
        return ["Nothing is known against the streak's pixels."]
    return [f"Flagged in the streak: {', '.join(said)}."]


def _others(stats: Mapping[str, Any]) -> list[str]:
    count = len(stats.get("other_boxes", ()))
    if count == 0:
        return []
    return [f"{count} other {'thing' if count == 1 else 'things'} moved; choose one with a region."]

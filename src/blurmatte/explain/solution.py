"""A solution in words: its explanation, the sum of alpha, and the evidence against it.

An assumed layer may be usable over its own plate. There alpha and light have the same error: more
alpha with a color nearer to the plate's gives the same picture. So a layer whose alpha is off by a
factor gives back the image, and what it leaves of the image is its measure.
"""

import math
from collections.abc import Iterator

import numpy as np

from blurmatte.background import PlateGuess
from blurmatte.color.model import ColorModel
from blurmatte.explain.grade import (
    alpha_peak,
    alternatives_in_words,
    doubts,
    grade_in_words,
    sweep_in_words,
)
from blurmatte.explain.numbers import rounded_std, with_error
from blurmatte.matting.maps import Grade, Quality
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import MatchSummary
from blurmatte.radiometry import LinearImage

_MEDIUM_LIGHT = np.full(3, 0.2)  # of white, of which the noise is stated
_AGAINST = {
    Quality.SATURATED: "clipped",
    Quality.PLATE_IN_MODEL: "plate of the object's color",
    Quality.OUT_OF_RANGE: "alpha out of range",
    Quality.MISFIT: "not explained by the color model",
    Quality.SHADOW: "only darker, a shadow or something black",
    Quality.OCCLUDED: "behind something still",
}
_MAX_UNEXPLAINED = 0.1  # part of the mean square change of the light
_MAX_RESIDUAL_STD = 3.0  # root mean square over the streak, in standard deviations of the noise


def solution_in_words(solution: Solution) -> Iterator[str]:
    """Sentences: the grade, alternatives, warnings, then everything else."""
    stats = solution.stats
    yield from (f"{line}." for line in grade_in_words(solution))
    yield from (f"{line[0].upper()}{line[1:]}." for line in alternatives_in_words(solution))
    yield from doubts(solution)
    if not stats.only_adds_light:
        yield f"Alpha up to {alpha_peak(solution):.2f}."
    yield from sweep_in_words(solution)
    if stats.smooth is not None:
        what = "change little" if stats.smooth.order == 1 else "bend little"
        settled = "" if stats.smooth.converged else " It had not settled yet: take a little care."
        yield f"All pixels were solved together, as alpha seems to {what} but for edges.{settled}"
    if stats.only_adds_light:
        yield _light(solution)
    elif stats.sum_alpha is not None:
        yield from _area(solution, stats.sum_alpha)
    if stats.match is not None:
        yield _match(stats.match)
    said = [
        f"{np.sqrt(noise.variance(_MEDIUM_LIGHT).mean()):.2g} in the {name}"
        for name, noise in (("image", stats.image_noise), ("plate", stats.plate_noise))
        if noise is not None
    ]
    if said:
        yield f"Noise (std, white is 1): {', '.join(said)}."
    yield _flags(solution)
    if count := len(stats.other_boxes):
        yield f"{count} other {'thing' if count == 1 else 'things'} moved; choose one with a region."


def _area(solution: Solution, total: float) -> Iterator[str]:
    """The sum of alpha, and what it lacks."""
    stats = solution.stats
    std = stats.sum_alpha_std or 0.0
    said = f"Sum of alpha {total:.0f} ± {rounded_std(std)}{_condition(solution.model)}"
    opacity = 1.0 if stats.sweep is None else stats.sweep.opacity
    if total > 3 * std and opacity == 1 and not _touches_border(solution):
        radius = math.sqrt(total / math.pi)
        error = rounded_std(std / (2 * math.pi * radius))
        said += ": the area of the silhouette in pixels, whatever the motion; "
        said += f"of a disc, the radius would be {radius:.1f} ± {error}"
    yield said + "."
    unknown = (stats.pixels or 0) - (stats.pixels_known or 0)
    if unknown:
        yield f"{unknown} pixels of the streak are unknown and not in the sum."
    if _touches_border(solution):
        yield "The streak touches the border; the sum lacks what lies beyond."


def _light(solution: Solution) -> str:
    """The sum of the light that was added."""
    inside = solution.streak
    total = solution.premultiplied[inside].sum(axis=0, dtype=float)
    std = np.sqrt((solution.premultiplied_std[inside].astype(float) ** 2).sum(axis=0))
    each = ", ".join(with_error(*pair) for pair in zip(total, std, strict=True))
    return f"Its light adds up to {each} (R, G, B; a white pixel is 1)."


def _condition(model: ColorModel) -> str:
    """Assumption of the sum of alpha, apart from the noise."""
    if not model.evidence and model.rank < 3:
        return ", if the given color is right"
    if set(model.evidence) == {"samples"}:
        return ", if the sampled pixels show nothing but the object"
    return ""


def _touches_border(solution: Solution) -> bool:
    x0, y0, x1, y1 = solution.stats.streak_box or (1, 1, 1, 1)
    width, height = solution.size
    return bool(min(x0, y0) == 0 or x1 == width or y1 == height)


def _match(match: MatchSummary) -> str:
    """The correction of the plate to match the image, and their agreement."""
    what = f"The plate was matched to the image: {match.in_words}"
    if match.is_unchanged:
        what = "The plate was used as it is"
    return (
        f"{what}; where nothing moved, they agree to {match.agreement:.2g} times their noise, at "
        f"edges to {match.edge_agreement:.2g}."
    )


def _flags(solution: Solution) -> str:
    inside = solution.quality[solution.streak]
    shares = (
        {flag: float(np.mean((inside & flag) != 0)) for flag in _AGAINST} if inside.size else {}
    )
    said = [f"{_AGAINST[flag]} {share:.1%}" for flag, share in shares.items() if share >= 0.0005]
    if not said:
        return "Nothing is known against the streak's pixels."
    return f"Flagged in the streak: {', '.join(said)}."


def usable_all_the_same(image: LinearImage, plate: LinearImage, solution: Solution) -> list[str]:
    """That an assumed layer gives back the image over its plate; one line, or none if it does not.

    image, plate: what was solved, of the size of the solution.
    """
    if solution.stats.grade is not Grade.ASSUMED:
        return []
    if solution.stats.may_be_shadow or isinstance(plate, PlateGuess):
        return []  # before a guess, an opaque object of any form gives back the image
    if not _gives_back(image, plate, solution):
        return []
    elsewhere = "; over another background alpha may be off by that factor"
    return [
        "over the same plate the layer gives back the picture, so that edits there and `remove` are "
        f"usable all the same{'' if solution.stats.only_adds_light else elsewhere}"
    ]


def _gives_back(image: LinearImage, plate: LinearImage, solution: Solution) -> bool:
    """Whether layer over plate differs from the image by little more than noise, and little at all."""
    inside = solution.streak & image.valid & plate.valid
    if not inside.any():
        return False
    image, plate, layer = image.in_srgb(), plate.in_srgb(), solution.layer
    C, B = image.rgb[inside], plate.rgb[inside]
    given = layer.premultiplied[inside] + (1 - layer.alpha[inside])[:, None] * B
    square, change = (float(np.mean((one - C) ** 2, dtype=float)) for one in (given, B))
    pairs = (solution.stats.image_noise, C), (solution.stats.plate_noise, B)
    noise = sum(float(own.variance(light).mean()) for own, light in pairs if own is not None)
    return square <= min(_MAX_RESIDUAL_STD**2 * noise, _MAX_UNEXPLAINED * change)

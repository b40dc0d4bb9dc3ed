"""A solution in words: its grade and why, the fitted shape, other colors, warnings, and its numbers.

An assumed layer may be usable over its own plate. There alpha and light have the same error: more
alpha with a color nearer to the plate's gives the same picture. So a layer whose alpha is off by a
factor gives back the image, and what it leaves of the image is its measure.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools
from blurmatte.color.model import ColorModel
from blurmatte.explain.numbers import rounded_std, with_article, with_error
from blurmatte.matting.maps import Grade, Quality
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import MatchSummary, SolutionStats, SweepSummary
from blurmatte.matting.summary import Alternative
from blurmatte.radiometry import LinearImage, Transfer

_MOST_BOXES = 5  # that are named
_MIN_BLUR_PX = 1.0  # of the rim; less is not visible
_MAX_KNOWN_STD = 0.1  # of an opacity that is worth a number
_REASONS = {
    "region": "the fitted shape reaches beyond the region",
    "plate": "the plate is a guess from the surroundings of the region",
    "shadow": "only light was lost, so that it may be a shadow",
    "light": "constant light of the object is assumed",
    "solver": "the errors of this solver are not calibrated",
    "opacity": "whether it hides all of the light behind it, and was in the picture all the time, is "
    "uncertain (--opacity states it)",
    "gray": "without hues alpha follows from the shape alone",
    "convergence": "the fit of the likeliest shape did not converge",
    "time": "not all explanations were tried in the given time",
    "clip": "path and radius contradict the other frames, so that it was solved alone",
    "color": "the color is uncertain",
    "colors": "the colors of the object vary",
    "shape": "alpha with and without a shape on a path differ",
    "no shape": "no shape on a path explains the streak",
    "noise": "noise is large compared with what the object changes",
    "correlation": "residuals of neighboring pixels are correlated",
    "file": "compression hides noise",
    "size": "the radius is uncertain",
    "blur": "the blur of the rim is uncertain",
    "disagreement": "another hypothesis may be right",
}
_WITHOUT_NUMBERS = {
    Grade.CONFIRMED: "alpha is known well",
    Grade.PLAUSIBLE: "alpha is known less well",
    Grade.ASSUMED: "a color or a shape had to be assumed",
}
_ALL_SHADOW = (
    "Only light was lost: all of this may be a shadow, or an object that is black, or darker than the "
    "plate and of its hue; the picture does not show which. Alpha holds only if it is an object of "
    "the color that is named."
)
_ALL_SHADOW_IN_GRAY = (
    "Only light was lost: all of this may be a shadow, or an object that is darker than the plate; "
    "gray pictures do not show which. Alpha holds only if it is an object."
)
_CUT_BY_REGION = (
    "The fitted shape reaches beyond the region, which may cut the object: the guess then shows its "
    "rest, and alpha, its sum and the motion are not determined; mark all of it, with 8 pixels around."
)
_MIN_FLAGGED_FRACTION = 0.25  # of the streak's pixels, for a warning
_REMEDY = {
    Quality.SATURATED: "is clipped in the image or the plate and cannot be known; expose shorter",
    Quality.PLATE_IN_MODEL: "lies before a plate of the object's own colors: nothing can be known "
    "there; allow fewer colors, or take the pictures before another background",
    Quality.SHADOW: "is only darker than the plate: a shadow, or something black, which the picture "
    "does not separate; choose a region without it",
    Quality.MISFIT: "does not fit the color: pick the object's color where it is sharp or opaque, "
    "give two colors (rank 2), or choose a region that holds the object alone",
}


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
            f"The lens blurs its rim by {sweep.softness:.1f} px: it was not in focus as the scene is."
        )
    if sweep.shadow is not None:
        away = float(np.hypot(*sweep.shadow.offset))
        taken = f"{100 * float(np.mean(sweep.shadow.strength)):.0f} %"
        weight = f"{(solution.stats.weights or (1.0,))[0]:.2f}"
        whose = "Its shadow" if weight == "1.00" else f"With a probability of {weight} its shadow"
        said.append(
            f"{whose}, {away:.0f} px from it, takes {taken} of the light behind; it is not in alpha."
        )
    return said


def _opacity(sweep: SweepSummary, reasons: Sequence[str]) -> list[str]:
    """How much of the light behind it an object hides, unless certainly all of it."""
    opacity, known = sweep.opacity, with_error(sweep.opacity, sweep.opacity_std)
    decide = "A plate with texture or a given color would decide."
    if opacity == 0:
        of = f" (opacity {known})" if sweep.opacity_std <= _MAX_KNOWN_STD else ""
        return [
            f"It only adds light{of}: alpha of its layer is 0, and the light is added to what is "
            "behind."
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
    more = f"correlated {excess:.2g} times as much as" if excess > 1 else "no more correlated than"
    said = [f"{shape} explains the streak; residuals in it are {more} noise."]
    if solution.model.rank == 3:
        said.append("Of any colors, shape and motion alone determine alpha.")
    return said


def _shape_on_path(sweep: SweepSummary) -> str:
    said = with_article(sweep.silhouette)
    of = "of radius" if sweep.is_disc else "with the area of a disc of radius"
    radius = f"{sweep.radius:.2f} ± {rounded_std(sweep.radius_std)} px"
    path = f"{sweep.path_in_words} of {sweep.length:.0f} px"
    return f"{said[0].upper()}{said[1:]} {of} {radius} on {path}"


def grade_in_words(solution: Solution) -> list[str]:
    """The grade, the calibrated errors, and the reasons of a grade that is not the best.

    Sentences without a full stop; none if the solution has no grade, e.g. of an older file.
    """
    stats = solution.stats
    if stats.grade is None:
        return []
    grade, known = stats.grade, ", ".join(_errors(stats, stats.grade))
    names = () if grade is Grade.CONFIRMED else stats.grade_reasons
    reasons = ", and ".join(f"{_REASONS.get(name, name)}{_number(name, stats)}" for name in names)
    said = {
        Grade.CONFIRMED: [known],
        Grade.PLAUSIBLE: [known, reasons],
        Grade.ASSUMED: [reasons, known],
    }[grade]
    return [f"{grade}: {'; '.join(filter(None, said)) or _WITHOUT_NUMBERS[grade]}"]


def _number(name: str, stats: SolutionStats) -> str:
    """The number behind a reason, with a space before it; empty without the terms of the error."""
    terms, claim = stats.error_terms, stats.claimed_error
    if name == "time":
        return f" ({', '.join(stats.untried)})" if stats.untried else ""
    if terms is None or claim is None:
        return ""
    weights, sweep = sorted(stats.weights or (1.0,)), stats.sweep
    radius = math.expm1(terms.radius) if sweep is None else 100 * sweep.radius_std / sweep.radius
    numbers = {
        "noise": lambda: f" (error {claim:.2g})",
        "shape": lambda: f" (by {claim * math.expm1(terms.shapeless):.2g})",
        "color": lambda: f" (± {math.expm1(terms.color_angle):.2g}°)",
        "colors": lambda: f" (by {math.degrees(terms.color_spread):.2g}°)",
        "size": lambda: f" (± {radius:.2g} %)",
        "correlation": lambda: f" ({math.exp(terms.correlation):.2g} times the variance)",
        "disagreement": lambda: f" (weight {weights[-2]:.2g})" if len(weights) > 1 else "",
    }
    return numbers[name]() if name in numbers else ""


def _errors(stats: SolutionStats, grade: Grade) -> list[str]:
    """Errors of alpha and of its sum, one standard deviation each."""
    error, scale = stats.alpha_error, stats.alpha_scale_std
    of_sum, said = scale or 0.0, list[str]()
    if stats.sum_alpha and stats.sum_alpha_std is not None:
        of_sum = max(of_sum, abs(stats.sum_alpha_std / stats.sum_alpha))
    if stats.only_adds_light:
        within = "" if error is None else f", alpha 0 within {error:.2g}"
        return [f"it only adds light{within}"]
    if grade is Grade.ASSUMED and scale:
        said.append(f"alpha is known up to a factor of 1 ± {scale:.2g}")
    if error is not None:
        said.append(f"{'' if said else 'alpha '}within {error:.2g}")
    if 0 < of_sum < 1:
        said.append(f"its sum within {rounded_std(100 * of_sum)} %")
    return said


def alternatives_of(solution: Solution) -> list[Alternative]:
    """The hypotheses of `stats.alternatives`, the answer's own first, in the color of the answer.

    None if the grade is confirmed, or if none were compared.
    """
    if solution.stats.grade in (None, Grade.CONFIRMED):
        return []
    found = list(solution.stats.alternatives or ())
    if found and solution.model.color:
        found[0] = replace(found[0], hex=solution.model.color)
    return found


def alternatives_in_words(solution: Solution) -> list[str]:
    """Alternatives, and the interval of the common factor of alpha; both without a full stop."""
    return [*also_fits(solution), *factor_interval(solution)]


def also_fits(solution: Solution) -> list[str]:
    """Colors of the hypotheses whose alpha differs from the answer's; one line or none.

    Of gray pictures the factors of alpha alone.
    """
    others = [one for one in alternatives_of(solution)[1:] if one.disagrees]
    gray = solution.stats.is_gray
    parts = (
        ("also fits", [_with_alpha(one, gray) for one in others if one.matters]),
        ("fits less well", [_with_alpha(one, gray) for one in others if not one.matters]),
    )
    said = [f"{heading}: {'; '.join(those)}" for heading, those in parts if those]
    return ["; ".join(said)] if said else []


def also_moved(boxes: Sequence[Sequence[int]], insignificant: int) -> list[str]:
    """Boxes of what else moved, the strongest first, and how many may be noise; one line or none."""
    if not boxes:
        return []
    named = " ".join(map(as_region, boxes[:_MOST_BOXES]))
    more = f" and {len(boxes) - _MOST_BOXES} more" if len(boxes) > _MOST_BOXES else ""
    weak = f"; {insignificant} more may be noise or compression" if insignificant else ""
    return [f"also moved, choose with --region: {named}{more}{weak}"]


def as_region(box: Sequence[int]) -> str:
    """A box as a value of --region."""
    return ",".join(map(str, box))


def factor_interval(solution: Solution) -> list[str]:
    """The interval of a factor of all of alpha; one line or none.

    By one standard deviation of the calibrated error, and over the hypotheses.
    """
    found = alternatives_of(solution)
    std = solution.stats.alpha_scale_std or 0.0
    ends = [(max(1 - std, 0.0), 1 + std, "by one standard deviation")] if std > 0 else []
    if len(found) > 1:
        factors = [1.0, *(one.alpha_factor for one in found)]
        ends.append((min(factors), max(factors), "over the hypotheses"))
    if not (found and ends) or solution.stats.only_adds_light:
        return []
    low, high = min(low for low, _, _ in ends), max(high for _, high, _ in ends)
    each = ", ".join(f"{low:.2f} to {high:.2f} {by}" for low, high, by in ends)
    return [f"all of alpha may be {low:.2f} to {high:.2f} times as large: {each}"]


def _with_alpha(one: Alternative, gray: bool) -> str:
    if one.hides_nothing:
        return f"light that hides nothing, of alpha 0 ({one.name})"
    return f"{'' if gray else f'{one.hex} with '}alpha x {one.alpha_factor:.2f} ({one.name})"


def doubts(solution: Solution) -> list[str]:
    """Warnings that a large part of the answer is unknown or impossible.

    One sentence each, with a remedy; none for a sound solution.
    """
    inside = solution.quality[solution.streak]
    if not inside.size:
        return []
    if solution.stats.may_be_shadow:
        return [_ALL_SHADOW_IN_GRAY if solution.stats.is_gray else _ALL_SHADOW]
    unknown = ~solution.known[solution.streak]
    shares = {
        flag: float(np.mean(((inside & flag) != 0) & (unknown | (flag != Quality.SATURATED))))
        for flag in _REMEDY
    }
    shape = likeliest_shape(solution)
    if shape is not None and shape.shadow is not None:
        del shares[Quality.SHADOW]  # `sweep_in_words` describes the object's own
    said = [f"{share:.0%} of the streak {_REMEDY[flag]}." for flag, share in shares.items()
            if share > _MIN_FLAGGED_FRACTION]  # fmt: skip
    if solution.stats.leaves_region:
        return [_CUT_BY_REGION, *said]
    return _no_object(solution) or [*said, *_impossible(solution)]


def bent_light(used: Transfer, better: Transfer) -> str:
    """That pictures were decoded with a curve with which no disc of one color explains the streak."""
    return (
        f"light looks bent: with --transfer {better.name} a disc of one color explains the streak, "
        f"with {used.name} none does"
    )


def second_hue(part: float) -> str:
    """That one color leaves as large a part of the change of light as that of an object of two."""
    return (
        f"one color leaves {part:.0%} of the change of light: the object may have a second color, and "
        "alpha then lacks it; give both (--rank 2, --color twice), or allow any (--rank 3)"
    )


def _no_object(solution: Solution) -> list[str]:
    """A warning that there may be no object.

    A common factor of alpha that is open makes no object disappear, unless it may be 0.
    """
    stats = solution.stats
    total, std = stats.sum_alpha, stats.sum_alpha_std or 0.0
    if total is None or stats.only_adds_light:
        return []
    if total > max(std, 3 * solution.sum_std_without_factor):
        return []
    why = "what moved here may not have this color"
    remedy = "choose the object with a region"
    if not stats.is_gray:
        remedy += ", or give its own color"
    if "plate" in stats.grade_reasons:
        why = "the region may cut the object"  # then the guess shows its rest
        remedy = "mark all of it, closely, or photograph the scene without it (--plate FILE)"
    if stats.rough_guess is not None:
        error = f"± {stats.rough_guess:.2g} of white"
        why = f"the scene is too rough to guess the plate ({error}), or {why}"
    return [
        f"Alpha adds up to {total:.0f} ± {rounded_std(std)}, which may be nothing: {why}; {remedy}."
    ]


def _impossible(solution: Solution) -> list[str]:
    """Warnings of alpha out of its range by more than noise."""
    known = solution.streak & solution.known
    alpha, margin = solution.alpha[known], 3 * solution.alpha_std[known]
    if not alpha.size:
        return []
    above, below = np.mean(alpha > 1.02 + margin), np.mean(alpha < -margin)
    said = []
    if above > 0.005:
        said.append(
            f"Alpha goes up to {alpha_peak(solution):.2f}, which cannot be (above 1 in {above:.1%} "
            "of the streak): the color is too near to the plate's, or the plate does not fit."
        )
    if below > 0.05:  # noise alone puts fewer pixels out of range
        said.append(
            f"Alpha is below 0 in {below:.0%} of the streak, which cannot be: a shadow or another "
            "thing is in it, or the color is wrong."
        )
    return said


def alpha_peak(solution: Solution) -> float:
    """The 99.5 % quantile of known alpha; 0 if no pixel is known."""
    alpha = solution.alpha[solution.streak & solution.known]
    return max(float(np.percentile(alpha, 99.5)), 0.0) if alpha.size else 0.0


def sure_pixels(solution: Solution) -> Bools:
    """(H, W) True where alpha exceeds three standard deviations within the streak."""
    sure = solution.streak & solution.known & (solution.alpha > 3 * solution.alpha_std)
    return np.asarray(sure & (solution.alpha > 0))


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
    found = f"{total:.0f} ± {rounded_std(std)}"
    if abs(total) < std or stats.leaves_region:
        found = f"is not determined ({found})"
    said = f"Sum of alpha {found}{_condition(solution.model)}"
    opacity = 1.0 if stats.sweep is None else stats.sweep.opacity
    if total > 3 * std and opacity == 1 and not _touches_border(solution):
        radius = math.sqrt(total / math.pi)
        error = rounded_std(std / (2 * math.pi * radius))
        said += ": the area of the silhouette in pixels, whatever the motion; "
        said += f"of a disc, the radius would be {radius:.1f} ± {error}"
    yield said + "."
    yield from (f"{line[0].upper()}{line[1:]}." for line in left_out(solution))
    if _touches_border(solution):
        yield "The streak touches the border; the sum lacks what lies beyond."


def left_out(solution: Solution) -> list[str]:
    """What of the streak the results do not hold: up to two lines without a full stop."""
    stats = solution.stats
    unknown = (stats.pixels or 0) - (stats.pixels_known or 0)
    said = [f"{unknown} pixels of the streak are unknown and not in the sum"] if unknown else []
    if solution.streak.any() and not (stats.only_adds_light or sure_pixels(solution).any()):
        said.append("alpha is nowhere above three standard deviations, so that color.png is black")
    return said


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
        return "No pixel of the streak is flagged."
    return f"Flagged in the streak: {', '.join(said)}."


def usable_all_the_same(image: LinearImage, plate: LinearImage, solution: Solution) -> list[str]:
    """That an assumed layer gives back the image over its plate; one line, or none if it does not.

    image, plate: what was solved, of the size of the solution.
    """
    if solution.stats.grade is not Grade.ASSUMED:
        return []
    if solution.stats.may_be_shadow or plate.is_guess:
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

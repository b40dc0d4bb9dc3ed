"""The accuracy of alpha and warnings: grade, causes, the fitted shape, other colors, unknown parts."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blurmatte.explain.numbers import rounded_std, with_article, with_error
from blurmatte.matting.maps import Grade, Quality
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SolutionStats, SweepSummary
from blurmatte.matting.summary import Alternative

_MOST_BOXES = 5  # that are named
_MIN_BLUR_PX = 1.0  # of the rim; less is not visible
_MAX_KNOWN_STD = 0.1  # of an opacity that is worth a number
_REASONS = {
    "plate": "the plate is a guess from the surroundings of the region",
    "shadow": "only light was lost, so that it may be a shadow",
    "light": "constant light of the object is assumed",
    "solver": "the errors of this solver are not calibrated",
    "opacity": "whether it hides all of the light behind it, and was in the picture all the time, is "
    "uncertain (--opacity states it)",
    "gray": "without hues alpha follows from the shape alone",
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
    weights = sorted(stats.weights or (1.0,))
    numbers = {
        "noise": lambda: f" (error {claim:.2g})",
        "shape": lambda: f" (by {claim * math.expm1(terms.shapeless):.2g})",
        "color": lambda: f" (± {math.expm1(terms.color_angle):.2g}°)",
        "colors": lambda: f" (by {math.degrees(terms.color_spread):.2g}°)",
        "size": lambda: f" (± {math.expm1(terms.radius):.2g} %)",
        "correlation": lambda: f" ({math.exp(terms.correlation):.2g} times the variance)",
        "disagreement": lambda: f" (weight {weights[-2]:.2g})" if len(weights) > 1 else "",
    }
    return numbers[name]() if name in numbers else ""


def _errors(stats: SolutionStats, grade: Grade) -> list[str]:
    """Errors of alpha and of its sum, one standard deviation each."""
    error, scale = stats.alpha_error, stats.alpha_scale_std
    said = []
    if stats.only_adds_light:
        within = "" if error is None else f", alpha 0 within {error:.2g}"
        return [f"it only adds light{within}"]
    if grade is Grade.ASSUMED and scale:
        said.append(f"alpha is known up to a factor of 1 ± {scale:.2g}")
    if error is not None:
        said.append(f"{'' if said else 'alpha '}within {error:.2g}")
    if grade is not Grade.ASSUMED and scale is not None:
        said.append(f"its sum within {rounded_std(100 * scale)} %")
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
    return _no_object(solution) or [*said, *_impossible(solution)]


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
    remedy = "choose the object with a region, or give its own color"
    if "plate" in stats.grade_reasons:
        remedy = "mark the object closely, or photograph the scene without it (--plate FILE)"
    return [
        f"Alpha adds up to {total:.0f} ± {rounded_std(std)}, which may be nothing: what moved here may "
        f"not have this color; {remedy}."
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

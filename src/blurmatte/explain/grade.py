"""The accuracy of alpha: grade, error, its main causes, and other colors that fit a streak."""

import math
from dataclasses import replace

from blurmatte.explain.numbers import rounded_std
from blurmatte.matting.alternatives import Alternative
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SolutionStats

_REASONS = {
    "shadow": "only light was lost, so that it may be a shadow",
    "duration": "the part of the exposure during which it was there is uncertain",
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
    """Colors of the hypotheses whose alpha differs from the answer's; one line or none."""
    others = [one for one in alternatives_of(solution)[1:] if one.disagrees]
    parts = (
        ("also fits", [_with_alpha(one) for one in others if one.matters]),
        ("fits less well", [_with_alpha(one) for one in others if not one.matters]),
    )
    said = [f"{heading}: {'; '.join(those)}" for heading, those in parts if those]
    return ["; ".join(said)] if said else []


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
    if not (found and ends):
        return []
    low, high = min(low for low, _, _ in ends), max(high for _, high, _ in ends)
    each = ", ".join(f"{low:.2f} to {high:.2f} {by}" for low, high, by in ends)
    return [f"all of alpha may be {low:.2f} to {high:.2f} times as large: {each}"]


def _with_alpha(one: Alternative) -> str:
    return f"{one.hex} with alpha x {one.alpha_factor:.2f} ({one.name})"

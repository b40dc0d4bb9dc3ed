"""The accuracy of alpha in one sentence: grade, error, and its main causes."""

from collections.abc import Mapping
from typing import Any

from blurmatte.explain.numbers import rounded_std
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution

_REASONS = {
    "shadow": "only light was lost, so that it may be a shadow",
    "clip": "path and radius contradict the other frames, so that it was solved alone",
    "color": "the color is uncertain, so that one had to be assumed",
    "shape": "the shape is uncertain, so that one had to be assumed",
    "noise": "noise is large compared with what the object changes",
    "file": "compression changed the colors of neighboring pixels",
    "size": "few pixels show the object",
    "disagreement": "hypotheses that are about as likely have different alpha",
}
_WITHOUT_NUMBERS = {
    Grade.CONFIRMED: "alpha is known well",
    Grade.PLAUSIBLE: "alpha is known less well",
    Grade.ASSUMED: "a color or a shape had to be assumed",
}


def grade_in_words(solution: Solution) -> list[str]:
    """The grade, the calibrated errors, and the reasons of a grade that is not the best.

    Sentences without a full stop; none if the solution has no grade, e.g. that of `Pixelwise`.
    """
    stats = solution.stats
    if "grade" not in stats:
        return []
    grade, known = solution.grade, ", ".join(_errors(stats, solution.grade))
    names = () if grade is Grade.CONFIRMED else stats.get("grade_reasons", ())
    reasons = ", and ".join(_REASONS.get(name, name) for name in names)
    said = {
        Grade.CONFIRMED: [known],
        Grade.PLAUSIBLE: [known, reasons],
        Grade.ASSUMED: [reasons, known],
    }[grade]
    return [f"{grade}: {'; '.join(filter(None, said)) or _WITHOUT_NUMBERS[grade]}"]


def _errors(stats: Mapping[str, Any], grade: Grade) -> list[str]:
    """Errors of alpha and of its sum, one standard deviation each."""
    error, scale = stats.get("alpha_error"), stats.get("alpha_scale_std")
    said = []
    if grade is Grade.ASSUMED and scale:
        said.append(f"alpha is known up to a factor of 1 ± {scale:.2g}")
    if error is not None:
        said.append(f"{'' if said else 'alpha '}within {error:.2g}")
    if grade is not Grade.ASSUMED and scale is not None:
        said.append(f"its sum within {rounded_std(100 * scale)} %")
    return said

"""Sentences about the grade."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.explain import doubts, explain, grade_in_words
from blurmatte.matting import Grade, Quality
from blurmatte.sweep.assess.calibration import REASONS as TERM_REASONS
from blurmatte.sweep.assess.calibration import ErrorTerms

REASONS = tuple(dict.fromkeys(name for name in TERM_REASONS.values() if name))


def test_missing_grade_has_no_sentence(solution):
    assert grade_in_words(solution()) == []
    assert explain(solution())[0] == "Alpha up to 0.30."


@pytest.mark.parametrize(
    ("grade", "reasons", "says"),
    [
        ("confirmed", ["noise"], "confirmed: alpha within 0.012, its sum within 2 %"),
        (
            "plausible",
            ["noise", "size"],
            "plausible: alpha within 0.012, its sum within 2 %; noise is large compared with what the "
            "object changes, and the radius is uncertain",
        ),
        (
            "assumed",
            ["color"],
            "assumed: the color is uncertain; alpha is known up to a "
            "factor of 1 ± 0.02, within 0.012",
        ),
    ],
)
def test_grade_with_errors_and_reasons(solution, grade, reasons, says):
    """Exact: the grade, its errors and its reasons."""
    stats = {"grade": Grade(grade), "alpha_error": 0.0123, "alpha_scale_std": 0.02}
    graded = solution(**stats, grade_reasons=reasons)
    assert grade_in_words(graded) == [says]
    assert explain(graded)[0] == f"{says}."


@pytest.mark.parametrize("grade", list(Grade))
def test_grade_without_errors_has_a_sentence(solution, grade):
    (said,) = grade_in_words(solution(grade=grade))
    assert said.startswith(f"{grade}: ")
    assert len(said) > len(f"{grade}: ")


@pytest.mark.parametrize("reason", REASONS)
def test_every_reason_has_a_text(solution, reason):
    (said,) = grade_in_words(solution(grade=Grade.ASSUMED, grade_reasons=(reason,)))
    assert len(said.split()) > 3


def test_error_of_the_scale_is_stated_as_a_factor(solution):
    (said,) = grade_in_words(solution(grade=Grade.ASSUMED, alpha_scale_std=0.25))
    assert said == "assumed: alpha is known up to a factor of 1 ± 0.25"
    (said,) = grade_in_words(solution(grade=Grade.ASSUMED, alpha_scale_std=0.0, alpha_error=0.08))
    assert said == "assumed: alpha within 0.08"


TERMS = ErrorTerms(radius=np.log1p(4.0), color_angle=np.log1p(7))


def test_reasons_state_the_numbers_of_their_terms(solution):
    """exact: ± 4 % of the radius, ± 7°, a second weight of 0.2, a claim of 0.03."""
    names = ("noise", "size", "color", "disagreement")
    (said,) = grade_in_words(
        solution(
            grade=Grade.PLAUSIBLE,
            grade_reasons=names,
            error_terms=TERMS,
            claimed_error=0.03,
            weights=(0.79, 0.01, 0.2),
        )
    )
    assert said == (
        "plausible: noise is large compared with what the object changes (error 0.03), and the radius "
        "is uncertain (± 4 %), and the color is uncertain (± 7°), and another hypothesis may be right "
        "(weight 0.2)"
    )


def test_impossible_sum_gives_a_warning(solution):
    nothing = solution(sum_alpha=-50.0, sum_alpha_std=2.0)
    (doubt,) = doubts(nothing)
    assert doubt.startswith(
        "Alpha adds up to -50 ± 2, which may be nothing: what moved here may not"
    )
    assert explain(nothing)[0] == doubt
    assert "the area" not in " ".join(explain(nothing))


def test_good_solution_has_no_warning(changed):
    assert doubts(changed()) == []
    assert doubts(changed(quality=(2, Quality.MISFIT))) == []
    assert doubts(changed(alpha=(10, 1.05))) == []  # noise may do that
    outside = np.full((20, 30), Quality.OUTSIDE, np.uint8)
    assert doubts(replace(changed(), quality=outside)) == []


@pytest.mark.parametrize(
    ("flag", "says"),
    [
        (Quality.PLATE_IN_MODEL, "40% of the streak lies before a plate of the object's own"),
        (Quality.SATURATED, "40% of the streak is clipped"),
        (
            Quality.SHADOW,
            "40% of the streak is only darker than the plate: a shadow, or something black",
        ),
        (Quality.MISFIT, "40% of the streak does not fit the color"),
    ],
)
def test_large_flagged_fraction_gives_a_warning(changed, flag, says):
    some = changed(quality=(4, flag))
    unknown = (some.quality & Quality.SATURATED) != 0
    (doubt,) = doubts(replace(some, alpha_std=np.where(unknown, np.inf, some.alpha_std)))
    assert doubt.startswith(says)


def test_known_clipped_pixels_give_no_warning(changed):
    assert doubts(changed(quality=(4, Quality.SATURATED))) == []


def test_possible_shadow_is_the_only_warning(solution):
    (doubt,) = doubts(solution(may_be_shadow=True))
    assert doubt.startswith(
        "Only light was lost: all of this may be a shadow, or an object that is"
    )


def test_impossible_alpha_gives_a_warning(changed):
    (above,) = doubts(changed(alpha=(1, 1.5)))
    assert above.startswith("Alpha goes up to 1.50, which cannot be (above 1 in 10.0% of the")
    (below,) = doubts(changed(alpha=(1, -0.5)))
    assert below.startswith("Alpha is below 0 in 10% of the streak, which cannot be: a shadow")
    assert doubts(changed(alpha=(1, -0.5), quality=(10, Quality.PLATE_IN_MODEL)))[1:] == []

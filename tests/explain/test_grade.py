"""Sentences about the grade, the shape and the alternatives of a solution."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color.model import ColorModel
from blurmatte.explain import explain
from blurmatte.explain.solution import (
    also_moved,
    alternatives_in_words,
    alternatives_of,
    doubts,
    grade_in_words,
    likeliest_shape,
)
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.maps import Grade
from blurmatte.matting.stats import SweepSummary
from blurmatte.matting.summary import Alternative
from blurmatte.sweep import Sweep
from blurmatte.sweep.assess.calibration import REASONS as TERM_REASONS
from blurmatte.sweep.assess.calibration import ErrorTerms
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.sweep import Diagnostics

REASONS = tuple(dict.fromkeys(name for name in TERM_REASONS.values() if name))
OWN = {
    "name": "disc on an arc, one paint",
    "rgb": (0.4, 0.1, 0.02),
    "hex": "#aa5a27",
    "weight": 0.9,
    "alpha_factor": 1.0,
    "alpha_difference": 0.0,
    "radius": 8.0,
}
LIKELY = {**OWN, "name": "no shape, one paint", "hex": "#a04020", "alpha_factor": 1.3,
          "weight": 0.1, "radius": None}  # fmt: skip
UNLIKELY = {**OWN, "name": "ellipse on a cubic curve, two paints", "hex": "#905030",
            "alpha_factor": 0.7, "weight": 0.0}  # fmt: skip
BOTH = Alternative(**OWN), Alternative(**LIKELY)


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
            "factor of 1 ± 0.02, within 0.012, its sum within 2 %",
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
    assert said == "assumed: alpha is known up to a factor of 1 ± 0.25, its sum within 25 %"
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


def test_the_radius_has_the_same_error_in_the_reason_and_on_the_sheet(solution):
    """exact: that of a guessed plate is in it, 10 % where the fit alone knows it to 4 %."""
    (said,) = grade_in_words(
        solution(
            grade=Grade.PLAUSIBLE,
            grade_reasons=("size",),
            error_terms=TERMS,
            claimed_error=0.03,
            sweep=disc_on_arc(radius_std=1.8),
        )
    )
    assert said.endswith("the radius is uncertain (± 10 %)")


def test_impossible_sum_gives_a_warning(solution):
    nothing = solution(sum_alpha=-50.0, sum_alpha_std=2.0)
    (doubt,) = doubts(nothing)
    assert doubt.startswith(
        "Alpha adds up to -50 ± 2, which may be nothing: what moved here may not"
    )
    assert explain(nothing)[0] == doubt
    assert "the area" not in " ".join(explain(nothing))


@pytest.mark.parametrize(("reasons", "remedy"), [((), "a region"), (("plate",), "--plate FILE")])
def test_a_factor_that_may_be_zero_gives_a_warning(solution, reasons, remedy):
    open_factor = solution(
        sum_alpha=100.0, sum_alpha_std=150.0, alpha_scale_std=1.49, grade_reasons=reasons
    )
    (doubt,) = doubts(open_factor)
    assert "100 ± 150, which may be nothing" in doubt
    assert remedy in doubt
    assert not doubts(solution(sum_alpha=100.0, sum_alpha_std=50.0, alpha_scale_std=0.49))


def test_nobody_is_advised_to_give_the_color_in_a_gray_picture(solution):
    (doubt,) = doubts(solution(sum_alpha=-50.0, sum_alpha_std=2.0, grade_reasons=("gray",)))
    assert doubt.endswith("choose the object with a region.")


def test_a_sum_that_a_guess_leaves_open_is_not_determined(solution):
    """A region that cuts the object has its rest in the guess, and no pixel shows it."""
    cut = solution(sum_alpha=1785.0, sum_alpha_std=16151.0, grade_reasons=("plate",))
    said = " ".join(explain(cut))
    assert "which may be nothing: the region may cut the object" in said
    assert "Sum of alpha is not determined (1785 ±" in said
    assert "known against" not in said


def test_a_rough_guess_is_the_reason_of_a_sum_that_may_be_nothing(solution):
    """A color was not given: that it may be another explains nothing."""
    rough = solution(
        sum_alpha=100.0, sum_alpha_std=150.0, alpha_scale_std=1.49, grade_reasons=("plate",),
        rough_guess=0.1712,
    )  # fmt: skip
    (doubt,) = doubts(rough)
    assert (
        "may be nothing: the scene is too rough to guess the plate (± 0.17 of white), or the"
        in doubt
    )
    assert "color" not in doubt


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


def disc_on_arc(**fields):
    """Of a disc on an arc, with other values in some fields."""
    disc = SweepSummary(
        silhouette="disc",
        path="arc",
        path_in_words="an arc",
        is_disc=True,
        xy=(),
        length=177.0,
        radius=18.0,
        radius_std=0.03,
        outlines=(),
        diagnostics=Diagnostics(residual_excess=1.13),
    )
    return replace(disc, **fields)


def without_shape(solution):
    """The same, with a likeliest hypothesis without a shape."""
    own = Alternative("no shape, one paint", (1.0, 0.0, 0.0), "#ff0000", 0.75, 1.0, 0.0, None)
    stats = replace(solution.stats, alternatives=(own,))
    return replace(solution, solver="Smooth()", stats=stats)


@pytest.mark.parametrize(
    ("excess", "words"),
    [
        (1.13, "correlated 1.1 times as much as noise."),
        (1e-6, "no more correlated than noise."),
    ],
)
def test_quality_of_fit_is_stated(solution, excess, words):
    disc = disc_on_arc(diagnostics=Diagnostics(residual_excess=excess))
    said = explain(replace(solution(sweep=disc), solver="Swept()"))
    shape = "A disc of radius 18.00 ± 0.03 px on an arc of 177 px"
    assert f"{shape} explains the streak; residuals in it are {words}" in said


@pytest.mark.parametrize("rank", [1, 3])
def test_shape_and_motion_alone_determine_alpha_of_any_colors(solution, rank):
    model = ColorModel.any() if rank == 3 else ColorModel.from_hex("#ff0000")
    said = explain(replace(solution(sweep=disc_on_arc()), model=model))
    assert ("Of any colors, shape and motion alone determine alpha." in said) == (rank == 3)


def test_rejected_shape_explains_only_a_part(solution):
    line = path_family("line")
    n = line.size + DISC.size
    rejected = Sweep(
        line, np.zeros(line.size), DISC, np.full(DISC.size, 5.0), ColorModel.any(),
        np.eye(n), (30, 20), Diagnostics(rejection="leaves the streak"),
    )  # fmt: skip
    said = " ".join(explain(replace(solution(sweep=disc_on_arc()), sweep=rejected)))
    assert "explains the streak only in part: the fit leaves the streak." in said
    assert "residuals" not in said


def test_smaller_weight_of_a_shape_is_stated(solution):
    shadow = CastShadow((-6.0, 8.0), 3.0, (0.4, 0.5, 0.6))
    averaged = solution(sweep=disc_on_arc(shadow=shadow), weights=(0.2, 0.05, 0.75))
    assert likeliest_shape(replace(averaged, solver="Swept()"))
    smooth = without_shape(averaged)
    assert not likeliest_shape(smooth)
    assert (
        "Alpha without a shape explains the streak better: its weight is 0.75. The likeliest shape "
        "has 0.2: a disc of radius 18.00 ± 0.03 px on an arc of 177 px." in explain(smooth)
    )
    assert "Its shadow" not in " ".join(explain(smooth))


def test_cast_shadow_is_described_without_a_warning(solution):
    shadow = CastShadow((-6.0, 8.0), 3.0, (0.4, 0.5, 0.6))
    solved = solution(sweep=disc_on_arc(shadow=shadow))
    assert (
        "Its shadow, 10 px from it, takes 50 % of the light behind; it is not in alpha."
        in explain(solved)
    )
    doubtful = solution(sweep=disc_on_arc(shadow=shadow), weights=(0.7, 0.3))
    assert "With a probability of 0.70 its shadow, 10 px from it, takes" in " ".join(
        explain(doubtful)
    )
    solved.quality[5:15, 5:15] = Quality.SHADOW
    assert not any("choose a region without it" in words for words in doubts(solved))
    assert any("choose a region without it" in words for words in doubts(without_shape(solved)))
    other = replace(solved, stats=SolutionStats(sweep=disc_on_arc()))
    assert any("choose a region without it" in words for words in doubts(other))


@pytest.mark.parametrize(("softness", "said"), [(0.0, False), (0.4, False), (3.62, True)])
def test_soft_rim_is_stated_if_significant(solution, softness, said):
    words = "The lens blurs its rim by 3.6 px: it was not in focus as the scene is."
    assert (words in explain(solution(sweep=disc_on_arc(softness=softness)))) == said


@pytest.mark.parametrize(
    ("silhouette", "is_disc", "words"),
    [
        ("growing disc", True, "A growing disc of radius 18.00 ± 0.03 px on an arc"),
        ("changing ellipse", False, "A changing ellipse with the area of a disc of radius 18.00"),
        (
            "ellipse",
            False,
            "An ellipse with the area of a disc of radius 18.00 ± 0.03 px on an arc",
        ),
        (
            "turning, changing outline of order 6",
            False,
            "A turning, changing outline of order 6 with",
        ),
        ("outline of order 6", False, "An outline of order 6 with the area of a disc"),
    ],
)
def test_kind_of_the_shape_is_stated(solution, silhouette, is_disc, words):
    said = explain(solution(sweep=disc_on_arc(silhouette=silhouette, is_disc=is_disc)))
    assert words in " ".join(said)


@pytest.mark.parametrize(
    ("opacity", "std", "words"),
    [
        (
            0.5,
            0.02,
            "It hides 0.500 ± 0.020 of the light behind it, or was there for that part of the",
        ),
        (0.7, 0.25, "Which part of the light behind it it hides is uncertain (0.70 ± 0.25)"),
        (0.0, 0.05, "It only adds light (opacity 0.000 ± 0.050): alpha of its layer is 0"),
        (0.0, 0.58, "It only adds light: alpha of its layer is 0"),
    ],
)
def test_how_much_light_an_object_hides_is_stated_unless_it_is_solid(solution, opacity, std, words):
    said = " ".join(explain(solution(sweep=disc_on_arc(opacity=opacity, opacity_std=std))))
    assert words in said
    assert "behind" not in " ".join(explain(solution(sweep=disc_on_arc())))


def test_an_opacity_that_nothing_shows_is_said_with_its_remedy(solution):
    solid = disc_on_arc(opacity=1.0, opacity_std=0.4)
    said = " ".join(explain(solution(sweep=solid, grade_reasons=("opacity",))))
    assert "It is taken for solid (opacity 1.00 ± 0.40)." in said
    assert "A plate with texture or a given color would decide." in said


def test_the_light_that_was_added_is_summed_in_the_place_of_alpha(solution):
    light = disc_on_arc(opacity=0.0, opacity_std=0.05)
    said = " ".join(explain(solution(sweep=light, sum_alpha=0.0, sum_alpha_std=3.0)))
    assert "Its light adds up to" in said
    assert "Sum of alpha" not in said
    assert "may be nothing" not in said


@pytest.mark.parametrize("grade", [Grade.CONFIRMED, Grade.ASSUMED])
def test_grade_of_a_lamp_states_no_factor_of_an_alpha_that_is_zero(solution, grade):
    light = disc_on_arc(opacity=0.0, opacity_std=0.05)
    stats = {"sweep": light, "grade": grade, "alpha_error": 0.015, "alpha_scale_std": 8e6}
    lamp = solution(**stats, alternatives=(Alternative(**OWN), Alternative(**LIKELY)))
    (said,) = grade_in_words(lamp)
    assert said == f"{grade}: it only adds light, alpha 0 within 0.015"
    assert "times as large" not in " ".join(explain(lamp))


def test_gray_pictures_have_no_colors_in_words(solution):
    stats = {"grade": Grade.ASSUMED, "grade_reasons": ("gray",), "alternatives": BOTH}
    gray = solution(**stats, may_be_shadow=True)
    assert gray.stats.is_gray
    (also, _) = alternatives_in_words(replace(gray, stats=replace(gray.stats, alpha_scale_std=0.2)))
    assert also == "also fits: alpha x 1.30 (no shape, one paint)"
    said = " ".join(explain(gray))
    assert "gray pictures do not show which" in said
    assert "given color" not in said


def graded(solution, *alternatives, scale=0.2):
    found = tuple(Alternative(**one) for one in alternatives)
    return solution(grade=Grade.ASSUMED, alpha_scale_std=scale, alternatives=found)


def test_colors_factors_and_interval(solution):
    """exact"""
    found = graded(solution, OWN, LIKELY, UNLIKELY)
    also, interval = alternatives_in_words(found)
    assert also == (
        "also fits: #a04020 with alpha x 1.30 (no shape, one paint); fits less well: #905030 with "
        "alpha x 0.70 (ellipse on a cubic curve, two paints)"
    )
    assert interval == (
        "all of alpha may be 0.70 to 1.30 times as large: 0.80 to 1.20 by one standard deviation, "
        "0.70 to 1.30 over the hypotheses"
    )
    _, *said = explain(found)
    assert said[:2] == [f"{line[0].upper()}{line[1:]}." for line in (also, interval)]


@pytest.mark.parametrize(
    ("factor", "says"), [(0.004, "light that hides nothing"), (0.01, "x 0.01")]
)
def test_an_alternative_without_alpha_is_said_to_hide_nothing(solution, factor, says):
    """exact: no color of a surface, and no factor of 0"""
    also, _ = alternatives_in_words(graded(solution, OWN, {**LIKELY, "alpha_factor": factor}))
    assert says in also
    assert "x 0.00" not in also
    assert (LIKELY["hex"] in also) == (factor == 0.01)


def test_interval_of_a_large_error_ends_at_zero(solution):
    """exact"""
    (interval,) = alternatives_in_words(graded(solution, OWN, scale=1.5))
    assert interval == (
        "all of alpha may be 0.00 to 2.50 times as large: 0.00 to 2.50 by one standard deviation"
    )


def test_equal_hypotheses_are_listed_but_not_named(solution):
    """exact"""
    same = {**LIKELY, "alpha_factor": 1.01, "alpha_difference": 0.004}
    found = graded(solution, OWN, same)
    assert len(alternatives_of(found)) == 2
    assert [line.split(":")[0] for line in alternatives_in_words(found)] == [
        "all of alpha may be 0.80 to 1.20 times as large"
    ]


@pytest.mark.parametrize(
    "stats",
    [
        {"grade": Grade.CONFIRMED, "alternatives": BOTH, "alpha_scale_std": 0.01},
        {"grade": Grade.ASSUMED, "alpha_scale_std": 0.2},
        {"alternatives": BOTH},
    ],
    ids=["confirmed", "none compared", "no grade"],
)
def test_solutions_without_alternatives_have_no_sentence(solution, stats):
    assert alternatives_in_words(solution(**stats)) == []


def test_what_else_moved_is_named_by_its_box():
    boxes = [(k, 0, k + 5, 9) for k in range(7)]
    assert also_moved([], 3) == []
    assert also_moved(boxes[:1], 0) == ["also moved, choose with --region: 0,0,5,9"]
    (line,) = also_moved(boxes, 2)
    assert line.endswith("4,0,9,9 and 2 more; 2 more may be noise or compression")


def test_error_of_the_sum_is_that_of_the_numbers(solution):
    """Exact: not the error of the common factor alone, and not 0 % of what is small."""
    for grade, scale, std, says in (
        ("assumed", 0.018, 31.0, "31 %"),
        ("confirmed", 0.0, 0.4, "0.4 %"),
    ):
        stats = {"alpha_scale_std": scale, "sum_alpha": 100.0, "sum_alpha_std": std}
        (said,) = grade_in_words(solution(grade=Grade(grade), **stats))
        assert said.endswith(f"its sum within {says}")

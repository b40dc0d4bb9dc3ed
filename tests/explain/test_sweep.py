"""Sentences about sweeps."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.explain import doubts, explain, likeliest_shape
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.alternatives import Alternative
from blurmatte.matting.stats import ShadowSummary, SweepSummary
from blurmatte.sweep import Diagnostics, Sweep, path_family
from blurmatte.sweep.model.silhouette import DISC


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


def test_quality_of_fit_is_stated(solution):
    said = explain(replace(solution(sweep=disc_on_arc()), solver="Swept()"))
    assert (
        "A disc of radius 18.00 ± 0.03 px on an arc of 177 px explains the streak; residuals in it "
        "are correlated 1.1 times as much as noise." in said
    )


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
    shadow = ShadowSummary((-6.0, 8.0), 3.0, (0.4, 0.5, 0.6))
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
    shadow = ShadowSummary((-6.0, 8.0), 3.0, (0.4, 0.5, 0.6))
    solved = solution(sweep=disc_on_arc(shadow=shadow))
    assert (
        "Its shadow, 10 px from it, takes 50 % of the light behind; it is not in alpha."
        in explain(solved)
    )
    solved.quality[5:15, 5:15] = Quality.SHADOW
    assert not any("choose a region without it" in words for words in doubts(solved))
    assert any("choose a region without it" in words for words in doubts(without_shape(solved)))
    other = replace(solved, stats=SolutionStats(sweep=disc_on_arc()))
    assert any("choose a region without it" in words for words in doubts(other))


@pytest.mark.parametrize(("softness", "said"), [(0.0, False), (0.4, False), (3.62, True)])
def test_soft_rim_is_stated_if_significant(solution, softness, said):
    words = "The lens blurs its rim by 3.6 px: it was not in focus as the plate is."
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

"""Warnings about a solution."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.explain import doubts, explain
from blurmatte.matting import Quality


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

"""Solution: raw estimates for measurements, and a layer for display."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from blurmatte.color.model import ColorModel
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SweepSummary
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.sweep.sweep import Diagnostics, Sweep

RED = ColorModel(np.array([[1.0], [0], [0]]))
GOOD = 0
UNKNOWN = [Quality.SATURATED, Quality.PLATE_IN_MODEL, Quality.OUTSIDE]
DOUBTFUL = [Quality.OUT_OF_RANGE, Quality.MISFIT]


def solution(alpha, quality, light=0.5):
    alpha, quality = np.array([alpha]), np.array([quality], np.uint8)
    premultiplied = np.repeat(light * alpha[..., None], 3, axis=-1)
    alpha_std = np.where(quality & Quality.SATURATED, np.inf, 0.02)  # in all channels
    return Solution(alpha, alpha_std, premultiplied,
                    np.full_like(premultiplied, 0.01), quality, RED, "Pixelwise()")  # fmt: skip


def test_layer_is_clipped_and_the_estimate_is_not():
    raw = solution([-0.1, 0.5, 1.2], [GOOD, GOOD, GOOD])
    assert_array_equal(raw.alpha, [[-0.1, 0.5, 1.2]])
    assert_array_equal(raw.layer.alpha, [[0, 0.5, 1]])
    assert_array_equal(raw.layer.premultiplied[0, :, 0], [0, 0.25, 0.6])


@pytest.mark.parametrize("flag", [Quality.SATURATED, Quality.OUTSIDE])
def test_layer_is_empty_where_nothing_is_known(flag):
    layer = solution([0.5, 0.5], [flag, GOOD]).layer
    assert_array_equal(layer.alpha, [[0, 0.5]])
    assert_array_equal(layer.premultiplied[0, 0], 0)


def test_layer_keeps_unknown_alpha_that_is_a_fraction():
    """exact: before a plate of the object's color; numbers outside 0 to 1 are no fractions."""
    unknown = solution([0.5, -0.2, 1.4], [Quality.PLATE_IN_MODEL] * 3)
    assert not unknown.known.any()
    assert_array_equal(unknown.layer.alpha, [[0.5, 0, 0]])
    assert_array_equal(unknown.layer.premultiplied[0, :, 0], [0.25, 0, 0])


def test_known_depends_on_the_error_not_on_flags():
    """exact: alpha of a pixel with one clipped channel is known, and shown."""
    one = solution([0.5], [Quality.SATURATED])
    known = replace(one, alpha_std=np.full((1, 1), 0.1))
    assert not one.known.any()
    assert known.known.all()
    assert known.layer.alpha[0, 0] == 0.5


def test_layer_is_empty_where_the_light_is_unknown():
    """exact: alpha behind a fence is known, and the layer is empty there."""
    hidden = replace(
        solution([0.5], [Quality.OCCLUDED]), premultiplied_std=np.full((1, 1, 3), np.inf)
    )
    assert hidden.known.all()
    assert not hidden.layer.alpha.any()


@pytest.mark.parametrize("flag", DOUBTFUL)
def test_doubtful_pixels_stay_in_the_layer(flag):
    assert solution([0.5], [flag]).layer.alpha[0, 0] == 0.5


def test_layer_has_no_negative_light():
    assert_array_equal(solution([0.5], [GOOD], light=-0.3).layer.premultiplied, np.zeros((1, 1, 3)))


def test_streak_and_known_follow_from_the_flags():
    flags = [GOOD, Quality.MISFIT, *UNKNOWN, Quality.OUTSIDE | Quality.SATURATED]
    pixels = solution([0.5] * 6, flags)
    assert_array_equal(pixels.streak, [[True, True, True, True, False, False]])
    assert_array_equal(pixels.known, [[True, True, False, False, True, False]])


def test_repr_is_one_line():
    some = solution([0.5, 0.5, 0.1, 0.3], [GOOD, Quality.MISFIT, Quality.OUTSIDE, GOOD])
    assert repr(some) == (
        "Solution(4x1, alpha up to 0.50, typical std 0.02, 33.3% of the streak's pixels flagged)"
    )
    assert repr(solution([0.5], [Quality.SATURATED])) == "Solution(1x1, nothing known)"
    std = np.array([[0.02, 0.0, 0.0, 0.0]], np.float32)
    assert "typical std 0.02" in repr(replace(some, alpha_std=std))  # where there may be something
    assert some.size == (4, 1)


def test_bits_are_powers_of_two_that_fit_a_byte():
    assert [flag.value for flag in Quality] == [1, 2, 4, 8, 16, 32, 64]


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("alpha", np.zeros((2, 1)), ValueError),
        ("alpha_std", np.zeros((1, 1), int), TypeError),
        ("premultiplied", np.zeros((1, 1)), ValueError),
        ("premultiplied_std", np.zeros((1, 1)), ValueError),
        ("quality", np.zeros((1, 1)), TypeError),
        ("quality", np.zeros((1, 2), np.uint8), ValueError),
    ],
)
def test_rejects_wrong_arguments(field, value, error):
    good = solution([0.5], [GOOD])
    fields = {
        name: getattr(good, name)
        for name in (
            "alpha",
            "alpha_std",
            "premultiplied",
            "premultiplied_std",
            "quality",
            "model",
            "solver",
        )
    }
    with pytest.raises(error, match=f"{field} must"):
        Solution(**{**fields, field: value})


def test_layer_converts_the_streak_only(monkeypatch):
    """Its cost is that of the streak, whatever the size of the picture."""
    from blurmatte.matting import solution as module

    seen, convert = [], module.light_in_srgb
    monkeypatch.setattr(
        module, "light_in_srgb", lambda light, m: seen.append(light.size) or convert(light, m)
    )
    small = solution([0.5, 0.25], [GOOD, GOOD])
    large = small.in_picture((40, 30, 42, 31), (100, 80))
    assert_array_equal(large.layer.alpha[30, 40:42], small.layer.alpha[0])
    assert_array_equal(large.layer.crop((40, 30, 42, 31)).premultiplied, small.layer.premultiplied)
    assert large.layer.alpha.sum() == 0.75
    assert set(seen) == {6}


def test_path_and_outlines_move_with_the_picture():
    """Exact: those of a crop are drawn where the crop lies."""
    path, outline = ((0.5, 1.0), (2.0, 3.0)), ((0.0, 1.0), (2.0, 3.0))
    sweep = SweepSummary(
        silhouette="disc",
        path="line",
        xy=path,
        length=2.5,
        radius=5.0,
        radius_std=0.1,
        outlines=(outline, ()),
        diagnostics=Diagnostics(converged=True, residual_excess=1.0),
    )
    stats = SolutionStats(streak_box=(1, 2, 3, 4), sweep=sweep)
    moved = replace(solution([0.5, 0.25], [GOOD, GOOD]), stats=stats)
    moved = moved.in_picture((40, 30, 42, 31), (100, 80)).stats
    assert moved.streak_box == (41, 32, 43, 34)
    assert moved.sweep.xy == ((40.5, 31.0), (42.0, 33.0))
    assert moved.sweep.outlines == (((40.0, 31.0), (42.0, 33.0)), ())


def test_errors_of_a_path_that_is_not_determined_are_at_most_the_diagonal():
    """exact: files with larger numbers are not read."""
    shape, path = np.array([5.0]), np.array([10.0, 10.0, 20.0, 12.0])
    sweep = Sweep(LINE, path, Silhouette(1), shape, RED, 1e40 * np.eye(5), (30, 40))
    summary = SweepSummary.of(sweep)
    assert summary.radius_std == 50
    assert {std for rim in summary.outlines_std for std in rim} == {50}


def test_masks_are_read_only():
    for mask in (solution([0.5], [GOOD]).streak, solution([0.5], [GOOD]).known):
        with pytest.raises(ValueError, match="read-only"):
            mask[0] = False


def test_grades_are_ordered_by_how_well_alpha_is_known():
    """exact: not by their letters."""
    ordered = [Grade.ASSUMED, Grade.PLAUSIBLE, Grade.CONFIRMED]
    assert sorted(reversed(ordered)) == ordered
    assert min(ordered) is Grade.ASSUMED
    assert Grade.CONFIRMED >= Grade.PLAUSIBLE > Grade.ASSUMED <= Grade.ASSUMED
    assert Grade.CONFIRMED == "confirmed"

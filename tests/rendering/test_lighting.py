"""Lamps: their directions, and what they do to paint."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.rendering.lighting import Lamp, check_lighting, lit, shade

WARM, COLD = Lamp((0, 0, 1), (1, 0.7, 0.4)), Lamp((2, 0, 0), (0.2, 0.4, 0.8))


def test_shade_is_ambient_and_the_cosine_to_each_lamp():
    facing = np.array([0.6, 0, 0.8])
    expected = 0.3 * np.array([0.6, 0.55, 0.6])
    expected = expected + 0.7 * (0.8 * np.array([1, 0.7, 0.4]) + 0.6 * np.array([0.2, 0.4, 0.8]))
    assert_allclose(shade(facing, (WARM, COLD), 0.3), expected)
    assert_allclose(shade(-facing, (WARM, COLD), 0.3), 0.3 * np.array([0.6, 0.55, 0.6]))
    assert_allclose(shade(np.array([0, 0, 1.0]), (Lamp((0, 0, 3)),), 0.3), 1)


def test_two_lamps_show_two_colors_of_a_paint_but_ambient_light_only_one():
    paints = np.array([[0.9, 0.5, 0.1]])
    assert_allclose(lit(paints, (WARM, COLD), 0.3), paints * [[1, 0.7, 0.4], [0.2, 0.4, 0.8]])
    assert_allclose(lit(paints, (WARM, COLD), 1), paints * [[0.6, 0.55, 0.6]])


def test_halfway_is_between_lamp_and_camera():
    assert_allclose(COLD.halfway, np.sqrt([0.5, 0, 0.5]))
    assert not Lamp((0, 0, -1)).halfway.any()


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda: Lamp((0, 0, 0)), ValueError, "direction must be a direction"),
        (lambda: Lamp((1, 0)), ValueError, "direction must be a direction"),
        (lambda: Lamp((0, np.nan, 1)), ValueError, "direction must be a direction"),
        (lambda: Lamp(color=(0, 0, 0)), ValueError, "color must be three linear values"),
        (lambda: check_lighting((), 0.5), ValueError, "lamps must be one or more, got none"),
        (lambda: check_lighting([WARM], 0.5), TypeError, "lamps must be a tuple of Lamp"),
        (lambda: check_lighting(((0, 0, 1),), 0.5), TypeError, "lamps must be a tuple of Lamp"),
        (lambda: check_lighting((WARM,), 1.2), ValueError, "ambient must lie between 0 and 1"),
    ],
)
def test_rejects_wrong_arguments(make, error, says):
    with pytest.raises(error, match=says):
        make()

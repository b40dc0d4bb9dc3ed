"""Streak: a region of the image."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from blurmatte.streaks import Streak


def test_from_box_fills_the_box():
    streak = Streak.from_box((2, 1, 5, 4), (8, 6))
    assert streak.mask.shape == (6, 8)
    assert streak.box == (2, 1, 5, 4)
    assert_array_equal(np.argwhere(streak.mask)[[0, -1]], [[1, 2], [3, 4]])
    assert streak.mask[streak.rows_columns].all()
    assert repr(streak) == "Streak(3x3 at 2,1, 9 pixels)"


def test_box_bounds_the_mask():
    mask = np.zeros((6, 8), bool)
    mask[2, 3] = mask[4, 6] = True
    assert Streak(mask).box == (3, 2, 7, 5)


@pytest.mark.parametrize(
    "box", [(-1, 0, 4, 4), (0, 0, 9, 4), (0, 0, 4, 7), (4, 0, 4, 4), (4, 4, 2, 6)]
)
def test_rejects_box_outside_the_picture(box):
    with pytest.raises(ValueError, match="must lie in the picture of 8x6 pixels, with x0 < x1"):
        Streak.from_box(box, (8, 6))


def test_around_is_cut_at_the_border():
    streak = Streak.from_box((3, 5, 10, 12), (20, 30))
    assert streak.around(0) == streak.box
    assert streak.around(2) == (1, 3, 12, 14)
    assert streak.around(100) == (0, 0, 20, 30)


def test_rejects_empty_and_non_boolean_masks():
    with pytest.raises(ValueError, match="at least one pixel; its mask is empty"):
        Streak(np.zeros((4, 4), bool))
    with pytest.raises(TypeError, match="mask must have a dtype of kind 'b'"):
        Streak(np.ones((4, 4)))

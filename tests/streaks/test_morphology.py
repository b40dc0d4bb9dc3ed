"""Opening and dilation."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy import ndimage

from blurmatte.streaks.morphology import widened, without_thin_parts


def test_without_thin_parts_equals_opening():
    """Oracle: SciPy's opening, to the border."""
    rng = np.random.default_rng(5)
    for side in (3, 4, 31):
        mask = ndimage.gaussian_filter(rng.normal(size=(side, 40)), 1.2) > 0
        assert_array_equal(without_thin_parts(mask), ndimage.binary_opening(mask, np.ones((3, 3))))


@pytest.mark.parametrize("by", [0, 1, 3])
def test_widened_equals_dilation(by):
    """Oracle: SciPy's dilation, to the border; the argument does not change."""
    mask = np.random.default_rng(6).random((9, 14)) > 0.95
    before = mask.copy()
    expected = ndimage.binary_dilation(mask, iterations=by) if by else before
    assert_array_equal(widened(mask, by), expected)
    assert_array_equal(mask, before)

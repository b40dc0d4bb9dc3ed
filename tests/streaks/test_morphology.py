"""Opening and dilation."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy import ndimage

from blurmatte.streaks.morphology import dilated, opened


def test_opened_equals_opening_of_scipy():
    """Oracle: SciPy's opening, to the border."""
    rng = np.random.default_rng(5)
    for side in (3, 4, 31):
        mask = ndimage.gaussian_filter(rng.normal(size=(side, 40)), 1.2) > 0
        assert_array_equal(opened(mask), ndimage.binary_opening(mask, np.ones((3, 3))))


@pytest.mark.parametrize("by", [0, 1, 3])
def test_dilated_equals_dilation_of_scipy(by):
    """Oracle: SciPy's dilation, to the border; the argument does not change."""
    mask = np.random.default_rng(6).random((9, 14)) > 0.95
    before = mask.copy()
    expected = ndimage.binary_dilation(mask, iterations=by) if by else before
    assert_array_equal(dilated(mask, by), expected)
    assert_array_equal(mask, before)

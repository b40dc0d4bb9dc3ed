"""Means over cells."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import cell_means


@pytest.mark.parametrize("side", [1, 2, 3, 7])
@pytest.mark.parametrize("more", [(), (3,)])
def test_a_cell_is_the_mean_of_its_pixels(side, more):
    # oracle
    values = np.random.default_rng(side).normal(size=(23, 31, *more))
    cells = cell_means(values, side)
    assert cells.shape == (23 // side, 31 // side, *more)
    for i, j in np.ndindex(cells.shape[:2]):
        block = values[i * side : (i + 1) * side, j * side : (j + 1) * side]
        assert_allclose(cells[i, j], block.mean(axis=(0, 1)), atol=1e-12)


def test_what_is_everywhere_the_same_stays_exactly():
    ones = np.ones((12, 18, 1), np.float32)
    assert_array_equal(cell_means(ones, 6), 1)
    assert cell_means(ones, 6).dtype == np.float32

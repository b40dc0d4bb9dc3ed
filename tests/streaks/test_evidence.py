"""Cells over which large pictures are averaged."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.streaks.evidence import in_cells


@pytest.mark.parametrize("cell", [2, 3, 7])
def test_cells_are_means_up_to_the_border(cell):
    values = np.random.default_rng(0).uniform(size=(10, 13, 3))
    cells = in_cells(values, cell)
    assert cells.shape == (-(-10 // cell), -(-13 // cell), 3)
    assert_allclose(cells[0, 0], values[:cell, :cell].mean(axis=(0, 1)))
    assert_allclose(in_cells(np.ones((10, 13, 1)), cell), 1)

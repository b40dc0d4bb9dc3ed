"""Areas of discs and boxes in grid cells, against closed forms and counting points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.rendering.coverage import box_coverage, cell_edges, disc_coverage


def counted_disc(x, y, radius, n=200):
    """Count n × n points of every cell."""
    inner = (np.arange(n) + 0.5) / n
    px = (x[:-1, None] + np.diff(x)[:, None] * inner).ravel()
    py = (y[:-1, None] + np.diff(y)[:, None] * inner).ravel()
    inside = px**2 + py[:, None] ** 2 <= radius**2
    return inside.reshape(len(y) - 1, n, len(x) - 1, n).mean(axis=(1, 3)) * np.outer(
        np.diff(y), np.diff(x)
    )


@pytest.mark.parametrize("radius", [0.2, 0.7, 3, 6.4])
@pytest.mark.parametrize("shift", [(0, 0), (0.5, 0.5), (0.31, -0.17)])
def test_disc_agrees_with_counting_points(radius, shift):
    x, y = np.arange(-8.0, 9) + shift[0], np.arange(-9.0, 10) + shift[1]
    area = disc_coverage(x, y, radius)
    assert_allclose(area, counted_disc(x, y, radius), atol=2e-3)
    assert_allclose(area.sum(), np.pi * radius**2, rtol=1e-13)


def test_disc_in_one_cell_in_quarters_and_cut_by_a_chord():
    far = np.array([-9.0, 9])
    assert_allclose(disc_coverage(far, far, 2), 4 * np.pi)
    assert_allclose(disc_coverage(np.array([-9.0, 0, 9]), np.array([-9.0, 0, 9]), 2), np.pi)
    segment = 4 * np.arccos(1 / 2) - np.sqrt(3)  # of radius 2, beyond the distance 1
    assert_allclose(disc_coverage(np.array([1.0, 9]), far, 2), segment)
    assert_allclose(disc_coverage(far, np.array([1.0, 9]), 2), segment)
    assert_allclose(disc_coverage(far, np.array([-9.0, -1]), 2), segment)


def test_disc_is_exactly_nothing_outside_and_everything_inside():
    x = np.arange(-30.0, 31)
    area = disc_coverage(x, x + 0.3, 18)
    nearest, farthest = (
        np.hypot(
            f(np.abs(x[:-1]), np.abs(x[1:])), f(np.abs(x[:-1] + 0.3), np.abs(x[1:] + 0.3))[:, None]
        )
        for f in (np.minimum, np.maximum)
    )
    assert np.all(area[nearest > 18.01] == 0)
    assert_allclose(area[farthest < 17.99], 1, rtol=1e-12)


def test_box_covers_its_sides():
    x = cell_edges(np.arange(-3.0, 4))
    assert_allclose(box_coverage(x, x, 3, 2).sum(), 6)
    assert_allclose(box_coverage(x, x, 3, 2)[3], [0, 0, 1, 1, 1, 0, 0])
    assert_allclose(box_coverage(x, x, 3, 2)[:, 3], [0, 0, 0.5, 1, 0.5, 0, 0])


def test_cells_split_the_pixels():
    assert_allclose(cell_edges(np.array([2.25, 3.25]), 2), [1.75, 2.25, 2.75, 3.25, 3.75])

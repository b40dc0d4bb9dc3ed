"""Areas of discs and boxes in grid cells, against closed forms and counting points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.rendering.coverage import box_coverage, cell_edges, disc_coverage, polygon_coverage

GRID = (np.arange(-8.0, 9) + 0.31, np.arange(-9.0, 8) - 0.17)
UNEVEN = (np.array([-7.0, -3.1, -3, -0.2, 0.4, 2, 6.5]), np.array([-5, -4.9, -1, 0.3, 4]))


def counted_disc(x, y, radius, n=200):
    """Count n × n points of every cell."""
    inner = (np.arange(n) + 0.5) / n
    px = (x[:-1, None] + np.diff(x)[:, None] * inner).ravel()
    py = (y[:-1, None] + np.diff(y)[:, None] * inner).ravel()
    inside = px**2 + py[:, None] ** 2 <= radius**2
    return inside.reshape(len(y) - 1, n, len(x) - 1, n).mean(axis=(1, 3)) * np.outer(
        np.diff(y), np.diff(x)
    )


@pytest.mark.diagonal
@pytest.mark.parametrize("radius", [0.2, 0.7, 3, 6.4])
@pytest.mark.parametrize("shift", [(0, 0), (0.5, 0.5), (0.31, -0.17)])
def test_disc_agrees_with_counting_points(radius, shift):
    x, y = np.arange(-8.0, 9) + shift[0], np.arange(-9.0, 10) + shift[1]
    area = disc_coverage(x, y, radius)
    assert_allclose(area, counted_disc(x, y, radius), atol=2e-3)
    assert_allclose(area.sum(), np.pi * radius**2, rtol=1e-13)


def test_disc_area_of_whole_quarter_and_segment():
    far = np.array([-9.0, 9])
    assert_allclose(disc_coverage(far, far, 2), 4 * np.pi)
    assert_allclose(disc_coverage(np.array([-9.0, 0, 9]), np.array([-9.0, 0, 9]), 2), np.pi)
    segment = 4 * np.arccos(1 / 2) - np.sqrt(3)  # of radius 2, beyond the distance 1
    assert_allclose(disc_coverage(np.array([1.0, 9]), far, 2), segment)
    assert_allclose(disc_coverage(far, np.array([1.0, 9]), 2), segment)
    assert_allclose(disc_coverage(far, np.array([-9.0, -1]), 2), segment)


def test_disc_coverage_is_exactly_0_outside_and_1_inside():
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


def test_box_area_is_exact():
    x = cell_edges(np.arange(-3.0, 4))
    assert_allclose(box_coverage(x, x, 3, 2).sum(), 6)
    assert_allclose(box_coverage(x, x, 3, 2)[3], [0, 0, 1, 1, 1, 0, 0])
    assert_allclose(box_coverage(x, x, 3, 2)[:, 3], [0, 0, 0.5, 1, 0.5, 0, 0])


def test_cells_split_the_pixels():
    assert_allclose(cell_edges(np.array([2.25, 3.25]), 2), [1.75, 2.25, 2.75, 3.25, 3.75])


# Polygons.


def clipped(vertices, axis, bound, side):
    """What of a polygon lies where side · (coordinate − bound) > 0: one step of Sutherland–Hodgman."""
    kept = []
    for a, b in zip(np.roll(vertices, 1, axis=0), vertices, strict=True):
        da, db = side * (a[axis] - bound), side * (b[axis] - bound)
        if (da > 0) != (db > 0):
            kept.append(a + (b - a) * da / (da - db))
        if db > 0:
            kept.append(b)
    return np.array(kept).reshape(-1, 2)


def shoelace(vertices):
    (x, y), (x2, y2) = vertices.T, np.roll(vertices, -1, axis=0).T
    return abs(np.sum(x * y2 - x2 * y)) / 2


def area_by_clipping(x, y, vertices):
    """Clip the polygon to every cell, one after another."""
    area = np.zeros((len(y) - 1, len(x) - 1))
    for j in range(len(y) - 1):
        for i in range(len(x) - 1):
            inside = vertices
            for axis, bound, side in (
                (0, x[i], 1),
                (0, x[i + 1], -1),
                (1, y[j], 1),
                (1, y[j + 1], -1),
            ):
                inside = clipped(inside, axis, bound, side)
            area[j, i] = shoelace(inside)
    return area


def regular(n, radius, turn=0.0, center=(0, 0)):
    angle = turn + 2 * np.pi * np.arange(n) / n
    return center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def star(turn):
    return regular(10, 6.0, turn) * np.where(np.arange(10) % 2, 0.4, 1)[:, None]


POLYGONS = {
    "triangle": regular(3, 5, 0.3),
    "triangle on the other hand": regular(3, 5, 1.1)[::-1],
    "sliver": np.array([[-6, -4.0], [6, 4.2], [6, 4.201]]),
    "corners on grid lines": regular(4, np.sqrt(8), np.pi / 4, (0.31, -0.17)),
    "star": star(0.2),
    "beyond the grid on all sides": regular(5, 30, 0.4),
    "around a corner of the grid": regular(6, 9, 0.2, (8, -9)),
    "across the left border": regular(5, 4, 0.3, (-8, 1)),
    "left of the grid": regular(4, 3, 0, (-15, 0)),
    "right of the grid": regular(4, 3, 0, (15, 0)),
    "within one cell": 0.01 * regular(3, 5, 0.3),
}


@pytest.mark.diagonal
@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("grid", [GRID, UNEVEN])
def test_polygon_agrees_with_clipping_it_to_each_cell(name, grid):
    vertices = POLYGONS[name]
    area = polygon_coverage(*grid, vertices)
    assert_allclose(area, area_by_clipping(*grid, vertices), atol=2e-12)
    assert_allclose(polygon_coverage(*grid, vertices[::-1]), area, atol=2e-12)


@pytest.mark.parametrize("turn", np.linspace(0, 2, 9))
def test_polygon_areas_sum_to_the_shoelace_area(turn):
    for vertices in (regular(3, 6, turn), star(turn), regular(4, 5, turn, (0.5, 0.25))):
        assert_allclose(polygon_coverage(*GRID, vertices).sum(), shoelace(vertices), atol=1e-10)


def test_upright_rectangle_equals_box():
    corners = np.array([[-2.2, -1.6], [2.2, -1.6], [2.2, 1.6], [-2.2, 1.6]])
    for grid in (GRID, UNEVEN):
        assert_allclose(polygon_coverage(*grid, corners), box_coverage(*grid, 4.4, 3.2), atol=1e-12)


def test_regular_polygon_approaches_disc():
    n = 4000
    corners = regular(n, 6.3 * np.sqrt(2 * np.pi / n / np.sin(2 * np.pi / n)))
    assert_allclose(polygon_coverage(*GRID, corners), disc_coverage(*GRID, 6.3), atol=1e-5)


def test_polygon_coverage_is_exactly_0_outside_and_1_inside():
    area = polygon_coverage(*GRID, regular(40, 6.1, 0.1))
    x, y = ((edges[1:] + edges[:-1]) / 2 for edges in GRID)
    away = np.hypot(x, y[:, None])
    assert np.all(area[away > 6.1 + 0.75] == 0)
    assert_allclose(area[away < 6.1 - 0.8], 1, rtol=1e-12)


def test_a_polygon_without_area_covers_nothing():
    assert not polygon_coverage(*GRID, np.array([[-3, -2.0], [3, 2], [-3, -2]])).any()

"""Sheets: exact areas of turned rectangles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.rendering.bodies import around, means, points_in

from blurmatte.rendering.coverage import box_coverage, cell_edges
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import AT_REST, Change, Pose

BLUE = np.array([0.1, 0.2, 0.7])
SHEET = Sheet(13.3, 6.1, BLUE)


def counted(sheet, x, y, pose, n=100):
    """Share of n × n points of every pixel that the sheet covers."""
    own = points_in(x, y, n) @ np.linalg.inv(pose.plane).T
    inside = np.all(np.abs(own) <= [sheet.width / 2, sheet.height / 2], axis=-1)
    return means(inside, x, y, n)


POSES = {
    "at rest": Change(),
    "turned in the picture": Change(turned=(0, 0, 0.6)),
    "turned in space": Change(turned=(0.7, -0.5, 0.3)),
    "seen from behind": Change(turned=(0, 2.6, 0.4)),
    "deformed": Change(turned=(0.7, -0.5, 0.3), scale=(1.4, 1), squash=(1.3, 1), squash_angle=0.8),
}


@pytest.mark.parametrize("name", POSES)
def test_agrees_with_counted_points(name):
    pose = POSES[name].at(0)
    x, y = around(SHEET, pose)
    coverage, light = SHEET.sharp(x, y, pose)
    assert_allclose(coverage, counted(SHEET, x, y, pose), atol=0.012)
    assert_allclose(coverage.sum(), 13.3 * 6.1 * abs(np.linalg.det(pose.plane)), rtol=1e-12)
    assert_allclose(light, coverage[..., None] * BLUE)
    assert_allclose(light @ SHEET.model.normals, 0, atol=1e-15)


def test_upright_sheet_equals_box():
    x, y = around(SHEET, AT_REST)
    box = box_coverage(cell_edges(x), cell_edges(y), 13.3, 6.1)
    assert_allclose(SHEET.sharp(x, y, AT_REST)[0], box, rtol=0, atol=0)
    a_little = Change(turned=(0, 0, 1e-9)).at(0)
    assert_allclose(SHEET.sharp(x, y, a_little)[0], box, atol=1e-7)


def test_a_quarter_turn_swaps_the_sides():
    quarter = Change(turned=(0, 0, np.pi / 2)).at(0)
    x, y = around(SHEET, quarter)
    swapped = Sheet(6.1, 13.3, BLUE).sharp(x, y, AT_REST)[0]
    assert_allclose(SHEET.sharp(x, y, quarter)[0], swapped, atol=1e-12)
    assert_allclose(SHEET.reach(quarter), (6.1 / 2, 13.3 / 2))


@pytest.mark.parametrize("axis", [(np.pi / 2, 0, 0), (0, np.pi / 2, 0)])
def test_edge_on_sheet_is_invisible(axis):
    coverage, light = SHEET.sharp(*around(SHEET, AT_REST), Change(turned=axis).at(0))
    assert_allclose(coverage, 0, atol=1e-12)
    assert_allclose(light, 0, atol=1e-12)


@pytest.mark.parametrize("turn", np.linspace(0, 6, 7))
def test_reach_is_the_extent_of_the_corners(turn):
    pose = Pose(Change(turned=(0.5, 0.2, turn)).at(0).rotation, 1.3 * np.eye(2))
    x, y = SHEET.reach(pose)
    corners = np.array([[1, 1], [1, -1]]) * [13.3 / 2, 6.1 / 2] @ pose.plane.T
    assert_allclose(np.abs(corners).max(axis=0), (x, y))


def test_repr_is_one_line():
    assert repr(Sheet(12, 7, BLUE)).startswith("Sheet(12x7, #")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((4, 0, BLUE), "height must be a positive number of pixels, got 0"),
        ((np.inf, 4, BLUE), "width must be a positive number of pixels, got inf"),
        ((4, 4, (0, 0, 0)), "color must be three linear values"),
    ],
)
def test_rejects_wrong_arguments(arguments, says):
    with pytest.raises(ValueError, match=says):
        Sheet(*arguments)

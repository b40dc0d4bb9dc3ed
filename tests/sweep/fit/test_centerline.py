"""Curves along the middle of a streak, from one end to the other."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.fit.centerline import center_curve, depth_of
from blurmatte.trajectory import Trajectory

SIZE = (140, 100)
LINE = Trajectory.line((28, 26), (112, 70))
ARC = Trajectory.arc((25, 75), (70, 25), (115, 75), points=200)
CORNER = Trajectory.bounce((25, 25), (70, 75), (115, 25))


def stroke(path, radius):
    """(h, w) bool, the pixels that a disc on a path touches."""
    x, y = np.meshgrid(*map(np.arange, SIZE))
    return np.any([np.hypot(x - a, y - b) <= radius for a, b in path.at(np.linspace(0, 1, 200))], 0)


def distance(points, path):
    curve = path.at(np.linspace(0, 1, 1000))
    return np.linalg.norm(points[:, None] - curve, axis=2).min(axis=1)


def ends_apart(curve, path):
    """Largest distance of the ends of a curve from those of a path, in the better direction."""
    ends = path.at([0, 1])
    return min(np.linalg.norm(curve[[i, -1 - i]] - ends, axis=1).max() for i in (0, -1))


@pytest.mark.parametrize("radius", [3, 8.5, 14])
@pytest.mark.parametrize("path", [LINE, ARC], ids=["line", "arc"])
def test_half_width_of_a_stroke_is_its_radius(path, radius):
    assert_allclose(depth_of(stroke(path, radius)).max(), radius, atol=1)


def test_half_width_is_also_of_masks_that_touch_the_border_and_of_one_pixel():
    assert depth_of(np.ones((7, 30), bool)).max() == 4
    assert depth_of(np.ones((1, 1), bool)).max() == 1


@pytest.mark.parametrize("part", [0.6, 0.8])
@pytest.mark.parametrize("path", [LINE, ARC, CORNER], ids=["line", "arc", "corner"])
def test_the_curve_goes_through_the_middle_of_a_stroke(path, part):
    radius = 8
    curve = center_curve(depth_of(stroke(path, radius)), part * radius)
    middle = curve[len(curve) // 5 : -len(curve) // 5]
    assert distance(middle, path).max() < (2.5 if path is CORNER else 1)
    assert ends_apart(curve, path) < (1 - part) * radius + 1.5


@pytest.mark.parametrize("path", [LINE, ARC], ids=["line", "arc"])
def test_its_points_are_equally_far_from_each_other(path):
    curve = center_curve(depth_of(stroke(path, 8)), 6)
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    assert_allclose(steps, steps.mean(), rtol=0.2)
    assert_allclose(steps.sum(), path.length, rtol=0.08)


def test_holes_in_a_streak_are_filled():
    mask = stroke(LINE, 8)
    holed = mask.copy()
    holed[44:48, 60:70] = False
    assert mask[44:48, 60:70].all()
    assert depth_of(holed).max() == depth_of(mask).max()
    assert_allclose(
        center_curve(depth_of(holed), 6), center_curve(depth_of(mask), 6), rtol=0, atol=0
    )


@pytest.mark.parametrize("part", [0.4, 0.8, 1.0])
def test_a_disc_alone_gives_a_short_line_through_its_middle(part):
    mask = stroke(Trajectory.line((60, 50), (60, 50)), 15)
    curve = center_curve(depth_of(mask), part * 15)
    assert np.all(np.isfinite(curve))
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    assert 15 * part / 2 - 0.1 < length < 2.5 * (1 - part) * 15 + 15 * part
    assert np.hypot(*(curve.mean(axis=0) - (60, 50))) < (1 - part) * 15 + 0.5


def test_disc_without_a_core_gives_a_line_of_half_its_radius_along_its_longer_axis():
    """A core of few pixels has no length, and the ellipse is perpendicular to the path."""
    x, y = np.meshgrid(*map(np.arange, SIZE))
    curve = center_curve(depth_of(np.hypot((x - 60) / 16, (y - 50) / 15) <= 1), 15)
    assert_allclose(curve[[0, -1], 1], 50, atol=1e-6)
    assert_allclose(sorted(curve[[0, -1], 0]), [60 - 15 / 4, 60 + 15 / 4], atol=1e-6)


def test_only_the_largest_piece_counts():
    mask = stroke(LINE, 8) | stroke(Trajectory.line((20, 85), (24, 85)), 8)
    assert_allclose(
        center_curve(depth_of(mask), 6),
        center_curve(depth_of(stroke(LINE, 8)), 6),
        rtol=0,
        atol=1e-9,
    )


def test_a_turned_picture_turns_the_curve():
    mask = stroke(LINE, 8)
    curve, turned = center_curve(depth_of(mask), 6), center_curve(depth_of(mask.T), 6)[:, ::-1]
    distance = min(np.abs(curve - turned).max(), np.abs(curve - turned[::-1]).max())
    assert distance < 2.5
    shifted = center_curve(depth_of(np.roll(mask, (5, -9), axis=(0, 1))), 6)
    assert_allclose(shifted, curve + np.array([-9, 5]), rtol=0, atol=1e-9)

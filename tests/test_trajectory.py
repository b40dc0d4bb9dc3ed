"""Trajectory: points, lengths, constant speed, and errors of wrong arguments."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.trajectory import Trajectory


def test_line_runs_at_constant_speed():
    line = Trajectory.line((10, 20), (13, 24))
    assert line.length == 5
    assert line.top_speed == 5
    assert_allclose(line.at(0.5), (11.5, 22))
    assert_allclose(line.at([[0, 1]]), [[(10, 20), (13, 24)]])


def test_at_is_linear_between_its_points_and_holds_at_the_ends():
    path = Trajectory(np.array([[0, 0], [4, 0], [4, 2]]), np.array([0, 0.8, 1]))
    assert path.length == 6
    assert path.top_speed == pytest.approx(10)
    assert_allclose(path.at([-1, 0.4, 0.9, 2]), [(0, 0), (2, 0), (4, 1), (4, 2)])


@pytest.mark.parametrize("middle", [(0, -5), (3, -4), (-4, 3), (0, 5), (-3, -4)])
def test_arc_lies_on_the_circle_through_its_points(middle):
    """Start (5, 0) and end (-5, 0) on the circle around the origin, via its middle."""
    arc = Trajectory.arc((5, 0), middle, (-5, 0), points=1001)
    assert_allclose(np.hypot(*arc.xy.T), 5)
    assert_allclose(arc.xy[[0, -1]], [(5, 0), (-5, 0)], atol=1e-12)
    assert np.linalg.norm(arc.xy - middle, axis=1).min() < 0.02
    assert_allclose(arc.length, 5 * np.pi, rtol=1e-5)
    assert_allclose(np.linalg.norm(np.diff(arc.xy, axis=0), axis=1), arc.length / 1000)


def test_arc_may_be_longer_than_half_a_circle():
    center, angles = np.array([30, 40]), np.radians([0, 200, 300])
    start, middle, end = center + 10 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    arc = Trajectory.arc(start, middle, end, points=2001)
    assert_allclose(arc.length, 10 * np.radians(300), rtol=1e-6)
    assert_allclose(np.linalg.norm(arc.xy - center, axis=1), 10)


def test_arc_through_points_on_a_line_is_that_line():
    arc = Trajectory.arc((0, 0), (1, 1), (4, 4))
    assert_allclose(arc.xy, [(0, 0), (4, 4)])


def test_parabola_is_a_throw():
    path = Trajectory.parabola((10, 50), (40, -30), (0, 60))
    assert_allclose(path.at([0, 0.5, 1]), [(10, 50), (30, 42.5), (50, 50)])
    assert_allclose(np.diff(path.xy, 2, axis=0), np.tile([0, 60 / 64**2], (63, 1)), atol=1e-12)


def test_parabola_along_its_velocity_is_an_accelerated_line():
    path = Trajectory.parabola((0, 0), (10, 0), (20, 0))
    assert_allclose(path.at(0.5), (7.5, 0))
    assert path.length == pytest.approx(20)
    assert path.top_speed == pytest.approx(30, rel=0.01)


def test_bounce_turns_at_its_contact():
    path = Trajectory.bounce((0, 0), (10, 10), (18, 4), at=0.25)
    assert_allclose(path.at([0.125, 0.25, 0.625]), [(5, 5), (10, 10), (14, 7)])


def test_from_rest_stays_and_then_moves():
    path = Trajectory.from_rest((3, 4), (9, 12), until=0.6)
    assert_allclose(path.at([0, 0.6, 0.8, 1]), [(3, 4), (3, 4), (6, 8), (9, 12)])
    assert path.length == 10


@pytest.mark.parametrize("t", [0, 0.3, 0.75, 1])
def test_part_follows_the_same_path(t):
    whole = Trajectory.arc((5, 0), (0, 5), (-5, 0))
    assert_allclose(whole.part(0.2, 0.9).at(t), whole.at(0.2 + 0.7 * t), atol=1e-12)
    assert len(whole.part(0, 1).t) == len(whole.t)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Trajectory.parabola((0, 0), (1, 1), (0, 1), points=2), "points must be 3"),
        (lambda: Trajectory.bounce((0, 0), (1, 1), (2, 0), at=1), "at must lie between 0 and 1"),
        (lambda: Trajectory.from_rest((0, 0), (1, 1), 0), "until must lie between 0 and 1"),
        (lambda: Trajectory.line((0, 0), (1, 1)).part(0.5, 0.5), "0 <= start < end <= 1"),
    ],
)
def test_constructors_reject_wrong_paths(make, says):
    with pytest.raises(ValueError, match=says):
        make()


def test_points_are_copied():
    xy = np.zeros((2, 2))
    path = Trajectory(xy, np.array([0, 1]))
    xy[:] = 7
    assert_allclose(path.xy, 0)


def test_repr_is_one_line():
    assert repr(Trajectory.line((1, 2), (4, 6))) == (
        "Trajectory((1.0, 2.0) to (4.0, 6.0), 5.0 px, 2 points)"
    )


@pytest.mark.parametrize(
    ("xy", "t", "says"),
    [
        ([[0, 0]], [0], r"xy must have the shape \(T, 2\)"),
        ([[0, 0, 0], [1, 1, 1]], [0, 1], "xy must have the shape"),
        ([[0, 0], [1, 1]], [0, 0.5, 1], "t must have the shape"),
        ([[0, 0], [np.nan, 1]], [0, 1], "xy must be finite"),
        ([[0, 0], [1, 1]], [0, 2], "t must increase from 0 to 1, got 0 to 2"),
        ([[0, 0], [1, 1], [2, 2]], [0, 0, 1], "t must increase"),
        ([[0, 0], [1, 1]], [0, np.nan], "t must increase"),
    ],
)
def test_rejects_wrong_arguments(xy, t, says):
    with pytest.raises(ValueError, match=says):
        Trajectory(np.array(xy), np.array(t))


def test_constructors_reject_wrong_arguments():
    with pytest.raises(ValueError, match="end must be one point"):
        Trajectory.line((0, 0), (1, 2, 3))
    with pytest.raises(ValueError, match="middle must lie between"):
        Trajectory.arc((0, 0), (9, 9), (4, 4))
    with pytest.raises(ValueError, match="must differ"):
        Trajectory.arc((1, 1), (9, 9), (1, 1))
    with pytest.raises(ValueError, match="points must be 3 or more"):
        Trajectory.arc((0, 0), (1, 2), (4, 4), points=2)

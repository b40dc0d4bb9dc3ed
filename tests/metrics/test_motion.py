"""TIoU: computed by hand, compared with a grid of points, and its invariances."""

import numpy as np
import pytest

from blurmatte.metrics import trajectory_iou
from blurmatte.trajectory import Trajectory

ARC = Trajectory.arc((10, 20), (40, 8), (70, 25))
BENT = Trajectory(np.array([[12, 22], [30, 10], [66, 20]]), np.array([0, 0.3, 1]))


def shifted(path, step):
    return Trajectory(path.xy + step, path.t)


def reverse(path):
    return Trajectory(path.xy[::-1], 1 - path.t[::-1])


def test_tiou_of_the_truth_is_one():
    assert trajectory_iou(ARC, ARC, 5) == pytest.approx(1, abs=1e-12)


def test_tiou_at_one_radius_equals_that_computed_by_hand():
    """The lens of two discs at a distance of one radius: (2π/3 − √3/2) r²."""
    lens = 2 * np.pi / 3 - np.sqrt(3) / 2
    score = trajectory_iou(shifted(ARC, (3, 4)), ARC, 5)
    assert score == pytest.approx(lens / (2 * np.pi - lens))


def test_tiou_at_two_radii_is_zero():
    line = Trajectory.line((0, 0), (40, 0))
    assert trajectory_iou(shifted(line, (0, 10)), line, 5) == 0
    assert trajectory_iou(shifted(line, (0, 10.1)), line, 5) == 0
    assert trajectory_iou(shifted(line, (0, 9.9)), line, 5) > 0


def test_tiou_is_the_mean_over_time():
    """A path at rest at the true start: full overlap at first, none at the other two times."""
    line, still = Trajectory.line((0, 0), (100, 0)), Trajectory.line((0, 0), (0, 0))
    assert trajectory_iou(still, line, 5, samples=3) == pytest.approx(1 / 3)


def test_tiou_agrees_with_points_on_a_grid():
    """Points of a fine grid in both discs over those in either."""
    y, x = np.mgrid[0:40:0.05, 0:90:0.05]

    def disc(center):
        return np.hypot(x - center[0], y - center[1]) < 7

    scores = []
    for t in np.linspace(0, 1, 4):
        a, b = disc(ARC.at(t)), disc(BENT.at(t))
        scores.append(np.sum(a & b) / np.sum(a | b))
    assert 0.2 < np.mean(scores) < 0.8
    assert trajectory_iou(BENT, ARC, 7, samples=4) == pytest.approx(np.mean(scores), abs=1e-3)


def test_tiou_does_not_depend_on_the_direction_of_time():
    score = trajectory_iou(BENT, ARC, 7)
    assert trajectory_iou(reverse(BENT), ARC, 7) == pytest.approx(score)
    assert trajectory_iou(BENT, reverse(ARC), 7) == pytest.approx(score)
    assert trajectory_iou(reverse(ARC), ARC, 7) == pytest.approx(1, abs=1e-12)


def test_tiou_depends_on_the_speed_along_the_path():
    """The right path at wrong times is wrong."""
    early = Trajectory(np.array([[0, 0], [50, 0], [100, 0]]), np.array([0, 0.2, 1]))
    assert trajectory_iou(early, Trajectory.line((0, 0), (100, 0)), 5) < 0.4


def test_tiou_is_invariant_to_scale_rotation_and_exchange():
    turn = 3 * np.array([[0.6, 0.8], [-0.8, 0.6]])
    a, b = (Trajectory(path.xy @ turn + (7, -9), path.t) for path in (BENT, ARC))
    score = trajectory_iou(BENT, ARC, 7)
    assert trajectory_iou(a, b, 21) == pytest.approx(score)
    assert trajectory_iou(ARC, BENT, 7) == pytest.approx(score)


def test_missing_path_scores_zero():
    assert trajectory_iou(None, ARC, 5) == 0


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ((ARC, ARC, 0), ValueError, "radius must be finite and above 0 pixels, got 0"),
        ((None, ARC, np.nan), ValueError, "radius must be finite"),
        ((ARC, ARC, 5, 1), ValueError, "samples must be 2 or more, got 1"),
        ((ARC.xy, ARC, 5), TypeError, "estimated must be a Trajectory, got ndarray"),
        ((ARC, None, 5), TypeError, "true must be a Trajectory, got NoneType"),
    ],
)
def test_rejects_wrong_arguments(arguments, error, says):
    with pytest.raises(error, match=says):
        trajectory_iou(*arguments)

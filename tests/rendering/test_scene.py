"""Scene and Shadow: what their doors refuse."""

import numpy as np
import pytest

from blurmatte.layer import Layer
from blurmatte.rendering import Ball, Scene
from blurmatte.rendering.scene import Shadow
from blurmatte.trajectory import Trajectory

BALL = Ball(4, (0.9, 0.5, 0.05))
PATH = Trajectory.line((5, 5), (9, 9))
PLATE = np.full((12, 16, 3), 0.5)


@pytest.mark.parametrize(
    ("plate", "path", "error", "says"),
    [
        (np.full((4, 4, 3), 128, np.uint8), PATH, TypeError, "plate must hold linear light"),
        (np.full((4, 4, 3), np.nan), PATH, ValueError, "plate must be finite"),
        (PLATE, [(0, 0), (1, 1)], TypeError, "trajectory must be a Trajectory, got list"),
    ],
)
def test_rejects_wrong_plate_and_trajectory(plate, path, error, says):
    with pytest.raises(error, match=says):
        Scene(plate, path, BALL)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"opacity": 0}, "opacity must be above 0 and at most 1, got 0"),
        ({"opacity": 1.1}, "opacity must be"),
        ({"opacity": np.nan}, "opacity must be"),
        ({"defocus": -1}, "defocus must be finite and not negative, got -1"),
        ({"defocus": np.inf}, "defocus must be"),
        ({"shutter_ramp": 0.6}, "shutter_ramp must lie between 0 and 0.5, got 0.6"),
        ({"occluder": Layer(np.ones((12, 15)), np.ones((12, 15, 3)))}, "occluder is 15x12"),
        ({"occluder": Layer(np.full((12, 16), 0.5), PLATE)}, "must be 0 or 1 in every pixel"),
    ],
)
def test_rejects_wrong_scene(wrong, says):
    with pytest.raises(ValueError, match=says):
        Scene(PLATE, PATH, BALL, **wrong)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"offset": (1, np.nan)}, "offset must be two finite numbers"),
        ({"offset": (1, 2), "softness": -1}, "softness must be finite and not negative"),
        ({"offset": (1, 2), "strength": (0.5, 0.5, 1.5)}, "strength must be three numbers 0…1"),
    ],
)
def test_rejects_wrong_shadow(wrong, says):
    with pytest.raises(ValueError, match=says):
        Shadow(**wrong)


@pytest.mark.parametrize(
    ("count", "duty", "says"), [(0, 1, "count must be 1 or more"), (3, 0, "duty must be above 0")]
)
def test_rejects_wrong_exposures(count, duty, says):
    with pytest.raises(ValueError, match=says):
        Scene(PLATE, PATH, BALL).exposures(count, duty)


def test_repr_is_one_line():
    text = repr(Scene(PLATE, PATH, BALL))
    assert text.startswith("Scene(16x12, Ball(radius 4")
    assert "\n" not in text

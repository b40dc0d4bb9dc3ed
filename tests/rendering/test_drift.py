"""Drift: shift, rotation and gain of known plates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.rendering import colorful_plate
from blurmatte.rendering.shot import Drift

SIZE = (72, 60)
INSIDE = np.s_[12:-12, 12:-12]


@pytest.fixture(scope="module")
def plate():
    return colorful_plate(SIZE, 1, tile=12)


def waves(x, y):
    """(..., 3) light of smooth waves, 9 pixels long and longer, at any point."""
    phases = (0.6 * x + 0.3 * y, 0.2 * x - 0.5 * y, 0.4 * x + 0.5 * y + 1)
    return 0.4 + 0.3 * np.stack([np.sin(phase) for phase in phases], axis=-1)


def grid():
    return np.meshgrid(*(np.arange(side, dtype=float) for side in SIZE))


def test_no_drift_returns_the_same_array(plate):
    assert Drift().apply(plate) is plate
    assert Drift((0, 0), 0, [1, 1, 1]) == Drift()


def test_whole_pixels_are_moved_right_and_down(plate):
    drifted = Drift(shift=(3, -2)).apply(plate)
    assert_allclose(drifted[1:-5, 8:-1], plate[3:-3, 5:-4], atol=1e-12)


@pytest.mark.parametrize("shift", [(0.4, 0), (0, -0.3), (2.5, 1.25)])
def test_shift_moves_a_pattern_of_known_light(shift):
    x, y = grid()
    drifted = Drift(shift).apply(waves(x, y))
    assert_allclose(drifted[INSIDE], waves(x - shift[0], y - shift[1])[INSIDE], atol=1e-4)


def test_rotation_turns_x_towards_y_about_the_center_and_then_shifts():
    """What is at p is found at center + R (p − center) + shift."""
    angle, shift, (x, y) = 0.03, (0.7, -0.4), grid()
    center = (np.array(SIZE) - 1) / 2
    back = [x - shift[0] - center[0], y - shift[1] - center[1]]
    turned = (
        center[0] + np.cos(angle) * back[0] + np.sin(angle) * back[1],
        center[1] - np.sin(angle) * back[0] + np.cos(angle) * back[1],
    )
    drifted = Drift(shift, angle).apply(waves(x, y))
    assert_allclose(drifted[INSIDE], waves(*turned)[INSIDE], atol=1e-4)


def test_a_quarter_turn_is_clockwise_on_the_screen():
    light = np.random.default_rng(0).uniform(size=(9, 9, 3))
    assert_allclose(Drift(rotation=np.pi / 2).apply(light), np.rot90(light, -1), atol=1e-12)


def test_inverse_drift_restores_the_plate():
    shift, light = np.array([0.37, -1.6]), waves(*grid())
    back = Drift(-shift).apply(Drift(shift).apply(light))
    assert_allclose(back[INSIDE], light[INSIDE], atol=1e-4)
    assert np.abs(Drift(shift).apply(light) - light)[INSIDE].max() > 0.1


def test_gain_alone_multiplies(plate):
    assert_array_equal(Drift(gain=(1.1, 1, 0.9)).apply(plate), plate * [1.1, 1, 0.9])


def test_gain_applies_after_the_shift(plate):
    moved = Drift((0.5, 0)).apply(plate)
    assert_allclose(Drift((0.5, 0), gain=(2, 1, 3)).apply(plate), moved * [2, 1, 3])


def test_light_is_never_clipped():
    light = np.zeros((20, 20, 3))
    light[:, 10:] = 2
    drifted = Drift((0.5, 0)).apply(light)
    assert drifted.min() < -0.05
    assert drifted.max() > 2.05


def test_dtype_is_preserved(plate):
    assert Drift((0.5, 0), gain=(1, 2, 1)).apply(plate.astype(np.float32)).dtype == np.float32


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"shift": (1, 2, 3)}, r"shift must be 2 finite numbers, got \[1.0, 2.0, 3.0\]"),
        ({"shift": (np.inf, 0)}, "shift must be 2 finite numbers"),
        ({"rotation": np.nan}, "rotation must be finite, got nan"),
        ({"gain": 1.1}, "gain must be 3 finite numbers, got 1.1"),
        ({"gain": (1, 0, 1)}, r"gain must be positive, got \[1.0, 0.0, 1.0\]"),
    ],
)
def test_rejects_wrong_arguments(settings, message):
    with pytest.raises(ValueError, match=message):
        Drift(**settings)


def test_rejects_wrong_light():
    with pytest.raises(TypeError, match="light must hold linear light as floats, got uint8"):
        Drift().apply(np.zeros((4, 4, 3), np.uint8))

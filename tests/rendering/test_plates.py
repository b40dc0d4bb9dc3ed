"""Plates: one hue, two hues, many; the seed decides."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.rendering import colorful_plate, plain_plate, two_hue_plate

FIRST, SECOND = np.array([0.5, 0.2, 0.1]), np.array([0.1, 0.2, 0.4])
PLATES = {
    "plain": lambda rng: plain_plate((90, 60), FIRST, rng),
    "two hues": lambda rng: two_hue_plate((90, 60), FIRST, SECOND, rng),
    "colorful": lambda rng: colorful_plate((90, 60), rng),
}


@pytest.mark.parametrize("name", PLATES)
def test_plates_are_light_of_their_size_and_seed(name):
    plate = PLATES[name](3)
    assert plate.shape == (60, 90, 3)
    assert plate.dtype == np.float64
    assert plate.min() > 0.01
    assert plate.max() < 0.85
    assert plate.tobytes() == PLATES[name](np.random.default_rng(3)).tobytes()
    assert plate.tobytes() != PLATES[name](4).tobytes()


def test_plain_plate_has_one_hue_and_some_texture():
    plate = PLATES["plain"](3)
    assert_allclose(np.cross(plate, FIRST), 0, atol=1e-15)
    assert_allclose([plate[..., 0].min(), plate[..., 0].max()], [0.55 * 0.5, 0.5])
    assert np.diff(plate[..., 0], axis=1).std() > 1e-3


def test_two_hue_plate_lies_on_the_segment():
    plate = PLATES["two hues"](3)
    share = (plate - FIRST) @ (SECOND - FIRST) / np.sum((SECOND - FIRST) ** 2)
    assert_allclose(plate, FIRST + share[..., None] * (SECOND - FIRST), atol=1e-14)
    assert 0 <= share.min() < 0.1
    assert 0.9 < share.max() <= 1


def test_colorful_plate_spreads_over_all_directions():
    """A streak across it meets colors far from one line and one plane."""
    plate = colorful_plate((200, 150), 3)
    direction = plate / np.linalg.norm(plate, axis=-1, keepdims=True)
    spread = np.linalg.svd(
        (direction - direction.mean(axis=(0, 1))).reshape(-1, 3), compute_uv=False
    )
    assert np.all(spread[:2] / np.sqrt(plate[..., 0].size) > 0.1)


def test_door():
    with pytest.raises(ValueError, match=r"size must be \(width, height\)"):
        colorful_plate((0, 10), 1)
    with pytest.raises(ValueError, match="tile must be positive"):
        colorful_plate((10, 10), 1, tile=0)
    with pytest.raises(ValueError, match="second must be three linear values"):
        two_hue_plate((10, 10), FIRST, (0, 0, 0), 1)
    with pytest.raises(TypeError, match="rng"):
        plain_plate((10, 10), FIRST)

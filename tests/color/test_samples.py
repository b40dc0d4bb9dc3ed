import numpy as np
import pytest
from tests.scenes import noisy, on_line

from blurmatte.color import core_colors, pick_colors
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.streaks import Streak

NOISE = NoiseModel(gain=2e-5, read_std=8e-4)
PAINT = np.array([0.9, 0.45, 0.05])


def photos(length, plate, noise=NOISE):
    """A noisy picture of a ball of radius 20 that moves by `length` pixels, plate and true alpha."""
    truth = on_line(plate, (90 - length / 2, 60), (90 + length / 2, 62), Ball(20, PAINT))
    return *noisy(truth, noise, 7), truth.layer.alpha


@pytest.fixture
def plate():
    return colorful_plate((180, 120), rng=3, tile=12)


def test_picks_are_the_pixels_within_the_radius():
    image = LinearImage(np.arange(60).reshape(4, 5, 3) / 60)
    picked = pick_colors(image, x=2, y=1, radius=1)
    expected = [image.rgb[y, x] for y, x in ((0, 2), (1, 1), (1, 2), (1, 3), (2, 2))]
    assert np.array_equal(picked, expected)


@pytest.mark.parametrize(("x", "y", "pixel"), [(4.4, 3.4, (3, 4)), (-0.4, 0.2, (0, 0))])
def test_nearest_pixel_is_always_included(x, y, pixel):
    image = LinearImage(np.arange(60).reshape(4, 5, 3) / 60)
    assert np.array_equal(pick_colors(image, x, y, radius=0), [image.rgb[pixel]])


@pytest.mark.parametrize("point", [(-1, 0), (0, -0.6), (5, 0), (0, 4), (np.nan, 0)])
def test_rejects_a_point_outside(point):
    image = LinearImage(np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match="must lie in the picture of 5x4"):
        pick_colors(image, *point)


def test_rejects_a_negative_radius():
    with pytest.raises(ValueError, match="radius must be"):
        pick_colors(LinearImage(np.zeros((4, 5, 3))), 1, 1, -1)


def test_clipped_pixels_are_excluded():
    valid = np.ones((4, 5), bool)
    valid[1, 2] = False
    image = LinearImage(np.ones((4, 5, 3)), valid=valid)
    assert len(pick_colors(image, 2, 1, 1)) == 4
    with pytest.raises(ColorModelError, match="is clipped; pick"):
        pick_colors(image, 2, 1, 0)


def test_core_is_opaque_and_has_the_color_of_the_paint(plate):
    image, empty, alpha = photos(12, plate)
    core = core_colors(image, empty)
    opaque = {tuple(color) for color in image.rgb[alpha > 0.95]}
    assert len(core) > 40
    assert np.mean([tuple(color) in opaque for color in core]) > 0.95
    model = ColorModel.from_samples(core, robust=True)
    assert np.degrees(np.arccos(model.pole @ PAINT / np.linalg.norm(PAINT))) < 1


@pytest.mark.parametrize("length", [60, 110])
def test_rejects_a_streak_without_an_opaque_core(plate, length):
    image, empty, alpha = photos(length, plate)
    assert alpha.max() < 0.8
    with pytest.raises(ColorModelError, match="no opaque core"):
        core_colors(image, empty)


def test_rejects_a_plate_without_texture():
    flat = plain_plate((180, 120), (0.3, 0.3, 0.25), rng=1) * 0 + 0.2
    image, empty, alpha = photos(12, flat)
    with pytest.raises(ColorModelError, match="too little texture"):
        core_colors(image, empty, Streak(alpha > 0))


def test_rejects_equal_pictures_and_other_sizes(plate):
    image, empty, _ = photos(12, plate)
    with pytest.raises(MotionError, match="nothing moved"):
        core_colors(empty, empty)
    with pytest.raises(ValueError, match="same size"):
        core_colors(image, LinearImage(empty.rgb[:50], NOISE))

"""Retouching changes the picture inside the streak only."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.background import Match
from blurmatte.compositing import remove, retouch
from blurmatte.matting import Pixelwise, solve
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import colorful_plate
from blurmatte.streaks import Streak


def exact(rendering):
    """The closed form of exact data, with noise far below rounding."""
    little = NoiseModel(read_std=1e-9)
    image, plate = (p.with_noise(little) for p in (rendering.image, rendering.plate))
    streak = Streak(rendering.layer.alpha > 0)
    return image, plate, solve(image, plate, rendering.model, Pixelwise(), streak=streak)


def test_unchanged_layer_gives_the_image_and_over_another_plate_the_scene_there(rendering):
    # exact, from the solution and not from the truth: 1/65535 and 1e-6
    image, plate, solution = exact(rendering)
    assert_allclose(solution.layer.over(plate).rgb, image.rgb, atol=1 / 65535)
    other = LinearImage(colorful_plate(image.size, 9, tile=11))
    truth = rendering.layer.over(other).rgb
    assert_allclose(solution.layer.over(other).rgb, truth, atol=1e-6)


def test_unchanged_layer_gives_the_same_picture(rendering):
    picture, changed = retouch(rendering.image, rendering.layer, rendering.layer)
    assert_array_equal(picture.rgb, rendering.image.rgb)
    assert not changed.any()


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_fading_in_the_picture_equals_fading_over_the_plate(rendering, factor):
    # exact
    faded = rendering.layer.fade(factor)
    picture, changed = retouch(rendering.image, rendering.layer, faded, rendering.plate)
    assert_allclose(picture.rgb, faded.over(rendering.plate).rgb, atol=1e-12)
    assert_array_equal(picture.rgb[~changed], rendering.image.rgb[~changed])
    assert_array_equal(changed, rendering.layer.alpha > 0)


def test_residual_of_the_layer_is_kept(paint):
    """Grain and shadow of the picture are in the faded picture."""
    grain = np.random.default_rng(3).normal(0, 0.01, paint.image.rgb.shape)
    image = replace(paint.image, rgb=paint.image.rgb + grain)
    faded = paint.layer.fade(0.5)
    picture, _ = retouch(image, paint.layer, faded, paint.plate)
    assert_allclose(picture.rgb - faded.over(paint.plate).rgb, grain, atol=1e-12)


def test_recoloring_needs_no_plate(paint):
    blue = paint.layer.recolor("#2040ff")
    without, _ = retouch(paint.image, paint.layer, blue)
    with_plate, _ = retouch(paint.image, paint.layer, blue, paint.plate)
    assert_allclose(without.rgb, with_plate.rgb, atol=1e-12)


def test_removal_gives_the_plate_inside_and_the_image_outside(rendering):
    # exact: bit-identical outside; the plate itself inside
    streak = rendering.layer.alpha > 0
    picture, changed = remove(rendering.image, rendering.plate, streak)
    assert_array_equal(changed, streak)
    assert_array_equal(picture.rgb[streak], rendering.plate.rgb[streak])
    assert_array_equal(picture.rgb[~streak], rendering.image.rgb[~streak])


def test_highlights_of_a_shifted_plate_replace_every_pixel_of_the_streak():
    """Clipped pixels and their neighbors in the interpolation are replaced as all others are."""
    rng = np.random.default_rng(5)
    rgb = rng.uniform(0.2, 0.9, (40, 60, 3))
    bright = rng.random((40, 60)) < 0.05
    rgb[bright] = 1.0
    plate = LinearImage(rgb, valid=~bright)
    image = replace(plate, rgb=np.zeros_like(rgb), valid=np.ones_like(bright))
    streak = np.zeros_like(bright)
    streak[8:32, 10:50] = True
    h = np.array([0, 0, 0.5 / 30, 0, 0, 0, 0, 0])  # half a pixel
    darker = replace(Match.nothing((60, 40)), h=h, light=0.98 * Match.nothing((60, 40)).light)
    picture, changed = remove(image, plate, streak, match=darker)
    assert_array_equal(changed, streak)
    assert_array_equal(picture.rgb.any(axis=-1), streak)


def test_pixels_unknown_in_the_plate_are_not_removed(paint):
    streak = paint.layer.alpha > 0
    valid = np.ones_like(streak)
    y, x = (part[0] for part in np.nonzero(streak))
    valid[y, x] = False
    plate = replace(paint.plate, valid=valid)
    picture, changed = remove(paint.image, plate, streak)
    assert not changed[y, x]
    assert_array_equal(picture.rgb[y, x], paint.image.rgb[y, x])


def test_rejects_wrong_arguments(paint):
    layer, image = paint.layer, paint.image
    with pytest.raises(ValueError, match="give the plate"):
        retouch(image, layer, layer.fade(0.5))
    with pytest.raises(ValueError, match="the edited layer"):
        retouch(image, layer, layer.crop((0, 0, 5, 5)))
    with pytest.raises(ValueError, match="the image"):
        retouch(image.crop((0, 0, 5, 5)), layer, layer)
    with pytest.raises(ValueError, match="the plate"):
        remove(image, paint.plate.crop((0, 0, 5, 5)), layer.alpha > 0)
    with pytest.raises(TypeError, match="streak"):
        remove(image, paint.plate, layer.alpha)

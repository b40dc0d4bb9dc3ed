"""Layers over backgrounds, and back in their own picture."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import on_line

from blurmatte.background import Match
from blurmatte.compositing import cover, light_gain, long_exposure, remove, retouch, stack
from blurmatte.layer import Layer
from blurmatte.matting import Pixelwise, solve
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, colorful_plate
from blurmatte.streaks import Streak

SIZE = (120, 70)
STOPS = [(20.0, 20.0), (45.0, 30.0), (70.0, 40.0), (95.0, 50.0)]


def test_background_of_equal_size_is_unchanged():
    picture = LinearImage(np.random.default_rng(0).uniform(size=(9, 7, 3)))
    assert cover(picture, (7, 9)) is picture


@pytest.mark.parametrize("size", [(40, 30), (30, 30), (10, 60), (200, 100), (1, 1), (81, 60)])
def test_background_of_any_size_keeps_its_light(size):
    picture = LinearImage(np.full((60, 80, 3), [0.2, 0.5, 7.0], np.float32))
    covered = cover(picture, size)
    assert covered.size == size
    assert covered.valid.all()
    assert_allclose(covered.rgb, np.broadcast_to([0.2, 0.5, 7.0], covered.rgb.shape), rtol=1e-5)


def test_background_is_scaled_around_its_center():
    x = np.broadcast_to(np.arange(80.0)[:, None], (60, 80, 3)).astype(np.float32)
    half = cover(LinearImage(x / 80), (30, 30))
    assert_allclose(
        80 * half.rgb[:, 3:-3, 0], np.tile(2 * np.arange(30) + 10.5, (30, 1))[:, 3:-3], atol=0.01
    )


def test_background_is_averaged_without_overshoot():
    checks = np.indices((64, 64)).sum(axis=0) % 2
    picture = LinearImage(checks[..., None].repeat(3, axis=-1).astype(np.float32))
    small = cover(picture, (8, 8)).rgb
    assert_allclose(small, 0.5, atol=0.02)
    step = LinearImage((picture.rgb * 0 + (np.arange(64) > 30)[:, None]).astype(np.float32))
    assert cover(step, (100, 100)).rgb.min() >= 0
    assert cover(step, (100, 100)).rgb.max() <= 1 + 1e-6


def test_invalid_pixels_stay_invalid():
    valid = np.ones((60, 80), bool)
    valid[30, 40] = False
    covered = cover(LinearImage(np.ones((60, 80, 3), np.float32), valid=valid), (40, 30))
    assert not covered.valid[15, 20]
    assert covered.valid.mean() > 0.98


def test_rejects_empty_sizes():
    with pytest.raises(ValueError, match="1 or more"):
        cover(LinearImage(np.ones((4, 4, 3))), (0, 5))


def test_light_gain_is_the_ratio_of_mean_light():
    plate = LinearImage(np.full((4, 6, 3), [0.1, 0.2, 0.4]))
    bright = LinearImage(np.full((3, 3, 3), [0.3, 0.2, 0.1]))
    assert_allclose(light_gain(bright, plate), [3, 1, 0.25])


def test_light_gain_excludes_invalid_pixels():
    rgb = np.full((2, 2, 3), 0.5)
    rgb[0, 0] = 50
    valid = np.array([[False, True], [True, True]])
    assert_allclose(light_gain(LinearImage(rgb, valid=valid), LinearImage(np.ones((1, 1, 3)))), 0.5)


def test_light_gain_rejects_pictures_without_light():
    black, white = LinearImage(np.zeros((2, 2, 3))), LinearImage(np.ones((2, 2, 3)))
    with pytest.raises(ValueError, match="no light on average"):
        light_gain(white, black)
    nothing = LinearImage(np.ones((2, 2, 3)), valid=np.zeros((2, 2), bool))
    with pytest.raises(ValueError, match="no pixel of the background is valid"):
        light_gain(nothing, white)


def flights():
    """A ball's path through three contiguous exposures."""
    plate = colorful_plate(SIZE, 3, tile=25)
    ball = Ball(9, (0.7, 0.35, 0.1))
    for start, end in pairwise(STOPS):
        yield on_line(plate, start, end, ball)


def test_stack_equals_layers_over_one_another():
    # oracle
    shots = list(flights())
    picture = shots[0].plate
    for shot in shots:
        picture = shot.layer.over(picture)
    together = stack(shot.layer for shot in shots)
    assert_allclose(together.over(shots[0].plate).rgb, picture.rgb, atol=1e-12)


def test_long_exposure_equals_a_rendering_of_that_exposure():
    """Exact up to time sampling: three contiguous exposures equal one of three times the length."""
    shots = list(flights())
    whole = long_exposure(shot.layer for shot in shots)
    truth = on_line(shots[0].plate.rgb, STOPS[0], STOPS[-1], Ball(9, (0.7, 0.35, 0.1)))
    assert_allclose(whole.alpha, truth.layer.alpha, atol=2e-3)
    assert_allclose(whole.over(truth.plate).rgb, truth.image.rgb, atol=2e-3)


def test_stack_of_one_layer_is_the_layer(paint):
    for verb in (stack, long_exposure):
        assert_allclose(verb([paint.layer]).premultiplied, paint.layer.premultiplied, atol=1e-15)


def test_one_layer_is_in_memory_at_a_time(paint):
    """Invariant: a layer may be released before the next is made."""
    made = []

    def layers():
        for _ in range(4):
            buffer = paint.layer.fade(1)
            yield buffer
            made.append(buffer.alpha.copy())
            buffer.alpha[...] = np.nan  # whoever still looks at it will notice
            buffer.premultiplied[...] = np.nan

    whole = long_exposure(layers())
    assert len(made) == 4
    assert_allclose(whole.alpha, paint.layer.alpha, atol=1e-15)


def test_rejects_wrong_arguments(paint):
    for verb in (stack, long_exposure):
        with pytest.raises(ValueError, match="there are no layers"):
            verb([])
        with pytest.raises(ValueError, match="layer 1 is 5x5 pixels and the first 192x128"):
            verb([paint.layer, paint.layer.crop((0, 0, 5, 5))])


def test_light_without_alpha_is_added():
    """Alpha of a stack is at most 1."""
    full = Layer(np.ones((1, 1)), np.full((1, 1, 3), 0.5))
    glow = Layer(np.zeros((1, 1)), np.full((1, 1, 3), 0.25))
    assert_allclose(stack([full, full, glow]).over(LinearImage(np.ones((1, 1, 3)))).rgb, 0.75)
    assert stack([full, full]).alpha == 1


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


def test_retouch_rejects_wrong_arguments(paint):
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

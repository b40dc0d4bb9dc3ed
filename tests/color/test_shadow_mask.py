"""cast_shadow_mask: pixels that are darker without light of the object."""

from functools import cache

import numpy as np
import pytest
from tests.scenes import photographed, rendered

from blurmatte.calibration import with_noise
from blurmatte.color.shadows import cast_shadow_mask, darkness, shadow_around
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import plain_plate, textured_plate
from blurmatte.rendering.scene import Shadow
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep import fit_sweep
from blurmatte.trajectory import Trajectory

SIZE = (192, 144)
GREEN = np.array([0.2, 0.6, 0.1])
ORANGE = np.array([0.8, 0.35, 0.06])
PLATES = {
    "plain": plain_plate(SIZE, (0.5, 0.42, 0.38), 4),
    "colorful": colorful_plate(SIZE, 2, tile=24),
    "textured": textured_plate(SIZE, 5),
}
PATH = Trajectory.line((60, 48), (120, 66))


@cache
def scene_of(plate, strength):
    """A ball, and its shadow unless it has no strength."""
    shadow = Shadow((8, 22), strength=(strength,) * 3) if strength else None
    return Scene(PLATES[plate], PATH, Ball(13, GREEN), shadow=shadow)


def taken(plate, seed=0, strength=0.5):
    """The truth, image and plate."""
    scene = scene_of(plate, strength)
    pictures = photographed(scene, Camera(code_std=1.5 / 255), seed, substeps=160)
    return rendered(scene, 160), *with_noise(*pictures)


def light_of(truth):
    """Unit color, and the light along it where the object is opaque."""
    pole, alpha = truth.model.pole, truth.layer.alpha
    return pole, float(np.sum(truth.layer.premultiplied @ pole * alpha) / np.sum(alpha**2))


@pytest.mark.parametrize("plate", PLATES)
def test_finds_the_shadow_without_most_of_the_object(plate):
    truth, image, without = taken(plate)
    alpha, shadow = truth.layer.alpha, truth.shadow.max(axis=-1)
    found = cast_shadow_mask(image, without, find_streaks(image, without)[0], *light_of(truth))
    assert np.mean(found[(shadow > 0.1) & (alpha == 0)]) > 0.95
    assert np.mean(found[(shadow < 0.01) & (alpha > 0.1)]) < 0.3


@pytest.mark.parametrize("plate", PLATES)
def test_a_shadow_is_found_before_the_object_is_fitted(plate):
    """Oracle: where only the shadow is, from the region in which the object's light is visible."""
    truth, image, without = taken(plate)
    alpha, shadow = truth.layer.alpha, truth.shadow.max(axis=-1)
    streak = Streak(alpha > 0.1)
    found = shadow_around(image, without, streak, truth.model.pole)
    assert np.mean(found[(shadow > 0.1) & (alpha == 0)]) > 0.9
    assert np.mean(found[(shadow < 0.01) & (alpha > 0.1)]) < 0.05
    truth, image, without = taken(plate, strength=0)
    assert not shadow_around(image, without, streak, truth.model.pole).any()


@pytest.mark.parametrize("plate", PLATES)
def test_without_a_shadow_nothing_is_found(plate):
    truth, image, without = taken(plate, strength=0)
    assert not cast_shadow_mask(
        image, without, find_streaks(image, without)[0], *light_of(truth)
    ).any()


@pytest.mark.parametrize("plate", PLATES)
def test_darkness_finds_the_shadow_without_a_color(plate):
    """Most of the shadow next to the object, and no pixel where the object adds light."""
    truth, image, without = taken(plate)
    alpha, shadow = truth.layer.alpha, truth.shadow.max(axis=-1)
    found = darkness(image, without, find_streaks(image, without)[0])
    assert np.mean(found[(shadow > 0.15) & (alpha == 0)]) > 0.9
    assert np.mean(found[(shadow < 0.01) & (alpha > 0.1)]) < 0.15


@pytest.mark.parametrize("seed", range(4))
def test_compression_noise_is_no_shadow(seed):
    """Honest: its noise is correlated over many pixels."""
    scene = Scene(plain_plate(SIZE, (0.3, 0.33, 0.36), seed), PATH, Ball(10, ORANGE))
    camera = Camera(code_std=1 / 255, jpeg_quality=95, chroma="4:2:0")
    image, without = with_noise(*photographed(scene, camera, seed, 5))
    streak = find_streaks(image, without)[0]
    assert not cast_shadow_mask(image, without, streak, *light_of(rendered(scene))).any()


def test_noise_is_no_shadow():
    """A region in which nothing moved."""
    truth, image, without = taken("plain", strength=0)
    still = Streak.from_box((130, 90, 180, 140), SIZE)
    assert not cast_shadow_mask(image, without, still, *light_of(truth)).any()


def test_black_object_has_no_shadow_mask():
    """For an object without light, all pixels would be shadow."""
    truth, image, without = taken("plain")
    streak = find_streaks(image, without)[0]
    assert not cast_shadow_mask(image, without, streak, truth.model.pole, 0.0).any()


def test_a_dark_streak_is_not_removed_completely():
    """Clipped pixels are no evidence of an object; a dilated rim must not cover all pixels."""
    light = np.asarray(PLATES["plain"], float)
    dark, valid = light.copy(), np.ones(light.shape[:2], bool)
    dark[40:60, 50:62] *= 0.5
    valid[40:60, 54:58] = False
    streak, noise = Streak.from_box((50, 40, 62, 60), SIZE), NoiseModel(read_std=0.003)
    image, plate = LinearImage(dark, noise, valid), LinearImage(light, noise)
    found = cast_shadow_mask(image, plate, streak, GREEN / np.linalg.norm(GREEN), 0.6)
    assert (streak.mask & ~found).any()


@pytest.mark.battery
@pytest.mark.parametrize("plate", PLATES)
def test_alpha_of_a_ball_excludes_its_shadow(plate):
    """honest: with the shadow fitted or excluded."""
    truth, image, without = taken(plate)
    sweep, true = fit_sweep(image, without), truth.layer.alpha
    assert not sweep.rejection
    assert np.sqrt(np.mean((sweep.alpha - true)[true > 0] ** 2)) < 0.012
    assert abs(sweep.alpha.sum() / true.sum() - 1) < 0.03
    assert abs(sweep.radius - 13) < 0.3

"""Projection of light on an object's color."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from blurmatte.color import (
    ColorModel,
    projected_energy,
    projection_vectors,
    projection_weights,
    streak_of_color,
)
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import Streak

NOISE = NoiseModel(gain=1e-12, read_std=0.01)
MODEL = ColorModel.from_hex("#20c040")


def before(plate, alpha, light):
    """A picture of (h, w) alpha and light along the model's color."""
    rgb = light[..., None] * MODEL.pole + (1 - alpha)[..., None] * plate.rgb
    return LinearImage(rgb, NOISE)


def plate_of(rng, shape=(20, 60)):
    return LinearImage(rng.uniform(0.2, 0.8, (*shape, 3)), NOISE)


def with_a_hand_and_a_ball(rng):
    """Streaks of any colors and of the model's color, in this order, with their image and plate."""
    plate = plate_of(rng)
    alpha, light = np.zeros((2, 20, 60))
    masks = np.zeros((2, 20, 60), bool)
    masks[0, 5:15, 5:15], masks[1, 5:15, 35:45] = True, True
    light[masks[1]], alpha[masks[1]] = 0.2, 0.4
    image = before(plate, alpha, light)
    image.rgb[masks[0]] = rng.uniform(0, 1, (100, 3))
    return *(Streak(mask) for mask in masks), image, plate


def test_projected_light_does_not_depend_on_alpha():
    rng = np.random.default_rng(0)
    plate = plate_of(rng)
    alpha, light = rng.uniform(0, 1, (2, 20, 60))
    image = before(plate, alpha, light)
    m = projection_vectors(plate, MODEL)
    assert_allclose(np.einsum("hwc,hwc->hw", m, image.rgb), light, rtol=0, atol=2e-5)


def test_variance_of_projected_light_is_that_of_noise():
    rng = np.random.default_rng(1)
    plate = plate_of(rng, (100, 100))
    image = before(plate, np.zeros((100, 100)), np.zeros((100, 100)))
    m = projection_vectors(plate, MODEL)
    weight = projection_weights(image, plate, m)
    noise = rng.normal(0, 0.01 * np.sqrt(2), image.rgb.shape)
    z = np.einsum("hwc,hwc->hw", m, noise) * np.sqrt(weight)
    assert_allclose(z.std(), 1, atol=0.03)
    assert abs(projected_energy(z, np.ones_like(weight), np.ones(z.shape, bool))) < 4 * np.sqrt(
        2 * z.size
    )


def test_light_of_another_color_projects_to_zero():
    hand, ball, image, plate = with_a_hand_and_a_ball(np.random.default_rng(3))
    assert streak_of_color([hand, ball], image, plate, MODEL) is ball


def test_streak_of_most_light_of_the_color_is_chosen():
    rng = np.random.default_rng(2)
    plate = plate_of(rng)
    alpha, light = np.zeros((2, 20, 60))
    masks = np.zeros((3, 20, 60), bool)
    for n, mask in enumerate(masks):
        mask[5:15, 5 + 20 * n : 15 + 20 * n] = True
    alpha[masks[0]] = 0.9  # a shadow: the strongest change
    light[masks[1]], alpha[masks[1]] = 0.05, 0.1
    light[masks[2]], alpha[masks[2]] = 0.2, 0.4
    shadow, faint, bright = streaks = [Streak(mask) for mask in masks]
    image = before(plate, alpha, light)
    assert streak_of_color(streaks, image, plate, MODEL) is bright
    assert streak_of_color(streaks[:2], image, plate, MODEL) is faint
    assert streak_of_color(streaks, image, plate, ColorModel.any()) is shadow


def test_a_streak_that_may_be_noise_is_chosen_only_if_all_may():
    """Before a plate of nearly the object's hue its own streak has little energy of the color."""
    object_, other, image, plate = with_a_hand_and_a_ball(np.random.default_rng(2))
    noise = replace(other, expected_false=3.0)
    assert streak_of_color([object_, noise], image, plate, MODEL) is object_
    both = [replace(object_, expected_false=3.0), noise]
    assert streak_of_color(both, image, plate, MODEL) is noise

"""CastShadow: the light that it removes from the plate."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.testing import assert_allclose
from tests.sweep.scenes import within

from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Scene, render
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.scene import Shadow
from blurmatte.streaks import Streak
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.model.path import LINE
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.42, 0.41, 0.4), 4)
PATH = Trajectory.line((60, 48), (96, 58))
RADIUS = 12.0
SHADOW = Shadow((-9.0, 15.0), softness=3.5, strength=(0.5, 0.45, 0.4))
CAST = CastShadow(SHADOW.offset, SHADOW.softness, SHADOW.strength)


@cache
def observed(shadow=SHADOW):
    """Truth and observation of a streak with all of its shadow, without noise."""
    truth = render(Scene(WALL, PATH, Ball(RADIUS, GREEN), shadow=shadow), 256)
    moved = (truth.layer.alpha > 0) | (truth.shadow.max(axis=-1) > 0.002)
    image, plate = (
        LinearImage(x.rgb, np.full_like(x.rgb, 1e-6)) for x in (truth.image, truth.plate)
    )
    return truth, observation_around(Streak(moved), 8, image, plate, ColorPrior(np.eye(3)))


def missing(observation):
    return CAST.missing(LINE, PATH.xy.ravel(), RADIUS, observation.pixels)


def test_missing_light_is_that_of_a_rendered_shadow():
    """oracle: the silhouette, shifted and blurred, at many moments, outside the object."""
    truth, observation = observed()
    S = missing(observation)
    assert_allclose(S[..., None] * CAST.strength, within(observation, truth.shadow), atol=0.003)


def test_a_shadow_darkens_the_plate():
    """exact: the image is (1 − α) times that plate."""
    rng = np.random.default_rng(0)
    alpha, B = rng.uniform(0, 0.9, (5, 6)), rng.uniform(0.1, 0.9, (5, 6, 3))
    S = rng.uniform(0, 1, alpha.shape) * (1 - alpha)
    left = (1 - alpha)[..., None] * CAST.on(B, S, alpha)
    assert_allclose(left, (1 - alpha[..., None] - S[..., None] * CAST.strength) * B, rtol=1e-10)


def test_coarse_pixels_have_the_mean_of_fine_ones():
    """invariant"""
    _, observation = observed()
    coarse = observation.coarser(2)
    small = missing(observation)
    h, w = (2 * (n // 2) for n in small.shape)
    means = small[:h, :w].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3))
    assert_allclose(missing(coarse), means, atol=0.02)


def test_is_possible_bounds_the_strength():
    assert CAST.is_possible
    for strength in ((0, 0.6, 0.5), (0.04, 0, 0), (0.01, 0.01, 0.01), (0.93, 0.7, 1)):
        assert not replace(CAST, strength=strength).is_possible

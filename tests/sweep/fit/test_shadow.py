"""A disc and its cast shadow: joint search, and comparison with a disc alone."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered
from tests.sweep.scenes import CAMERA, GREEN, ONE_PAINT, alpha_error, within

from blurmatte.calibration import with_noise
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Ball, Scene
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.plates import plain_plate, textured_plate
from blurmatte.rendering.pose import Change
from blurmatte.rendering.scene import Shadow
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.multistart import Multistart, start_along
from blurmatte.sweep.fit.outline import fit_outline
from blurmatte.sweep.fit.shadow import fit_cast, fit_with_shadow, in_shadow, may_be_shaded
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.model.path import LINE
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
RADIUS = 12.0
BOUNDS = 4.0, 40.0
WALL = plain_plate(SIZE, (0.42, 0.41, 0.4), 4)
PATH = Trajectory.line((60, 48), (96, 58))
SHADOW = Shadow((-9.0, 15.0), softness=3.5, strength=(0.5, 0.45, 0.4))
BALL = Scene(WALL, PATH, Ball(RADIUS, GREEN, ambient=1.0), shadow=SHADOW)


def observed(scene, seed=None):
    """Alpha and observation of a streak with its shadow, without noise if there is no seed."""
    truth = rendered(scene, 160)
    moved = truth.layer.alpha > 0
    if scene.shadow is not None:
        moved |= truth.shadow.max(axis=-1) > 0.002
    if seed is None:
        pictures = (x.with_noise(NoiseModel(read_std=1e-3)) for x in (truth.image, truth.plate))
    else:
        pictures = with_noise(*photographed(scene, CAMERA, seed, substeps=160))
    observation = observation_around(Streak(moved), 8, *pictures, ONE_PAINT)
    return within(observation, truth.layer.alpha), observation


def search_of(observation):
    """A search without curves of its own: all fits start from a disc."""
    coarse = observation.coarse_enough(RADIUS, 4.0)
    return Multistart(observation, coarse, (), BOUNDS, np.array(SIZE) / 2)


def true_disc(observation):
    return start_along(observation, LINE, PATH.xy[[0, -1]].ravel(), RADIUS)


@pytest.mark.parametrize("start", [None, CastShadow((-14.0, 9.0), 6.0, 3 * (0.1,))])
@pytest.mark.parametrize("offset", [(-9.0, 15.0), (4.0, 18.0), (-16.0, -9.0)])
def test_the_shadow_of_a_known_disc_is_found(start, offset):
    """exact: also if one coordinate of the first offset is 0, as straight below."""
    if start is not None:
        start = replace(start, offset=np.add(offset, (4, -5)))
    _, observation = observed(replace(BALL, shadow=replace(SHADOW, offset=offset)))
    disc = true_disc(observation)
    true = CastShadow(tuple(offset), SHADOW.softness, SHADOW.strength)
    disc = disc.relit(in_shadow(observation, disc, true))  # so that its color is the true one
    found = fit_cast(observation, disc, start)
    assert_allclose(found.offset, offset, atol=0.25)
    assert_allclose(found.softness, SHADOW.softness, atol=0.4)
    assert_allclose(found.strength, SHADOW.strength, atol=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_a_disc_without_a_shadow_casts_none(seed):
    """honest"""
    scene = replace(BALL, plate=textured_plate(SIZE, 2), shadow=None)
    _, observation = observed(scene, seed)
    disc = minimize(true_disc(observation), BOUNDS)
    assert not fit_cast(observation, disc).is_possible
    assert fit_with_shadow(disc, search_of(observation), disc) is None


@pytest.mark.parametrize(
    "offset", [(-9.0, 15.0), (0.0, 20.0), (14.0, 12.0)], ids=["behind", "below", "ahead"]
)
def test_disc_and_shadow_are_found_together(offset):
    """honest: from the best disc alone, which is wrong."""
    alpha, observation = observed(replace(BALL, shadow=replace(SHADOW, offset=offset)), 1)
    alone = minimize(true_disc(observation), BOUNDS)
    disc, cast = fit_with_shadow(alone, search_of(observation), alone)
    assert alpha_error(disc.swept.alpha, alpha) < 0.006 < alpha_error(alone.swept.alpha, alpha)
    assert np.linalg.norm(np.subtract(cast.offset, offset)) < 1
    assert disc.cost < alone.cost


def test_the_search_for_a_shadow_ends_where_there_is_none(monkeypatch):
    """cost: rounds that gain nothing are not repeated up to their limit."""
    _, observation = observed(replace(BALL, shadow=None), seed=0)
    disc = minimize(true_disc(observation), BOUNDS)
    fits = []
    monkeypatch.setattr(
        "blurmatte.sweep.fit.shadow.fit_cast", lambda *at: fits.append(at) or fit_cast(*at)
    )
    assert fit_with_shadow(disc, search_of(observation), disc) is None
    assert 2 <= len(fits) <= 8  # of two starts with up to ten rounds each


def test_a_shadow_is_refined_only_if_it_may_become_the_likeliest():
    """cost: to a tall sheet and its shadow an outline fits better than a disc with a shadow."""
    _, observation = observed(Scene(WALL, PATH, Sheet(22, 38, GREEN), shadow=SHADOW), 1)
    disc = minimize(true_disc(observation), BOUNDS)
    search = search_of(observation)
    assert fit_with_shadow(disc, search, disc) is not None
    assert fit_with_shadow(disc, search, fit_outline(disc)) is None


def test_the_disc_is_in_the_observation_with_its_shadow():
    """exact"""
    _, observation = observed(BALL, 1)
    alone = minimize(true_disc(observation), BOUNDS)
    disc, cast = fit_with_shadow(alone, search_of(observation), alone)
    expected = in_shadow(observation, disc, cast).B
    assert np.abs(disc.observation.B - expected).max() < 0.02
    assert disc.observation.C is observation.C


def test_in_shadow_changes_the_plate_alone():
    """invariant: noise and image are unchanged."""
    _, observation = observed(BALL)
    cast = CastShadow(SHADOW.offset, SHADOW.softness, SHADOW.strength)
    shaded = in_shadow(observation, true_disc(observation), cast)
    assert shaded.C is observation.C
    assert shaded.B_variance is observation.B_variance
    assert np.all(shaded.B <= observation.B)
    assert np.any(shaded.B < 0.8 * observation.B)


@pytest.mark.parametrize(
    ("scene", "shaded"),
    [
        (BALL, True),
        (replace(BALL, shadow=None, change=Change(squash=(1.5, 1.5), squash_angle=0.6)), False),
    ],
)
def test_a_shadow_could_be_as_likely_as_an_outline_only_where_there_is_one(scene, shaded):
    _, observation = observed(scene, seed=5)
    disc = minimize(true_disc(observation), BOUNDS)
    outline = minimize(disc.of_kind(replace(disc.silhouette, order=2)), BOUNDS)
    assert (outline.variance_inflation > 1.2) == shaded
    assert may_be_shaded(disc, outline) == shaded

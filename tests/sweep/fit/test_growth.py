"""fit_growing: growth of a disc if the data require it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.sweep.scenes import (
    BALLS,
    BOUNDS,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    ONE_PAINT,
    TILES,
    WALL,
    along,
    disc_at,
    error,
    observed,
)

from blurmatte.rendering import Ball, Scene
from blurmatte.rendering.pose import Change
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.outline import fit_growing, growing
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, LINE, PARABOLA

NEARER = Scene(WALL, along(LINE), Ball(10, GREEN, ambient=1.0), Change(scale=(0.75, 1.35)))
AWAY = Scene(TILES, along(ARC), Ball(10, GREEN, ambient=1.0), Change(scale=(1.4, 0.8)))
CURVED = Scene(TILES, along(CUBIC), Ball(10, GREEN, ambient=1.0), Change(scale=(0.75, 1.35)))


@cache
def disc_of(scene, family, seed=0):
    """The disc that fits best near the true path."""
    return minimize(disc_at(observed(scene, seed, color=ONE_PAINT), family), BOUNDS)


@pytest.mark.parametrize(
    ("scene", "family"),
    [(NEARER, LINE), (AWAY, ARC), (CURVED, CUBIC)],
    ids=["nearer", "away", "nearer on a cubic"],
)
def test_a_ball_that_comes_nearer_grows(scene, family):
    """exact up to noise: the logarithm of the ratio of sizes, and the mean size."""
    disc = disc_of(scene, family)
    state = fit_growing(disc, BOUNDS)
    assert state.silhouette.name == "growing disc"
    first, last = scene.change.scale
    ahead = np.sign((state.curve[-1] - state.curve[0]) @ (disc.curve[-1] - disc.curve[0]))
    assert_allclose(ahead * state.shape[1], np.log(last / first), atol=0.06)
    assert_allclose(state.shape[0], 10 * (first + last) / 2, rtol=0.03)
    assert error(state, scene) < 0.01 < 0.02 < error(disc, scene)
    assert state.variance_inflation < 1.5 < disc.variance_inflation


@pytest.mark.parametrize("family", [LINE, ARC, PARABOLA, CUBIC, BOUNCE], ids=lambda f: f.name)
@pytest.mark.parametrize("scenes", [FLAT, FLAT_BEFORE_TILES], ids=["wall", "tiles"])
@pytest.mark.parametrize(
    "seeds", [range(1), pytest.param(range(1, 3), marks=pytest.mark.battery)], ids=["one", "more"]
)
def test_a_ball_that_keeps_its_size_does_not_grow(scenes, family, seeds):
    """honest: neither noise nor a path of varying speed gives growth."""
    for seed in seeds:
        disc = disc_of(scenes[family], family, seed)
        assert fit_growing(disc, BOUNDS) is disc


@pytest.mark.parametrize("family", [LINE, PARABOLA], ids=lambda f: f.name)
def test_a_shaded_ball_hardly_grows(family):
    """honest: shading that the color field does not follow may give a little."""
    state = fit_growing(disc_of(BALLS[family], family), BOUNDS)
    assert abs(state.silhouette.rates(state.shape)[0]) < 0.1


def test_the_rim_stays_as_soft_as_that_of_the_disc():
    disc = disc_of(NEARER, LINE)
    soft = disc.of_kind(replace(disc.silhouette, soft=True))
    for start in growing(soft.moved(soft.path, np.array([disc.shape[0], 0.8]))):
        assert start.silhouette.soft
        assert start.shape[-1] == 0.8


def test_starts_include_both_signs_of_growth():
    disc = disc_of(NEARER, LINE)
    rates = [start.silhouette.rates(start.shape)[0] for start in growing(disc)]
    assert sorted(set(rates)) == [-0.5, 0.5]
    assert {start.family for start in growing(disc)} == {LINE, PARABOLA}

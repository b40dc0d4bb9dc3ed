"""Levenberg–Marquardt: from a perturbed start to the rendered path and radius."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.sweep.scenes import (
    BOUNDS,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    NEUTRAL,
    ONE_PAINT,
    RADIUS,
    RED,
    alpha_error,
    degrees_between,
    disc_at,
    exact,
    path_error,
    rendered,
    within,
)
from tests.sweep.scenes import TIMES as T

from blurmatte.color.model import ColorModel
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE
from blurmatte.sweep.model.state import state_at

SMOOTH = [LINE, ARC, PARABOLA, CUBIC, BOUNCE]


def turned_by(color, degrees):
    """A color rotated by an angle."""
    away = np.cross(color, [0.2, -0.5, 1])
    return color + np.tan(np.radians(degrees)) * np.linalg.norm(color) * away / np.linalg.norm(away)


@pytest.mark.diagonal
@pytest.mark.parametrize("color", [ONE_PAINT, NEUTRAL], ids=["one paint", "any colors"])
@pytest.mark.parametrize("family", SMOOTH, ids=lambda family: family.name)
@pytest.mark.parametrize("scenes", [FLAT, FLAT_BEFORE_TILES], ids=["wall", "tiles"])
def test_exact_light_gives_the_exact_path(family, scenes, color):
    """exact"""
    observation = exact(scenes[family], color)
    start = disc_at(observation, family, (1.5, -1), 1.15 * RADIUS)
    end = minimize(start, BOUNDS)
    assert end.converged
    assert end.cost < start.cost
    assert path_error(family.at(end.path, T)[0], family) < 0.05
    assert_allclose(end.shape, [RADIUS], atol=0.02)
    assert degrees_between(end.mean_color, GREEN) < 0.1
    true = within(observation, rendered(scenes[family]).layer.alpha)
    assert alpha_error(end.swept.alpha, true) < 2e-3


@pytest.mark.diagonal
@pytest.mark.parametrize("offset", [(0, 0), (4, 3), (-15, 9), (60, -30)])
@pytest.mark.parametrize("factor", [0.5, 1, 2])
def test_the_cost_never_increases(offset, factor):
    """invariant"""
    start = disc_at(exact(FLAT[LINE], ONE_PAINT), LINE, offset, factor * RADIUS)
    assert minimize(start, BOUNDS).cost <= start.cost


def test_a_converged_state_stays():
    """invariant"""
    end = minimize(disc_at(exact(FLAT[ARC], ONE_PAINT), ARC, 1, 1.1 * RADIUS), BOUNDS)
    again = minimize(end, BOUNDS)
    assert again.converged
    assert_allclose(again.path, end.path, atol=0.01)
    assert again.cost > end.cost - 0.02


def test_a_radius_at_a_bound_has_not_converged():
    observation = exact(FLAT[LINE], ONE_PAINT)
    assert minimize(disc_at(observation, LINE, 1, 0.7 * RADIUS), BOUNDS).converged
    for factor, bounds, held in ((0.7, (3, 9), 9), (1.5, (14, 40), 14)):
        end = minimize(disc_at(observation, LINE, 1, factor * RADIUS), bounds)
        assert end.shape[0] == held
        assert not end.converged


def test_no_step_is_taken_beyond_the_maximum():
    start = disc_at(exact(FLAT[LINE], ONE_PAINT), LINE, 2.0)
    assert minimize(start, BOUNDS, 0) is start
    assert not minimize(start, BOUNDS, 1).converged


def test_a_large_tolerance_ends_earlier():
    start = disc_at(exact(FLAT[LINE], ONE_PAINT), LINE, 2.0)
    rough, fine = (minimize(start, BOUNDS, tolerance=t) for t in (1e4, 1e-2))
    assert fine.cost < rough.cost <= start.cost
    assert rough.converged


def test_an_extreme_shape_has_not_converged():
    observation = exact(FLAT[LINE], ONE_PAINT)
    disc = disc_at(observation, LINE, 1, 1.1 * RADIUS)
    for stretch, converged in ((2.5, False), (0.2, True)):
        shape = ELLIPSE.like(DISC, disc.shape)
        shape[1] = stretch
        end = minimize(state_at(observation, LINE, disc.path, ELLIPSE, shape), BOUNDS)
        assert end.converged is converged


def known(color, std):
    """A prior of a color known to `std` radians in each direction."""
    pole = color / np.linalg.norm(color)
    covariance = std**2 * (np.eye(3) - np.outer(pole, pole))
    return ColorPrior.of(ColorModel(pole[:, None], covariance, {}))


def test_a_known_color_is_kept():
    """Also against the light."""
    wrong = turned_by(GREEN, 4)
    observation = exact(FLAT_BEFORE_TILES[LINE], known(wrong, 0))
    end = minimize(disc_at(observation, LINE, 2, 1.1 * RADIUS), BOUNDS)
    assert degrees_between(end.mean_color, wrong) < 0.1


def test_a_color_that_is_hardly_known_is_estimated():
    vague = known(turned_by(GREEN, 4), 0.5)
    end = minimize(disc_at(exact(FLAT_BEFORE_TILES[LINE], vague), LINE, 2, 1.1 * RADIUS), BOUNDS)
    found = end.observation.color.axes @ end.field.colors.mean(axis=0)
    assert degrees_between(found, GREEN) < 0.3
    assert degrees_between(found, RED) > 10


def test_coarse_pixels_give_the_same_path():
    """invariant"""
    fine = minimize(disc_at(exact(FLAT[LINE], ONE_PAINT), LINE, 1, 1.1 * RADIUS), BOUNDS)
    coarse = minimize(fine.on(fine.observation.coarser(3)), BOUNDS)
    assert_allclose(coarse.path, fine.path, atol=0.05)
    assert_allclose(coarse.shape, fine.shape, atol=0.05)


def test_shifted_pictures_give_a_shifted_path():
    """invariant: by whole pixels, to the tolerance."""
    observation = exact(FLAT[LINE], ONE_PAINT)
    x0, y0 = observation.origin
    shifted = replace(observation, origin=(x0 + 7, y0 - 5))
    one = minimize(disc_at(observation, LINE, 1, 1.1 * RADIUS), BOUNDS)
    start = disc_at(observation, LINE, 1, 1.1 * RADIUS)
    offset = np.array([7.0, -5, 7, -5])
    other = state_at(shifted, LINE, start.path + offset, DISC, start.shape)
    assert_allclose(minimize(other, BOUNDS).path, one.path + offset, atol=1e-3)


def test_a_start_outside_the_picture_stays():
    lost = disc_at(exact(FLAT[LINE], ONE_PAINT), LINE, (-900, 0))
    assert not lost.swept.alpha.any()
    end = minimize(lost, BOUNDS)
    assert not end.converged
    assert_array_equal(end.path, lost.path)

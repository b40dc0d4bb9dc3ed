"""State: its cost, derivatives, and conversion to other observations and families."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.sweep.scenes import (
    BALL,
    BALLS,
    BEFORE_TILES,
    FLAT,
    FLAT_BEFORE_TILES,
    GREEN,
    NEUTRAL,
    ONE_PAINT,
    degrees_between,
    disc_at,
    exact,
    observed,
    rendered,
    residuals_of,
)

from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import ELLIPSE, Silhouette
from blurmatte.sweep.model.state import state_at
from blurmatte.sweep.model.student_t import loss, student_weight

every_family = pytest.mark.parametrize("family", BALLS, ids=lambda family: family.name)


def moved_by(state, change):
    """The state with other parameters of path and shape, as one array."""
    n = len(state.path)
    return state.moved(state.path + change[:n], state.shape + change[n:])


def test_the_cost_is_the_loss_of_residuals_and_the_cost_of_the_field():
    observation = observed(BALL)
    state = disc_at(observation, offset=(1.0, -0.5))
    chi2 = (state.e**2).sum(axis=0)
    expected = np.sum(observation.weight * loss(chi2, 3)) + state.field.cost
    assert_allclose(state.cost, expected, rtol=1e-12)
    assert_allclose(state.weights, observation.weight * student_weight(chi2, 3))
    assert_allclose(state.chi2, chi2)


def numeric_gradient(state, function, step=1e-3):
    """(size,) derivatives of a function of a state by its parameters."""
    steps = step * np.eye(state.size)
    return np.array(
        [(function(moved_by(state, d)) - function(moved_by(state, -d))) / (2 * step) for d in steps]
    )


@pytest.mark.diagonal
@pytest.mark.parametrize("color", [NEUTRAL, ONE_PAINT], ids=["any colors", "one paint"])
@every_family
def test_the_gradient_is_that_of_the_loss(family, color):
    """oracle: finite differences at fixed colors, at which the cost is stationary."""
    observation = observed(BEFORE_TILES[family], color=color)
    state = disc_at(observation, family, (1.0, -0.7), 11.6)

    def loss_at(other):
        e = residuals_of(state, state.observation, other.swept.alpha)
        return np.sum(observation.weight * loss((e**2).sum(axis=0), 3))

    H, g = state.information()
    scale = np.sqrt(np.diag(H))  # the gradient in units of one standard deviation
    expected = numeric_gradient(state, loss_at) / scale
    assert_allclose(g / scale, expected, atol=0.03 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("family", [LINE, BOUNCE], ids=lambda family: family.name)
def test_the_gradient_vanishes_where_the_cost_is_least(family, seed):
    """oracle: within half a standard deviation of each parameter, at the truth."""
    state = disc_at(observed(FLAT[family], seed, color=ONE_PAINT), family)
    H, g = state.information()
    covariance = np.linalg.inv(H)
    off = covariance @ (g - numeric_gradient(state, lambda other: other.cost, 1e-2))
    assert np.abs(off / np.sqrt(np.diag(covariance))).max() < 0.5


@every_family
def test_the_curvature_is_that_of_the_gradient(family):
    """oracle: small steps at the truth of a scene without noise, where residuals are about 0.

    The mean color is free, so that brightness and radius may be exchanged; the declared noise is such
    that this is what the radius is known from.
    """
    state = disc_at(exact(FLAT_BEFORE_TILES[family], ONE_PAINT).raised(25), family)
    H, _ = state.information()
    numeric = numeric_gradient(state, lambda other: other.information()[1])
    scale = np.sqrt(np.diag(H))
    off = (H - (numeric + numeric.T) / 2) / np.outer(scale, scale)
    smooth = np.ones(state.size, bool)
    smooth[len(state.path) - 1] = family.kink(state.path) is None  # times of a kink are discrete
    assert np.abs(off[np.ix_(smooth, smooth)]).max() < 0.04
    assert_allclose(H, H.T, rtol=1e-9, atol=1e-9 * np.abs(H).max())


def test_the_curvature_has_no_negative_direction():
    state = disc_at(observed(BALL), offset=(2.0, 1.0))
    assert np.linalg.eigvalsh(state.information()[0])[0] > 0


def test_brighter_pictures_have_the_same_cost():
    """invariant: light by s, and variance by s²."""
    observation = observed(BEFORE_TILES[ARC])
    brighter = replace(
        observation,
        C=2 * observation.C,
        B=2 * observation.B,
        C_variance=4 * observation.C_variance,
        B_variance=4 * observation.B_variance,
    )
    one, other = (disc_at(x, ARC, (1.0, 0.5)) for x in (observation, brighter))
    assert_allclose(other.cost, one.cost, rtol=1e-9)
    assert_allclose(other.mean_color, 2 * one.mean_color, rtol=1e-9)
    for a, b in zip(one.information(), other.information(), strict=True):
        assert_allclose(b, a, rtol=1e-6, atol=1e-6 * np.abs(a).max())


def test_mean_color_is_that_of_the_ball():
    """exact: shading changes the length, not the direction."""
    state = disc_at(exact(BALL, ONE_PAINT))
    assert degrees_between(state.mean_color, GREEN) < 0.1
    layer = rendered(BALL).layer
    mean = layer.premultiplied.sum(axis=(0, 1)) / layer.alpha.sum()
    assert_allclose(state.mean_color, mean, rtol=0.1)  # of the nodes, not of the light


def test_pixels_of_zero_weight_are_ignored():
    """invariant: for any light."""
    observation = observed(BALL)
    valid = observation.valid.copy()
    valid[30:40, 40:50] = False
    hidden = replace(observation, valid=valid, weight=observation.weight * valid)
    other = hidden.with_light(np.where(valid[..., None], hidden.C, 0.9))
    one, other = (disc_at(x, offset=(0.5, 0.5)) for x in (hidden, other))
    assert_allclose(other.cost, one.cost, rtol=1e-12)
    assert_allclose(other.information()[0], one.information()[0], rtol=1e-9, atol=1e-6)


def test_on_another_observation_is_swept_again():
    observation = observed(BALL)
    state, coarse = disc_at(observation), observation.coarser(3)
    there = state.on(coarse)
    assert there.observation is coarse
    assert there.swept.alpha.shape == coarse.weight.shape
    slow = state_at(coarse, LINE, state.path, state.silhouette, state.shape)
    assert there.cost == slow.cost


def test_relit_keeps_alpha():
    """oracle: equal to a new sweep."""
    observation = observed(BALLS[ARC])
    state = disc_at(observation, ARC, 1.0)
    other = observation.with_light(0.9 * observation.C + 0.05)
    quick, slow = state.relit(other), state.on(other)
    assert quick.swept is state.swept
    assert quick.cost == slow.cost != state.cost
    assert_array_equal(quick.e, slow.e)


@pytest.mark.parametrize("family", [ARC, PARABOLA, CUBIC, BOUNCE], ids=lambda f: f.name)
def test_along_another_family_is_the_same_line(family):
    state = disc_at(exact(BALL))
    other = state.along(family)
    assert other.family is family
    assert_allclose(other.curve, state.curve, atol=1e-8)
    assert other.along(family) is other
    assert_allclose(state.along(FROM_REST).curve[[0, -1]], state.curve[[0, -1]])
    assert state.along(LINE) is state


def test_of_another_kind_is_the_same_shape():
    state = disc_at(exact(BALL))
    ellipse = state.of_kind(ELLIPSE)
    assert_allclose(ellipse.swept.alpha, state.swept.alpha, atol=1e-4)
    assert ellipse.size == state.size + 2
    soft = state.of_kind(Silhouette(1, soft=True))
    assert_array_equal(soft.shape, [*state.shape, 0])


def test_a_state_outside_the_picture_has_no_object():
    state = disc_at(observed(BALL), offset=(-900.0, 0.0))
    assert not state.swept.alpha.any()
    assert state.field.colors.shape == (0, 3)
    assert not state.information()[0].any()
    same = state_at(state.observation, LINE, state.path, state.silhouette, state.shape)
    assert same.cost == state.cost

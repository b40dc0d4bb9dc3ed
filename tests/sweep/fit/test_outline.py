"""fit_outline: a disc unless the data clearly require another shape."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.sweep.scenes import (
    BALL,
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
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import Change
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.outline import (
    changing,
    exchanged,
    fit_outline,
    gain_of_resolution,
    outlined,
    pivoting,
    stretched,
    turning,
)
from blurmatte.sweep.model.path import LINE
from blurmatte.trajectory import Trajectory

PATH = along(LINE)
EGG = Scene(WALL, PATH, Ball(12, GREEN, ambient=1.0), Change(squash=(1.5, 1.5), squash_angle=0.9))
SQUARE = Scene(TILES, PATH, Sheet(24, 24, GREEN), Change(turned=(0.0, 0.0, 1.1)))
SHEET = Scene(
    WALL, PATH, Sheet(30, 14, GREEN), Change(turned=(0.0, 0.0, 0.4), spin=(0.0, 0.0, 1.0))
)
NARROWING = Scene(
    WALL, PATH, Ball(11, GREEN, ambient=1.0), Change(squash=(1.0, 1.9), squash_angle=0.9)
)


def stick_about_its_end(length=56.0, width=9.0, first=0.4, turn=1.0, end=(44, 34), plate=WALL):
    """A stick that turns about an end."""
    time = np.linspace(0, 1, 33)
    angles = first + turn * time
    center = end + length / 2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    change = Change(turned=(0.0, 0.0, first), spin=(0.0, 0.0, turn))
    return Scene(plate, Trajectory(center, time), Sheet(length, width, GREEN), change)


STICK = stick_about_its_end()


@cache
def disc_of(scene, seed=0):
    """The disc that fits best near the true path."""
    return minimize(disc_at(observed(scene, seed, color=ONE_PAINT)), BOUNDS)


@cache
def outline_of(scene):
    return fit_outline(disc_of(scene))


@pytest.mark.diagonal
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scene", [FLAT[LINE], FLAT_BEFORE_TILES[LINE]], ids=["wall", "tiles"])
def test_a_ball_remains_a_disc(scene, seed):
    """honest: noise gives no other shape."""
    disc = disc_of(scene, seed)
    assert fit_outline(disc) is disc


@pytest.mark.parametrize("scene", [EGG, replace(EGG, plate=TILES)], ids=["wall", "tiles"])
def test_a_squashed_ball_becomes_an_ellipse(scene):
    disc, state = disc_of(scene), outline_of(scene)
    assert state.silhouette.name == "ellipse"
    assert error(state, scene) < 0.01 < 0.03 < error(disc, scene)
    assert state.variance_inflation < 1.3 < disc.variance_inflation
    assert state.cost < disc.cost


def test_an_ellipse_has_the_true_axes():
    """exact up to noise: stretches by 1.5 and 1/1.5 along and across its angle."""
    state, angle = outline_of(EGG), EGG.change.squash_angle
    expected = np.log(1.5) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
    assert_allclose(state.shape[1:3], expected, atol=0.03)
    assert_allclose(state.silhouette.radius(state.shape), 12, atol=0.15)


def test_a_turning_sheet_turns():
    """honest"""
    disc, state = disc_of(SHEET), outline_of(SHEET)
    assert state.silhouette.turns
    assert error(state, SHEET) < 0.05 < error(disc, SHEET)
    assert_allclose(state.silhouette.turn(state.shape), 1, atol=0.15)
    assert_allclose(state.silhouette.area(state.shape), 30 * 14, rtol=0.03)


@pytest.mark.battery
def test_a_stick_that_turns_about_its_end_is_found():
    """honest: from the disc that covers its fan."""
    disc, state = disc_of(STICK), outline_of(STICK)
    assert state.silhouette.turns
    assert error(state, STICK) < 0.02 < 0.1 < error(disc, STICK)
    assert_allclose(abs(state.silhouette.turn(state.shape)), 1, atol=0.05)
    assert_allclose(state.silhouette.area(state.shape), 56 * 9, rtol=0.05)
    assert_allclose(state.mean_color, GREEN, atol=0.03)


def test_a_stick_may_rest_at_the_outermost_point_of_which_most_changed():
    """exact: the ends that turning shapes start from, and their turns."""
    starts = list(pivoting(disc_of(STICK)))
    assert len(starts) == 4
    for start in starts:
        outline, curve = start.silhouette, start.curve
        assert outline.turns
        turned = np.diff(np.unwrap(np.arctan2(*(curve - (44, 34)).T[::-1])))
        assert_allclose(turned.sum(), outline.turn(start.shape), atol=0.25)
        assert np.hypot(*(curve.mean(axis=0) - STICK.trajectory.xy.mean(axis=0))) < 8


def test_increasingly_squashed_ball_changes():
    """honest: by the ratio of its stretches, 1.9, along its angle."""
    disc, state = disc_of(NARROWING), outline_of(NARROWING)
    angle = NARROWING.change.squash_angle
    expected = np.log(1.9) * np.array([0, np.cos(2 * angle), np.sin(2 * angle)])
    ahead = np.sign((state.curve[-1] - state.curve[0]) @ (disc.curve[-1] - disc.curve[0]))
    assert state.silhouette.changes
    assert_allclose(ahead * state.silhouette.rates(state.shape), expected, atol=0.1)
    assert error(state, NARROWING) < 0.02 < error(disc, NARROWING)


def test_changing_starts_are_the_best_and_discs():
    disc = disc_of(BALL)
    best = next(iter(turning(disc, disc)))
    starts = list(changing(disc, best))
    assert [start.silhouette.turns for start in starts] == [True, False]
    for start in starts:
        assert start.silhouette.changes
        assert not start.silhouette.rates(start.shape).any()
        assert_allclose(start.swept.alpha, disc.swept.alpha, atol=1e-4)


def test_a_square_gets_the_orders_that_its_corners_need():
    """honest: a Fourier series of order 4 or more has four corners."""
    disc, state = disc_of(SQUARE), outline_of(SQUARE)
    assert 4 <= state.silhouette.order <= 12
    assert error(state, SQUARE) < 0.02 < error(disc, SQUARE)
    assert_allclose(state.silhouette.area(state.shape), 24**2, rtol=0.03)


@pytest.mark.parametrize("scene", [EGG, SQUARE, SHEET], ids=["egg", "square", "sheet"])
def test_the_outline_is_never_worse_than_the_disc(scene):
    """invariant: by the information criterion, on the disc's pixels."""
    state, disc = outline_of(scene), disc_of(scene)
    assert state.observation.weight.shape == disc.observation.weight.shape
    assert state.cost <= disc.cost


def test_stretched_starts_have_the_length_of_the_streak():
    """invariant: a longer shape has a shorter path."""
    disc = disc_of(BALL)
    ends = disc.curve[[0, -1]]
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    reach = np.linalg.norm(ends[1] - ends[0]) + 2 * disc.shape[0]
    starts = list(stretched(disc, disc))
    assert len(starts) == 3
    for start in starts:
        length = np.linalg.norm(np.diff(start.curve[[0, -1]], axis=0))
        width = np.ptp(start.silhouette.outline(start.shape, 720) @ direction)
        assert_allclose(length + width, reach, rtol=1e-3)
        assert_allclose(start.curve.mean(axis=0), disc.curve.mean(axis=0), atol=1e-6)


def test_starts_include_both_directions_of_rotation():
    disc = disc_of(BALL)
    turns = [start.silhouette.turn(start.shape) for start in turning(disc, disc)]
    assert sorted(set(turns)) == [-1, 0, 1]
    assert outlined(disc).order == 6


OBLONG = Scene(WALL, Trajectory.line((70, 56), (84, 56)), Sheet(28, 20, GREEN))


def test_a_sheet_and_its_path_can_exchange_their_lengths_before_one_hue():
    """oracle: both leave the same light, with alphas that differ by the factor of the lengths."""
    observation = observed(OBLONG, color=ONE_PAINT)
    disc = minimize(disc_at(observation), BOUNDS)
    found = fit_outline(disc)
    other = exchanged(found, disc)
    ratio = other.swept.alpha.sum() / found.swept.alpha.sum()
    assert max(ratio, 1 / ratio) == pytest.approx(2.0, rel=0.15)
    lengths = [float(np.linalg.norm(one.curve[-1] - one.curve[0])) for one in (found, other)]
    assert sorted(lengths) == pytest.approx([14, 28], rel=0.15)
    assert abs(other.cost - found.cost) < 0.02 * disc.cost


def test_sharper_corners_gain_where_the_order_limits_them():
    """oracle: of squares of the highest order, as much as a fit of a higher order; others nothing."""
    square = outline_of(replace(SQUARE, plate=WALL))
    low, high = (
        minimize(square.of_kind(replace(square.silhouette, order=order)), BOUNDS)
        for order in (4, 12)
    )
    assert gain_of_resolution(low, BOUNDS) == 0
    sharper = minimize(high.of_kind(replace(high.silhouette, order=32)), BOUNDS)
    gain = gain_of_resolution(high, BOUNDS)
    assert 0 < gain == pytest.approx(high.cost - sharper.cost, abs=2.0)


def test_discs_and_shapes_that_turn_exchange_nothing():
    disc = disc_of(FLAT[LINE])
    turns = disc.of_kind(replace(outlined(disc), turns=True))
    assert exchanged(disc, disc) is None
    assert exchanged(turns, disc) is None

"""Silhouettes that change during the exposure: oracle at single moments, and finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm
from tests.sweep.scenes import wrong_derivatives

from blurmatte.sweep.model import silhouette_kernel
from blurmatte.sweep.model.path import ARC, LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette, moments

SIZE = W, H = 48, 36
ROUND = np.array([14.3, 20.4, 31.1, 19.8, -5])
REST = np.array([22.3, 17.4, 22.3, 17.4])
GROWING, CHANGING = Silhouette(1, changes=True), Silhouette(2, changes=True)
SHAPES = {
    GROWING: np.array([6.2, 0.8]),
    CHANGING: np.array([6, 0.3, -0.2, -0.5, 0.4, 0.3]),
    Silhouette(5, changes=True): np.array(
        [6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -0.02, 0.01, 0.5, -0.3, 0.5]
    ),
    Silhouette(4, turns=True, changes=True): np.array(
        [6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -1.5, 0.4, 0.3, -0.2]
    ),
    Silhouette(1, changes=True, soft=True): np.array([6.2, -0.8, 1.2]),
    Silhouette(4, turns=True, changes=True, soft=True): np.array(
        [6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -1.5, 0.4, 0.3, -0.2, 0.8]
    ),
}


def name_of(silhouette):
    return ("soft " if silhouette.soft else "") + silhouette.name


every_kind = pytest.mark.parametrize("silhouette", SHAPES, ids=name_of)


def canvas():
    return Pixels((H, W))


def at_moment(silhouette, shape, t):
    """The silhouette without rotation and change, and its shape (m,) at exposure fraction t."""
    still = replace(silhouette, turns=False, changes=False)
    g, a, b = silhouette.rates(shape) * (t - 0.5)
    turn = silhouette.turn(shape) * (t - 0.5)
    shape = still.like(silhouette, shape)
    if still.order == 1:
        return still, np.array([shape[0] * np.exp(g), *shape[1:]])
    c, s = np.cos(turn), np.sin(turn)
    stretch = expm(np.array([[g + a, b], [b, g - a]]))
    return still, still.mapped(shape, np.array([[c, -s], [s, c]]) @ stretch)


@every_kind
def test_alpha_is_the_mean_of_the_shapes_at_many_moments(silhouette):
    """Oracle: the shape at rest at each moment; `mapped` has separate tests."""
    shape, times = SHAPES[silhouette], (np.arange(160) + 0.5) / 160
    alpha = silhouette.sweep(ARC, ROUND, shape, canvas()).alpha
    expected = np.zeros((H, W))
    for t in times:
        still, mapped = at_moment(silhouette, shape, t)
        center = np.tile(ARC.at(ROUND, np.array([t]))[0][0], 2)
        expected += still.sweep(LINE, center, mapped, canvas()).alpha / len(times)
    assert_allclose(alpha, expected, rtol=0, atol=5e-3)
    assert np.sqrt(np.mean((alpha - expected)[alpha > 0] ** 2)) < 7e-4


@every_kind
def test_derivatives_are_those_of_small_steps(silhouette):
    """exact"""
    for i, off in enumerate(wrong_derivatives(silhouette, ROUND, SHAPES[silhouette], canvas())):
        of_soft_outline = silhouette.soft and silhouette.order > 2 and i > len(ROUND)
        assert off < (0.2 if of_soft_outline else 0.06)


@every_kind
def test_alpha_sums_to_the_mean_area(silhouette):
    """exact: the area changes as exp 2 g (t - 1/2)."""
    shape = SHAPES[silhouette]
    g = silhouette.rates(shape)[0]
    alpha = silhouette.sweep(ARC, ROUND, shape, canvas()).alpha
    assert_allclose(alpha.sum(), silhouette.area(shape) * np.sinh(g) / g, rtol=2e-3)
    assert alpha.max() < 1 + 1e-9


@every_kind
def test_zero_rates_give_the_constant_silhouette(silhouette):
    shape = SHAPES[silhouette].copy()
    shape[silhouette.at("rates")] = 0
    plain = replace(silhouette, changes=False)
    swept = silhouette.sweep(ARC, ROUND, shape, canvas())
    alike = plain.sweep(ARC, ROUND, plain.like(silhouette, shape), canvas())
    assert_allclose(swept.alpha, alike.alpha, rtol=0, atol=1e-6)
    known = len(ROUND) + 2 * silhouette.order - 1 + silhouette.turns
    J = swept.by_parameters[..., :known]
    assert_allclose(J, alike.by_parameters[..., :known], rtol=0, atol=1e-6)


@every_kind
def test_reversed_time_reverses_the_change(silhouette):
    back, shape = np.array([*ROUND[2:4], *ROUND[:2], -ROUND[4]]), SHAPES[silhouette].copy()
    first = 2 * silhouette.order - 1
    shape[first : len(shape) - silhouette.soft] *= -1
    alpha = silhouette.sweep(ARC, back, shape, canvas()).alpha
    expected = silhouette.sweep(ARC, ROUND, SHAPES[silhouette], canvas()).alpha
    assert_allclose(alpha, expected, rtol=0, atol=1e-9)


@every_kind
def test_reach_is_the_maximum_over_the_exposure(silhouette):
    shape, times = SHAPES[silhouette], np.linspace(0, 1, 41)
    rim = silhouette.outline(shape, 360)
    far = [np.linalg.norm(rim @ L.T, axis=1).max() for L in silhouette.map_at(shape, times)]
    assert_allclose(silhouette.reach(shape), max(far))
    assert max(far) > 1.05 * far[20]


def test_maps_are_exponentials_of_the_rates():
    shape = SHAPES[CHANGING]
    g, a, b = CHANGING.rates(shape)
    for t, L in zip((0, 0.3, 1), CHANGING.map_at(shape, np.array([0, 0.3, 1])), strict=True):
        assert_allclose(L, expm((t - 0.5) * np.array([[g + a, b], [b, g - a]])))
    assert_allclose(GROWING.map_at(np.array([6, 0.8]), np.array([1.0]))[0], np.exp(0.4) * np.eye(2))


def test_alpha_of_a_narrowing_disc_at_rest_decreases_outwards():
    """Foreshortened along x from 1 to e^-1.2: the widest point is covered for a moment only."""
    shape = np.array([8, 0, 0, -0.6, -0.6, 0])
    alpha = CHANGING.sweep(LINE, REST, shape, canvas()).alpha
    x, y = round(REST[0]), round(REST[1])
    assert_allclose(alpha[y, x + 8 - 1], 0.5, atol=0.2)
    assert alpha[y, x + 12] < 0.3
    assert_allclose(alpha[y + 6, x], 1)
    assert alpha[y + 10, x] == 0


def test_moments_are_close_where_growth_moves_the_rim():
    moves = (GROWING.rim_motion(np.array([60.0, rate])) for rate in (2.0, 0.1))
    fast, slow = (moments(LINE, REST, 1.0, move)[0] for move in moves)
    assert len(fast) > len(slow) == len(moments(LINE, REST, 1.0)[0])
    assert np.diff(60 * np.exp(2 * (fast - 0.5))).max() < 1


def test_like_keeps_the_rates():
    shape = SHAPES[CHANGING]
    rich = Silhouette(4, turns=True, changes=True, soft=True)
    same = rich.like(CHANGING, shape)
    assert_array_equal(rich.rates(same), CHANGING.rates(shape))
    assert_array_equal(CHANGING.like(rich, same), shape)
    assert_array_equal(GROWING.like(CHANGING, shape), [6, -0.5])
    assert_array_equal(CHANGING.like(GROWING, np.array([6.2, 0.8])), [6.2, 0, 0, 0.8, 0, 0])
    assert_array_equal(DISC.like(GROWING, np.array([6.2, 0.8])), [6.2])
    assert_array_equal(ELLIPSE.rates(np.array([6, 0.3, -0.2])), [0, 0, 0])


def test_rates_are_bounded():
    assert_array_equal(GROWING.possible(np.array([9.0, 5.0]), (2, 8)), [8, 2])
    wild = np.array([6, 0.1, 0, -3.0, 2.5, 0.1])
    assert_array_equal(CHANGING.possible(wild, (2, 8)), [6, 0.1, 0, -2, 2, 0.1])
    assert CHANGING.extreme(np.array([6, 1.2, 0, 0, 2, 0]))
    assert not CHANGING.extreme(np.array([6, 0.5, 0, 0, 2, 0]))


def test_parameters_have_names():
    assert [s.name for s in SHAPES] == [
        "growing disc", "changing ellipse", "changing outline of order 5",
        "turning, changing outline of order 4", "growing disc",
        "turning, changing outline of order 4",
    ]  # fmt: skip
    for silhouette, shape in SHAPES.items():
        assert silhouette.size == len(shape)


def test_points_without_a_rim_normal_keep_their_distance():
    """Exact: at equal distance from rims on two sides, the lattice has the normal 0."""
    lattice = np.zeros((9, 9, 8))
    lattice[..., 0], lattice[..., 3] = 0.3, 0.5  # distance inside, curvature
    square = np.array([[-2.0, -2], [2, -2], [2, 2], [-2, 2]])
    alpha, J = np.zeros((7, 7)), np.zeros((7, 7, 9))
    silhouette_kernel.sweep(
        (np.full((1, 2), 3.0), np.zeros((1, 2, 2)), np.ones(1)), np.diag([1.2, 0.9])[None],
        np.zeros((1, 2, 2, 3)), True, (lattice, -2.0, -2.0, 0.5, square),
        (np.eye(2), np.zeros((2, 2, 3)), np.zeros(0)), 0.9, alpha, J,
    )  # fmt: skip
    assert np.isfinite(J).all()
    assert 0.5 < alpha[3, 3] < 0.75

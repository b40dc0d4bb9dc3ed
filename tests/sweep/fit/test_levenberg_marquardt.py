"""Descents: from a start that is off to path, shape and color as they were rendered."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Ball, Change, Scene, colorful_plate, plain_plate, render
from blurmatte.streaks import Streak
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, main_colors, relit, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.color_prior import known_color
from blurmatte.sweep.model.path import ARC, BOUNCE, LINE
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE
from blurmatte.trajectory import Trajectory

SIZE = (150, 100)
GREEN = np.array([0.25, 0.7, 0.12])
RED = np.array([0.7, 0.15, 0.1])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TILES = colorful_plate(SIZE, 2, tile=20)
BOUNDS = 3.0, 40.0
NOISE = NoiseModel(read_std=1e-3)
TIMES = np.linspace(0, 1, 65)
WAYS = {
    LINE: Trajectory.line((38, 36), (106, 62)),
    ARC: Trajectory.arc((34, 60), (76, 38), (114, 62)),
    BOUNCE: Trajectory.bounce((34, 34), (74, 70), (114, 46), 0.4),
}
BEFORE_WALL = {family: Scene(WALL, way, Ball(11, GREEN)) for family, way in WAYS.items()}
BEFORE_TILES = {family: Scene(TILES, way, Ball(11, GREEN)) for family, way in WAYS.items()}


@cache
def data_of(scene):
    """All of a scene without noise, though some is declared."""
    truth = render(scene, 400)
    image, plate = (picture.with_noise(NOISE) for picture in (truth.image, truth.plate))
    return truth, observation_around(Streak(truth.layer.alpha > 0), 12, image, plate, None)


def off_by(data, family, pixels, factor, color):
    """A start whose points are off by `pixels`, and its radius by a factor."""
    xy = WAYS[family].at(TIMES) + pixels
    frame = Frame.of(np.asarray(color, float)[:, None])
    path = min(family.starts(xy), key=lambda p: np.abs(family.at(p, TIMES)[0] - xy).max())
    return state_at(data, family, path, DISC, DISC.start(11 * factor), frame)


def turned_by(color, degrees):
    """A color in another direction."""
    away = np.cross(color, [0.2, -0.5, 1])
    return color + np.tan(np.radians(degrees)) * np.linalg.norm(color) * away / np.linalg.norm(away)


def degrees_between(state, model):
    """The largest angle from the colors of the one to those of the other."""
    off = state.frame.across.T @ model.basis
    return np.degrees(np.arcsin(min(np.linalg.norm(off, 2), 1)))


@pytest.mark.parametrize("family", WAYS, ids=lambda family: family.name)
@pytest.mark.parametrize("scenes", [BEFORE_WALL, BEFORE_TILES], ids=["wall", "tiles"])
def test_exact_data_give_the_exact_path(family, scenes):
    truth, data = data_of(scenes[family])
    start = off_by(data, family, (2.5, -2), 1.2, turned_by(GREEN, 6))
    end = descend(data, start, BOUNDS)
    assert end.converged
    assert end.cost < 0.01 * start.cost
    xy, _ = family.at(end.path, TIMES)
    assert_allclose(xy, truth.trajectory.at(TIMES), atol=0.02)
    assert_allclose(end.shape, [11], atol=0.02)
    assert degrees_between(end, truth.model) < 0.1
    true = truth.layer.alpha
    x, y = (int(side) for side in data.origin)
    h, w = end.swept.alpha.shape
    assert_allclose(end.swept.alpha, true[y : y + h, x : x + w], atol=5e-3)


def test_a_plane_of_colors_comes_out_too():
    body = Ball(13, GREEN, second_color=RED)
    spin = Change(spin=(1.0, 0.5, 0.8))
    truth, data = data_of(Scene(TILES, WAYS[LINE], body, spin))
    path = LINE.starts(WAYS[LINE].at(TIMES) + 2)[0]
    shape = DISC.start(12)
    frame = main_colors(data, DISC.sweep(LINE, path, shape, data).alpha, 2)
    end = descend(data, state_at(data, LINE, path, DISC, shape, frame), BOUNDS)
    assert end.frame.rank == 2
    xy, _ = LINE.at(end.path, TIMES)
    assert_allclose(xy, truth.trajectory.at(TIMES), atol=0.05)
    assert_allclose(end.shape, [13], atol=0.03)
    assert degrees_between(end, truth.model) < 0.3


@pytest.mark.parametrize("pixels", [(0, 0), (4, 3), (-15, 9), (60, -30)])
@pytest.mark.parametrize("factor", [0.5, 1, 2])
def test_the_cost_never_rises(pixels, factor):
    _, data = data_of(BEFORE_WALL[LINE])
    start = off_by(data, LINE, pixels, factor, turned_by(GREEN, 20))
    end = descend(data, start, BOUNDS)
    assert end.cost <= start.cost


def test_an_end_is_an_end():
    _, data = data_of(BEFORE_WALL[ARC])
    end = descend(data, off_by(data, ARC, (1, 1), 1.1, GREEN), BOUNDS)
    again = descend(data, end, BOUNDS)
    assert_allclose(again.path, end.path, atol=0.01)
    assert again.cost > end.cost - 0.01


def test_the_radius_stays_within_bounds():
    _, data = data_of(BEFORE_WALL[LINE])
    assert descend(data, off_by(data, LINE, (1, 1), 0.7, GREEN), BOUNDS).converged
    for first, bounds, held in ((0.7, (3, 9), 9), (1.5, (14, 40), 14)):
        end = descend(data, off_by(data, LINE, (1, 1), first, GREEN), bounds)
        assert end.shape[0] == held
        assert not end.converged  # it would be smaller or larger


def test_an_extreme_shape_is_no_end():
    _, data = data_of(BEFORE_WALL[LINE])
    start = off_by(data, LINE, (1, 1), 1.1, GREEN)
    shape = ELLIPSE.like(DISC, start.shape)
    shape[1] = 2.5
    extreme = state_at(data, LINE, start.path, ELLIPSE, shape, start.frame)
    end = descend(data, extreme, BOUNDS)
    assert end.cost < extreme.cost
    assert not end.converged
    shape[1] = 0.2
    assert descend(
        data, state_at(data, LINE, start.path, ELLIPSE, shape, start.frame), BOUNDS
    ).converged


def model_of(color, std):
    """A color known to `std` radians in each direction."""
    pole = color / np.linalg.norm(color)
    return ColorModel(pole[:, None], std**2 * (np.eye(3) - np.outer(pole, pole)), {})


def test_a_known_color_is_kept():
    """Even where the data say otherwise."""
    wrong = model_of(turned_by(GREEN, 4), 0)
    _, data = data_of(BEFORE_TILES[LINE])
    data = replace(data, known=known_color(wrong))
    end = descend(data, off_by(data, LINE, (2, 2), 1.1, wrong.pole), BOUNDS)
    assert degrees_between(end, wrong) < 0.1


def test_a_color_hardly_known_is_found():
    vague = model_of(turned_by(GREEN, 4), 0.5)
    truth, data = data_of(BEFORE_TILES[LINE])
    data = replace(data, known=known_color(vague))
    end = descend(data, off_by(data, LINE, (2, 2), 1.1, vague.pole), BOUNDS)
    assert degrees_between(end, truth.model) < 0.1


def test_knowledge_adds_to_what_the_data_say():
    """To cost, gradient and curvature: a parabola around the color that is known."""
    _, data = data_of(BEFORE_WALL[LINE])
    informed = replace(data, known=known_color(model_of(GREEN, 0.01)))
    base = off_by(data, LINE, (0, 0), 1, turned_by(GREEN, 1))

    def added(turns):
        state = replace(base, frame=base.frame.turned(np.asarray(turns)))
        return seen(informed, state).cost - seen(data, state).cost

    H, g = (
        with_it - without
        for with_it, without in zip(base.information(informed), base.information(data), strict=True)
    )
    assert_allclose(added((0, 0)), 0.5 * (np.radians(1) / 0.01) ** 2, rtol=0.01)
    step = 1e-4 * np.eye(2)
    slope = [(added(d) - added(-d)) / 2e-4 for d in step]
    assert_allclose(g[-2:], slope, rtol=0.01, atol=1)
    assert_allclose(H[-2:, -2:], 1e4 * np.eye(2), atol=10)
    assert np.all(g[:-2] == 0)
    assert np.all(H[:-2] == 0)


def test_the_gradient_is_that_of_the_cost():
    """By path and radius; that by a color leaves out what noise feigns."""
    _, data = data_of(BEFORE_TILES[LINE])
    data = replace(data, C_variance=1e-3 + 0 * data.C, B_variance=1e-3 + 0 * data.B)
    state = off_by(data, LINE, (1, -1), 1.1, turned_by(GREEN, 3))
    _, g = state.information(data)
    step = 1e-4

    def cost(change):
        path, shape = state.path + change[:4], state.shape + change[4:]
        return state_at(data, LINE, path, DISC, shape, state.frame).cost

    numeric = [(cost(d) - cost(-d)) / (2 * step) for d in step * np.eye(5)]
    assert_allclose(g[:5], numeric, rtol=0.01, atol=0.005 * np.abs(numeric).max())


def test_the_same_state_is_seen_in_coarser_data():
    _, data = data_of(BEFORE_WALL[LINE])
    end = descend(data, off_by(data, LINE, (1, 1), 1.1, GREEN), BOUNDS)
    coarse = data.coarser(3)
    there = descend(coarse, seen(coarse, end), BOUNDS)
    assert there.swept.alpha.shape == coarse.weight.shape
    assert_allclose(there.path, end.path, atol=0.05)
    assert_allclose(there.shape, end.shape, atol=0.05)


def test_main_colors_are_those_that_are_left_over():
    truth, data = data_of(BEFORE_TILES[LINE])
    x, y = (int(side) for side in data.origin)
    h, w = data.weight.shape
    frame = main_colors(data, truth.layer.alpha[y : y + h, x : x + w], 1)
    assert abs(frame.within[:, 0] @ truth.model.pole) > 1 - 1e-9


def test_what_has_left_the_picture_stays_there():
    _, data = data_of(BEFORE_WALL[LINE])
    lost = off_by(data, LINE, (-900, 0), 1, GREEN)
    assert not lost.swept.alpha.any()
    end = descend(data, lost, BOUNDS)
    assert not end.converged
    assert_allclose(end.path, lost.path)


def test_in_other_light_alpha_is_what_it_was():
    """Oracle: the same as if it were swept again."""
    _, data = data_of(BEFORE_WALL[ARC])
    state = off_by(data, ARC, 1.0, 1.1, GREEN)
    other = data.with_light(0.9 * data.C + 0.05)
    quick, slow = relit(other, state), seen(other, state)
    assert quick.swept is state.swept
    assert quick.cost == slow.cost != state.cost
    assert_allclose(quick.e, slow.e, atol=0)
    assert_allclose(quick.moments, slow.moments, atol=0)

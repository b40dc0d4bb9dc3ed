"""How much of the plate's texture is seen through an object of any colors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import ColorModelError
from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.radiometry import with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Shot,
    Sprite,
    plain_plate,
    render,
    textured_plate,
)
from blurmatte.streaks import Streak
from blurmatte.sweep.attenuation import attenuation, structure
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
TEXTURE = textured_plate(SIZE, 2)
WAY = Trajectory.line((44, 42), (112, 68))
COLORS = np.random.default_rng(3).uniform(0.05, 0.9, (4, 8, 3))
GRAY = Ball(11, np.full(3, 0.4))
PAINTED = Ball(11, np.ones(3), texture=np.kron(COLORS, np.ones((8, 8, 1))))


def swept(body, plate, radius, seed=0, code_std=1.5 / 255, **change):
    """Observation, and a disc of any colors of a radius on the way that the body went."""
    scene = Scene(plate, WAY, body, Change(**change))
    truth = render(scene, 200)
    pictures = Shot(scene, Camera(code_std=code_std), plate_frames=3, seed=seed).photograph(truth)
    data = observation_around(Streak(truth.layer.alpha > 0), 12, *with_noise(*pictures), None)
    frame = Frame.of(np.eye(3))
    return data, state_at(data, LINE, WAY.xy.ravel(), DISC, DISC.start(radius), frame)


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_alpha_that_is_wrong_by_a_factor_is_off_by_that(factor):
    """Exact, but for little noise: of an object without paint, nothing else has the plate's texture."""
    data, state = swept(GRAY, TEXTURE, 11.0, code_std=0.05 / 255)
    assert attenuation(data, state) < 0.04
    wrong = replace(state, swept=replace(state.swept, alpha=factor * state.swept.alpha))
    assert_allclose(attenuation(data, wrong), abs(1 - 1 / factor), rtol=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_paint_says_nothing_against_the_right_alpha(seed):
    """Honest: however much is painted; a wrong radius is told."""
    right, wrong = (
        attenuation(*swept(PAINTED, TEXTURE, radius, seed, spin=(0.3, 0.4, 0.0)))
        for radius in (11.0, 15.0)
    )
    assert right < 0.12
    assert wrong > 0.24


def test_few_edges_do_not_speak_for_all_of_the_streak():
    """Invariant: alpha that is wrong but where the plate has most structure, if places may differ."""
    strong = np.where(np.arange(SIZE[0]) < 60, 1.0, 0.2)[:, None]
    plate, black = 0.3 + strong * (TEXTURE - 0.3), Ball(11, np.full(3, 0.01))
    data, state = swept(black, plate, 11.0, code_std=0.05 / 255)
    columns = data.origin[0] + np.arange(data.streak.shape[1])
    wrong = np.where(columns < 60, 1.0, 1.6) * state.swept.alpha
    off = replace(state, swept=replace(state.swept, alpha=wrong))
    of_few, of_all = (attenuation(data, off, scatter) for scatter in (0.0, 0.2))
    assert of_few < 0.5 * of_all
    assert 0.2 < of_all < 1 - 1 / 1.6
    assert attenuation(data, state, 0.2) < 0.06


def test_a_plain_plate_tells_nothing():
    """Door: noise is no structure, and then nothing is confirmed."""
    wall = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
    data, _ = swept(PAINTED, wall, 11.0)
    assert structure(data) < 1.5
    data, state = swept(PAINTED, np.full((SIZE[1], SIZE[0], 3), 0.3), 11.0)
    nothing = replace(data, B=np.full_like(data.B, 0.3), B_variance=np.zeros_like(data.B))
    assert np.isinf(attenuation(nothing, state))


def photographed(body):
    way = Trajectory.line((60, 50), (104, 66))
    scene = Scene(textured_plate(SIZE, 5), way, body, Change(spin=(0.3, 0.0, 0.0)))
    truth = render(scene, 200)
    return truth, Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=1).photograph(truth)


@pytest.mark.battery
def test_a_ball_of_many_colors_is_told_by_itself():
    """Honest: by its shape, for the texture behind it agrees."""
    truth, pictures = photographed(Ball(14, np.ones(3), texture=PAINTED.texture))
    solution = solve(*pictures)
    assert solution.model.rank == 3
    off = (solution.alpha - truth.layer.alpha)[truth.layer.alpha > 0]
    claimed = solution.alpha_std[truth.layer.alpha > 0]
    assert np.sqrt(np.mean(off**2)) < min(0.02, 2 * np.sqrt(np.mean(claimed**2)))


@pytest.mark.parametrize(
    "size",
    [
        pytest.param((30, 12), id="sheet", marks=pytest.mark.battery),
        pytest.param((24, 24), id="square"),
    ],
)
def test_other_shapes_of_many_colors_are_not(size):
    """Door: no disc is confirmed, and colors tell nothing."""
    rows, columns = (np.arange(n) * k // n for n, k in zip(size[::-1], (4, 8), strict=True))
    flag = Sprite(Layer(np.ones(size[::-1]), COLORS[rows][:, columns]))
    with pytest.raises(ColorModelError):
        solve(*photographed(flag)[1])

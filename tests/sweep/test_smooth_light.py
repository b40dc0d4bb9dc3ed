"""Smooth light: what a wrong alpha leaves in the light of an object."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.radiometry import with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Shot,
    colorful_plate,
    plain_plate,
    render,
    textured_plate,
)
from blurmatte.streaks import Streak
from blurmatte.sweep import MAX_MISFIT, end, fit_sweep
from blurmatte.sweep.data import data_around
from blurmatte.sweep.descent import state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.path import LINE
from blurmatte.sweep.silhouette import DISC
from blurmatte.sweep.smooth_light import SmoothLight, smooth_light
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN, RED = np.array([0.25, 0.7, 0.12]), np.array([0.7, 0.2, 0.1])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
WAY = Trajectory.line((44, 42), (112, 68))


def taken(scene, seed=0, **camera):
    """Streak, image and plate."""
    shot = Shot(scene, Camera(code_std=1.5 / 255, **camera), plate_frames=3, seed=seed)
    truth = render(scene, 200)
    return Streak(truth.layer.alpha > 0), *with_noise(*shot.photograph(truth))


def said_of(shot, radius, colors=GREEN[:, None]):
    """Of a disc of a radius on the way that a ball of radius 11 went."""
    streak, image, plate = shot
    data = data_around(streak, 12, image, plate, None)
    path, frame = WAY.xy.ravel(), Frame.of(colors)
    return smooth_light(data, state_at(data, LINE, path, DISC, DISC.start(radius), frame))


@pytest.mark.parametrize("colors", [GREEN[:, None], np.stack([GREEN, RED], axis=1)], ids=["1", "2"])
@pytest.mark.parametrize(("plate", "tells"), [(WALL, False), (textured_plate(SIZE, 2), True)])
def test_texture_tells_alpha_where_there_is_some(plate, tells, colors):
    shot = taken(Scene(plate, WAY, Ball(11, GREEN)))
    right, wrong = (said_of(shot, radius, colors) for radius in (11.0, 14.0))
    assert (right.share > 0.5) == tells
    assert right.against < 3
    assert right.astray == 0
    assert (wrong.against > 10) == tells
    if tells:
        assert 0.1 < wrong.astray < 1


def test_nothing_is_said_where_noise_hides_all():
    shot = Shot(Scene(WALL, WAY, Ball(11, GREEN)), Camera(code_std=60 / 255), seed=1)
    truth = render(shot.scene, 60)
    image, plate = with_noise(*shot.photograph(truth))
    said = said_of((Streak(truth.layer.alpha > 0), image, plate), 14.0)
    assert (said.share, said.astray) == (0, 0)


def test_what_it_contradicts_is_no_answer(monkeypatch):
    """Door: the best that there is does not explain the streak, and says why."""
    scene = Scene(WALL, WAY, Ball(11, GREEN))
    streak, image, picture = taken(scene)
    assert fit_sweep(image, picture, streak).misfit < MAX_MISFIT
    monkeypatch.setattr(
        end, "smooth_light", lambda data, state: SmoothLight(1.0, 50.0, 0.3, 0.3, 0.3)
    )
    sweep = fit_sweep(image, picture, streak)
    assert np.isinf(sweep.misfit)
    assert "off by 30% if its light changes little" in sweep.complaint(MAX_MISFIT)


def test_two_paints_are_not_believed_where_it_would_tell_nothing(monkeypatch):
    """Door: a plane of colors explains what it likes then."""
    paints = Ball(13, GREEN, second_color=RED)
    scene = Scene(colorful_plate(SIZE, 2, tile=20), WAY, paints, Change(spin=(1.0, 0.5, 0.8)))
    streak, image, plate = taken(scene)
    sweep = fit_sweep(image, plate, streak)
    assert sweep.model.rank == 2
    assert sweep.misfit < MAX_MISFIT
    asked = end.smooth_light

    def hardly_told(data, state):
        return replace(asked(data, state), share=0.15)

    monkeypatch.setattr(end, "smooth_light", hardly_told)
    assert fit_sweep(image, plate, streak).misfit > MAX_MISFIT
    given = fit_sweep(image, plate, streak, sweep.model)
    assert given.misfit < MAX_MISFIT  # what is known needs no confirmation


def test_fine_paint_is_no_wrong_shape_where_texture_confirms_alpha():
    """Honest: of little noise any paint leaves more, and alpha is as exact as the texture says."""
    colors = np.random.default_rng(1).uniform(0.05, 0.9, (8, 16, 3))
    ball = Ball(16, np.ones(3), texture=np.kron(colors, np.ones((8, 8, 1))))
    way = Trajectory.line((55, 45), (85, 62))
    shot = Shot(
        Scene(textured_plate(SIZE, 2), way, ball), Camera(code_std=0.1 / 255), plate_frames=3
    )
    truth = render(shot.scene, 200)
    streak = Streak(truth.layer.alpha > 0)
    sweep = fit_sweep(*shot.photograph(truth), streak, ColorModel.any())
    assert sweep.misfit == 1
    off = (sweep.alpha - truth.layer.alpha)[streak.mask]
    assert np.sqrt(np.mean(off**2)) < 0.01
    usual = np.sqrt(np.mean(truth.layer.alpha[streak.mask] ** 2))
    assert np.sqrt(np.mean(off**2)) / usual < sweep.stats["texture"] < 0.05

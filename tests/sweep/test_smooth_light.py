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
from blurmatte.sweep import smooth_light as of_light
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC
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
    data = observation_around(streak, 12, image, plate, None)
    path, frame = WAY.xy.ravel(), Frame.of(colors)
    return smooth_light(data, state_at(data, LINE, path, DISC, DISC.start(radius), frame))


@pytest.mark.parametrize("colors", [GREEN[:, None], np.stack([GREEN, RED], axis=1)], ids=["1", "2"])
@pytest.mark.parametrize(("plate", "tells"), [(WALL, False), (textured_plate(SIZE, 2), True)])
def test_texture_tells_alpha_where_there_is_some(plate, tells, colors):
    shot = taken(Scene(plate, WAY, Ball(11, GREEN)))
    right, wrong = (said_of(shot, radius, colors) for radius in (11.0, 14.0))
    assert (right.share > 0.5) == tells
    assert right.astray == right.astray_of_places == 0
    assert (wrong.astray_of_places > 0.1) == tells
    if tells:
        assert 0.1 < wrong.astray < 1


@pytest.mark.parametrize("seed", range(2))
def test_noise_that_hangs_together_says_nothing_against_alpha(monkeypatch, seed):
    """Honest: codecs leave patches of noise, in a streak and beside it; a wrong alpha is still told."""
    from scipy.ndimage import gaussian_filter

    streak, image, plate = taken(Scene(textured_plate(SIZE, 2), WAY, Ball(11, GREEN)))
    patches = gaussian_filter(np.random.default_rng(seed).normal(size=image.rgb.shape), (3, 3, 0))
    patches *= 2 * np.sqrt(image.variance.mean()) / patches.std()
    shot = streak, replace(image, rgb=(image.rgb + patches).astype(np.float32)), plate
    right, wrong = (said_of(shot, radius) for radius in (11.0, 14.0))
    assert right.astray < 0.05
    assert wrong.astray > 0.1
    monkeypatch.setattr(of_light, "coherence_of_noise", lambda data, state, size: 1.0)
    assert said_of(shot, 11.0).astray > right.astray


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
    monkeypatch.setattr(end, "smooth_light", lambda data, state: SmoothLight(1.0, 0.3, 0.3))
    sweep = fit_sweep(image, picture, streak)
    assert np.isinf(sweep.misfit)
    assert "off by 30% if its light changes little" in sweep.complaint(MAX_MISFIT)


PAINTS = Scene(
    colorful_plate(SIZE, 2, tile=20),
    WAY,
    Ball(13, GREEN, second_color=RED),
    Change(spin=(1.0, 0.5, 0.8)),
)
EGG = Scene(WALL, WAY, Ball(10, GREEN), Change(squash=(1.5, 1.5), squash_angle=0.9))


@pytest.mark.parametrize(
    ("scene", "rank", "share", "believed"),
    [
        (PAINTS, 2, 0.25, True),
        (PAINTS, 2, 0.18, False),  # a plane of colors explains what it likes
        (Scene(WALL, WAY, Ball(11, GREEN)), 1, 0.0, True),  # a ball is what most moves
    ],
    ids=["told", "hardly told", "one paint"],
)
def test_a_wrong_alpha_of_two_paints_must_leave_a_trace(monkeypatch, scene, rank, share, believed):
    """Door: where nothing would contradict it, a shape is not believed; a known color is."""
    streak, image, plate = taken(scene)
    asked = end.smooth_light
    monkeypatch.setattr(
        end, "smooth_light", lambda data, state: replace(asked(data, state), share=share)
    )
    monkeypatch.setattr(end, "attenuation", lambda data, state: np.inf)  # nor any colors
    sweep = fit_sweep(image, plate, streak)
    assert (sweep.misfit <= MAX_MISFIT) == believed
    paints = np.stack([GREEN, RED][:rank])
    known = ColorModel(np.linalg.svd(paints.T, full_matrices=False)[0])
    assert fit_sweep(image, plate, streak, known).misfit <= MAX_MISFIT


@pytest.mark.battery
def test_outlines_are_asked_place_by_place(monkeypatch):
    """Door: like planes of colors they take up more than a disc of one paint."""
    streak, image, plate = taken(EGG)
    asked = end.smooth_light
    for places, believed in ((0.15, True), (0.25, False)):
        monkeypatch.setattr(
            end, "smooth_light",
            lambda data, state, places=places: replace(
                asked(data, state), astray_of_places=places, astray=0.05
            ),
        )  # fmt: skip
        sweep = fit_sweep(image, plate, streak)
        assert sweep.silhouette.order > 1
        assert (sweep.misfit <= MAX_MISFIT) == believed
        assert ("off by 25%" in sweep.complaint(MAX_MISFIT)) != believed


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

"""The shadow that a disc casts: where it is, and what of it a picture tells."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Scene,
    Shadow,
    Shot,
    plain_plate,
    render,
    textured_plate,
)
from blurmatte.streaks import Streak
from blurmatte.sweep.model.cast_shadow import CastShadow, covariance_added, fit_cast, in_shadow
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.42, 0.41, 0.4), 4)
WAY = Trajectory.line((60, 48), (96, 58))
RADIUS = 12.0
SHADOW = Shadow((-9.0, 15.0), softness=3.5, strength=(0.5, 0.45, 0.4))
CAST = CastShadow(np.array(SHADOW.offset), SHADOW.softness, np.array(SHADOW.strength))


def scene_of(plate=WALL, shadow=SHADOW):
    return Scene(plate, WAY, Ball(RADIUS, GREEN), shadow=shadow)


def data_of(scene, seed=None):
    """The data of a streak with all of its shadow, without noise unless there is a seed."""
    truth = render(scene, 256)
    moved = (truth.layer.alpha > 0) | (truth.shadow.max(axis=-1) > 0.002)
    if seed is None:
        known = LinearImage(truth.image.rgb, 1e-6 * np.ones_like(truth.image.rgb))
        plate = LinearImage(truth.plate.rgb, 1e-6 * np.ones_like(truth.image.rgb))
        return truth, observation_around(Streak(moved), 8, known, plate, None)
    shot = Shot(scene, Camera(code_std=1.5 / 255), plate_frames=3, seed=seed)
    return truth, observation_around(Streak(moved), 8, *with_noise(*shot.photograph(truth)), None)


def disc_in(data, radius=RADIUS):
    return state_at(data, LINE, WAY.xy.ravel(), DISC, DISC.start(radius), Frame.of(GREEN[:, None]))


def within(data, whole):
    """The part of a picture that data have."""
    (x0, y0), (h, w) = map(int, data.origin), data.weight.shape
    return whole[y0 : y0 + h, x0 : x0 + w]


def test_what_is_missing_is_what_a_rendered_shadow_takes():
    """oracle: the silhouette, moved and blurred, of many moments, where the object is not in front."""
    truth, data = data_of(scene_of())
    S = CAST.of(data, disc_in(data))
    assert_allclose(S[..., None] * CAST.strength, within(data, truth.shadow), atol=0.003)


def test_it_is_as_if_the_plate_were_darker():
    """exact: (1 − α) times that plate is all that is left of it."""
    rng = np.random.default_rng(0)
    alpha, B = rng.uniform(0, 0.9, (5, 6)), rng.uniform(0.1, 0.9, (5, 6, 3))
    S = rng.uniform(0, 1, alpha.shape) * (1 - alpha)
    left = (1 - alpha)[..., None] * CAST.on(B, S, alpha)
    assert_allclose(left, (1 - alpha[..., None] - S[..., None] * CAST.strength) * B, rtol=1e-10)


def test_large_pixels_have_means_of_small_ones():
    """invariant"""
    _, data = data_of(scene_of())
    coarse = data.coarser(2)
    small = CAST.of(data, disc_in(data))
    h, w = (2 * (n // 2) for n in small.shape)
    means = small[:h, :w].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3))
    assert_allclose(CAST.of(coarse, disc_in(coarse)), means, atol=0.02)


@pytest.mark.parametrize("start", [None, CastShadow(np.array([-14.0, 9.0]), 6.0, np.full(3, 0.1))])
def test_the_shadow_is_told_where_the_disc_is_known(start):
    _, data = data_of(scene_of())
    found = fit_cast(data, disc_in(data), start)
    assert_allclose(found.offset, CAST.offset, atol=0.15)
    assert_allclose(found.softness, CAST.softness, atol=0.3)
    assert_allclose(found.strength, CAST.strength, atol=0.02)


def test_one_that_lies_straight_below_is_told_too():
    """Where it is looked for first its offset has a part that is 0."""
    shadow = replace(SHADOW, offset=(4.0, 18.0))
    _, data = data_of(scene_of(shadow=shadow))
    assert_allclose(fit_cast(data, disc_in(data)).offset, shadow.offset, atol=0.15)


def test_without_a_shadow_there_is_none():
    for seed in range(3):
        _, data = data_of(scene_of(textured_plate(SIZE, 2), None), seed)
        assert not fit_cast(data, disc_in(data)).is_possible


def test_what_takes_all_light_or_that_of_one_channel_is_no_shadow():
    assert CAST.is_possible
    for strength in ([0, 0.6, 0.5], [0.04, 0, 0], [0.01, 0.01, 0.01], [0.93, 0.7, 1]):
        assert not replace(CAST, strength=np.array(strength)).is_possible


def told_together(seed, turns=20):
    """Of a ball whose shadow lies on most of its own way."""
    shadow = replace(SHADOW, offset=(8.0, 3.0))
    _, data = data_of(scene_of(shadow=shadow), seed)
    disc, cast = disc_in(data), replace(CAST, offset=np.array(shadow.offset))
    for _ in range(turns):
        cast = fit_cast(data, disc, cast)
        lit = in_shadow(data, disc, cast)
        disc = descend(lit, seen(lit, disc), (5, 30))
    return lit, disc, cast


def test_errors_of_disc_and_shadow_go_together():
    """honest: the scatter of radius and way, which alone would seem to be known better."""
    n, ends, alone, both = 12, [], [], []
    for seed in range(n):
        lit, disc, cast = told_together(seed)
        H, _ = disc.information(lit)
        added = covariance_added(lit, disc, cast)
        ends.append([*disc.path, disc.shape[0]])
        alone.append(np.sqrt(np.diag(np.linalg.inv(H))[:5]))
        both.append(np.sqrt(np.diag(np.linalg.inv(H) + added)[:5]))
        assert np.linalg.eigvalsh(added)[0] > -1e-9 * np.abs(added).max()
    z = (np.array(ends) - [*WAY.xy.ravel(), RADIUS]) / np.mean(both, axis=0)
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    wider = np.mean(both, axis=0) / np.mean(alone, axis=0)
    assert np.all(wider >= 1)
    assert wider.max() > 1.1

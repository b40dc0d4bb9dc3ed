"""What is less known of a shape that may be freer, and that others than it has lead elsewhere."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Camera, Change, Scene, Shot, plain_plate, render
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.ranking import price
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.freer import if_it_changes, if_not_round
from blurmatte.sweep.fit.outline_start import bulgy, shaped
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Swept
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.model.residual_statistics import overstated
from blurmatte.trajectory import Trajectory

GREEN = np.array([0.25, 0.7, 0.12])
WAY = Trajectory.line((46, 42), (110, 66))
BALL = Scene(plain_plate((160, 112), (0.34, 0.33, 0.3), 4), WAY, Ball(11, GREEN))
EGG = replace(BALL, change=Change(squash=(1.5, 1.5), squash_angle=0.9))
GROWING = replace(BALL, change=Change(scale=(0.9, 1.1)))
DROP = replace(BALL, change=Change(squash=(1.0, 1.4), squash_angle=0.9))
LONGER = np.array([0.0, np.log(1.4) * np.cos(1.8), np.log(1.4) * np.sin(1.8)])


@cache
def taken(scene, silhouette=DISC, seed=0):
    """The data, and the disc, or what else is asked for, that fits best."""
    truth = render(scene, 160)
    pictures = Shot(scene, Camera(code_std=1.5 / 255), plate_frames=3, seed=seed).photograph(truth)
    data = observation_around(Streak(truth.layer.alpha > 0), 12, *with_noise(*pictures), None)
    ends, frame = WAY.xy.ravel(), Frame.of(GREEN[:, None])
    start = state_at(data, LINE, ends, silhouette, silhouette.start(11), frame)
    return data, descend(data, start, (3, 40))


def test_what_a_disc_is_less_known_if_it_need_not_be_round():
    """oracle: invert all that is known of an outline, and leave the order out."""
    data, disc = taken(BALL)
    H, g = shaped(data, disc, bulgy(disc)).information(data)
    first = len(disc.path) + 1
    kept = [*range(first), *range(len(H) - 2, len(H))]
    every = np.linalg.inv(H)
    alone = np.linalg.inv(H[np.ix_(kept, kept)])
    freer = if_not_round(data, disc)
    assert_allclose(alone + freer.less_known, every[np.ix_(kept, kept)], rtol=1e-6, atol=1e-9)
    assert_allclose(freer.step, -(every @ g)[kept], rtol=1e-6, atol=1e-9)
    assert np.linalg.eigvalsh(freer.less_known).min() > -1e-9


@pytest.mark.parametrize("scene", [BALL, EGG], ids=["ball", "egg"])
def test_what_is_not_round_leads_elsewhere(scene):
    """honest: a ball's radius hardly differs if it may have order, that of something longer does."""
    data, disc = taken(scene)
    freer = if_not_round(data, disc)
    radius = len(disc.path)
    known = np.linalg.inv(disc.information(data)[0])
    std = np.sqrt((known + freer.less_known)[radius, radius])
    assert (abs(freer.step[radius]) > 5 * std) == (scene is EGG)


@pytest.mark.parametrize("silhouette", [DISC, ELLIPSE], ids=lambda s: s.name)
@pytest.mark.parametrize(
    ("scene", "change"),
    [(GROWING, [np.log(1.1 / 0.9), 0, 0]), (DROP, LONGER)],
    ids=["growing", "drop"],
)
def test_how_it_changes_is_found(scene, change, silhouette):
    """honest: one step finds much of what a ball does that grows, or becomes longer, and no more."""
    data, state = taken(scene, silhouette)
    freer = if_it_changes(data, state)
    far = np.linalg.norm(change)
    along = freer.freedom @ change / far
    assert 0.4 * far < along < 1.1 * far
    assert np.linalg.norm(freer.freedom - along * np.array(change) / far) < 0.2 * far
    assert freer.gain > 4


def test_what_does_not_change_seems_to_by_noise_alone():
    """honest: twice the gain is χ² of three, so that its mean is 1.5, and its spread as much."""
    gains = []
    for seed in range(12):
        data, disc = taken(BALL, seed=seed)
        freer = if_it_changes(data, disc)
        assert np.linalg.norm(freer.freedom) < 0.1
        gains.append(freer.gain)
    assert 0.3 < np.mean(gains) < 3
    assert max(gains) < price(data, 3)


def test_a_change_that_is_unusual_is_not_expected():
    """exact: where nothing tells of a change there is none."""
    data, disc = taken(BALL)
    dark = replace(data, weight=1e-12 * data.weight)
    freer = if_it_changes(dark, disc)
    assert_allclose(freer.freedom, 0, atol=1e-6)
    assert_allclose(freer.gain, 0, atol=1e-6)


def test_what_changes_is_less_known():
    """oracle: invert all that is known, with shapes that are alike by half or twice."""
    data, disc = taken(DROP)
    J = disc.swept.by_parameters
    by = disc.silhouette.by_change(disc.family, disc.path, disc.shape, data)
    swept = Swept(disc.swept.alpha, np.concatenate([J, by], axis=2))
    H, g = replace(disc, swept=swept).information(data)
    n = J.shape[2]
    H[n : n + 3, n : n + 3] += np.eye(3) * overstated(data, disc) * VARIANCE / 0.5**2
    kept = [*range(n), n + 3, n + 4]
    every, alone = np.linalg.inv(H), np.linalg.inv(H[np.ix_(kept, kept)])
    freer = if_it_changes(data, disc)
    assert_allclose(alone + freer.less_known, every[np.ix_(kept, kept)], rtol=1e-6, atol=1e-9)
    assert_allclose(freer.freedom, -(every @ g)[n : n + 3], rtol=1e-6)

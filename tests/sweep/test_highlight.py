"""The highlight of a disc: the smear it leaves, and what of it a picture tells."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shot, plain_plate, render
from blurmatte.streaks import Streak
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.highlight import (
    Highlight,
    covariance_added,
    fit_highlight,
    plane_of,
    without_highlight,
)
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.4, 0.4, 0.4), 4)
WAY = Trajectory.line((56, 46), (104, 62))
RADIUS = 13.0
LAMP = np.full(3, 0.6)


def data_of(ball, seed=None):
    """The data of a streak, without noise unless there is a seed."""
    scene = Scene(WALL, WAY, ball)
    truth = render(scene, 200)
    moved = Streak(truth.layer.alpha > 0)
    if seed is None:
        pictures = (
            LinearImage(p.rgb, np.full(p.rgb.shape, 1e-6)) for p in (truth.image, truth.plate)
        )
    else:
        shot = Shot(scene, Camera(code_std=1.5 / 255), plate_frames=3, seed=seed)
        pictures = with_noise(*shot.photograph(truth))
    return observation_around(moved, 8, *pictures, None)


def disc_in(data):
    return state_at(data, LINE, WAY.xy.ravel(), DISC, DISC.start(RADIUS), Frame.of(GREEN[:, None]))


def across(light, disc):
    """The part of a light that no shade of the paint has."""
    return disc.frame.across @ disc.frame.across.T @ light


def test_its_smear_is_the_mean_of_all_that_it_was():
    """oracle"""
    data = data_of(Ball(RADIUS, GREEN))
    disc, spot = disc_in(data), Highlight(np.array([-3.0, 4.5]), 2.2, LAMP)
    h, w = data.weight.shape
    y, x = np.mgrid[:h, :w] + np.array(data.origin)[::-1, None, None]
    expected = np.zeros((h, w))
    for t in (np.arange(500) + 0.5) / 500:
        cx, cy = (1 - t) * WAY.xy[0] + t * WAY.xy[1] + spot.offset
        expected += np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * 2.2**2)) / 500
    assert_allclose(spot.of(data, disc), expected, atol=3e-3 * expected.max())


def test_large_pixels_have_means_of_small_ones():
    """invariant"""
    data = data_of(Ball(RADIUS, GREEN))
    spot, coarse = Highlight(np.array([-3.0, 4.5]), 3.0, LAMP), data.coarser(2)
    fine = spot.of(data, disc_in(data))
    h, w = coarse.weight.shape
    means = fine[: 2 * h, : 2 * w].reshape(h, 2, w, 2).mean(axis=(1, 3))
    assert_allclose(spot.of(coarse, disc_in(coarse)), means, atol=0.02 * fine.max())


@pytest.mark.parametrize("known", [False, True], ids=["unknown", "nearly known"])
def test_a_spot_is_found_where_it_was_added(known):
    """oracle, but for large pixels: place, size, and the light across the paint."""
    data = data_of(Ball(RADIUS, GREEN))
    disc, spot = disc_in(data), Highlight(np.array([-3.0, 4.5]), 2.2, LAMP)
    lit = replace(data, C=data.C + spot.of(data, disc)[..., None] * spot.light)
    start = Highlight(np.array([-2.0, 5.5]), 3.0, LAMP) if known else None
    found = fit_highlight(lit, seen(lit, disc), start)
    assert_allclose(found.offset, spot.offset, atol=0.1)
    assert_allclose(found.softness, spot.softness, rtol=0.05)
    assert_allclose(found.light, across(LAMP, disc), rtol=0.1)
    rest = without_highlight(lit, disc, replace(spot, light=LAMP))
    assert_allclose(rest.C, data.C, atol=1e-12)


def test_its_color_is_the_least_that_no_channel_lacks():
    """exact, and door: what would take light that the paint has not is none."""
    disc = disc_in(data_of(Ball(RADIUS, GREEN)))
    color = Highlight(np.zeros(2), 2.0, across(LAMP, disc)).color(disc.main)
    assert_allclose(color.min(), 0, atol=1e-12)
    assert_allclose(across(color, disc) / np.linalg.norm(across(color, disc)),
                    across(LAMP, disc) / np.linalg.norm(across(LAMP, disc)), atol=1e-12)  # fmt: skip
    red = np.array([1.0, 0.0, 0.0])
    assert Highlight(np.zeros(2), 2.0, np.array([0.0, -0.1, 0.2])).color(red) is None


def test_it_is_paler_than_its_paint():
    """door: what makes a color deeper is no light of a lamp, though it may be light."""
    disc = disc_in(data_of(Ball(RADIUS, GREEN)))
    for sign, told in ((1, True), (-1, False)):
        spot = Highlight(np.zeros(2), 2.0, sign * 0.1 * across(LAMP, disc))
        assert (spot.color(disc.main) is not None) is told


def told_together(seed):
    data = data_of(Ball(RADIUS, GREEN, highlight=0.6), seed)
    disc, spot = disc_in(data), None
    for _ in range(6):
        spot = fit_highlight(data, disc, spot)
        rest = without_highlight(data, disc, spot)
        disc = descend(rest, seen(rest, disc), (6, 26))
    return rest, disc, spot


def test_errors_of_disc_and_highlight_go_together():
    """honest: path and radius scatter as claimed, by more than if the highlight were known."""
    ends, alone, both, poles = [], [], [], []
    plane = Ball(RADIUS, GREEN, highlight=0.6).model
    for seed in range(16):
        rest, disc, spot = told_together(seed)
        H, _ = disc.information(rest)
        known, added = np.linalg.inv(H), covariance_added(rest, disc, spot)
        assert np.linalg.eigvalsh(added)[0] > -1e-9 * np.abs(added).max()
        ends.append([*disc.path, disc.shape[0]])
        alone.append(np.sqrt(np.diag(known)[:5]))
        both.append(np.sqrt(np.diag(known + added)[:5]))
        model = plane_of(rest, disc, spot, (known + added)[-2:, -2:])
        poles.append(np.degrees(np.arccos(min(abs(model.pole @ plane.pole), 1))))
    z = (np.array(ends) - [*WAY.xy.ravel(), RADIUS]) / np.mean(both, axis=0)
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.8
    assert np.all(np.mean(both, axis=0) >= np.mean(alone, axis=0))
    assert np.mean(poles) < 2

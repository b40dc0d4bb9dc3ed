"""Cuts, pans and changes of light in a clip."""

import numpy as np
import pytest

from blurmatte.background.shots import find_shots, thumbnail
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import coded

SHAPE = (6, 8)


def scene(seed):
    return np.random.default_rng(seed).uniform(60, 180, SHAPE).astype(np.float32)


def frames(picture, count, gain=1.0, seed=0):
    """Noisy frames in which one square after the other is covered."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        now = gain * picture + rng.normal(0, 0.5, SHAPE).astype(np.float32)
        now[3, k % 8] = 250
        yield now


def edges(shots):
    return [(shot.start, shot.stop, shot.begins_with, shot.moving) for shot in shots]


def test_clip_of_one_scene_is_one_shot():
    assert edges(find_shots(frames(scene(1), 12), 1.0)) == [(0, 12, "start", False)]


def test_cut_begins_a_shot():
    both = [*frames(scene(1), 7), *frames(scene(2), 5)]
    assert edges(find_shots(both, 1.0)) == [(0, 7, "start", False), (7, 12, "cut", False)]


def test_flicker_is_no_shot_and_lasting_change_of_light_is():
    flicker = [one for k in range(10) for one in frames(scene(1), 1, 1 + 0.03 * (k % 2))]
    assert len(find_shots(flicker, 1.0)) == 1
    lamp = [*frames(scene(1), 6), *frames(scene(1), 6, 1.8)]
    assert edges(find_shots(lamp, 1.0))[1] == (6, 12, "light", False)


def test_moving_camera_is_a_shot_of_its_own():
    rng = np.random.default_rng(3)
    still = scene(1)
    pan = [still.copy()]
    for _ in range(6):  # a third of the squares change from frame to frame
        now = pan[-1].copy()
        now.flat[rng.permutation(now.size)[: now.size // 3]] += 20
        pan.append(now)
    found = find_shots([*frames(still, 5), *pan[1:], *frames(pan[-1], 5)], 1.0)
    assert edges(found) == [
        (0, 5, "start", False),
        (5, 11, "cut", True),
        (11, 16, "cut", False),
    ]


def test_flash_belongs_to_the_shot_before():
    flash = [*frames(scene(1), 5), np.full(SHAPE, 255, np.float32), *frames(scene(1), 5)]
    assert find_shots(flash, 1.0)[0].stop >= 6


def test_thumbnail_is_the_mean_over_squares():
    light = np.random.default_rng(4).uniform(0, 1, (33, 50, 3))
    small = thumbnail(coded(0, LinearImage(light)))
    assert small.shape == (2, 3)
    assert small[1, 2] == pytest.approx(light[16:32, 32:48, 0].mean(), rel=1e-5)


def test_no_frames_are_no_shots():
    assert find_shots([], 1.0) == []

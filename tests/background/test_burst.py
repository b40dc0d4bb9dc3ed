"""burst_plate: the plate of a shot from the hand, of other shots with the object elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from tests.handheld import fine_scene, noisy, shown, similarity, with_ball
from tests.scenes import on_line

from blurmatte.background import Matching, PlateGuess, burst_plate, fit_match, guess_plate
from blurmatte.background.burst import over_noise
from blurmatte.matting import solve
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import SRGB, LinearImage, decode
from blurmatte.rendering import Ball
from blurmatte.rendering.plates import textured_plate

SIZE = (192, 120)
VIEWS = [similarity(SIZE, -6.3, 4.1, 1.004, 0.01), similarity(SIZE), similarity(SIZE, 7.7, -3.4)]
GAINS = np.array([[1.06, 1.04, 0.98], [1, 1, 1], [0.95, 0.96, 1]])


@pytest.fixture(scope="module")
def points():
    return fine_scene((230, 150))


@pytest.fixture(scope="module")
def shots(points):
    def shot(k):
        start = np.array([40.0 + 45 * k, 60])
        rendering = with_ball(
            shown(points, SIZE, VIEWS[k]), VIEWS[k], start, start + np.array([20, -8])
        )
        return noisy(rendering.image.rgb * GAINS[k], k)

    return [shot(k) for k in range(3)]


def test_plate_of_two_other_shots_is_the_scene_without_the_object(points, shots):
    # honest
    plate, matches = burst_plate(shots[1], [shots[0], shots[2]])
    true = shown(points, SIZE, VIEWS[1])
    inside = np.s_[12:-12, 12:-12]
    valid = plate.valid[inside]
    assert valid.mean() > 0.97
    z = ((plate.rgb - true) / np.sqrt(plate.noise))[inside][valid]
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25
    assert np.abs(plate.rgb - true)[inside][valid].max() < 0.06  # the ball differs by up to 0.6
    assert [match.moves for match in matches] == [True, True]


def test_place_that_the_object_hides_in_all_shots_is_not_known(points):
    scene = shown(points, SIZE, VIEWS[1])
    lights = [scene.copy() for _ in range(3)]
    for k, light in enumerate(lights):
        light[40:80, 80:120] = np.eye(3)[k]
    image, *plates = (noisy(light, k) for k, light in enumerate(lights))
    plate, _ = burst_plate(image, plates)
    assert not plate.valid[44:76, 84:116].any()
    assert plate.valid[:36].mean() > 0.97


def overlapping(step, light):
    """Three shots of a wall by a camera at rest; a streak that moves on by `step` pixels."""
    h, w = light.shape[:2]
    y, x = np.mgrid[:h, :w]
    shots = []
    for k in range(3):
        along = np.clip(x, 60 + step * k, 100 + step * k)
        alpha = np.clip(1 - np.hypot(x - along, y - 50) / 12, 0, 0.5)[..., None]
        shots.append(noisy(alpha * (0.8, 0.16, 0.05) + (1 - alpha) * light, k))
    return shots


@pytest.mark.parametrize("step", [8, 16, 24])
def test_overlap_of_streaks_before_a_wall_is_guessed(step):
    # honest
    x = np.mgrid[:120, :192][1][..., None] / 192
    wall = (0.5 + 0.2 * x - 0.1 * x**2) * np.array([1, 0.9, 0.75])
    shots = overlapping(step, wall)
    plate, _ = burst_plate(shots[1], [shots[0], shots[2]], Matching.NONE)
    assert isinstance(plate, PlateGuess)
    assert plate.valid.all()
    assert np.abs(plate.rgb - wall)[30:70, 40:150].max() < 0.03  # the object differs by up to 0.35


def passing(overlap):
    """Three shots of a ball that moves 40 pixels before a wall; image, plate and wall."""
    x = np.mgrid[:120, :192][1][..., None] / 192
    wall = (0.45 + 0.2 * x - 0.1 * x**2) * np.array([1, 0.9, 0.75])
    step, half = np.array([40 * (1 - overlap), 0]), np.array([20, 0])
    shots = []
    for k in (-1, 0, 1):
        middle = np.array([96, 60]) + k * step
        picture = on_line(wall, middle - half, middle + half, Ball(10, (0.8, 0.16, 0.05)))
        shots.append(noisy(picture.image.rgb, k + 1))
    plate, _ = burst_plate(shots[1], [shots[0], shots[2]], Matching.NONE)
    return shots[1], plate, wall


@pytest.mark.parametrize("overlap", [0.3, 0.6, 0.8])
def test_shots_that_show_the_object_do_not_count_as_noise(overlap):
    # oracle: two of three shots show it in the same place
    _, plate, wall = passing(overlap)
    off = (plate.rgb - wall)[45:75, 60:132]
    assert isinstance(plate, PlateGuess)
    assert np.sqrt(np.mean(off**2)) < 0.007  # the object differs by up to 0.2


@pytest.mark.battery
@pytest.mark.parametrize("overlap", [0.3, 0.6, 0.8])
def test_length_of_streaks_that_overlap_is_within_its_error(overlap):
    # honest
    image, plate, _ = passing(overlap)
    motion = measure_motion(solve(image, plate))
    assert abs(motion.length - 40) < 3 * motion.length_std < 3
    assert abs(motion.radius - 10) < 3 * motion.radius_std


@pytest.mark.battery
def test_streaks_that_overlap_before_a_texture_are_within_their_errors():
    # honest: a rough guess does not show whether two shots agree on the scene or on the object
    z = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene, half, shots = textured_plate((200, 120), rng), np.array([20, 0]), []
        for k in (-1, 0, 1):
            middle = np.array([100 + 8 * k, 60])
            picture = on_line(scene, middle - half, middle + half, Ball(10, (0.8, 0.16, 0.05)))
            shots.append(noisy(picture.image.rgb, 3 * seed + k + 1))
        plate, _ = burst_plate(shots[1], [shots[0], shots[2]], Matching.NONE)
        motion = measure_motion(solve(shots[1], plate))
        z += [*((motion.center - [100, 60]) / motion.center_std)]
        z.append((motion.length - 40) / motion.length_std)
    assert np.mean(np.abs(z) < 3) >= 0.95


def test_streaks_apart_are_not_guessed():
    shots = overlapping(66, np.full((120, 260, 3), 0.5))
    plate, _ = burst_plate(shots[1], [shots[0], shots[2]], Matching.NONE)
    assert not isinstance(plate, PlateGuess)


def test_single_plate_is_refused(shots):
    # door
    with pytest.raises(ValueError, match="plates must be two or more, got 1; use match_plate"):
        burst_plate(shots[0], shots[1:2])


def test_shot_of_another_size_is_refused(shots):
    # door
    small = LinearImage(shots[0].rgb[:100])
    with pytest.raises(ValueError, match="size"):
        burst_plate(shots[1], [shots[0], small])


def test_match_does_not_follow_the_object_before_a_wall():
    """oracle: a displacement of the object looks like one of the camera, and then nothing moved"""
    x, y = np.meshgrid(np.arange(480), np.arange(320))
    shade = 0.35 + 0.2 * np.exp(-((x - 350) ** 2 + (y - 40) ** 2) / 6e4)
    wall, shots = shade[..., None] * [1, 0.95, 0.85], []
    for k in range(3):
        start = np.array([144 + 24.0 * k, 174 - 6.0 * k])
        light = on_line(
            wall, start, start + np.array([50, -12]), Ball(13, (0.85, 0.16, 0.05))
        ).image.rgb
        codes = np.rint(255 * SRGB.encode(np.clip(noisy(light, k).rgb, 0, 1)))
        shots.append(decode(codes.astype(np.uint8), SRGB))
    _, matches = burst_plate(shots[1], [shots[0], shots[2]])
    assert not any(match.moves for match in matches)
    assert not fit_match(shots[1], shots[0]).moves


@pytest.mark.parametrize("channels", [1, 3])
def test_noise_seldom_contradicts_a_guess(channels):
    # exact: the quantile of 99.9 %, in gray pictures of one channel
    noise = 0.01 * np.random.default_rng(5).standard_normal((150, 150, channels))
    seen = LinearImage(0.4 + noise + np.zeros(3), np.full((150, 150, 3), 1e-4))
    region = np.zeros((150, 150), bool)
    region[20:130, 20:130] = True
    guess = guess_plate(seen, region)
    again = replace(seen, rgb=0.4 + np.roll(noise, 75, axis=0) + np.zeros(3))
    over = over_noise((again.rgb - guess.rgb) ** 2, again, guess)
    assert 2e-4 < np.mean(over[region] > 1) < 3e-3

"""motion_of_added_light, and tracks of lamps before a dark sky."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from blurmatte.errors import MotionError
from blurmatte.motion.clip.steps import measure_clip
from blurmatte.motion.picture.measure import motion_of_added_light
from blurmatte.radiometry import LinearImage, NoiseModel

SIZE, LENGTH, BLUR, NOISE, FINE = (120, 70), 25.0, 1.4, 0.004, 4
COLOR = np.array([0.6, 0.7, 0.38])
COLOR /= np.linalg.norm(COLOR)


def lamp(middle, angle, brightness=6.0):
    """(H, W, 3) light of a point that moved, as a lens shows it; `brightness` is its sum."""
    width, height = SIZE
    t = np.linspace(-0.5, 0.5, 400)[:, None] * LENGTH
    xy = np.array(middle) + t * [np.cos(angle), np.sin(angle)]
    column, row = np.rint((xy + 0.5) * FINE - 0.5).astype(int).T
    points = np.zeros((height * FINE, width * FINE))
    np.add.at(points, (row, column), brightness / len(t))
    light = gaussian_filter(points, BLUR * FINE).reshape(height, FINE, width, FINE).sum((1, 3))
    return light[..., None] * COLOR


def any_way(rng):
    """The middle of a lamp, and the direction in which it moves."""
    return np.array([60, 35]) + rng.uniform(-3, 3, 2), rng.uniform(-0.3, 0.3)


def noisy(light, rng):
    noise = rng.normal(0, NOISE, light.shape)
    return LinearImage((light + noise).astype(np.float32), NoiseModel(read_std=NOISE))


def test_place_length_and_direction_of_a_lamp_are_within_their_errors():
    # honest
    rng = np.random.default_rng(1)
    sky, streak, z = np.full((*SIZE[::-1], 3), 0.003), np.ones(SIZE[::-1], bool), []
    streak[:15], streak[-15:] = False, False
    for _ in range(60):
        middle, angle = any_way(rng)
        image, plate = noisy(sky + lamp(middle, angle, 20.0), rng), noisy(sky, rng)
        motion = motion_of_added_light(image, plate, streak, COLOR)
        std = np.sqrt(np.diag(motion.covariance))
        z.append((motion.values[:4] - [*middle, angle, LENGTH]) / std[:4])
    z = np.array(z)
    np.testing.assert_allclose(np.sqrt(np.mean(z**2, axis=0)), 1, atol=0.3)
    assert np.abs(z).max() < 4


def test_errors_of_clipped_lamps_cover_the_light_that_is_cut_off():
    # honest: the peaks are above the sensor's white, and unknown
    rng = np.random.default_rng(4)
    sky, streak, off, claimed = np.full((*SIZE[::-1], 3), 0.003), np.ones(SIZE[::-1], bool), [], []
    streak[:15], streak[-15:] = False, False
    for _ in range(20):
        middle, angle = any_way(rng)
        image, plate = noisy(sky + lamp(middle, angle, 300.0), rng), noisy(sky, rng)
        clipped = (image.rgb >= 1).any(axis=-1)
        assert clipped.sum() > 50
        image = replace(image, rgb=np.minimum(image.rgb, 1), valid=~clipped)
        motion = motion_of_added_light(image, plate, streak, COLOR)
        off.append(motion.values[:4] - [*middle, angle, LENGTH])
        claimed.append(np.sqrt(np.diag(motion.covariance))[:4])
    z = np.array(off) / claimed
    assert np.abs(z).max() < 3


def test_errors_of_a_lamp_before_an_uneven_plate_cover_it():
    # honest: the plate's light is missing where the object hides it
    rng = np.random.default_rng(5)
    streak, z = np.ones(SIZE[::-1], bool), []
    streak[:15], streak[-15:] = False, False
    for _ in range(20):
        middle, angle = any_way(rng)
        cells = rng.uniform(0, 0.2, (9, 15, 1)).repeat(8, 0).repeat(8, 1)[: SIZE[1], : SIZE[0]]
        sky = cells * [0.6, 0.7, 0.38]
        alpha = lamp(middle, angle, 80.0) @ COLOR
        light = sky * (1 - alpha[..., None]) + 0.5 * alpha[..., None] * COLOR
        motion = motion_of_added_light(noisy(light, rng), noisy(sky, rng), streak, COLOR)
        z.append((motion.values[:2] - middle) / motion.center_std)
    assert np.abs(z).max() < 3


def test_light_that_is_not_above_its_error_has_no_motion():
    # door
    rng = np.random.default_rng(2)
    sky, streak = np.full((*SIZE[::-1], 3), 0.003), np.ones(SIZE[::-1], bool)
    with pytest.raises(MotionError, match="the added light sums to"):
        motion_of_added_light(noisy(sky, rng), noisy(sky, rng), streak, COLOR)


def test_lamp_before_a_dark_sky_is_found_in_every_frame():
    # honest
    rng = np.random.default_rng(3)
    stars = np.where(rng.random(SIZE[::-1]) < 0.01, rng.exponential(1.0, SIZE[::-1]), 0)
    sky = 0.003 * np.array([1.2, 1.0, 0.8]) + gaussian_filter(stars, 0.9)[..., None]
    places = [np.array([20 + 16 * k, 20 + 6 * k]) for k in range(6)]
    frames = [noisy(sky + lamp(xy, np.arctan2(6, 16), 40.0), rng) for xy in places]
    z = []
    for xy, row in zip(places, measure_clip(frames), strict=True):
        motion = row.sighting.motion
        z.append((motion.center - xy) / motion.center_std)
    assert np.abs(z).max() < 3.5


def test_lamp_before_a_dim_textured_sky_is_in_its_place_in_every_frame():
    """A change of speed looks like a change of brightness, and alpha is none where texture shows it."""
    # honest
    rng = np.random.default_rng(1)
    cells = 0.02 + 0.02 * rng.random((9, 15, 1)).repeat(8, 0).repeat(8, 1)
    sky = cells[: SIZE[1], : SIZE[0]] * [0.6, 0.7, 1.0]
    places = [np.array([20 + 11 * k, 56 - 6 * k]) for k in range(8)]
    light = [sky + lamp(xy, -0.5, 100.0) for xy in places]
    rows = measure_clip([noisy(one, rng) for one in light])
    off = np.array([row.sighting.motion.center - xy for xy, row in zip(places, rows, strict=True)])
    std = np.array([row.sighting.motion.center_std for row in rows])
    assert np.abs(off).max() < 0.1
    assert np.abs(off / std).max() < 3.5

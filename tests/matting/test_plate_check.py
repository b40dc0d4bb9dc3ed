"""Plate checks: brightness around the streak, and the order of image and plate."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import PlateWarning
from blurmatte.matting.plate_check import _brightness_around, _looks_swapped, warn_if_plate_differs
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Camera
from blurmatte.rendering.plates import two_hue_plate
from blurmatte.streaks import Streak

NOISE = NoiseModel(gain=2e-4, read_std=0.002)
CAMERA = Camera(NOISE, bits=None)


def pair(scene, gain=(1, 1, 1), seed=0):
    """A noisy image, `gain` times as bright per channel, and plate; the streak."""
    rng = np.random.default_rng(seed)
    image, plate = (
        CAMERA.photograph(light, rng) for light in (scene.image.rgb * gain, scene.plate.rgb)
    )
    return image, plate, Streak(scene.layer.alpha > 0)


def test_gain_is_measured_exactly():
    """Where the plate has one color, it is the gain itself."""
    plate = np.full((60, 80, 3), [0.3, 0.2, 0.1])
    image = LinearImage(plate * [1.05, 1, 0.9])
    streak = Streak.from_box((30, 20, 50, 40), (80, 60))
    gain = _brightness_around(image, LinearImage(plate), streak)
    assert_allclose(gain, [0.05, 0, -0.1], atol=1e-12)


def test_pixels_of_the_streak_are_ignored():
    plate = np.full((60, 80, 3), 0.3)
    light = plate.copy()
    light[20:40, 30:50] = 0.9
    streak = Streak.from_box((30, 20, 50, 40), (80, 60))
    assert not _brightness_around(LinearImage(light), LinearImage(plate), streak).any()


def test_pixels_of_other_motion_are_ignored(paint):
    image, plate, streak = pair(paint)
    light = image.rgb.copy()
    light[:, :15] += 0.3
    assert np.max(np.abs(_brightness_around(LinearImage(light), plate, streak))) < 0.01


def test_clipped_pixels_are_ignored(paint):
    image, plate, streak = pair(paint)
    light, valid = image.rgb.copy(), np.ones(streak.mask.shape, bool)
    light[:, 60:], valid[:, 60:] = 1, False
    gain = _brightness_around(LinearImage(light, valid=valid), plate, streak)
    assert np.max(np.abs(gain)) < 0.01


def test_too_few_surrounding_pixels_give_no_gain(paint):
    image, plate, _ = pair(paint, gain=(1.3, 1.3, 1.3))
    everywhere = Streak.from_box((0, 0, 192, 128), image.size)
    assert not _brightness_around(image, plate, everywhere).any()


def test_clipped_pictures_do_not_determine_the_order(paint):
    image, plate, streak = pair(paint)
    clipped = LinearImage(image.rgb, NOISE, valid=np.zeros(streak.mask.shape, bool))
    assert not _looks_swapped(plate, clipped, streak)


@pytest.mark.parametrize("gain", [(1.04, 1.04, 1.04), (0.95, 0.95, 0.95), (1, 1, 1.08)], ids=str)
def test_changed_brightness_warns(paint, gain):
    with pytest.warns(PlateWarning, match="brightness differs from the plate"):
        warn_if_plate_differs(*pair(paint, gain))


def test_warning_states_the_change_and_a_remedy(paint):
    with pytest.warns(PlateWarning) as caught:
        warn_if_plate_differs(*pair(paint, (1.06, 1, 0.94)))
    (said,) = (str(warning.message) for warning in caught)
    red, blue = _brightness_around(*pair(paint, (1.06, 1, 0.94)))[[0, 2]]
    assert f"{red:+.1%} in R" in said
    assert f"{blue:+.1%} in B" in said
    assert red > 0.04
    assert blue < -0.04
    assert "use a plate of the same exposure and light" in said


def test_same_brightness_does_not_warn(paint):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(20):
            warn_if_plate_differs(*pair(paint, seed=seed))


@pytest.mark.parametrize("alpha", [0.3, 0.7])
def test_lower_contrast_of_the_plate_means_swapped_pictures(alpha):
    """A flat sheet leaves 1 − alpha of the plate's contrast; if swapped, contrast increases."""
    light = two_hue_plate((96, 64), (0.5, 0.1, 0.1), (0.1, 0.2, 0.5), 0)
    streak = Streak.from_box((10, 10, 86, 54), (96, 64))
    a = alpha * streak.mask[..., None]
    blurred = a * np.array([0.4, 0.4, 0.1]) + (1 - a) * light
    rng = np.random.default_rng(0)
    image, plate = (CAMERA.photograph(p, rng) for p in (blurred, light))
    assert not _looks_swapped(image, plate, streak)
    assert _looks_swapped(plate, image, streak)
    with pytest.warns(PlateWarning, match="look swapped: .* the plate is the picture without"):
        warn_if_plate_differs(plate, image, streak)


def test_swapped_pictures_are_detected_despite_noise():
    """The plate's noise is not missing texture of the image."""
    texture = two_hue_plate((96, 64), (0.4, 0.2, 0.3), (0.3, 0.25, 0.35), 0)
    streak, rng = Streak.from_box((10, 10, 86, 54), (96, 64)), np.random.default_rng(0)
    camera = Camera(NoiseModel(read_std=0.005), bits=None)
    covered = np.where(streak.mask[..., None], 0.4 * texture + 0.15, texture)
    image, plate = (camera.photograph(light, rng) for light in (texture, covered))
    assert _looks_swapped(image, plate, streak)


def test_noise_is_not_taken_for_texture():
    """Before a flat plate no difference is found, at any noise."""
    flat, streak = np.full((64, 96, 3), 0.3), Streak.from_box((10, 10, 86, 54), (96, 64))
    cameras = [Camera(NoiseModel(read_std=std), bits=None) for std in (0.002, 0.02)]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        a, b = (camera.photograph(flat, rng) for camera in cameras)
        assert not _looks_swapped(a, b, streak)
        assert not _looks_swapped(b, a, streak)


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.3])
def test_shading_and_wrong_noise_do_not_look_swapped(paint, gain):
    """A gain that falls to the corners in the image alone, and noise stated twice too large."""
    image, plate, streak = pair(paint)
    y, x = np.indices(image.valid.shape)
    shading = gain * (1 - 0.2 * ((x / 191 - 0.5) ** 2 + (y / 127 - 0.5) ** 2))
    shaded = LinearImage(image.rgb * shading[..., None], NOISE)
    loud = NoiseModel(gain=8e-4, read_std=0.004)
    assert not _looks_swapped(shaded, plate.with_noise(NOISE), streak)
    assert not _looks_swapped(shaded.with_noise(loud), plate.with_noise(loud), streak)

"""Image and plate of plain arrays, photographed by one camera."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Camera, colorful_plate
from blurmatte.rendering.processing import Processing
from blurmatte.rendering.shot import photograph_pair

NOISE = NoiseModel(gain=1e-4, read_std=0.002)
PHONE = Camera(NOISE, blur=0.6, bayer=True, processing=Processing(1, 0.3, 0.8))


@pytest.fixture(scope="module")
def lights():
    plate = colorful_plate((61, 45), 1, tile=15)
    image = plate.copy()
    image[15:30, 20:40] = [0.6, 0.3, 0.1]
    return image, plate


def test_image_is_taken_before_the_plate(lights):
    image, plate = photograph_pair(PHONE, *lights, rng=7)
    rng = np.random.default_rng(7)
    for picture, light in zip((image, plate), lights, strict=True):
        assert_array_equal(picture.rgb, PHONE.photograph(light, rng).rgb)
    assert_array_equal(photograph_pair(PHONE, *lights, 7, plate_frames=3)[0].rgb, image.rgb)


def test_plate_is_the_median_of_its_frames(lights):
    _, plate = photograph_pair(PHONE, *lights, 7, plate_frames=4)
    rng = np.random.default_rng(7)
    PHONE.photograph(lights[0], rng)
    frames = [PHONE.photograph(lights[1], rng) for _ in range(4)]
    assert_array_equal(plate.rgb, np.median([f.rgb for f in frames], axis=0))
    assert plate.noise is None


@pytest.mark.parametrize("plate_frames", [1, 4])
def test_frames_of_a_clip_are_the_lights(lights, plate_frames):
    pytest.importorskip("av")
    pair = photograph_pair(Camera(NOISE), *lights, 7, plate_frames, crf=10)
    for picture, light in zip(pair, lights, strict=True):
        rms = np.sqrt(np.mean((picture.rgb - light) ** 2, axis=(0, 1)))
        assert_allclose(rms, 0, atol=0.05)
        assert picture.meta.levels == 256


def test_codec_repeats_static_frames(lights):
    """Of a plate, noise differs from frame to frame; in a coarse clip hardly anything does."""
    pytest.importorskip("av")
    image, plate = photograph_pair(Camera(NOISE), lights[1], lights[1], 7, crf=30)
    apart = photograph_pair(Camera(NOISE), lights[1], lights[1], 7)
    assert np.std(image.rgb - plate.rgb) < 0.5 * np.std(apart[0].rgb - apart[1].rgb)


def test_rejects_wrong_arguments(lights):
    image, plate = lights
    with pytest.raises(ValueError, match="image is 61x44 pixels and plate 61x45"):
        photograph_pair(PHONE, image[1:], plate, 1)
    with pytest.raises(ValueError, match="plate_frames must be 1 or more, got 0"):
        photograph_pair(PHONE, image, plate, 1, plate_frames=0)
    with pytest.raises(TypeError, match="plate must hold linear light as floats"):
        photograph_pair(PHONE, image, plate.astype(int), 1)
    for settings in ({"bits": 16}, {"bits": None}, {"jpeg_quality": 90}):
        with pytest.raises(ValueError, match=r"frames of an H\.264 clip hold 8 bits"):
            photograph_pair(Camera(**settings), image, plate, 1, crf=23)

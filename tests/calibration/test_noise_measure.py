"""Gain and read noise of a camera from frames, from an even region, and against a plate."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import shift

from blurmatte.calibration import measure_noise, measure_noise_against, measure_noise_within
from blurmatte.calibration.noise_measure import _fitted
from blurmatte.calibration.noise_samples import noise_of_frames
from blurmatte.errors import NoiseError
from blurmatte.radiometry import LINEAR, LinearImage, NoiseModel
from blurmatte.rendering import Camera
from blurmatte.rendering.plates import textured_plate

SENSOR = NoiseModel(gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.0015, 0.003))
FAINT = NoiseModel(gain=(2e-5, 1e-5, 4e-5), read_std=(6e-4, 5e-4, 1e-3))
UNEQUAL = NoiseModel(gain=SENSOR.gain, read_std=SENSOR.read_std, relative_std=0.02)
BAR = 0.05


def ramp(width, height):
    """Light that rises smoothly from dark to bright."""
    level = 0.02 + 0.75 * np.linspace(0, 1, width) ** 2
    return np.tile(level[:, None] * [1, 0.8, 0.9], (height, 1, 1))


RAMP = ramp(320, 240)
SMALL = ramp(128, 96)
TEXTURE = textured_plate((320, 240), 1)


def frames(light, count, noise=SENSOR, seed=0, **camera):
    """Pictures of the same light, or of each of several; their noise not known."""
    camera = Camera(noise, **({"bits": 16} | camera))
    rng = np.random.default_rng(seed)
    several = [light] * count if isinstance(light, np.ndarray) else light
    return [camera.photograph(one, rng).with_noise(None) for one in several]


def check(fit, noise=SENSOR, bar=BAR):
    assert_allclose(fit.sensor.gain, noise.gain, rtol=bar)
    assert_allclose(fit.sensor.read_std, noise.read_std, rtol=bar)


CAMERAS = [
    pytest.param({"bits": None}, SENSOR, id="floats"),
    pytest.param({"bits": 16, "transfer": LINEAR}, SENSOR, id="16 bit linear"),
    pytest.param({"bits": 12, "transfer": LINEAR}, SENSOR, id="12 bit linear"),
    pytest.param({"bits": 8}, SENSOR, id="8 bit"),
    pytest.param({"bits": 8}, FAINT, id="8 bit, mostly rounding"),
]


@pytest.mark.parametrize(("camera", "noise"), CAMERAS)
def test_frames_give_gain_and_read_noise(camera, noise):
    """Oracle: what the camera was given, whatever its file adds."""
    fit = measure_noise(frames(RAMP, 8, noise, **camera))
    check(fit, noise)
    assert np.all(fit.gain_std < BAR * np.array(noise.gain))
    assert np.all(fit.read_std_std < BAR * np.array(noise.read_std))
    assert_allclose(fit.scale, 1, atol=0.1)
    assert fit.changed < 0.001
    assert fit.separable


@pytest.mark.parametrize(("camera", "noise"), CAMERAS[1:4:2])
def test_plate_and_even_region_give_gain_and_read_noise(camera, noise):
    """Oracle."""
    picture, plate = frames(RAMP, 2, noise, **camera)
    check(measure_noise_against(picture, plate), noise)
    check(measure_noise_within(picture, np.ones((240, 320), bool)), noise, 1.2 * BAR)


def test_noise_of_code_values_includes_rounding():
    """Oracle: the scatter of many pictures about the exact light."""
    found = measure_noise(frames(RAMP, 4, bits=8)).noise
    for level in (0.03, 0.2, 0.6):
        light = level * (1 + 0.1 * np.random.default_rng(0).uniform(-1, 1, (300, 300, 3)))
        error = frames(light, 1, bits=8)[0].rgb - light
        assert_allclose(
            found.variance(np.full(3, level)), np.mean(error**2, axis=(0, 1)), rtol=0.06
        )


def scores_of(kind, noise):
    """(estimate - truth) / std of gain and read noise, over seeds."""
    scores = []
    for seed in range(8):
        pictures = frames(SMALL, 2, noise, seed)
        match kind:
            case "frames":
                fit = measure_noise(pictures)
            case "within":
                fit = measure_noise_within(pictures[0], np.ones((96, 128), bool))
            case "against":
                fit = measure_noise_against(*pictures)
        scores.append(np.subtract(fit.sensor.gain, noise.gain) / fit.gain_std)
        scores.append(np.subtract(fit.sensor.read_std, noise.read_std) / fit.read_std_std)
    return scores


@pytest.mark.parametrize("kind", ["frames", "within", "against"])
def test_std_of_gain_and_read_noise_is_calibrated(kind):
    """Honest: of a camera with noise proportional to the light."""
    scores = scores_of(kind, UNEQUAL)
    assert abs(np.mean(scores)) < 0.3
    assert 0.8 < np.std(scores) < 1.2


@pytest.mark.parametrize("kind", ["frames", "within", "against"])
def test_std_is_conservative_if_no_noise_is_proportional_to_the_light(kind):
    """Honest: it includes a possible one, which cannot be negative."""
    scores = scores_of(kind, SENSOR)
    assert abs(np.mean(scores)) < 0.3
    assert 0.5 < np.std(scores) < 0.8


def test_texture_does_not_bias_frames():
    """Invariant: light that changes from pixel to pixel has the same noise."""
    check(measure_noise(frames(TEXTURE, 6)))


def moving(light, radius, count):
    """A ball that crosses the scene."""
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    for k in range(count):
        scene = light.copy()
        scene[(x - 60 - 30 * k) ** 2 + (y - 120) ** 2 < radius**2] = 0.5
        yield scene


@pytest.mark.parametrize("radius", [10, 40])
def test_moving_objects_are_rejected(radius):
    """Invariant; the larger one covers a third of some frames."""
    fit = measure_noise(frames(list(moving(RAMP, radius, 6)), 6))
    check(fit)
    swept = np.any([scene != RAMP for scene in moving(RAMP, radius, 6)], axis=(0, -1)).mean()
    assert 0.6 * swept < fit.changed < swept + 0.05


def test_flicker_and_drift_are_corrected():
    """Invariant."""
    rng = np.random.default_rng(0)
    across = np.linspace(0, 1, 320)[:, None]
    check(measure_noise(frames([RAMP * (1 + 0.02 * rng.normal()) for _ in range(6)], 6)))
    check(measure_noise(frames([RAMP * (1 + 0.01 * k * across) for k in range(6)], 6)))


def test_only_still_pixels_are_used():
    """Oracle: the rest may be anything."""
    pictures = frames(RAMP, 3)
    still = np.zeros((240, 320), bool)
    still[:120] = True
    spoiled = []
    for k, picture in enumerate(pictures):
        rgb = picture.rgb.copy()
        rgb[120:] = 0.1 + 0.2 * k
        spoiled.append(LinearImage(rgb, valid=picture.valid, meta=picture.meta))
    fit = measure_noise(spoiled, still)
    check(fit)
    assert fit.changed < 0.01


def test_clipped_pixels_are_ignored():
    """Invariant: black and white areas, whose noise is cut off."""
    light = RAMP.copy()
    light[:80], light[80:160, 250:] = 0, 1
    check(measure_noise(frames(light, 6, bits=8)))


def test_accepts_iterators():
    """Invariant: with the result of a list."""
    pictures = frames(SMALL, 3)
    assert measure_noise(iter(pictures)).sensor == measure_noise(pictures).sensor


def test_large_pictures_are_sampled():
    """Oracle: all of the picture."""
    sample = noise_of_frames(frames(TEXTURE, 6), None, max_pixels=40_000)
    assert sample.light.size < 0.6 * TEXTURE.size
    check(_fitted(sample)[0], bar=0.1)


@pytest.mark.parametrize("part", [0.0, 0.5])
def test_the_plate_may_be_an_average(part):
    """Oracle: the picture's noise, not the mean of both."""
    calm = NoiseModel.from_coefficients(part**2 * SENSOR.coefficients)
    (picture,), (plate,) = frames(RAMP, 1), frames(RAMP, 1, calm, seed=1)
    check(measure_noise_against(picture, plate), bar=1.5 * BAR)


def test_object_before_the_plate_is_rejected():
    """Invariant."""
    (picture,), (plate,) = frames([next(moving(RAMP, 40, 1))], 1), frames(RAMP, 1, seed=1)
    fit = measure_noise_against(picture, plate)
    check(fit)
    assert 0.05 < fit.changed < 0.1


def test_compressed_noise_is_correlated():
    """Oracle: compression preserves noise over large areas, and reduces it in pixels."""
    fit = measure_noise(frames(RAMP, 4, bits=8, jpeg_quality=95))
    middle = np.full(3, 0.3)
    single = fit.noise.variance(middle) / SENSOR.variance(middle)
    assert np.all(single < 0.75)
    assert np.all((single * fit.scale**2 > 0.7) & (single * fit.scale**2 < 2))
    halved = measure_noise(frames(RAMP, 4, bits=8, jpeg_quality=95, chroma="4:2:0"))
    assert np.all(halved.scale > 1.5 * fit.scale)


def test_demosaiced_noise_is_correlated():
    """Oracle: red and blue of a mosaic are measured in one pixel of four, green in two."""
    fit = measure_noise(frames(RAMP, 4, bayer=True))
    assert_allclose(fit.scale, [2.45, 1.67, 2.45], rtol=0.1)


def test_texture_everywhere_gives_an_upper_bound():
    """Invariant: at least the noise, with a scale above 1."""
    fit = measure_noise_within(frames(TEXTURE, 1)[0], np.ones((240, 320), bool))
    light = np.full(3, 0.25)
    assert np.all(fit.noise.variance(light) > 2 * SENSOR.variance(light))
    assert np.all(fit.scale > 2)


def test_edges_in_an_even_region_are_rejected():
    """Invariant."""
    light = RAMP.copy()
    light[100:104] *= 0.5
    fit = measure_noise_within(frames(light, 1)[0], np.ones((240, 320), bool))
    check(fit, bar=0.1)
    assert fit.changed > 0.02


def test_one_level_of_light_does_not_separate_gain_and_read_noise():
    """Honest: the fit is marked as inseparable; the sum is correct."""
    region = np.zeros((240, 320), bool)
    region[50:150, 200:300] = True
    (picture,) = frames(np.full((240, 320, 3), 0.3), 1)
    fit = measure_noise_within(picture, region)
    assert not fit.separable
    light = np.full(3, 0.3)
    assert_allclose(fit.noise.variance(light), SENSOR.variance(light), rtol=0.1)


@pytest.mark.parametrize("pixels", [0.3, 2.0])
def test_rejects_a_moving_camera(pixels):
    """Door."""
    rng = np.random.default_rng(0)
    moved = [shift(TEXTURE, (*(pixels * rng.normal(size=2)), 0), order=1, mode="nearest")
             for _ in range(4)]  # fmt: skip
    with pytest.raises(NoiseError, match=r"the camera moved: frames are shifted by up to \d"):
        measure_noise(frames(moved, 4))


def test_rejects_frames_of_another_scene():
    """Door: most of the picture changed."""
    other = RAMP.copy()
    other[60:] = RAMP[:180, ::-1]
    with pytest.raises(NoiseError, match=r"changed by more than noise|the camera moved|exposure"):
        measure_noise(frames([RAMP, other], 2))


@pytest.mark.parametrize(
    ("light", "said"),
    [
        ([0 * SMALL + 2] * 2, "0 pixels are usable to measure noise, 256 are needed"),
        ([0 * SMALL] * 2, r"\d+ pixels are usable to measure noise"),
        ([SMALL, 2 * SMALL], r"brightness of frame 2 differs .* by \+6.%; .* same exposure"),
    ],
    ids=["white", "black", "exposure"],
)
def test_rejects_clipped_frames_and_other_exposures(light, said):
    """Door."""
    with pytest.raises(NoiseError, match=said):
        measure_noise(frames(light, 2))


def test_rejects_copies():
    """Door."""
    with pytest.raises(NoiseError, match="there is no noise: the pictures are copies of one"):
        measure_noise(frames(SMALL, 1) * 3)
    with pytest.raises(NoiseError, match="there is no noise"):
        measure_noise_within(LinearImage(np.full((40, 40, 3), 0.5)), np.ones((40, 40), bool))


def test_rejects_wrong_arguments():
    """Door."""
    (picture,), small = frames(SMALL, 1), LinearImage(np.full((40, 40, 3), 0.5))
    with pytest.raises(ValueError, match=r"frames must be two or more .*, got none"):
        measure_noise([])
    with pytest.raises(ValueError, match=r"frames must be two or more .*, got one"):
        measure_noise([picture])
    with pytest.raises(ValueError, match="frame 1 is 128x96 pixels and frame 2 40x40"):
        measure_noise([picture, small])
    with pytest.raises(ValueError, match=r"still must have the shape \(96, 128\)"):
        measure_noise([picture, picture], np.ones((40, 40), bool))
    with pytest.raises(TypeError, match="region must hold booleans"):
        measure_noise_within(picture, np.ones((96, 128)))
    with pytest.raises(ValueError, match="region must hold some pixels"):
        measure_noise_within(picture, np.zeros((96, 128), bool))
    few = np.zeros((96, 128), bool)
    few[:10, :10] = True
    with pytest.raises(NoiseError, match="100 pixels are usable to measure noise"):
        measure_noise_within(picture, few)

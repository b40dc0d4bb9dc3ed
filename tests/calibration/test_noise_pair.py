"""NoiseModel equals its formula, and fit_noise recovers the noise of the camera."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.calibration import fit_noise, with_noise
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, NoiseModel
from blurmatte.rendering import Camera

SENSOR = NoiseModel(
    gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.001, 0.004), relative_std=(0.003, 0.002, 0.006)
)
LIGHT = np.array([0.05, 0.1, 0.2, 0.35])[:, None] * np.ones(3)


def std_of(noise):
    return np.sqrt(noise.variance(LIGHT))


def scaled(noise, factor):
    return NoiseModel.from_coefficients(noise.coefficients * factor**2)


def pair(light, plate, noise, plate_part, seed, **camera):
    """Two pictures, the second with `plate_part` of the first's noise; their noise not known."""
    rng, of_plate = np.random.default_rng(seed), scaled(noise, plate_part)
    code_std = camera.pop("code_std", 0)
    image = Camera(noise, code_std, **camera).photograph(light, rng)
    plate = Camera(of_plate, code_std * plate_part, **camera).photograph(plate, rng)
    return image.with_noise(None), plate.with_noise(None)


def code_noise(code_std):
    """(4, 3) true std of light in an 8-bit sRGB file: noise in code values, and rounding."""
    return SRGB.slope(LIGHT) * np.sqrt(code_std**2 + 1 / 255**2 / 12)


def test_variance_is_the_formula():
    light = np.array([0.3, 0.1, 0.5])
    expected = [0.002**2 + 2e-4 * 0.3 + (0.003 * 0.3) ** 2,
                0.001**2 + 1e-4 * 0.1 + (0.002 * 0.1) ** 2,
                0.004**2 + 4e-4 * 0.5 + (0.006 * 0.5) ** 2]  # fmt: skip
    assert_allclose(SENSOR.variance(light), expected, rtol=1e-14)
    assert_allclose(
        SENSOR.variance(-light), np.square([0.002, 0.001, 0.004])
    )  # no negative photons
    assert SENSOR.variance(light.astype(np.float32)).dtype == np.float32


def test_from_coefficients_inverts_coefficients():
    again = NoiseModel.from_coefficients(SENSOR.coefficients)
    assert_allclose(again.coefficients, SENSOR.coefficients, rtol=1e-12)
    assert_array_equal(NoiseModel(gain=0.1).gain, [0.1, 0.1, 0.1])


@pytest.mark.parametrize("field", ["gain", "read_std", "relative_std"])
@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf, (0, 0, -1)])
def test_rejects_negative_and_infinite_parameters(field, value):
    with pytest.raises(ValueError, match=f"{field} must lie between 0 and 1e\\+06"):
        NoiseModel(**{field: value})


@pytest.mark.parametrize("transfer", [SRGB, LINEAR], ids=lambda transfer: transfer.name)
def test_rounding_model_equals_rounded_light(transfer):
    rng = np.random.default_rng(0)
    for light in (0.02, 0.1, 0.3, 0.8):
        exact = light * (1 + 0.1 * rng.uniform(-1, 1, (300, 300, 3)))
        rounded = Camera(transfer=transfer).photograph(exact, 0).rgb
        predicted = np.sqrt(NoiseModel.rounding(256, transfer).variance(np.full(3, light)))
        assert_allclose(np.sqrt(np.mean((rounded - exact) ** 2)), predicted, rtol=0.12)


@pytest.mark.parametrize("plate_part", [0, 0.5, 1])
def test_measures_a_sensor(paint, plate_part):
    fits = [fit_noise(*pair(paint.image.rgb, paint.plate.rgb, SENSOR, plate_part, seed, bits=None))
            for seed in range(4)]  # fmt: skip
    image = np.mean([std_of(of_image) for of_image, _ in fits], axis=0)
    plate = np.mean([std_of(of_plate) for _, of_plate in fits], axis=0)
    true = std_of(SENSOR)
    assert_allclose(np.hypot(image, plate), true * np.hypot(1, plate_part), rtol=0.08)
    assert_allclose(np.mean(image / true), 1, atol=0.06)
    assert_allclose(np.mean(plate / true), plate_part, atol=0.2 if plate_part == 0 else 0.06)


@pytest.mark.diagonal
@pytest.mark.parametrize("plate_part", [0, 0.5, 1])
@pytest.mark.parametrize("code_std", [1 / 255, 2 / 255], ids=["1/255", "2/255"])
def test_measures_eight_bit_files(paint, code_std, plate_part):
    fits = [fit_noise(*pair(paint.image.rgb, paint.plate.rgb, NoiseModel(), plate_part, seed,
                            code_std=code_std)) for seed in range(4)]  # fmt: skip
    image, plate = (np.mean([std_of(fit[i]) for fit in fits], axis=0) for i in (0, 1))
    true_image, true_plate = code_noise(code_std), code_noise(code_std * plate_part)
    assert_allclose(np.hypot(image, plate), np.hypot(true_image, true_plate), rtol=0.1)
    assert_allclose(np.mean(image / true_image), 1, atol=0.1)
    # Noise of the plate alone is the difference of two uncertain variances.
    assert_allclose(np.mean(plate / true_image), np.mean(true_plate / true_image), atol=0.15)


def test_moving_objects_are_rejected(paint):
    """The moving ball covers a sixth of the picture; leaving it out by hand changes little."""
    image, plate = pair(paint.image.rgb, paint.plate.rgb, SENSOR, 1, 0, bits=None)
    of_image, of_plate = fit_noise(image, plate)
    known, known_plate = fit_noise(image, plate, still=paint.layer.alpha == 0)
    blind, by_hand = (np.hypot(std_of(a), std_of(b))
                      for a, b in ((of_image, of_plate), (known, known_plate)))  # fmt: skip
    assert_allclose(blind, by_hand, rtol=0.05)


@pytest.mark.parametrize("cut", [0.0, 1.5], ids=["black", "white"])
def test_clipped_areas_are_ignored(paint, cut):
    light = paint.plate.rgb.copy()
    light[:, :110] = cut
    noise = NoiseModel(gain=1e-4, read_std=0.002)
    for bits, transfer in ((16, LINEAR), (16, SRGB), (8, SRGB)):
        fits = fit_noise(*pair(light, light, noise, 1, 3, bits=bits, transfer=transfer))
        for fit in fits:
            assert_allclose(std_of(fit), std_of(noise), rtol=0.15)


def test_large_uniform_area_does_not_bias_other_levels(paint):
    light = paint.plate.rgb.copy()
    light[:, :120] = 0.3
    of_image, of_plate = fit_noise(*pair(light, light, NoiseModel(), 1, 3, code_std=1 / 255))
    assert_allclose(np.hypot(std_of(of_image), std_of(of_plate)),
                    np.sqrt(2) * code_noise(1 / 255), rtol=0.15)  # fmt: skip


def test_equal_pictures_have_no_noise(paint):
    of_image, of_plate = fit_noise(paint.image, paint.plate)
    assert std_of(of_image).max() < 1e-6
    assert std_of(of_plate).max() < 1e-6


def test_noise_of_files_is_at_least_rounding(paint):
    plate = Camera().photograph(paint.plate.rgb, 0)
    for fit in fit_noise(plate, plate):
        assert_allclose(std_of(fit), std_of(NoiseModel.rounding(256, SRGB)), rtol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 5, 3), (5, 1, 3), (2, 2, 3), (20, 2, 3)])
def test_tiny_pictures_give_a_result(shape):
    rng = np.random.default_rng(0)
    plate = LinearImage(rng.uniform(0.1, 1, shape))
    image = LinearImage(plate.rgb + rng.normal(0, 0.01, shape))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for fit in fit_noise(image, plate):
            assert np.isfinite(std_of(fit)).all()


def test_no_valid_pixels_give_no_noise(paint):
    nothing = LinearImage(paint.plate.rgb, valid=np.zeros(paint.plate.valid.shape, bool))
    for fit in fit_noise(nothing, paint.plate):
        assert std_of(fit).max() < 1e-6


def test_known_noise_is_kept(paint):
    image, plate = paint.image.with_noise(SENSOR), paint.plate
    with_both, measured = with_noise(image, plate)
    assert with_both is image
    assert isinstance(measured.noise, NoiseModel)
    assert with_noise(image, plate.with_noise(SENSOR))[1].noise is SENSOR


def test_rejects_wrong_sizes_and_masks(paint):
    small = LinearImage(np.ones((4, 4, 3)))
    with pytest.raises(TypeError, match="light must be a ndarray, got list"):
        NoiseModel(read_std=0.1).variance([0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="image is 192x128 pixels and plate 4x4"):
        fit_noise(paint.image, small)
    with pytest.raises(ValueError, match=r"still must have the shape \(4, 4\), got \(2, 2\)"):
        fit_noise(small, small, still=np.ones((2, 2), bool))
    with pytest.raises(TypeError, match="still must hold booleans"):
        fit_noise(small, small, still=np.ones((4, 4)))

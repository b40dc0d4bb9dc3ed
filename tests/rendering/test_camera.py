"""The camera: noise as its model says, code values as the transfer says, the seed decides."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import LINEAR, SRGB, NoiseModel
from blurmatte.rendering import add_noise, encode_codes, photograph

LIGHT = np.array([0.05, 0.2, 0.6])
NOISE = NoiseModel(gain=2e-4, read_std=0.002, relative_std=0.003)


@pytest.fixture(scope="module")
def light():
    return np.tile(LIGHT, (150, 200, 1))


def test_noise_has_the_variance_of_its_model(light):
    rest = add_noise(light, NOISE, 1) - light
    assert_allclose(rest.mean(axis=(0, 1)), 0, atol=4e-4)
    assert_allclose(rest.std(axis=(0, 1)), np.sqrt(NOISE.variance(LIGHT)), rtol=0.02)


def test_noise_in_code_values_has_its_spread_there(light):
    noisy = add_noise(light, NoiseModel(), 1, SRGB, code_std=2 / 255)
    codes = SRGB.encode(noisy) - SRGB.encode(light)
    assert_allclose(codes.std(axis=(0, 1)), 2 / 255, rtol=0.02)


def test_floats_know_their_noise(light):
    assert photograph(light, NOISE, 1, bits=None).noise is NOISE
    picture = photograph(light, NOISE, 1, bits=None, code_std=1 / 255)
    assert picture.rgb.dtype == light.dtype
    assert_allclose((picture.rgb - light).std(axis=(0, 1)) ** 2, picture.variance[0, 0], rtol=0.04)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("transfer", [SRGB, LINEAR], ids=lambda transfer: transfer.name)
def test_without_noise_only_rounding_is_left(light, bits, transfer):
    rng = np.random.default_rng(0)
    light = rng.uniform(0.01, 0.9, light.shape)
    picture = photograph(light, NoiseModel(), 1, bits, transfer)
    step = np.abs(transfer.encode(picture.rgb.astype(float)) - transfer.encode(light))
    assert step.max() < 0.501 / (2**bits - 1) + 1e-6
    assert picture.meta.levels == 2**bits
    assert picture.noise is None


def test_codes_are_encoded_rounded_and_clipped():
    light = np.array([-0.1, 0, 0.5, 1, 3])
    assert_array_equal(encode_codes(light, 8), [0, 0, 188, 255, 255])
    assert_array_equal(encode_codes(light, 16, LINEAR), [0, 0, 32768, 65535, 65535])


def test_clipped_light_is_not_valid():
    light = np.full((2, 2, 3), 0.5)
    light[0, 0, 1] = 1.4
    assert_array_equal(photograph(light, NoiseModel(), 1).valid, [[False, True], [True, True]])


def test_same_seed_same_bytes(light):
    first, again, other = (photograph(light, NOISE, seed).rgb.tobytes() for seed in (5, 5, 6))
    assert first == again != other
    rng = np.random.default_rng(5)
    assert add_noise(light, NOISE, rng).tobytes() != add_noise(light, NOISE, rng).tobytes()


def test_door(light):
    with pytest.raises(TypeError, match="rng"):
        photograph(light, NOISE)
    with pytest.raises(TypeError, match="light must hold linear light as floats, got uint8"):
        photograph(light.astype(np.uint8), NOISE, 1)
    with pytest.raises(ValueError, match="bits must be 8 or 16, got 12"):
        photograph(light, NOISE, 1, bits=12)
    with pytest.raises(ValueError, match="code_std must be finite and not negative"):
        add_noise(light, NOISE, 1, code_std=-1)

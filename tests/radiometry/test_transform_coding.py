import numpy as np
import pytest
from scipy.fft import dctn, idctn

from blurmatte.radiometry import SRGB, CodingError
from blurmatte.radiometry.transform_coding import lost_change, quantization_variance

BLOCKS = (24, 20)


def texture(strength, falloff, seed=0):
    """(H, W) blocks whose cosine coefficients have Laplace distributions, weaker at high frequency."""
    rng = np.random.default_rng(seed)
    u = np.add.outer(np.arange(8), np.arange(8))
    coefficients = strength * np.exp(-u / falloff) * rng.laplace(size=(*BLOCKS, 8, 8))
    blocks = idctn(coefficients, axes=(2, 3), norm="ortho")
    return blocks.transpose(0, 2, 1, 3).reshape(8 * BLOCKS[0], 8 * BLOCKS[1])


def quantized(plane, step):
    blocks = plane.reshape(BLOCKS[0], 8, BLOCKS[1], 8).transpose(0, 2, 1, 3)
    c = dctn(blocks, axes=(2, 3), norm="ortho") / step
    c = step * np.sign(c) * np.floor(np.abs(c) + 1 / 3)
    return idctn(c, axes=(2, 3), norm="ortho").transpose(0, 2, 1, 3).reshape(plane.shape)


@pytest.mark.parametrize(("strength", "falloff"), [(60, 4.0), (20, 2.0), (4, 8.0), (300, 30.0)])
def test_variance_is_that_of_the_lost_coefficients(strength, falloff):
    # oracle: the quantizer itself
    step, true = 8.0, texture(strength, falloff)
    decoded = quantized(true, step)
    stated = quantization_variance(decoded, np.full(BLOCKS, step)).mean()
    assert stated == pytest.approx(np.mean((decoded - true) ** 2), rel=0.25)


def test_textured_part_of_a_picture_has_the_larger_error():
    step = np.full(BLOCKS, 8.0)
    true = texture(80, 6.0)
    true[:, :80] = 100.0
    variance = quantization_variance(quantized(true, 8.0), step)
    assert variance[:, 14:].mean() > 10 * variance[:, 1:5].mean()


def test_many_steps_leave_a_ninth_of_a_squared_step():
    # exact: the error is uniform between −1/3 and 2/3 of a step
    step = 0.5
    plane = quantized(texture(400, 60.0), step)
    assert quantization_variance(plane, np.full(BLOCKS, step)) == pytest.approx(
        step**2 / 9, rel=0.03
    )


def test_incomplete_blocks_are_extended():
    plane = np.full((21, 30), 7, np.uint8)
    assert quantization_variance(plane, np.ones((3, 4))).shape == (3, 4)


def test_rows_of_light_have_the_variance_of_their_blocks():
    # exact
    blocks = np.arange(24, dtype=np.float32).reshape(2, 4, 3) * 1e-5
    error = CodingError(blocks, (30, 14), SRGB)
    light = np.random.default_rng(0).uniform(0.1, 0.9, (14, 30))
    whole = error.variance(light, 1)
    np.testing.assert_array_equal(error.variance(light[5:9], 1, 5), whole[5:9])
    slope = SRGB.slope(light[13, 29])
    assert whole[13, 29] == pytest.approx(blocks[1, 3, 1] * slope**2)


def test_coefficients_below_five_sixths_of_a_step_are_lost():
    # exact: a constant block has one coefficient, 8 times its value
    assert lost_change(np.full((8, 16), 0.8 / 8), 1.0) == pytest.approx(0.1 * np.ones((8, 16)))
    assert lost_change(np.full((8, 16), -0.9 / 8), 1.0) == pytest.approx(0.1 / 8 * np.ones((8, 16)))

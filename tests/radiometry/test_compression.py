"""Compression: what a JPEG file makes of code values is known before it is written."""

import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from scipy.fft import dctn, idctn

from blurmatte.jpeg.coding import compression_of
from blurmatte.radiometry import SRGB, CodingError, Compression
from blurmatte.radiometry.compression import lost_change, quantization_variance
from blurmatte.rendering.camera import from_jpeg, to_jpeg

SAMPLINGS = ["4:4:4", "4:2:2", "4:2:0"]
NOISE = 1.5 / 255
BLOCKS = (24, 20)


@pytest.fixture(scope="module")
def codes():
    """(75, 83, 3) smooth colors and a sharp edge."""
    y, x = np.mgrid[:75, :83] / 80
    smooth = np.stack([0.3 + 0.4 * x, 0.5 + 0.2 * np.sin(9 * y), 0.4 + 0.3 * x * y], axis=-1)
    smooth[(x + y) > 1] = (0.8, 0.35, 0.15)
    return np.rint(255 * smooth).astype(np.uint8)


def through_a_file(codes, chroma, quality=80):
    file = to_jpeg(codes, quality, chroma)
    return from_jpeg(file), compression_of(file)


@pytest.mark.parametrize("chroma", SAMPLINGS)
def test_expected_codes_without_noise_are_those_of_the_file(codes, chroma):
    """Exact."""
    held, compression = through_a_file(codes, chroma)
    assert np.abs(held.astype(int) - codes).max() > 20
    assert_allclose(compression.expected(codes / 255, 0), held / 255, atol=1e-12)


@pytest.mark.parametrize("chroma", SAMPLINGS)
def test_expected_codes_with_noise_are_the_mean_of_many_files(codes, chroma):
    """Honest: of other noise than it draws itself, of which 16 draws leave 1.5/4 codes."""
    rng = np.random.default_rng(5)
    smooth = codes / 255
    draws = (smooth + NOISE * rng.standard_normal((100, *codes.shape))).clip(0, 1)
    files = [through_a_file(np.rint(255 * draw).astype(np.uint8), chroma) for draw in draws]
    mean = np.mean([held for held, _ in files], axis=0)
    off = 255 * files[0][1].expected(smooth, NOISE) - mean
    assert np.sqrt(np.mean(off**2)) < 0.5
    assert np.sqrt(np.mean((codes - mean) ** 2)) > 3 * np.sqrt(np.mean(off**2))


@pytest.mark.parametrize("chroma", SAMPLINGS)
def test_once_returns_the_codes_of_the_file(codes, chroma):
    """Exact: as a file holds it, cropped and on its side too."""
    held, compression = through_a_file(codes, chroma)
    assert_allclose(compression.once(codes / 255), held / 255, atol=1e-12)
    part = compression.cropped(16, 32).once(codes[32:, 16:] / 255)
    assert_allclose(part[16:, 16:], held[48:, 32:] / 255, atol=1e-12)
    aside = compression.transposed().once(np.swapaxes(codes, 0, 1) / 255)
    expected = compression.transposed().expected(np.swapaxes(codes, 0, 1) / 255, 0)
    assert_allclose(aside, expected, atol=1e-12)


@pytest.mark.parametrize("corner", [(8, 5), (16, 32), (1, 3)])
@pytest.mark.parametrize("chroma", SAMPLINGS)
def test_cropped_compression_equals_crop_of_compressed(codes, chroma, corner):
    """Invariant: but for blocks that the part's sides cut."""
    _, compression = through_a_file(codes, chroma)
    x, y = corner
    part = compression.cropped(x, y).expected(codes[y:, x:] / 255, 0)
    whole = compression.expected(codes / 255, 0)[y:, x:]
    assert_array_equal(part[16:, 16:], whole[16:, 16:])


@pytest.mark.parametrize("chroma", SAMPLINGS)
def test_mirrored_and_transposed_compression_keep_the_blocks(codes, chroma):
    """Invariant: what stands upside down or on its side was compressed as it lay."""
    _, compression = through_a_file(codes, chroma)
    width = codes.shape[1]
    turned = {
        "on its side": (compression.transposed(), lambda x: np.swapaxes(x, 0, 1)),
        "mirrored": (compression.mirrored(width), lambda x: x[:, ::-1]),
    }
    lying = compression.expected(codes / 255, NOISE)
    for name, (upright, turn) in turned.items():
        off = 255 * (upright.expected(turn(codes) / 255, NOISE) - turn(lying))
        # What fills the last blocks is another side's.
        assert np.sqrt(np.mean(off[16:-16, 16:-16] ** 2)) < 0.9, name
        assert np.sqrt(np.mean((255 * lying - codes) ** 2)) > 3, name


def test_vertical_subsampling_equals_transposed_horizontal(codes):
    """4:4:0, which is what a 4:2:2 file on its side is: rows share nothing, columns do."""
    held, compression = through_a_file(np.ascontiguousarray(np.swapaxes(codes, 0, 1)), "4:2:2")
    turned = compression.transposed()
    assert turned.shared == (1, 2)
    assert turned.mcu == (8, 16)
    upright = np.swapaxes(held, 0, 1) / 255
    assert_allclose(turned.expected(codes / 255, 0), upright, atol=1e-12)


def test_draws_are_seeded(codes):
    _, compression = through_a_file(codes, "4:2:0")
    first, second = (compression.expected(codes / 255, NOISE) for _ in range(2))
    assert_array_equal(first, second)


def test_chroma_blur_is_half_the_subsampling():
    """Oracle: how far the color of a column of pixels runs in 4:2:0, as a standard deviation."""
    steps = ((1,) * 8,) * 8
    compression, x = Compression(steps, steps, (2, 2)), np.arange(-5, 6)
    squares = []
    for column in (30, 31):
        codes = np.full((64, 64, 3), 0.5)
        codes[:, column] = (0.9, 0.3, 0.5)  # of the same luma
        seen = compression.expected(codes, NOISE)
        red = (seen[..., 0] - seen[..., 1]).mean(axis=0)[column - 5 : column + 6]
        squares.append(np.average(x**2, weights=red))
    assert np.sqrt(np.mean(squares)) == pytest.approx(compression.spread, rel=0.1)
    assert replace(compression, shared=(1, 1)).spread == 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"luma": ((1,) * 8,) * 7}, "luma must be 8 by 8 steps"),
        ({"chroma": ((0,) * 8,) * 8}, "from 1 to 255"),
        ({"luma": ((256,) * 8,) * 8}, "from 1 to 255"),
        ({"shared": (4, 1)}, "1 or 2 by 1 or 2 pixels share chroma"),
    ],
)
def test_rejects_invalid_steps_and_subsampling(changes, message):
    steps = ((3,) * 8,) * 8
    with pytest.raises(ValueError, match=message):
        Compression(**({"luma": steps, "chroma": steps} | changes))


def test_steps_are_those_of_the_file(codes):
    """Rows of the table are vertical frequencies, as in the file's own words, unzigzagged."""
    tables = [list(range(1, 65)), list(range(65, 129))]
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", qtables=tables, subsampling="4:2:0")
    compression = compression_of(file.getvalue())
    assert compression.luma[0] == tuple(range(1, 9))
    assert compression.chroma[7] == tuple(range(121, 129))
    assert compression.shared == (2, 2)


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

"""The camera: noise as its model says, code values as the transfer says, the seed decides."""

import io
import re

import numpy as np
import pytest
from benchmarks.rendered import add_noise
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from blurmatte.files.reading import read
from blurmatte.radiometry import LINEAR, SRGB, NoiseModel
from blurmatte.rendering import Camera, colorful_plate
from blurmatte.rendering.processing import encode_codes

LIGHT = np.array([0.05, 0.2, 0.6])
NOISE = NoiseModel(gain=2e-4, read_std=0.002, relative_std=0.003)


@pytest.fixture(scope="module")
def light():
    return np.tile(LIGHT, (150, 200, 1))


@pytest.fixture(scope="module")
def plate():
    """Of odd sides."""
    return 1.5 * colorful_plate((61, 45), 1, tile=15)


# Noise


def test_noise_has_the_variance_of_its_model(light):
    rest = add_noise(light, NOISE, 1) - light
    assert_allclose(rest.mean(axis=(0, 1)), 0, atol=4e-4)
    assert_allclose(rest.std(axis=(0, 1)), np.sqrt(NOISE.variance(LIGHT)), rtol=0.02)


def test_code_noise_has_its_standard_deviation_in_code_values(light):
    noisy = Camera(code_std=2 / 255, bits=None).photograph(light, 1).rgb
    codes = SRGB.encode(noisy) - SRGB.encode(light)
    assert_allclose(codes.std(axis=(0, 1)), 2 / 255, rtol=0.02)


def test_float_pictures_have_the_true_noise_model(light):
    assert Camera(NOISE, bits=None).photograph(light, 1).noise is NOISE
    picture = Camera(NOISE, 1 / 255, bits=None).photograph(light, 1)
    assert picture.rgb.dtype == light.dtype
    assert_allclose((picture.rgb - light).std(axis=(0, 1)) ** 2, picture.variance[0, 0], rtol=0.04)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_sensor_noise_is_drawn_before_code_noise(light, dtype):
    """Figures of many tests rest on these draws."""
    light, rng = light.astype(dtype), np.random.default_rng(3)
    seen = light + np.sqrt(NOISE.variance(light)) * rng.standard_normal(light.shape)
    codes = SRGB.encode(seen) + 2 / 255 * rng.standard_normal(light.shape)
    camera = Camera(NOISE, 2 / 255)
    by_hand = np.rint(255 * np.clip(SRGB.encode(SRGB.decode(codes).astype(dtype)), 0, 1))
    assert_array_equal(camera.expose(light, 3), by_hand)


def test_same_seed_same_bytes(light):
    camera = Camera(NOISE)
    first, again, other = (camera.photograph(light, seed).rgb.tobytes() for seed in (5, 5, 6))
    assert first == again != other
    rng = np.random.default_rng(5)
    assert camera.expose(light, rng).tobytes() != camera.expose(light, rng).tobytes()


# Code values


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("transfer", [SRGB, LINEAR], ids=lambda transfer: transfer.name)
def test_error_without_noise_is_rounding_only(light, bits, transfer):
    light = np.random.default_rng(0).uniform(0.01, 0.9, light.shape)
    picture = Camera(bits=bits, transfer=transfer).photograph(light, 1)
    step = np.abs(transfer.encode(picture.rgb.astype(float)) - transfer.encode(light))
    assert 0.49 / (2**bits - 1) - 1e-5 < step.max() < 0.5 / (2**bits - 1) + 1e-5
    assert picture.meta.levels == 2**bits
    assert picture.noise is None


def test_codes_are_encoded_rounded_and_clipped():
    light = np.array([-0.1, 0, 0.5, 1, 3])
    assert_array_equal(encode_codes(light, 8), [0, 0, 188, 255, 255])
    assert_array_equal(encode_codes(light, 16, LINEAR), [0, 0, 32768, 65535, 65535])


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_codes_fill_their_dtype_in_equal_steps(bits):
    ramp = np.tile(np.linspace(-0.1, 1.1, 20_000)[None, :, None], (1, 1, 3))
    codes = Camera(bits=bits, transfer=LINEAR).expose(ramp, 0)
    found, top = np.unique(codes), np.iinfo(codes.dtype).max
    assert codes.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert len(found) == 2**bits
    assert_allclose(found, np.arange(2**bits) * top / (2**bits - 1), atol=0.5)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_clipped_light_is_not_valid(bits):
    light = np.full((2, 2, 3), 0.5)
    light[0, 0, 1] = 1.4
    picture = Camera(bits=bits).photograph(light, 1)
    assert_array_equal(picture.valid, [[False, True], [True, True]])


# JPEG


@pytest.mark.parametrize("chroma", ["4:4:4", "4:2:2", "4:2:0"])
@pytest.mark.parametrize("quality", [60, 95])
def test_photograph_equals_the_decoded_file(plate, tmp_path, quality, chroma):
    """By OpenImageIO, whose JPEG library may round otherwise than Pillow's."""
    camera = Camera(NOISE, jpeg_quality=quality, chroma=chroma)
    (tmp_path / "plate.jpg").write_bytes(camera.compress(camera.expose(plate, 1)))
    file, picture = read(tmp_path / "plate.jpg"), camera.photograph(plate, 1)
    codes, expected = (255 * SRGB.encode(p.rgb.astype(float)) for p in (file, picture))
    assert_allclose(codes, expected, atol=1.01)
    assert file.meta.levels == picture.meta.levels == 256


@pytest.mark.parametrize(
    ("chroma", "sampling"), [("4:4:4", 0x11), ("4:2:2", 0x21), ("4:2:0", 0x22)]
)
def test_file_has_the_quality_and_chroma_subsampling(plate, chroma, sampling):
    """Of the luma, in the header; chroma is 0x11."""
    cameras = [Camera(jpeg_quality=q, chroma=chroma) for q in (30, 90)]
    coarse, fine = (camera.compress(camera.expose(plate, 1)) for camera in cameras)
    frame = fine.index(b"\xff\xc0")
    assert fine[frame + 11] == sampling
    with Image.open(io.BytesIO(coarse)) as a, Image.open(io.BytesIO(fine)) as b:
        assert sum(a.quantization[0]) > 4 * sum(b.quantization[0])


def test_compression_error_is_small_at_quality_100(plate):
    exact = 255 * SRGB.encode(np.minimum(plate, 1))

    def error(**file):
        light = Camera(**file).photograph(plate, 0).rgb.astype(float)
        return np.sqrt(np.mean((255 * SRGB.encode(light) - exact) ** 2))

    errors = [error(), error(jpeg_quality=100), error(jpeg_quality=75), error(jpeg_quality=20)]
    assert errors == sorted(errors)
    assert errors[1] < 1 < 4 < errors[3]


# Chroma without JPEG

BT601 = np.array([0.299, 0.587, 0.114])


def shared_slowly(values, down):
    """Code values of which blocks 2 wide and `down` high share chroma, one block after another."""
    luma = values @ BT601
    blue, red = (
        between_blocks(c - luma, down) / part
        for c, part in ((values[..., 2], 1.772), (values[..., 0], 1.402))
    )
    green = luma - (0.299 * 1.402 * red + 0.114 * 1.772 * blue) / 0.587
    return np.stack([luma + 1.402 * red, green, luma + 1.772 * blue], axis=-1)


def between_blocks(c, down):
    """Means of blocks, and straight lines between the centers of whole blocks."""
    (height, width), left, top = c.shape, range(0, c.shape[1], 2), range(0, c.shape[0], down)
    means = [[c[y : y + down, x : x + 2].mean() for x in left] for y in top]
    rows = [np.interp(range(width), np.array(left) + 0.5, row) for row in means]
    middles = np.array(top) + (down - 1) / 2
    return np.stack(
        [np.interp(range(height), middles, column) for column in np.transpose(rows)], axis=1
    )


@pytest.mark.parametrize(("chroma", "down"), [("4:2:2", 1), ("4:2:0", 2)])
@pytest.mark.parametrize("size", [(61, 45), (60, 44), (2, 5), (5, 2), (1, 1)])
def test_subsampled_pixels_share_chroma(chroma, down, size):
    light = np.random.default_rng(0).uniform(0.2, 0.5, (*size[::-1], 3))
    codes = Camera(bits=16, transfer=LINEAR, chroma=chroma).expose(light, 0)
    assert_allclose(codes / 65535, shared_slowly(light, down), atol=4 / 65535)
    assert (np.abs(codes / 65535 - light).max() > 0.01) == (size != (1, 1))


@pytest.mark.parametrize("chroma", ["4:2:2", "4:2:0"])
def test_chroma_subsampling_preserves_gray(chroma):
    gray = np.repeat(np.random.default_rng(0).uniform(0, 1.2, (33, 47, 1)), 3, axis=-1)
    assert_array_equal(Camera(chroma=chroma).expose(gray, 0), Camera().expose(gray, 0))


def test_subsampled_values_are_quantized_in_ycbcr():
    """One color all over: three numbers of a few bits each, so it is a little off."""
    codes = Camera(chroma="4:2:0").expose(np.full((4, 4, 3), LIGHT), 0)
    assert len(np.unique(codes.reshape(-1, 3), axis=0)) == 1
    values = SRGB.encode(LIGHT)
    ycc = np.array([values @ BT601, *(values[[2, 0]] - values @ BT601) / [1.772, 1.402]])
    luma, blue, red = np.rint(255 * ycc)
    assert_allclose(codes[0, 0, [2, 0]], [luma + 1.772 * blue, luma + 1.402 * red], atol=0.5)


# Mosaic


def mosaic(**settings):
    return Camera(bits=None, bayer=True, **settings)


@pytest.mark.parametrize("size", [(2, 2), (3, 2), (9, 12), (12, 9)])
def test_mosaic_preserves_constant_light(size):
    light = np.full((*size[::-1], 3), LIGHT)
    assert_allclose(mosaic().photograph(light, 0).rgb, light, rtol=1e-14)


def test_mosaic_preserves_ramps():
    y, x = np.indices((20, 31))[..., None]
    light = LIGHT + x * [0.01, -0.004, 0.003] + y * [0.002, 0.007, -0.005]
    seen = mosaic().photograph(light, 0).rgb
    assert_allclose(seen[1:-1, 1:-1], light[1:-1, 1:-1], rtol=1e-13)
    assert np.abs(seen - light)[0].max() > 1e-3  # beyond the border the ramp turns back


def test_mosaic_pattern_is_rggb():
    light = np.random.default_rng(0).uniform(size=(6, 8, 3))
    seen = mosaic().photograph(light, 0).rgb == light
    for y, x, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        assert_array_equal(seen[y::2, x::2], np.broadcast_to(np.arange(3) == channel, (3, 4, 3)))


def test_mosaic_noise_is_correlated_and_unknown(light):
    picture = mosaic(noise=NOISE).photograph(light, 1)
    rest = picture.rgb - light
    assert picture.noise is None
    sigma = np.sqrt(NOISE.variance(LIGHT))
    assert_allclose(rest[::2, ::2, 0].std(), sigma[0], rtol=0.03)
    assert_allclose(rest[1:-1:2, 1:-1:2, 0].std(), sigma[0] / 2, rtol=0.03)  # of four neighbors
    assert_allclose(rest[2:-2:2, 2:-2:2, 1].std(), sigma[1] / 2, rtol=0.03)
    neighbors = np.corrcoef(rest[::2, 1:-1:2, 0].ravel(), rest[::2, 2::2, 0].ravel())[0, 1]
    assert neighbors == pytest.approx(np.sqrt(0.5), abs=0.03)


def test_sensor_clips_before_demosaicing():
    light = np.full((6, 6, 3), 0.5)
    light[2, 2] = 9
    through = Camera(bits=16, bayer=True, transfer=LINEAR).photograph(light, 0)
    assert_allclose(through.rgb[2, 3, 0], 0.75, atol=1e-5)
    assert_array_equal(np.argwhere(~through.valid), [[2, 2]])
    assert mosaic().photograph(light, 0).rgb.max() == 9


# The door


def test_rejects_wrong_pictures(light):
    with pytest.raises(TypeError, match="rng"):
        Camera().photograph(light)
    with pytest.raises(TypeError, match="light must hold linear light as floats, got uint8"):
        Camera().photograph(light.astype(np.uint8), 1)
    with pytest.raises(ValueError, match="bits must be 8, 10, 12 or 16, got 9"):
        encode_codes(light, 9)
    with pytest.raises(ValueError, match="bits None has no code values; use photograph"):
        Camera(bits=None).expose(light, 1)
    with pytest.raises(ValueError, match="without jpeg_quality makes no JPEG"):
        Camera().compress(np.zeros((8, 8, 3), np.uint8))
    with pytest.raises(
        TypeError, match=re.escape("codes must be (H, W, 3) uint8, got (8, 8, 3) u")
    ):
        Camera(jpeg_quality=90).compress(np.zeros((8, 8, 3), np.uint16))
    with pytest.raises(ValueError, match="2x2 pixels or more for a mosaic, got 200x1"):
        Camera(bayer=True).photograph(light[:1], 1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": 0.01}, "noise must be a NoiseModel, got float"),
        ({"code_std": -1}, "code_std must be finite and not negative, got -1"),
        ({"code_std": np.nan}, "code_std must be finite and not negative, got nan"),
        ({"bits": 14}, "bits must be 8, 10, 12 or 16, got 14"),
        ({"chroma": "4:1:1"}, "chroma must be one of 4:4:4, 4:2:2, 4:2:0, got '4:1:1'"),
        ({"chroma": "4:2:0", "bits": None}, "chroma 4:2:0 .* floats .* have none"),
        ({"jpeg_quality": 0}, "jpeg_quality must be a whole number from 1 to 100, got 0"),
        ({"jpeg_quality": 90.5}, "jpeg_quality must be a whole number from 1 to 100, got 90.5"),
        ({"jpeg_quality": 90, "bits": 16}, "a JPEG holds 8 bits, got bits 16"),
        ({"jpeg_quality": 90, "bits": None}, "a JPEG holds 8 bits, got bits None"),
        ({"jpeg_quality": 90, "transfer": LINEAR}, "a JPEG is read as sRGB, got the curve linear"),
    ],
)
def test_rejects_wrong_settings(settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        Camera(**settings)


@pytest.mark.parametrize("chroma", ["4:4:4", "4:2:2", "4:2:0"])
def test_compression_metadata_equals_that_of_the_file(plate, tmp_path, chroma):
    camera = Camera(jpeg_quality=83, chroma=chroma)
    path = tmp_path / "picture.jpg"
    path.write_bytes(camera.compress(camera.expose(plate, 1)))
    compression = camera.photograph(plate, 1).meta.compression
    assert compression is not None
    assert compression == read(path).meta.compression
    assert Camera(chroma=chroma).photograph(plate, 1).meta.compression is None

"""LinearImage validates itself when constructed; `decode` converts code values."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import (
    LINEAR,
    SRGB,
    Compression,
    LinearImage,
    Meta,
    NoiseModel,
    are_gray,
    decode,
)

NOISE = NoiseModel(gain=1e-3, read_std=0.01)


@pytest.fixture
def rgb():
    return np.random.default_rng(0).uniform(0, 1, (4, 6, 3))


def test_all_pixels_are_valid_by_default(rgb):
    image = LinearImage(rgb)
    assert image.valid.all()
    assert image.size == (6, 4)
    assert repr(image) == f"LinearImage(6x4, up to {rgb.max():.2f}, 100.0% valid)"
    named = LinearImage(rgb, valid=rgb[..., 0] < 2, meta=Meta(source="throw.png"))
    assert repr(named).startswith("LinearImage(throw.png, 6x4")


def test_light_may_be_negative_or_above_white(rgb):
    assert_array_equal(LinearImage(rgb - 0.5).rgb, rgb - 0.5)
    assert_array_equal(LinearImage(rgb * 5).rgb, rgb * 5)


def test_variance_is_that_of_the_model_or_given(rgb):
    assert_allclose(LinearImage(rgb, noise=NOISE).variance, 1e-4 + 1e-3 * rgb)
    given = np.full_like(rgb, 4e-6)
    assert LinearImage(rgb, noise=given).variance is given
    assert LinearImage(rgb).with_noise(NOISE).noise is NOISE
    with pytest.raises(ValueError, match="not known; measure it with fit_noise"):
        _ = LinearImage(rgb).variance


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("transfer", [SRGB, LINEAR], ids=lambda transfer: transfer.name)
def test_decode_applies_the_curve(dtype, transfer):
    top = np.iinfo(dtype).max
    codes = np.random.default_rng(0).integers(0, top, (5, 7, 3)).astype(dtype)
    codes[0, 0, 1] = top
    image = decode(codes, transfer)
    assert image.rgb.dtype == np.float32
    assert_allclose(image.rgb, transfer.decode(codes / top), rtol=1e-6)
    assert_array_equal(np.argwhere(~image.valid), [[0, 0]])
    assert (image.meta.levels, image.meta.transfer) == (top + 1, transfer)
    assert image.noise is None


@pytest.mark.parametrize(
    ("rgb", "error", "words"),
    [
        ([[1.0, 2.0, 3.0]], TypeError, "rgb must be a NumPy array of linear light, got list"),
        (np.zeros((4, 6, 3), np.uint8), TypeError, "as floats, got uint8; decode code values"),
        (np.zeros((4, 6)), ValueError, r"rgb must have the shape \(height, width, 3\), got \(4, 6"),
        (np.zeros((4, 6, 4)), ValueError, r"\(height, width, 3\), got \(4, 6, 4\)"),
        (np.zeros((0, 6, 3)), ValueError, r"\(height, width, 3\), got \(0, 6, 3\)"),
        (np.full((4, 6, 3), np.nan), ValueError, "rgb must be finite; .* mark them in `valid`"),
        (np.full((4, 6, 3), -np.inf), ValueError, "rgb must be finite"),
        (np.arange(72.0).reshape(4, 6, 3), ValueError, "1 is white, got whole numbers up to 71;"),
    ],
)
def test_rejects_light_of_other_dtypes_and_shapes(rgb, error, words):
    with pytest.raises(error, match=words):
        LinearImage(rgb)


@pytest.mark.parametrize("lamp", [16.0, 255.0])
def test_light_above_white_is_no_code_value(rgb, lamp):
    bright = 300 * rgb
    bright[0, 0] = lamp
    assert LinearImage(bright).rgb.max() > 100
    LinearImage(np.where(rgb > 0.5, lamp, 0.0))  # a part of it that is dark, or clipped


@pytest.mark.parametrize(
    ("fields", "error", "words"),
    [
        ({"valid": np.ones((6, 4), bool)}, ValueError, r"valid must have the shape \(4, 6\)"),
        (
            {"valid": np.ones((4, 6))},
            TypeError,
            "valid must hold booleans, as valid > 0, got float64",
        ),
        ({"valid": [True]}, TypeError, "valid must be a NumPy array, got list"),
        ({"noise": np.ones((4, 6))}, ValueError, r"noise must have the shape \(4, 6, 3\)"),
        ({"noise": 0.01}, TypeError, "noise must be a NumPy array, got float"),
        ({"noise": np.full((4, 6, 3), -1e-6)}, ValueError, "noise holds variances, got -1e-06"),
        ({"noise": np.full((4, 6, 3), np.inf)}, ValueError, "noise must be finite"),
    ],
)
def test_rejects_fields_of_other_shapes(rgb, fields, error, words):
    with pytest.raises(error, match=words):
        LinearImage(rgb, **fields)


def test_decode_rejects_codes_that_are_no_integers(rgb):
    with pytest.raises(TypeError, match="codes must be uint8 or uint16, got float64"):
        decode(rgb, SRGB)


def test_unsaturated_channels_of_a_clipped_pixel_are_usable():
    """exact: those at the top of their file are not, and none of a missing pixel."""
    codes = np.array([[[255, 9, 9], [255, 255, 9], [9, 9, 9]]], np.uint8)
    picture = decode(codes, SRGB)
    assert picture.clipped.tolist() == [[[True, False, False], [True, True, False], [False] * 3]]
    assert picture.usable.tolist() == [[[False, True, True], [False, False, True], [True] * 3]]
    missing = replace(picture, valid=np.zeros((1, 3), bool))
    assert not missing.usable[0, 2].any()
    raw = replace(picture, meta=replace(picture.meta, to_srgb=((1, 0, 0), (0, 1, 0), (0, 0, 1))))
    assert not raw.usable[0, :2].any()
    light = LinearImage(np.array([[[1.2, 0.5, 0.5]]]))
    assert light.usable.all()  # what is valid is not clipped, however bright
    assert replace(light, valid=~light.valid).clipped.tolist() == [[[True, False, False]]]


def test_crop_moves_the_origin_of_the_compression(rgb):
    """Invariant: of parts of parts, too."""
    steps = ((1,) * 8,) * 8
    meta = Meta(compression=Compression(steps, steps, (2, 2), (1, 0)))
    image = LinearImage(rgb, meta=meta)
    part = image.crop((2, 1, 6, 4)).crop((1, 1, 3, 2))
    assert part.meta.compression == replace(meta.compression, origin=(4, 2))
    assert image.meta.compression.origin == (1, 0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_equal_channels_in_both_pictures_are_gray(dtype):
    codes = np.random.default_rng(0).integers(1, np.iinfo(dtype).max, (130, 7, 1)).astype(dtype)
    gray = decode(np.repeat(codes, 3, axis=2), SRGB)
    colored = np.repeat(codes, 3, axis=2)
    colored[77, 3, 2] -= 1  # one code value in one pixel
    assert are_gray(gray, gray)
    assert not are_gray(gray, decode(colored, SRGB))
    assert are_gray(decode(colored, SRGB), replace(gray, meta=Meta(gray=True)))


def test_floats_are_gray_up_to_16_bits(rgb):
    gray = rgb[..., :1] * [1, 1.0004, 1]
    assert are_gray(LinearImage(gray), LinearImage(gray))
    assert not are_gray(LinearImage(gray * [1, 1, 1.01]), LinearImage(gray))


def test_light_and_noise_beyond_a_million_are_rejected(rgb):
    with pytest.raises(ValueError, match="rgb must not exceed"):
        LinearImage(rgb * 1e7)
    for name in ("gain", "read_std", "relative_std"):
        with pytest.raises(ValueError, match=f"{name} must lie between 0 and"):
            NoiseModel(**{name: 2.0**63})
        with pytest.raises(ValueError, match=f"{name} must lie between 0 and"):
            NoiseModel(**{name: float("nan")})

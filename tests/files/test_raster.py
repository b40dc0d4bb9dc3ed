"""TIFFs and sizes of files as people have them."""

import struct
import warnings

import numpy as np
import OpenEXR
import pytest
import tifffile

from blurmatte.errors import BlurmatteWarning, FileError
from blurmatte.files.inplace import write_changed
from blurmatte.files.reading import read, read_layer
from blurmatte.radiometry import LINEAR, SRGB

WEDGE = np.tile(np.linspace(0, 1, 64), (32, 1))


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"compression": "zlib"}])
def test_zero_is_white_where_a_tiff_says_so(tmp_path, dtype, options):
    path, top = tmp_path / "a.tif", np.iinfo(dtype).max
    codes = np.rint(WEDGE * top).astype(dtype)
    tifffile.imwrite(path, codes, photometric="miniswhite", **options)
    image = read(path, LINEAR)
    np.testing.assert_allclose(image.rgb[..., 0], 1 - codes / top, atol=1e-7)
    write_changed(tmp_path / "b.tif", path, image, np.zeros(WEDGE.shape, bool), LINEAR)
    np.testing.assert_array_equal(read(tmp_path / "b.tif", LINEAR).rgb, image.rgb)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_alpha_is_not_inverted_with_the_gray(tmp_path, dtype):
    path, top = tmp_path / "a.tif", np.iinfo(dtype).max
    codes = np.stack([WEDGE, np.full_like(WEDGE, 0.8)], axis=-1) * top
    tifffile.imwrite(
        path, codes.astype(dtype), photometric="miniswhite", extrasamples=["unassalpha"]
    )
    layer = read_layer(path, LINEAR)
    np.testing.assert_allclose(layer.alpha, 0.8, atol=1 / top)
    np.testing.assert_allclose(layer.premultiplied[..., 0], 0.8 * (1 - WEDGE), atol=2 / top)


def test_inverted_floats_are_rejected(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", WEDGE.astype(np.float32), photometric="miniswhite")
    with pytest.raises(FileError, match=r"WhiteIsZero.*floats"):
        read(tmp_path / "a.tif")


def test_floats_that_would_be_read_as_black_are_rejected(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", np.full((32, 64, 3), 0.5), photometric="rgb", tile=(16, 16)
    )
    with pytest.raises(FileError, match="64-bit floats in tiles"):
        read(tmp_path / "a.tif")


def test_a_thumbnail_before_the_picture_is_passed_over(tmp_path):
    path = tmp_path / "a.tif"
    codes = np.random.default_rng(0).integers(9, 200, (32, 64, 3), np.uint8)
    with tifffile.TiffWriter(path) as file:
        file.write(codes[::4, ::4], photometric="rgb", subfiletype=1)
        file.write(codes, photometric="rgb", software="kept")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = read(path, SRGB)
    np.testing.assert_allclose(image.rgb, SRGB.decode(codes / 255), atol=1e-6)
    write_changed(tmp_path / "b.tif", path, image, np.zeros((32, 64), bool), SRGB)
    with tifffile.TiffFile(tmp_path / "b.tif") as file:
        np.testing.assert_array_equal(file.asarray(), codes)
        assert file.pages[0].software == "kept"


def test_a_thumbnail_alone_is_rejected(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(np.zeros((8, 8, 3), np.uint8), photometric="rgb", subfiletype=1)
    with pytest.raises(FileError, match="holds a thumbnail"):
        read(tmp_path / "a.tif")


def test_a_tiff_of_several_pictures_names_the_page(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for value in (50, 90):
            file.write(np.full((8, 8, 3), value, np.uint8), photometric="rgb")
    with pytest.warns(BlurmatteWarning, match="page 1 of 2 is read"):
        image = read(tmp_path / "a.tif", LINEAR)
    assert image.rgb[0, 0, 0] == np.float32(50 / 255)


@pytest.mark.parametrize(
    ("method", "name"), [(50000, "ZSTD"), (34925, "LZMA"), (34712, "JPEG 2000"), (12345, "12345")]
)
def test_compression_that_cannot_be_read_is_named(tmp_path, method, name):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((32, 64, 3), np.uint8), photometric="rgb")
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<HHII", 259, 3, 1, 1))
    struct.pack_into("<H", content, at + 8, method)
    path.write_bytes(content)
    with pytest.raises(FileError, match=f"compressed by .*{name}, which cannot"):
        read(path, SRGB)


def test_more_pixels_than_a_file_can_hold_need_a_raised_limit(tmp_path):
    path, light = tmp_path / "a.exr", np.full((8, 8, 3), 0.5, np.float32)
    header = {
        "type": OpenEXR.scanlineimage,
        "displayWindow": (np.array([0, 0], np.int32), np.array([7999, 7999], np.int32)),
    }
    OpenEXR.File(header, {"RGB": light}).write(str(path))
    with pytest.raises(
        FileError, match=r"8000 x 8000 pixels in \d+ bytes .*--max-pixels|--max-pix"
    ):
        read(path)

"""Every invalid file raises a one-line error that names it and says what to do."""

import io
import struct
import zlib
from functools import partial

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image
from tests.files import conftest

from blurmatte.errors import FileError
from blurmatte.files.reading import read, read_layer
from blurmatte.files.solutions import read_solution
from blurmatte.radiometry import SRGB

EXR = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


refusal = partial(conftest.refusal, transfer=SRGB)


@pytest.fixture
def good(tmp_path):
    """Four whole files by other programs, large enough to be cut anywhere."""
    codes = np.random.default_rng(0).integers(0, 255, (100, 120, 3)).astype(np.uint8)
    folder = tmp_path / "good"
    folder.mkdir()
    Image.fromarray(codes).save(folder / "a.png")
    Image.fromarray(codes).save(folder / "a.jpg")
    Image.fromarray(codes).save(folder / "progressive.jpg", progressive=True)
    Image.fromarray(codes).save(folder / "a.tif")
    Image.fromarray(codes).save(folder / "zip.tif", compression="tiff_adobe_deflate")
    light = {"RGB": (codes / 255).astype(np.float32)}
    OpenEXR.File(dict(EXR), light).write(str(folder / "a.exr"))
    return folder


FILES = ["a.png", "a.jpg", "progressive.jpg", "a.tif", "zip.tif", "a.exr"]


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("cut", [0.999, 0.98, 0.5, 0.02])
def test_truncated_file_is_rejected_without_output(good, capfd, name, cut):
    path = good / name
    whole = path.read_bytes()
    assert read(path, transfer=SRGB).size == (120, 100)
    path.write_bytes(whole[: int(cut * len(whole))])
    assert "again" in refusal(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", FILES)
def test_one_missing_byte_is_detected(good, name):
    path = good / name
    path.write_bytes(path.read_bytes()[:-1])
    assert "again" in refusal(path)


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_damaged_file_is_rejected_without_output(good, capfd, name):
    path = good / name
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    path.write_bytes(damaged)
    assert "damaged" in refusal(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "exr"])
def test_empty_files_and_text_have_different_errors(tmp_path, extension):
    path = tmp_path / f"a.{extension}"
    path.write_bytes(b"")
    assert "is empty" in refusal(path)
    path.write_text("I am not a picture.\n" * 20)
    assert "as PNG, JPEG, TIFF or OpenEXR; the file holds no picture" in refusal(path)


def test_missing_file_and_folder(tmp_path):
    assert "no such file" in refusal(tmp_path / "nowhere.png")
    assert "no such file" in refusal(tmp_path / "nowhere")
    (tmp_path / "folder.png").mkdir()
    assert "is a folder" in refusal(tmp_path / "folder.png")
    (tmp_path / "file").write_text("")
    assert "Not a directory" in refusal(tmp_path / "file" / "a.png")


def test_clips_and_unknown_files_are_no_pictures(tmp_path):
    (tmp_path / "a.webp").write_bytes(b"RIFF")
    assert "no picture of a known kind" in refusal(tmp_path / "a.webp")
    (tmp_path / "a.MP4").write_bytes(b"....ftyp")
    assert "extract one frame of the clip" in refusal(tmp_path / "a.MP4")


def test_format_is_determined_by_the_first_bytes(good):
    lying = good / "a.jpg"
    assert read(lying.rename(good / "b.png"), transfer=SRGB).meta.levels == 256


def huge_png(make_png, good):
    return make_png(np.zeros((1, 1, 3), np.uint8), size=(100_000, 100_000))


def huge_exr(make_png, good):
    content = bytearray((good / "a.exr").read_bytes())
    for window in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = content.index(window) + len(window) + 4
        content[at : at + 16] = struct.pack("<4i", 0, 0, 99_999, 99_999)
    return bytes(content)


def huge_tif(make_png, good):
    content = bytearray((good / "a.tif").read_bytes())
    (start,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, start)
    for at in range(start + 2, start + 2 + 12 * count, 12):
        (tag,) = struct.unpack_from("<H", content, at)
        if tag in (256, 257, 278):  # width, height, rows per strip
            struct.pack_into("<HII", content, at + 2, 4, 1, 100_000)
    return bytes(content)


@pytest.mark.parametrize("forge", [huge_png, huge_exr, huge_tif])
def test_huge_size_is_rejected_before_memory_is_allocated(good, make_png, forge):
    path = good / f"huge.{forge.__name__[-3:]}"
    path.write_bytes(forge(make_png, good))
    message = refusal(path)
    assert "100000 x 100000 pixels" in message
    assert "--max-pixels" in message


@pytest.mark.parametrize("name", FILES)
def test_max_pixels_is_the_limit(good, name):
    assert "120 x 100" in refusal(good / name, max_pixels=11_999)
    assert read(good / name, transfer=SRGB, max_pixels=12_000).size == (120, 100)


def test_huge_display_window_is_rejected(tmp_path):
    window = (np.array([0, 0], np.int32), np.array([99_999, 99_999], np.int32))
    header = EXR | {
        "displayWindow": window,
        "dataWindow": (np.array([0, 0], np.int32), np.array([3, 3], np.int32)),
    }
    OpenEXR.File(header, {"RGB": np.zeros((4, 4, 3), np.float32)}).write(str(tmp_path / "a.exr"))
    assert "--max-pixels" in refusal(tmp_path / "a.exr")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("extension", ["exr", "tif"])
def test_nan_and_infinity_are_counted(tmp_path, bad, extension):
    light = np.zeros((4, 5, 3), np.float32)
    light[1, 2] = bad
    light[3, 0, 1] = bad
    path = tmp_path / f"a.{extension}"
    if extension == "exr":
        OpenEXR.File(dict(EXR), {"RGB": light}).write(str(path))
    else:
        tifffile.imwrite(path, light, photometric="rgb")
    assert "2 of 20 pixels are NaN, infinite, or beyond" in refusal(path)


@pytest.mark.parametrize("transfer", [None, SRGB])
def test_code_values_that_are_stored_as_floats_are_rejected(tmp_path, transfer):
    codes = np.random.default_rng(0).integers(0, 256, (4, 5, 3)).astype(np.float32)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb")
    with pytest.raises(FileError, match="divide it so that 1 is white; its floats are code values"):
        read(tmp_path / "a.tif", transfer)


def test_nan_in_alpha_is_counted(tmp_path):
    rgba = np.zeros((4, 5, 4), np.float32)
    rgba[0, 0, 3] = np.nan
    OpenEXR.File(dict(EXR), {"RGBA": rgba}).write(str(tmp_path / "a.exr"))
    with pytest.raises(FileError, match="1 of 20 pixels"):
        read_layer(tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("name", "mode", "says"),
    [
        ("a.png", "P", "palette"),
        ("a.tif", "P", "palette"),
        ("a.jpg", "CMYK", "CMYK"),
        ("a.tif", "CMYK", "CMYK"),
        ("a.tif", "LAB", "convert it to RGB"),
        ("a.png", "1", "fewer than 8 bits per channel (1)"),
        ("a.tif", "1", "1 bits"),
    ],
)
def test_unsupported_color_modes_are_rejected(tmp_path, ramp, name, mode, says):
    Image.new(mode, (8, 6)).save(tmp_path / name)
    assert says in refusal(tmp_path / name)


@pytest.mark.parametrize("dtype", [np.uint32, np.int16, np.int8])
def test_unsupported_integer_types_are_rejected(tmp_path, dtype):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((4, 5, 3), dtype), photometric="rgb")
    assert "are not supported" in refusal(tmp_path / "a.tif")


def test_error_without_rgb_lists_the_channels(tmp_path):
    depth = {"Z": np.zeros((4, 5), np.float32)}
    OpenEXR.File(dict(EXR), depth).write(str(tmp_path / "a.exr"))
    assert "but Z" in refusal(tmp_path / "a.exr")


def test_png_without_pixels_is_rejected(tmp_path, make_png):
    content = make_png(np.zeros((2, 2, 3), np.uint8))
    at = content.index(b"IDAT") - 4
    (tmp_path / "a.png").write_bytes(content[:at] + content[-12:])
    assert "no picture" in refusal(tmp_path / "a.png")


def test_bytes_after_a_png_are_ignored(tmp_path, make_png):
    content = make_png(np.zeros((2, 2, 3), np.uint8)) + b"notes of a phone"
    (tmp_path / "a.png").write_bytes(content)
    assert read(tmp_path / "a.png", transfer=SRGB).size == (2, 2)


def test_unreadable_profile_is_ignored(tmp_path, make_png, capfd):
    """libpng drops it; the file then says nothing."""
    junk = {b"iCCP": b"x\0\0" + zlib.compress(b"junk" * 50)}
    (tmp_path / "a.png").write_bytes(make_png(np.zeros((2, 2, 3), np.uint8), junk))
    assert read(tmp_path / "a.png", transfer=SRGB).meta.icc_profile is None
    assert capfd.readouterr() == ("", "")


def test_attribute_names_that_are_not_utf8_are_ignored(tmp_path):
    path = tmp_path / "a.exr"
    OpenEXR.File(EXR | {"owner_of_it": "me"}, {"RGB": np.ones((4, 5, 3), np.float32)}).write(
        str(path)
    )
    path.write_bytes(path.read_bytes().replace(b"owner_of_it", b"besitzer_\xfc\xfc"))
    assert read(path).size == (5, 4)


def test_png_page_offset_is_ignored(tmp_path, make_png):
    """Painting programs note where a PNG lay on their canvas."""
    codes = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    offset = {b"oFFs": struct.pack(">iiB", 3, 70_000, 0)}
    (tmp_path / "a.png").write_bytes(make_png(codes, offset))
    image = read(tmp_path / "a.png", transfer=SRGB)
    assert np.array_equal(np.rint(255 * SRGB.encode(image.rgb)), codes)


def test_a_plain_exr_holds_no_solution(good):
    with pytest.raises(FileError, match=r"a\.exr: give .* holds no Solution"):
        read_solution(good / "a.exr")


def test_padding_at_the_end_of_a_jpeg_is_ignored(good):
    """Some cameras do it."""
    whole = (good / "a.jpg").read_bytes()
    (good / "a.jpg").write_bytes(whole[:-2] + b"\0\0\0" + whole[-2:] + b"more")
    theirs = np.asarray(Image.open(io.BytesIO(whole)))
    image = read(good / "a.jpg", transfer=SRGB)
    assert np.abs(255 * SRGB.encode(image.rgb) - theirs).max() < 1.5

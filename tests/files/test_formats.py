"""What a file is: by content, by name, and how each kind is read or refused."""

import io
import os
import struct
import sys

import av
import numpy as np
import pillow_heif
import pytest
from PIL import Image
from tests.commands import run
from tests.files.conftest import para, profile_bytes, refusal, write_dng

from blurmatte import formats
from blurmatte.files.frames import read_frames
from blurmatte.files.inplace import write_changed
from blurmatte.files.reading import read
from blurmatte.files.writing import write
from blurmatte.formats import FORMATS, Holds, format_at, is_clip, pictures_in, recognized
from blurmatte.radiometry import REC709, SRGB, LinearImage
from blurmatte.radiometry.transfer import PQ

SIZE = 64, 48
HEIC_STEP = 6 / 255  # of light: quality 95, smooth colors
P3 = (0.5151, 0.2412, -0.0011), (0.2919, 0.6922, 0.0419), (0.1572, 0.0666, 0.7841)


@pytest.fixture
def codes():
    """(48, 64, 3) smooth code values, the left border red."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] / SIZE[0]
    picture = np.stack([0.3 + 0.4 * x, 0.2 + 0.5 * y, 0.6 - 0.3 * x], axis=-1)
    picture[:, :16] = 0.8, 0.2, 0.2
    return np.rint(255 * picture).astype(np.uint8)


@pytest.fixture
def display_p3():
    """Its ICC profile: primaries of P3, the curve of sRGB."""
    return profile_bytes(para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), P3)


def encoded(codes, form, **options):
    file = io.BytesIO()
    Image.fromarray(codes).save(file, form, **options)
    return file.getvalue()


def heic(codes, bits=8, **options):
    file = io.BytesIO()
    mode = "RGB" if bits == 8 else "RGB;16"
    made = pillow_heif.from_bytes(mode, codes.shape[1::-1], codes.tobytes())
    made.save(file, quality=95, **options)
    return file.getvalue()


def clip(path, codes, **options):
    with av.open(path, "w", **options) as file:
        stream = file.add_stream("mpeg4", rate=30)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for _ in range(3):
            for packet in stream.encode(av.VideoFrame.from_ndarray(codes, "rgb24")):
                file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)


HEADS = {
    "JPEG": b"\xff\xd8\xff\xe0", "PNG": b"\x89PNG\r\n\x1a\n", "TIFF": b"MM\0*", "EXR": b"v/1\1",
    "WebP": b"RIFF\1\2\3\4WEBPVP8 ", "BMP": b"BM\1\2\3\4\0\0\0\0", "HEIC": b"\0\0\0\x18ftypheic",
    "AVIF": b"\0\0\0\x1cftypmif1\0\0\0\0mif1avif", "camera RAW": b"FUJIFILMCCD-RAW ",
    "QuickTime": b"\0\0\0\x14ftypqt  ", "MP4": b"\0\0\0\x18ftypisom", "GIF": b"GIF89a",
    "Matroska": b"\x1a\x45\xdf\xa3", "AVI": b"RIFF\1\2\3\4AVI LIST", "MPEG": b"\0\0\1\xba",
    "MPEG transport stream": b"G" + bytes(187) + b"G", "JPEG XL": b"\xff\x0a\1", "PNM": b"P6\n8 8",
    "Photoshop": b"8BPS\0\1", "web page or drawing": b"<!DOCTYPE html>", "playlist": b"#EXTM3U\n",
    "FITS": b"SIMPLE  =                    T",
}  # fmt: skip


@pytest.mark.parametrize("name", HEADS)
def test_content_decides_whatever_the_extension(name):
    for extension in (".jpg", ".mp4", ".heic", ".txt", ""):
        found = recognized(HEADS[name] + bytes(8), f"a{extension}")
        assert str(found) == name


def test_extension_decides_where_content_says_nothing():
    assert recognized(b"II*\0" + bytes(20), "a.dng") is formats.RAW
    assert recognized(b"II*\0" + bytes(20), "a.tif") is formats.TIFF
    assert recognized(b"\0\0\0\x14moov", "a.mp4") is formats.MOV
    assert recognized(bytes(20), "a.tga").holds is Holds.OTHER
    assert recognized(bytes(20), "a.png") is None
    assert recognized(bytes(20), "a.mp4") is formats.MP4
    assert recognized(bytes(20), "a.unknown") is None


def test_formats_have_an_extension_each_and_a_remedy_if_they_are_not_read():
    listed = [name for form in FORMATS for name in form.extensions]
    assert len(listed) == len(set(listed))
    assert all(bool(form.remedy) == (form.holds is Holds.OTHER) for form in FORMATS)
    assert all(bool(form.reader) != (form.holds is Holds.OTHER) for form in FORMATS)


@pytest.mark.parametrize("extension", formats.RAW.extensions)
def test_a_camera_raw_is_a_picture_of_every_extension(tmp_path, extension):
    path = tmp_path / f"a{extension}"
    write_dng(path, np.full((48, 64), 3000, np.uint16))
    assert format_at(path) is formats.RAW
    assert not is_clip(path)
    assert not is_clip(f"nowhere{extension}")


def test_raws_of_a_folder_are_read_unless_it_holds_other_pictures(tmp_path):
    for k in range(3):
        write_dng(tmp_path / f"a{k}.dng", np.full((48, 64), 3000 + k, np.uint16))
    assert len(read_frames(tmp_path)) == 3
    (tmp_path / "a0.jpg").touch()
    (tmp_path / "._a0.jpg").touch()
    assert [path.name for path in pictures_in(tmp_path)] == ["a0.jpg"]


def test_misnamed_pictures_are_read(tmp_path, codes):
    """exact: what is read does not depend on the extension."""
    kinds = {"PNG": {}, "JPEG": {}, "TIFF": {}, "BMP": {}, "WEBP": {"lossless": True}, "AVIF": {}}
    contents = {form: encoded(codes, form, **options) for form, options in kinds.items()}
    contents["HEIC"] = heic(codes)
    for form, content in contents.items():
        lights = []
        for extension in ("jfif", "heic", "jpg", "webp", "bmp", "mp4", "unknown"):
            path = tmp_path / f"{form}.{extension}"
            path.write_bytes(content)
            assert is_clip(path) is False
            lights.append(read(path, SRGB).rgb)
        assert all(np.array_equal(lights[0], light) for light in lights)
        if form not in ("JPEG", "AVIF", "HEIC"):
            assert np.array_equal(lights[0], SRGB.decode(codes / 255).astype(np.float32))


def test_misnamed_clips_are_read(tmp_path, codes):
    """exact: also names that FFmpeg takes for a sequence of pictures."""
    clip(str(tmp_path / "a.mp4"), codes)
    for name in ("a.jpg", "a.dng", "a%04d.jpg", "a*.png", "a"):
        (tmp_path / name).write_bytes((tmp_path / "a.mp4").read_bytes())
        assert is_clip(tmp_path / name)
        assert len(list(read_frames(tmp_path / name, REC709))) == 3
        if "%" not in name:
            assert "extract one frame of the clip (MP4)" in refusal(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "head", "says"),
    [
        (
            "a.png",
            b"\xff\x0a\1",
            "convert it to PNG or TIFF; this kind of file (JPEG XL) is not read",
        ),
        ("a.tga", bytes(18), "this kind of file (TARGA)"),
        (
            "a.jpg",
            b"<html>",
            "download the picture itself; this kind of file (web page or drawing)",
        ),
        ("a.mp4", b"#EXTM3U\n/etc/passwd\n", "give the clip itself; this kind of file (playlist)"),
        ("a.json", b"{}", "give a picture or a clip; this kind of file (text)"),
    ],
)
def test_other_files_are_named_with_a_remedy(tmp_path, name, head, says):
    (tmp_path / name).write_bytes(head)
    assert says in refusal(tmp_path / name)
    assert says in refusal(tmp_path / name, reader=lambda path: list(read_frames(path)))


@pytest.mark.skipif(sys.platform != "linux", reason="names that others do not allow")
def test_a_name_is_a_name(tmp_path, codes, monkeypatch):
    """exact: names that are URLs, options, patterns, or no text for some library."""
    monkeypatch.chdir(tmp_path)
    clip("whole.mp4", codes)
    film = (tmp_path / "whole.mp4").read_bytes()
    names = (
        "throw:1",
        "http:x",
        "concat:a|b",
        "file:y",
        "-x",
        "a?b=1",
        "q%04d",
        os.fsdecode(b"th\xffrow"),
    )
    for name in names:
        with open(f"{name}.mp4", "wb") as file:
            file.write(film)
        assert len(list(read_frames(f"{name}.mp4", REC709))) == 3
        for extension in ("png", "webp"):
            with open(f"{name}.{extension}", "wb") as file:
                file.write(encoded(codes, extension, lossless=True))
            assert np.array_equal(
                read(f"{name}.{extension}", SRGB).rgb, SRGB.decode(codes / 255).astype(np.float32)
            )


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow text only")
def test_pictures_are_written_into_a_folder_whose_name_is_no_text(tmp_path, codes):
    """exact."""
    folder = tmp_path / os.fsdecode(b"o\xff")
    folder.mkdir()
    image = LinearImage((codes / 255).astype(np.float32))
    for name in ("a.png", "a.tif", "a.exr"):
        write(folder / name, image)
        assert abs(read(folder / name).rgb - image.rgb).max() < 1e-4
    assert sorted(path.name for path in folder.iterdir()) == ["a.exr", "a.png", "a.tif"]


@pytest.mark.parametrize("command", ["track", "plate", "solve"])
def test_a_command_for_clips_says_that_a_picture_is_one(tmp_path, codes, command):
    """door."""
    (tmp_path / "a.webp").write_bytes(encoded(codes, "WEBP"))
    asked = [
        command,
        tmp_path / "a.webp",
        "-o",
        tmp_path / ("o.png" if command == "plate" else "o"),
    ]
    if command == "solve":
        asked += ["--frames", "0:2"]
    if command == "track":
        asked[-1] = tmp_path / "o.csv"
    result = run(*asked)
    assert result.exit_code == 2
    assert "a.webp: give a clip, or several pictures; it is one picture (WebP)" in result.stderr


# HEIC.


def test_heic_is_decoded_to_linear_light(tmp_path, codes):
    """oracle: by its color box; its chroma is subsampled, its quantization not known."""
    (tmp_path / "a.heic").write_bytes(heic(codes))
    image = read(tmp_path / "a.heic")
    assert abs(image.rgb - SRGB.decode(codes / 255))[:, 24:].max() < HEIC_STEP
    assert (image.meta.levels, image.meta.converted, image.meta.subsampled) == (256, False, True)
    (tmp_path / "b.heic").write_bytes(heic(codes, chroma=444))
    assert not read(tmp_path / "b.heic").meta.subsampled


def test_heic_of_ten_bits_keeps_them(tmp_path):
    """exact: white is 1 and saturated, and light has more than 256 values."""
    ramp = np.repeat(np.linspace(0.2, 0.8, 256)[None, :, None], 64, axis=0).repeat(3, axis=2)
    ramp[:8] = 1
    content = heic(np.rint(65535 * ramp).astype(np.uint16), 10, chroma=444)
    (tmp_path / "a.heic").write_bytes(content)
    image = read(tmp_path / "a.heic")
    assert image.meta.levels == 1024
    assert image.rgb[:4].min() > 0.99
    assert not image.valid[:4, 8:-8].all()
    assert abs(image.rgb[24:] - SRGB.decode(ramp[24:])).max() < 0.004
    assert len(np.unique(image.rgb[40])) > 200


def test_heic_with_a_profile_is_converted_to_the_primaries_of_srgb(tmp_path, codes, display_p3):
    """exact: the same numbers as a PNG of the same codes with this profile."""
    (tmp_path / "a.heic").write_bytes(heic(codes, chroma=444, icc_profile=display_p3))
    (tmp_path / "a.png").write_bytes(encoded(codes, "PNG", icc_profile=display_p3))
    photo, png = read(tmp_path / "a.heic"), read(tmp_path / "a.png")
    assert photo.meta.converted
    assert abs(photo.rgb - png.rgb)[:, 24:].max() < HEIC_STEP
    assert photo.meta.icc_profile == display_p3


@pytest.mark.parametrize("orientation", range(1, 9))
def test_photos_are_turned_by_their_orientation(tmp_path, codes, orientation):
    """oracle: WebP by EXIF, as PNG; HEIC by libheif alone, whose EXIF is not applied twice."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    for form, options in (("PNG", {}), ("WEBP", {"lossless": True})):
        (tmp_path / form).write_bytes(encoded(codes, form, exif=exif, **options))
    assert np.array_equal(read(tmp_path / "PNG", SRGB).rgb, read(tmp_path / "WEBP", SRGB).rgb)
    (tmp_path / "HEIC").write_bytes(heic(codes, exif=exif.tobytes(), chroma=444))
    shown = read(tmp_path / "PNG", SRGB).rgb
    photo = read(tmp_path / "HEIC")
    assert photo.rgb.shape == shown.shape
    assert np.median(abs(photo.rgb - shown)) < HEIC_STEP


def test_heic_of_pq_is_decoded_by_it(tmp_path, codes):
    """exact."""
    content = bytearray(heic(codes))
    at = content.index(b"colrnclx") + 8
    content[at : at + 4] = struct.pack(">2H", 9, 16)
    (tmp_path / "a.heic").write_bytes(content)
    assert read(tmp_path / "a.heic").meta.transfer == PQ


def test_heic_without_its_library_names_the_extra(tmp_path, codes, monkeypatch):
    """door."""
    (tmp_path / "a.heic").write_bytes(heic(codes))
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    assert 'pip install "blurmatte[heic]", or export it as PNG' in refusal(tmp_path / "a.heic")


def test_damaged_and_animated_photos_are_refused(tmp_path, codes):
    """door."""
    contents = {form: encoded(codes, form) for form in ("WEBP", "AVIF", "BMP")}
    for name, content in {"HEIC": heic(codes), **contents}.items():
        for part in (0.3, 0.9):
            (tmp_path / name).write_bytes(content[: int(part * len(content))])
            assert "copy or export it again" in refusal(tmp_path / name)
    two = [Image.fromarray(codes), Image.fromarray(255 - codes)]
    two[0].save(tmp_path / "b.webp", save_all=True, append_images=two[1:])
    assert "it is an animation (WebP)" in refusal(tmp_path / "b.webp")


@pytest.mark.parametrize("kind", ["P", "L", "RGBA"])
def test_bmp_of_gray_is_read_and_of_colored_palettes_refused(tmp_path, codes, kind):
    """exact: cameras of machines write gray BMPs with a palette."""
    Image.fromarray(codes).convert(kind).save(tmp_path / "a.bmp")
    if kind == "P":
        assert "a palette rounds the colors" in refusal(tmp_path / "a.bmp")
        return
    image = read(tmp_path / "a.bmp", SRGB)
    want = np.asarray(Image.fromarray(codes).convert(kind).convert("RGB"))
    assert np.array_equal(image.rgb, SRGB.decode(want / 255).astype(np.float32))
    assert image.valid.all()
    assert image.meta.gray == (kind == "L")


def test_an_edited_heic_keeps_profile_and_exif(tmp_path, codes, display_p3):
    """exact: in a PNG; unchanged pixels are those that were decoded."""
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    content = heic(codes, icc_profile=display_p3, exif=exif.tobytes())
    (tmp_path / "a.heic").write_bytes(content)
    image = read(tmp_path / "a.heic")
    changed = np.zeros((48, 64), bool)
    changed[20, 30] = True
    write_changed(tmp_path / "b.png", tmp_path / "a.heic", image, changed)
    with Image.open(tmp_path / "b.png") as png:
        assert png.info["icc_profile"] == display_p3
        assert png.getexif()[0x010F] == "Maker"
    assert np.allclose(read(tmp_path / "b.png").rgb, image.rgb, atol=1e-6)

"""In-place edits, read by Pillow, OpenCV, tifffile and blurmatte."""

import io
import struct
import warnings
from dataclasses import replace

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.testing import assert_allclose
from PIL import ExifTags, Image, ImageCms, ImageOps
from PIL.PngImagePlugin import PngInfo
from PIL.TiffImagePlugin import IFDRational
from tests.disk import room_for

from blurmatte.errors import BlurmatteWarning, FileError, TransferWarning
from blurmatte.files.inplace import write_changed
from blurmatte.files.reading import read
from blurmatte.files.writing import write
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, gamma

EXIF_DIRECTORY, GPS_DIRECTORY = 0x8769, 0x8825
ORIENTATION, MAKER_NOTE, EXPOSURE_TIME, USER_COMMENT = 0x0112, 0x927C, 0x829A, 0x9286
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF/></x:xmpmeta>'
SIZE = 61, 45
EXTENSIONS = ["png", "tif", "jpg"]


def scene(seed=0):
    """(H, W, 3) uint8 codes: smooth, an edge, noise; nothing near black or white."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    codes = np.stack([100 + x, 180 - 2 * y, 90 + y + x / 2], axis=-1)
    codes[20:, 30:] = (170, 60, 50)
    return np.clip(codes + rng.normal(0, 4, codes.shape), 20, 235).astype(np.uint8)


def camera_exif(orientation=1):
    """EXIF of a camera with a maker note."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[ORIENTATION] = "Example", "C1", orientation
    exif[0x0132] = "2024:05:06 09:00:00"
    inner = exif.get_ifd(EXIF_DIRECTORY)
    inner[EXPOSURE_TIME], inner[0x9003] = IFDRational(1, 60), "2024:05:06 07:08:09"
    inner[MAKER_NOTE], inner[USER_COMMENT] = b"Example\0\1\2\3" * 9, b"ASCII\0\0\0by hand"
    inner[0xA434], inner[0x8827], inner[0x9204] = "50mm f/2", 400, IFDRational(-1, 3)
    place = exif.get_ifd(GPS_DIRECTORY)
    place[1], place[2] = "N", (IFDRational(52), IFDRational(30), IFDRational(3, 2))
    return exif


def tags_by_pillow(path):
    """The tags of a file read by Pillow, without the position of pixels; EXIF and GPS separate."""
    with Image.open(path) as file:
        exif = file.getexif()
        whole = {
            tag: value for tag, value in exif.items() if tag in (0x010F, 0x0110, 0x0112, 0x0132)
        }
        return whole, dict(exif.get_ifd(EXIF_DIRECTORY)), dict(exif.get_ifd(GPS_DIRECTORY))


def srgb_profile():
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def make(path, orientation=1, profile=None, **options):
    """A picture with all metadata; a TIFF is converted from the PNG, because Pillow drops its EXIF."""
    profile = srgb_profile() if profile is None else profile
    picture = Image.fromarray(scene())
    common = {
        "exif": camera_exif(orientation),
        "icc_profile": profile,
        "dpi": (300, 300),
        **options,
    }
    if path.suffix == ".jpg":
        picture.save(path, xmp=XMP, **{"quality": 92, **common})
    elif path.suffix == ".png":
        text = PngInfo()
        text.add_itxt("XML:com.adobe.xmp", XMP.decode())
        text.add_text("Title", "Kept")
        picture.save(path, pnginfo=text, **common)
    else:
        first = make(path.with_name("first.png"), orientation, profile, **options)
        image = read(first)
        write_changed(path, first, image, np.zeros(image.valid.shape, bool))
    return path


def edited(path, **options):
    """The light of a file with a spot of another color, and the mask of the spot."""
    image = read(path, **options)
    changed = np.zeros(image.valid.shape, bool)
    changed[11:30, 8:25] = True
    light = image.rgb.copy()
    light[changed] = SRGB.decode(np.array([0.3, 0.62, 0.41]))
    return replace(image, rgb=light, noise=None), changed


def codes_of(path):
    """Code values as stored."""
    if path.suffix == ".tif":
        return tifffile.imread(path)
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)


@pytest.mark.parametrize("target", EXTENSIONS)
@pytest.mark.parametrize("source", EXTENSIONS)
def test_metadata_is_kept(tmp_path, source, target):
    """Exact, by Pillow: EXIF with maker note, GPS, orientation, profile, XMP, resolution."""
    original = make(tmp_path / f"o.{source}", orientation=6)
    path = tmp_path / f"new.{target}"
    write_changed(path, original, *edited(original))
    assert tags_by_pillow(path) == tags_by_pillow(tmp_path / f"o.{source}")
    assert tags_by_pillow(path)[1][MAKER_NOTE].startswith(b"Example\0\1\2\3")
    assert tags_by_pillow(path)[2][1] == "N"
    assert codes_of(path).shape == codes_of(original).shape
    with Image.open(original) as before, Image.open(path) as after:
        assert after.info["icc_profile"] == before.info["icc_profile"]
        assert after.info["xmp"].rstrip(b"\0") == XMP
        assert_allclose([float(n) for n in after.info["dpi"]], 300, atol=0.01)


@pytest.mark.diagonal
@pytest.mark.parametrize("target", ["png", "tif"])
@pytest.mark.parametrize("source", EXTENSIONS)
@pytest.mark.parametrize("orientation", [1, 5, 6, 8])
def test_unchanged_pixels_are_bit_identical(tmp_path, source, target, orientation):
    """Exact: decoded code values; inside the mask, the requested light to half a code value."""
    original = make(tmp_path / f"o.{source}", orientation)
    picture, changed = edited(original)
    path = tmp_path / f"new.{target}"
    write_changed(path, original, picture, changed)
    before, after = read(original), read(path)
    assert np.array_equal(after.rgb[~changed], before.rgb[~changed])
    assert after.meta.icc_profile == before.meta.icc_profile
    asked = 255 * SRGB.encode(picture.rgb[changed])
    assert_allclose(255 * SRGB.encode(after.rgb[changed]), asked, atol=0.5001)
    assert codes_of(path).shape == (SIZE[1], SIZE[0], 3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_agrees_with_pillow(tmp_path, orientation):
    """Oracle: one changed pixel lands where Pillow finds it."""
    original = make(tmp_path / "o.png", orientation)
    image = read(original)
    changed = np.zeros(image.valid.shape, bool)
    changed[3, 7] = True
    light = np.where(changed[..., None], 0, image.rgb).astype(np.float32)
    write_changed(tmp_path / "n.png", original, replace(image, rgb=light), changed)
    with Image.open(tmp_path / "n.png") as file:
        upright = np.asarray(ImageOps.exif_transpose(file))
    assert np.argwhere((upright == 0).all(axis=-1)).tolist() == [[3, 7]]


@pytest.mark.diagonal
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("subsampling", [0, 1, 2])
@pytest.mark.parametrize("orientation", [1, 6])
def test_unchanged_jpeg_blocks_decode_identically(tmp_path, subsampling, progressive, orientation):
    """Exact in Pillow, OpenCV and blurmatte, except one pixel where chroma is interpolated."""
    more = {"subsampling": subsampling, "progressive": progressive}
    original = make(tmp_path / "o.jpg", orientation, **more)
    picture, changed = edited(original)
    path = tmp_path / "new.jpg"
    write_changed(path, original, picture, changed)
    stored = np.rot90(changed) if orientation == 6 else changed
    free = ~reached(stored, subsampling)
    assert 200 < free.sum() < free.size - changed.sum()
    for decode in (pillow_codes, codes_of):
        assert np.array_equal(decode(path)[free], decode(original)[free])
        assert not np.array_equal(decode(path), decode(original))
    upright = free if orientation == 1 else np.rot90(free, -1)
    assert np.array_equal(read(path).rgb[upright], read(original).rgb[upright])


def pillow_codes(path):
    with Image.open(path) as file:
        return np.asarray(file)


def reached(stored, subsampling):
    """The MCUs with a changed pixel, dilated by two pixels (one chroma sample)."""
    width, height = ((8, 8), (16, 8), (16, 16))[subsampling]
    mask = np.zeros_like(stored)
    for y, x in np.argwhere(stored):
        top, left = y // height * height, x // width * width
        mask[top : top + height, left : left + width] = True
    if subsampling:
        mask = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    return mask


def test_changed_jpeg_blocks_have_the_given_light(tmp_path):
    """Exact, to half a step of the mean of an even block."""
    original = make(tmp_path / "o.jpg", quality=98, subsampling=0)
    picture, changed = edited(original)
    write_changed(tmp_path / "n.jpg", original, picture, changed)
    inside = np.zeros_like(changed)
    inside[16:24, 8:24] = True  # whole blocks of one color
    codes = 255 * SRGB.encode(read(tmp_path / "n.jpg").rgb[inside])
    assert_allclose(codes, 255 * np.array([[0.3, 0.62, 0.41]]).repeat(inside.sum(), 0), atol=1.6)
    edges = 255 * SRGB.encode(read(tmp_path / "n.jpg").rgb[changed])
    assert np.sqrt(np.mean((edges - 255 * SRGB.encode(picture.rgb[changed])) ** 2)) < 2


def test_unchanged_picture_keeps_every_coefficient(tmp_path):
    """Invariant: a full mask compresses once more; an empty mask changes nothing."""
    original = make(tmp_path / "o.jpg", subsampling=2)
    image = read(original)
    write_changed(tmp_path / "n.jpg", original, image, np.zeros(image.valid.shape, bool))
    assert np.array_equal(pillow_codes(tmp_path / "n.jpg"), pillow_codes(original))


def test_bit_depth_and_alpha_are_kept(tmp_path, make_png):
    """Exact: 16 bits with alpha, gray and in color, to both kinds of file."""
    rng = np.random.default_rng(2)
    for channels in (1, 2, 3, 4):
        codes = rng.integers(9000, 50000, (40, 52, channels), dtype=np.uint16)
        original = tmp_path / f"o{channels}.png"
        original.write_bytes(make_png(codes, {b"sRGB": b"\0"}))
        image = read(original)
        changed = rng.random((40, 52)) < 0.3
        light = np.where(changed[..., None], 0.25, image.rgb).astype(np.float32)
        for extension in ("png", "tif"):
            path = tmp_path / f"n{channels}.{extension}"
            write_changed(path, original, replace(image, rgb=light), changed)
            new = codes_of(path) if extension == "tif" else opencv_png(path, channels)
            new = new.reshape(codes.shape)
            assert new.dtype == np.uint16
            assert np.array_equal(new[~changed], codes[~changed])
            colors = channels - 1 + channels % 2
            assert (new[changed][:, :colors] == round(65535 * float(SRGB.encode(0.25)))).all()
            assert np.array_equal(new[..., colors:], codes[..., colors:])
            assert read(path).meta.transfer is SRGB  # and it is said there, too: no warning
            assert np.array_equal(read(path).valid, image.valid)


def opencv_png(path, channels):
    """By OpenCV, in the order of the file; it makes colors of gray with alpha."""
    codes = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return (
        codes if channels == 1 else codes[..., {2: [0, 3], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]]
    )


def test_gray_with_alpha_is_read_by_pillow(tmp_path, make_png):
    """Exact, with its color type."""
    codes = np.random.default_rng(3).integers(30, 200, (20, 24, 2), dtype=np.uint8)
    (tmp_path / "o.png").write_bytes(make_png(codes, {b"sRGB": b"\0"}))
    image = read(tmp_path / "o.png")
    write_changed(tmp_path / "n.png", tmp_path / "o.png", image, np.ones((20, 24), bool))
    with Image.open(tmp_path / "n.png") as file:
        assert file.mode == "LA"
        assert np.array_equal(np.asarray(file), codes)


def test_premultiplied_tiff_stays_so(tmp_path):
    """Exact: unchanged numbers and the meaning of alpha are kept."""
    codes = np.full((16, 16, 4), 100, np.uint8)
    tifffile.imwrite(tmp_path / "o.tif", codes, photometric="rgb", extrasamples=["assocalpha"])
    image = read(tmp_path / "o.tif", SRGB)
    changed = np.zeros((16, 16), bool)
    changed[4:8] = True
    light = np.where(changed[..., None], SRGB.decode(0.2), image.rgb).astype(np.float32)
    write_changed(tmp_path / "n.tif", tmp_path / "o.tif", replace(image, rgb=light), changed, SRGB)
    with tifffile.TiffFile(tmp_path / "n.tif") as file:
        assert file.pages[0].extrasamples == (1,)
        new = file.asarray()
    assert (new[changed] == (51, 51, 51, 100)).all()
    assert np.array_equal(new[~changed], codes[~changed])


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_float_tiff_stays_light(tmp_path, dtype):
    """Exact: beyond white and below black, too."""
    light = np.random.default_rng(4).normal(0.5, 1, (30, 20, 3)).astype(dtype)
    tifffile.imwrite(tmp_path / "o.tif", light, photometric="rgb")
    image = read(tmp_path / "o.tif")
    changed = np.zeros((30, 20), bool)
    changed[:5] = True
    new = np.where(changed[..., None], np.float32(2.5), image.rgb)
    for extension in ("tif", "exr"):
        path = tmp_path / f"n.{extension}"
        write_changed(path, tmp_path / "o.tif", replace(image, rgb=new), changed)
        assert np.array_equal(read(path).rgb, new)


def test_a_profile_with_other_primaries_is_inverted(tmp_path, curve, make_profile):
    """Exact: all 8-bit colors of it come back, by its own curves and matrix."""
    profile = make_profile(
        {"r": curve["curv"](563), "g": curve["curv"](563), "b": curve["curv"](461)}
    )
    codes = np.random.default_rng(6).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for extension in ("png", "tif"):
        original = tmp_path / f"o.{extension}"
        Image.fromarray(codes).save(original, icc_profile=profile)
        image = read(original)
        write_changed(tmp_path / "n.png", original, image, np.ones((64, 64), bool))
        assert np.array_equal(pillow_codes(tmp_path / "n.png"), codes)
        with Image.open(tmp_path / "n.png") as file:
            assert file.info["icc_profile"] == profile


def test_chunks_of_a_png_are_kept(tmp_path, make_png):
    """Exact: color, text and unknown chunks, in their order; gamma is inverted."""
    chunks = {
        b"gAMA": struct.pack(">I", 55556),
        b"pHYs": struct.pack(">2LB", 11811, 11811, 1),
        b"tEXt": b"Title\0Kept",
        b"prVt": b"of some program",
        b"acTL": struct.pack(">2L", 1, 0),
    }
    codes = scene()
    (tmp_path / "o.png").write_bytes(make_png(codes, chunks))
    image = read(tmp_path / "o.png")
    assert image.meta.transfer.name == gamma(1 / 0.55556).name
    write_changed(tmp_path / "n.png", tmp_path / "o.png", image, np.ones(codes.shape[:2], bool))
    content = (tmp_path / "n.png").read_bytes()
    places = [content.index(kind + data) for kind, data in list(chunks.items())[:4]]
    assert places == sorted(places)
    assert b"acTL" not in content
    assert np.array_equal(pillow_codes(tmp_path / "n.png"), codes)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_exif_behind_the_pixels_does_not_turn_a_png(tmp_path, make_png, extension):
    png = make_png(
        scene(), {b"sRGB": b"\0", b"eXIf": camera_exif(6).tobytes().removeprefix(b"Exif\0\0")}
    )
    at, pixels = png.index(b"eXIf") - 4, png.index(b"IDAT") - 4
    source, target = tmp_path / "a.png", tmp_path / f"b.{extension}"
    source.write_bytes(png[:at] + png[pixels:-12] + png[at:pixels] + png[-12:])
    image = read(source)
    write_changed(target, source, image, np.zeros(image.valid.shape, bool))
    assert read(target).size == image.size == SIZE
    if extension == "png":
        written = target.read_bytes()
        assert written.index(b"sRGB") < written.index(b"IDAT") < written.index(b"eXIf")


@pytest.mark.parametrize("target", EXTENSIONS)
@pytest.mark.parametrize("source", EXTENSIONS)
def test_declaration_of_srgb_is_kept_in_every_format(tmp_path, make_png, source, target):
    """Exact: by EXIF or by a chunk, depending on the format."""
    original = tmp_path / f"o.{source}"
    original.write_bytes(make_png(scene(), {b"sRGB": b"\0"}))
    if source != "png":
        image = read(original)
        first = original.rename(tmp_path / "first.png")
        write_changed(original, first, image, np.zeros(image.valid.shape, bool))
    path = tmp_path / f"n.{target}"
    write_changed(path, original, *edited(original))
    assert read(path).meta.transfer is SRGB
    with Image.open(path) as file:
        if target == "png":
            assert file.info["srgb"] == 0
        else:
            assert file.getexif().get_ifd(EXIF_DIRECTORY)[0xA001] == 1


def test_compressed_xmp_of_a_png_is_kept(tmp_path):
    """Exact: uncompressed in another format."""
    text = PngInfo()
    text.add_itxt("XML:com.adobe.xmp", XMP.decode(), lang="en", zip=True)
    Image.fromarray(scene()).save(tmp_path / "o.png", pnginfo=text, icc_profile=srgb_profile())
    assert XMP not in (tmp_path / "o.png").read_bytes()
    write_changed(tmp_path / "n.jpg", tmp_path / "o.png", *edited(tmp_path / "o.png"))
    with Image.open(tmp_path / "n.jpg") as file:
        assert file.info["xmp"] == XMP


def test_color_key_is_replaced_by_alpha(tmp_path, make_png):
    """Exact: alpha as read by OpenImageIO, without the color key."""
    codes = scene()
    codes[0, 0] = (1, 2, 3)
    key = struct.pack(">3H", 1, 2, 3)
    (tmp_path / "o.png").write_bytes(make_png(codes, {b"sRGB": b"\0", b"tRNS": key}))
    image = read(tmp_path / "o.png")
    write_changed(tmp_path / "n.png", tmp_path / "o.png", image, np.zeros(codes.shape[:2], bool))
    with Image.open(tmp_path / "n.png") as file:
        assert np.array_equal(np.asarray(file.convert("RGB")), codes)
    assert np.array_equal(read(tmp_path / "n.png").valid, image.valid)


@pytest.mark.parametrize("form", [{"byteorder": ">"}, {"bigtiff": True}, {"tile": (16, 16)}])
def test_tags_of_every_form_of_tiff_are_kept(tmp_path, form):
    """Exact, by tifffile: names, numbers of both kinds, maker notes."""
    tags = [(271, "s", 0, "Example", True), (33434, 5, 1, (1, 60), True), (274, "H", 1, 3, True)]
    original = tmp_path / "o.tif"
    tifffile.imwrite(
        original,
        scene(),
        photometric="rgb",
        extratags=tags,
        metadata=None,
        resolution=(240, 240),
        **form,
    )
    image = read(original, SRGB)
    write_changed(tmp_path / "n.tif", original, image, np.zeros(image.valid.shape, bool), SRGB)
    with tifffile.TiffFile(tmp_path / "n.tif") as file:
        new = file.pages[0].tags
        assert new["Make"].value == "Example"
        assert new["ExposureTime"].value == (1, 60)
        assert new["Orientation"].value == 3
        assert new["XResolution"].value == (240, 1)
        assert np.array_equal(file.asarray(), scene())


def with_thumbnail(exif, small):
    """An EXIF block of Pillow with a second directory that contains a thumbnail."""
    block = bytearray(exif.tobytes()[6:])
    order = "<" if block[:2] == b"II" else ">"
    (count,) = struct.unpack_from(order + "H", block, 8)
    block += b"\0" * (len(block) % 2)
    struct.pack_into(order + "L", block, 10 + 12 * count, len(block))
    start = len(block) + 2 + 2 * 12 + 4
    block += struct.pack(order + "H", 2)
    block += struct.pack(order + "HHLL", 0x0201, 4, 1, start)
    block += struct.pack(order + "HHLL", 0x0202, 4, 1, len(small)) + b"\0" * 4
    return b"Exif\0\0" + bytes(block) + small


@pytest.mark.parametrize("target", EXTENSIONS)
@pytest.mark.parametrize("source", ["png", "jpg"])
def test_thumbnail_is_removed(tmp_path, source, target):
    """Exact: and no other EXIF data."""
    file = io.BytesIO()
    Image.fromarray(scene()[:16, :16]).save(file, "JPEG")
    small = file.getvalue()
    original = make(tmp_path / f"o.{source}", exif=with_thumbnail(camera_exif(), small))
    assert small in original.read_bytes()
    path = tmp_path / f"n.{target}"
    write_changed(path, original, *edited(original))
    assert small[20:] not in path.read_bytes()
    assert tags_by_pillow(path) == tags_by_pillow(original)
    with Image.open(original) as before, Image.open(path) as after:
        assert before.getexif().get_ifd(ExifTags.IFD.IFD1)
        assert not after.getexif().get_ifd(ExifTags.IFD.IFD1)


def test_multi_picture_index_is_removed(tmp_path):
    """Exact: further pictures are removed; other segments are kept."""
    data = make(tmp_path / "a.jpg").read_bytes()
    index = b"\xff\xe2\x00\x0aMPF\0\1\2\3\4"
    original = tmp_path / "o.jpg"
    original.write_bytes(data[:2] + index + b"\xff\xfe\x00\x06note" + data[2:] + data)
    with pytest.warns(BlurmatteWarning, match=r"n\.jpg: without the further pictures of o\.jpg"):
        write_changed(tmp_path / "n.jpg", original, *edited(original))
    content = (tmp_path / "n.jpg").read_bytes()
    assert b"MPF\0" not in content
    assert b"\xff\xfe\x00\x06note" in content
    assert content.count(b"\xff\xd9") == 1


GAIN_MAP_XMP = (
    b'<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"\n'
    b' xmlns:C="http://ns.google.com/photos/1.0/container/" dc:creator="me"'
    b' xmlns:Item="http://ns.google.com/photos/1.0/container/item/"><C:Directory><rdf:Seq><rdf:li>'
    b'<C:Item Item:Semantic="GainMap" Item:Length="9"/></rdf:li></rdf:Seq></C:Directory>'
    b"</rdf:Description>"
)
CLIP_XMP = (
    b"<rdf:Description xmlns:GCamera='http://ns.google.com/photos/1.0/camera/' dc:creator=\"me\""
    b" GCamera:MotionPhoto='1' GCamera:MicroVideoOffset='99' GCamera:burst='7'>"
    b"<GCamera:MotionPhotoVersion>1</GCamera:MotionPhotoVersion></rdf:Description>"
)
PREVIEW_XMP = (
    b'<rdf:Description xmlns:xmp="http://ns.adobe.com/xap/1.0/" dc:creator="me" xmp:Rating="3">'
    b"<xmp:Thumbnails><rdf:Alt>old</rdf:Alt></xmp:Thumbnails></rdf:Description>"
)


def with_segments(path, *bodies, behind=b""):
    """A JPEG with these segments, (marker, body), and bytes behind the picture."""
    data = make(path).read_bytes()
    parts = (
        b"\xff" + bytes([marker]) + struct.pack(">H", len(body) + 2) + body
        for marker, body in bodies
    )
    at = data.index(b"\xff\xdb\0")  # behind the segments of `make`
    path.write_bytes(data[:at] + b"".join(parts) + data[at:] + behind)
    return path


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize(
    ("xmp", "kept", "gone", "says"),
    [
        (GAIN_MAP_XMP, b"", (b"hdrgm:Version", b"Semantic", b"Directory"), "HDR gain map"),
        (CLIP_XMP, b"GCamera:burst", (b"MotionPhoto", b"MicroVideo"), "clip"),
        (PREVIEW_XMP, b'xmp:Rating="3"', (b"Thumbnails", b"old"), ""),
    ],
    ids=["gain map", "clip", "preview"],
)
@pytest.mark.filterwarnings("ignore::blurmatte.errors.BlurmatteWarning")
def test_statements_about_further_pictures_go_with_them(
    tmp_path, recwarn, extension, xmp, kept, gone, says
):
    """Exact: no XMP about a gain map, a clip or a preview that is not written; one line says so."""
    packet = b"http://ns.adobe.com/xap/1.0/\0" + xmp
    original = with_segments(tmp_path / "o.jpg", (0xE1, packet), behind=b"further")
    path = tmp_path / f"n.{extension}"
    warnings.simplefilter("always")
    write_changed(path, original, *edited(original))
    content = path.read_bytes()
    assert b'dc:creator="me"' in content
    assert kept in content
    assert not any(part in content for part in gone)
    assert b"further" not in content
    found = [str(one.message) for one in recwarn if "without the" in str(one.message)]
    assert found == (
        [f"{path}: without the {says} of o.jpg, which would show the old picture"] if says else []
    )


@pytest.mark.filterwarnings("ignore::blurmatte.errors.BlurmatteWarning")
def test_gain_map_of_iso_and_small_copies_of_photoshop_are_removed(tmp_path):
    """Exact: the segment of ISO 21496-1 and two resources; the others are kept byte by byte."""

    def resource(number, data):
        return b"8BIM" + struct.pack(">HHL", number, 0, len(data)) + data + b"\0" * (len(data) % 2)

    caption = resource(1028, b"caption"), resource(1037, b"hint")
    resources = caption[0] + resource(1036, b"small copy!") + resource(1033, b"older") + caption[1]
    original = with_segments(
        tmp_path / "o.jpg",
        (0xE2, b"urn:iso:std:iso:ts:21496:-1\0\0\0"),
        (0xED, b"Photoshop 3.0\0" + resources),
    )
    write_changed(tmp_path / "n.jpg", original, *edited(original))
    content = (tmp_path / "n.jpg").read_bytes()
    assert b"21496" not in content
    assert b"Photoshop 3.0\0" + b"".join(caption) in content


@pytest.mark.parametrize("source", EXTENSIONS)
def test_original_may_be_overwritten(tmp_path, source):
    """Exact: as if it were another file."""
    original = make(tmp_path / f"o.{source}")
    picture, changed = edited(original)
    write_changed(tmp_path / f"n.{source}", original, picture, changed)
    write_changed(original, original, picture, changed)
    assert original.read_bytes() == (tmp_path / f"n.{source}").read_bytes()


def test_undeclared_curve_is_that_of_read_image(tmp_path):
    """Exact: with a warning, or with the given transfer."""
    Image.fromarray(scene()).save(tmp_path / "o.png")
    image = read(tmp_path / "o.png", LINEAR)
    changed = np.ones(image.valid.shape, bool)
    write_changed(tmp_path / "n.png", tmp_path / "o.png", image, changed, LINEAR)
    assert np.array_equal(pillow_codes(tmp_path / "n.png"), scene())
    with pytest.warns(TransferWarning, match="no color profile"):
        write_changed(tmp_path / "n.png", tmp_path / "o.png", image, changed)


def test_exr_contains_the_light_of_the_whole_picture(tmp_path):
    """Exact: of JPEG and of EXR originals."""
    original = make(tmp_path / "o.jpg")
    picture, changed = edited(original)
    write_changed(tmp_path / "n.exr", original, picture, changed)
    light = OpenEXR.File(str(tmp_path / "n.exr")).channels()["RGB"].pixels
    assert np.array_equal(light[~changed], read(original).rgb[~changed])
    assert np.array_equal(light[changed], picture.rgb[changed])
    assert read(tmp_path / "n.exr").meta.exposure_time == pytest.approx(1 / 60)
    write_changed(tmp_path / "m.exr", tmp_path / "n.exr", picture, ~changed)
    assert np.array_equal(read(tmp_path / "m.exr").rgb, picture.rgb)


def test_gray_stays_gray(tmp_path):
    """Exact: one channel in every format; color is rejected."""
    for extension in EXTENSIONS:
        original = tmp_path / f"o.{extension}"
        Image.fromarray(scene()).convert("L").save(original)
        image = read(original, SRGB)
        changed = np.zeros(image.valid.shape, bool)
        changed[:9] = True
        light = np.where(changed[..., None], np.float32(0.3), image.rgb)
        path = tmp_path / f"n.{extension}"
        write_changed(path, original, replace(image, rgb=light), changed, SRGB)
        new = pillow_codes(path)
        assert new.ndim == 2
        assert np.array_equal(new[16:], pillow_codes(original)[16:])
        assert_allclose(new[:8], 255 * SRGB.encode(0.3), atol=1.5)
        light = light * np.array([1, 1, 0.9], np.float32)
        with pytest.raises(FileError, match="is gray, and the changed pixels are colored"):
            write_changed(path, original, replace(image, rgb=light), changed, SRGB)


def test_invalid_requests_raise_one_line_errors(tmp_path, make_png):
    """Door: and existing files are unchanged."""
    original = make(tmp_path / "o.png")
    picture, changed = edited(original)
    kept = tmp_path / "kept.jpg"
    kept.write_bytes(b"precious")

    def refused(error, words, target=kept, source=original, image=picture, mask=changed):
        with pytest.raises(error, match=words) as caught:
            write_changed(target, source, image, mask)
        assert "\n" not in str(caught.value)
        assert kept.read_bytes() == b"precious"
        assert not list(tmp_path.glob(".blurmatte*"))

    refused(FileError, "change the extension", target=tmp_path / "a.gif")
    refused(FileError, "no such file", source=tmp_path / "none.png")
    refused(ValueError, "picture is 20x20 pixels", image=LinearImage(np.ones((20, 20, 3))))
    refused(ValueError, "changed must have the shape", mask=changed[:-1])
    refused(TypeError, "must hold booleans", mask=changed.astype(np.uint8))
    (tmp_path / "a.dng").write_bytes(b"II*\0 and so on")
    refused(FileError, "give a developed picture", source=tmp_path / "a.dng")
    write(tmp_path / "a.exr", picture)
    refused(FileError, "write .exr", source=tmp_path / "a.exr")
    tifffile.imwrite(tmp_path / "a.tif", picture.rgb, photometric="rgb")
    refused(FileError, "a JPEG file holds no floats", source=tmp_path / "a.tif")
    alpha = np.dstack([scene(), scene()[..., 0]])
    (tmp_path / "b.png").write_bytes(make_png(alpha, {b"sRGB": b"\0"}))
    refused(FileError, "cannot hold its alpha", source=tmp_path / "b.png")
    (tmp_path / "c.png").write_bytes(make_png(scene(), {b"gAMA": struct.pack(">I", 55556)}))
    refused(FileError, "only a PNG can state its encoding", source=tmp_path / "c.png")
    (tmp_path / "folder.jpg").mkdir()
    refused(FileError, "is a folder", target=tmp_path / "folder.jpg")


def test_error_for_unsupported_jpeg_recommends_png(tmp_path):
    """Door: an RGB JPEG. Writing a PNG succeeds."""
    original = tmp_path / "o.jpg"
    Image.fromarray(scene()).save(original, keep_rgb=True)
    picture, changed = edited(original, transfer=SRGB)
    with pytest.raises(FileError, match=r"write \.png .* sampling of the JPEG is not supported"):
        write_changed(tmp_path / "n.jpg", original, picture, changed, SRGB)
    assert not (tmp_path / "n.jpg").exists()
    write_changed(tmp_path / "n.png", original, picture, changed, SRGB)


def test_exif_too_long_for_a_jpeg_raises_an_error(tmp_path):
    """Door: a TIFF may contain more than the 64 kB of a segment."""
    tag = (50000, "B", 70_000, bytes(70_000), True)
    tifffile.imwrite(tmp_path / "o.tif", scene(), photometric="rgb", extratags=[tag], metadata=None)
    picture, changed = edited(tmp_path / "o.tif", transfer=SRGB)
    with pytest.raises(FileError, match="EXIF is too long"):
        write_changed(tmp_path / "n.jpg", tmp_path / "o.tif", picture, changed, SRGB)


def test_damaged_exif_does_not_prevent_writing(tmp_path):
    """Door: truncated at any byte; a JPEG keeps the readable part."""
    whole = camera_exif().tobytes()
    for length in (6, 9, 14, 40, 100, 200, len(whole) - 3):
        segment = b"\xff\xe1" + struct.pack(">H", length + 2) + whole[:length]
        file = io.BytesIO()
        Image.fromarray(scene()).save(file, "JPEG")
        original = tmp_path / "o.jpg"
        original.write_bytes(file.getvalue()[:2] + segment + file.getvalue()[2:])
        picture, changed = edited(original, transfer=SRGB)
        for extension in EXTENSIONS:
            path = tmp_path / f"n.{extension}"
            write_changed(path, original, picture, changed, SRGB)
            assert read(path, SRGB).size == SIZE
        assert segment in (tmp_path / "n.jpg").read_bytes()


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_full_disk_keeps_the_old_file(tmp_path, extension):
    """Door."""
    original = make(tmp_path / f"o.{extension}")
    picture, changed = edited(original)
    write_changed(tmp_path / f"n.{extension}", original, picture, changed)  # compiled, and stored
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with room_for(2000), pytest.raises(FileError, match="cannot be written") as caught:
        write_changed(original, original, picture, changed)
    assert "\n" not in str(caught.value)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

import struct
import zlib
from dataclasses import replace

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
import tifffile
from numpy.testing import assert_allclose
from PIL import Image, ImageOps

import blurmatte as bm
from blurmatte.checks import DIRECTIONS
from blurmatte.errors import FileError
from blurmatte.files.raster_writing import save_pixels
from blurmatte.files.reading import read, read_layer
from blurmatte.jpeg.coding import jpeg_bytes, read_jpeg
from blurmatte.radiometry import SRGB
from blurmatte.radiometry.sensor import exif_orientation

EXR = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("extension", ["png", "tif"])
def test_every_code_value_is_decoded_by_the_table(tmp_path, make_png, dtype, extension):
    levels = np.iinfo(dtype).max + 1
    codes = np.arange(levels, dtype=dtype).reshape(-1, 64, 1).repeat(3, axis=2)
    path = tmp_path / f"all.{extension}"
    if extension == "png":
        path.write_bytes(make_png(codes))
    else:
        tifffile.imwrite(path, codes, photometric="rgb")
    image = read(path, transfer=SRGB)
    light = SRGB.decode(codes / (levels - 1))
    assert_allclose(image.rgb, light, rtol=1e-6)
    assert image.rgb.dtype == np.float32
    assert image.meta.levels == levels
    assert not image.valid[-1, -1]
    assert image.valid.sum() == image.valid.size - 1


def test_one_saturated_channel_is_enough(tmp_path, ramp, make_png):
    ramp[3, 5, 1] = 255
    (tmp_path / "a.png").write_bytes(make_png(ramp))
    valid = read(tmp_path / "a.png", transfer=SRGB).valid
    assert not valid[3, 5]
    assert valid.sum() == valid.size - 1


def test_jpeg_is_what_pillow_decodes(tmp_path, ramp):
    Image.fromarray(ramp).save(tmp_path / "a.jpg", quality=90)
    theirs = np.asarray(Image.open(tmp_path / "a.jpg")).astype(int)
    ours = 255 * SRGB.encode(read(tmp_path / "a.jpg", transfer=SRGB).rgb)
    assert_allclose(ours, theirs, atol=1.01)  # their upsampling of color may round otherwise


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_of_another_library_is_read_to_the_bit(tmp_path, ramp, dtype):
    light = (ramp / 100 - 0.2).astype(dtype)
    OpenEXR.File(dict(EXR), {"RGB": light}).write(str(tmp_path / "a.exr"))
    image = read(tmp_path / "a.exr")
    assert np.array_equal(image.rgb, light.astype(np.float32))
    assert image.valid.all()
    assert image.meta.levels is None


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_float_tiff_of_another_library(tmp_path, ramp, dtype):
    light = (ramp / 100 - 0.2).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb")
    assert np.array_equal(read(tmp_path / "a.tif").rgb, light.astype(np.float32))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("extension", ["png", "tif", "jpg"])
def test_pixels_are_turned_as_pillow_turns_them(tmp_path, ramp, orientation, extension):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{extension}"
    Image.fromarray(ramp).save(path, exif=exif, **({"quality": 100} if extension == "jpg" else {}))
    theirs = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    image = read(path, transfer=SRGB)
    assert image.rgb.shape == theirs.shape
    assert_allclose(255 * SRGB.encode(image.rgb), theirs, atol=2 if extension == "jpg" else 1e-3)


def with_density(path, picture, unit, x, y):
    """A PNG, JPEG or TIFF with these densities; unit 0 is none, 1 is the meter or inch."""
    if path.suffix == ".tif":
        tifffile.imwrite(
            path, picture, photometric="rgb", resolution=(x, y), resolutionunit=unit + 1
        )
        return
    Image.fromarray(picture).save(path)
    data = path.read_bytes()
    if path.suffix == ".png":
        body = b"pHYs" + struct.pack(">IIB", x, y, unit)
        chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
        path.write_bytes(data[:33] + chunk + data[33:])  # behind the header
    else:
        at = data.index(b"JFIF\0") + 7
        path.write_bytes(data[:at] + struct.pack(">BHH", unit, x, y) + data[at + 5 :])


@pytest.mark.parametrize(
    ("name", "unit", "x", "y", "shown"),
    [
        ("a.png", 1, 300, 150, "1:2, 40x30 are shown as 20x30"),  # twice as many columns as rows
        ("a.png", 0, 45, 64, "64:45, 40x30 are shown as 57x30"),
        ("a.jpg", 1, 300, 150, "1:2, 40x30 are shown as 20x30"),
        ("a.jpg", 2, 150, 300, "2:1, 40x30 are shown as 80x30"),
        ("a.jpg", 0, 2, 1, "2:1, 40x30 are shown as 80x30"),  # the shape of a pixel
        ("a.tif", 1, 300, 150, "1:2, 40x30 are shown as 20x30"),
        ("a.tif", 0, 1, 2, "2:1, 40x30 are shown as 80x30"),
    ],
)
def test_pixels_that_are_not_square_are_refused(tmp_path, ramp, name, unit, x, y, shown):
    # door: as those of clips are; the size shows which side is too short
    picture = np.ascontiguousarray(np.resize(ramp, (30, 40, 3)))
    with_density(tmp_path / name, picture, unit, x, y)
    with pytest.raises(
        FileError, match=f"export it with square pixels as .*its pixels are {shown}"
    ):
        read(tmp_path / name)


GAIN_MAP = (
    b'<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"/>'
)


def test_bytes_between_segments_of_a_jpeg_with_a_gain_map_are_an_error(tmp_path, ramp, capfd):
    """Door: one clear message, and nothing that a library prints."""
    path = tmp_path / "a.jpg"
    Image.fromarray(ramp).save(path, xmp=GAIN_MAP)
    read(path, transfer=SRGB)
    data = path.read_bytes()
    at = data.index(b"\xff\xdb")  # of the first quantization table
    path.write_bytes(data[:at] + b"lost" + data[at:])
    with pytest.raises(FileError, match="no marker where a segment ends"):
        read(path, transfer=SRGB)
    assert capfd.readouterr() == ("", "")


def test_a_marker_within_the_body_of_a_jpeg_with_a_gain_map_is_an_error(tmp_path, ramp, capfd):
    """Door: one clear message, and nothing that a library prints."""
    path = tmp_path / "a.jpg"
    Image.fromarray(np.resize(ramp, (30, 40, 3))).save(path, xmp=GAIN_MAP)
    data = path.read_bytes()
    path.write_bytes(data[:-60] + b"\xff\xe0" + data[-58:])
    with pytest.raises(FileError, match="the JPEG is damaged or truncated"):
        read(path, transfer=SRGB)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
@pytest.mark.parametrize(("unit", "x", "y"), [(1, 72, 72), (0, 1, 1), (0, 0, 64), (1, 0, 0)])
def test_square_and_meaningless_densities_are_accepted(tmp_path, ramp, name, unit, x, y):
    with_density(tmp_path / name, ramp, unit, x, y)
    assert read(tmp_path / name, transfer=SRGB).rgb.shape == ramp.shape


@pytest.mark.parametrize(("aspect", "square"), [(1.0, True), (2.0, False)])
def test_exr_of_pixels_that_are_not_square_is_refused(tmp_path, ramp, aspect, square):
    # door: also as a layer
    spec = oiio.ImageSpec(*ramp.shape[1::-1], 4, "float")
    spec["PixelAspectRatio"] = aspect
    target = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert target.open(str(tmp_path / "a.exr"), spec)
    assert target.write_image(np.full((*ramp.shape[:2], 4), 0.5, np.float32))
    target.close()
    for reads in (read, read_layer):
        if square:
            reads(tmp_path / "a.exr")
        else:
            with pytest.raises(FileError, match="its pixels are 2:1"):
                reads(tmp_path / "a.exr")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("extension", ["png", "tif"])
def test_readout_is_from_each_stored_row_to_the_next(tmp_path, orientation, extension):
    # oracle: where light that increases from row to row of the file increases in the picture
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored = np.repeat(np.linspace(20, 200, 8, dtype=np.uint8)[:, None], 8, axis=1)
    Image.fromarray(np.dstack([stored] * 3)).save(tmp_path / f"a.{extension}", exif=exif)
    image = read(tmp_path / f"a.{extension}", transfer=SRGB)
    down, right = (np.sign(np.diff(image.rgb[..., 0], axis=axis)).mean() for axis in (0, 1))
    assert DIRECTIONS[image.meta.readout] == (right, down)


@pytest.mark.parametrize("extension", ["jpg", "tif", "exr"])
def test_exposure_time_is_kept(tmp_path, extension):
    path = str(tmp_path / f"a.{extension}")
    spec = oiio.ImageSpec(4, 3, 3, oiio.FLOAT if extension == "exr" else oiio.UINT8)
    spec["ExposureTime"] = 0.25
    target = oiio.ImageOutput.create(path)
    target.open(path, spec)
    target.write_image(np.zeros((3, 4, 3), np.uint8))
    target.close()
    assert read(path, transfer=SRGB).meta.exposure_time == 0.25


def test_gray_is_three_equal_channels(tmp_path, ramp, make_png):
    gray = ramp[..., :1]
    (tmp_path / "g.png").write_bytes(make_png(gray))
    OpenEXR.File(dict(EXR), {"Y": (gray[..., 0] / 255).astype(np.float32)}).write(
        str(tmp_path / "g.exr")
    )
    coded, linear = read(tmp_path / "g.png", transfer=SRGB), read(tmp_path / "g.exr")
    assert_allclose(coded.rgb, SRGB.decode(gray / 255).repeat(3, axis=2), atol=1e-7)
    assert_allclose(linear.rgb, (gray / 255).repeat(3, axis=2), atol=1e-7)
    assert coded.meta.gray
    assert linear.meta.gray
    assert coded.meta.source == "g.png"


def test_opaque_alpha_is_dropped(tmp_path, ramp, make_png):
    opaque = np.dstack([ramp, np.full((24, 32), 255, np.uint8)])
    (tmp_path / "a.png").write_bytes(make_png(opaque))
    image = read(tmp_path / "a.png", transfer=SRGB)
    assert image.valid.all()
    assert_allclose(image.rgb, SRGB.decode(ramp / 255), atol=1e-7)


def test_straight_colors_survive_a_small_alpha(tmp_path, ramp, make_png):
    """And the pixel is not the whole truth about the scene, so it is not valid."""
    alpha = np.full((24, 32), 255, np.uint8)
    alpha[2, 3] = 1
    (tmp_path / "a.png").write_bytes(make_png(np.dstack([ramp, alpha])))
    image = read(tmp_path / "a.png", transfer=SRGB)
    assert_allclose(image.rgb, SRGB.decode(ramp / 255), atol=1e-7)
    assert not image.valid[2, 3]
    assert image.valid.sum() == image.valid.size - 1


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_straight_layer_is_premultiplied_in_light(tmp_path, ramp, make_png, extension):
    rgba = np.dstack([ramp, ramp[::-1, :, 0]])
    path = tmp_path / f"a.{extension}"
    if extension == "png":
        path.write_bytes(make_png(rgba))
    else:
        tifffile.imwrite(path, rgba, photometric="rgb", extrasamples=["unassalpha"])
    layer = read_layer(path, transfer=SRGB)
    alpha = rgba[..., 3:] / 255
    assert_allclose(layer.alpha, alpha[..., 0], atol=1e-7)
    assert_allclose(layer.premultiplied, alpha * SRGB.decode(ramp / 255), atol=1e-6)


def test_premultiplied_tiff_is_divided_before_its_curve(tmp_path):
    """sRGB code 128 at alpha 0.5 (128 of 255) was white before it was multiplied."""
    rgba = np.full((2, 2, 4), 128, np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", rgba, photometric="rgb", extrasamples=["assocalpha"])
    layer = read_layer(tmp_path / "a.tif", transfer=SRGB)
    assert_allclose(layer.straight(), 1, atol=1e-6)
    assert_allclose(layer.alpha, 128 / 255)


def test_exr_layer_is_read_unchanged(tmp_path, ramp):
    alpha = ramp[..., :1] / 255
    rgba = np.dstack([ramp / 300 * alpha, alpha]).astype(np.float32)
    OpenEXR.File(dict(EXR), {"RGBA": rgba}).write(str(tmp_path / "a.exr"))
    layer = read_layer(tmp_path / "a.exr")
    assert np.array_equal(layer.premultiplied, rgba[..., :3])
    assert np.array_equal(layer.alpha, rgba[..., 3])


def test_picture_without_alpha_is_rejected_as_layer(tmp_path, ramp, make_png):
    (tmp_path / "a.png").write_bytes(make_png(ramp))
    with pytest.raises(FileError, match=r"a\.png: give .* has no alpha"):
        read_layer(tmp_path / "a.png", transfer=SRGB)


def test_data_window_is_placed_in_the_display_window(tmp_path, ramp):
    """Compositing programs store only the part of a picture that is not empty."""
    rgb = (ramp / 255).astype(np.float32)
    window = (np.array([-2, 5], np.int32), np.array([29, 28], np.int32))
    full = (np.array([0, 0], np.int32), np.array([39, 26], np.int32))
    header = EXR | {"dataWindow": window, "displayWindow": full}
    OpenEXR.File(header, {"RGB": rgb}).write(str(tmp_path / "a.exr"))
    image = read(tmp_path / "a.exr")
    assert image.size == (40, 27)
    assert np.array_equal(image.rgb[5:27, 0:30], rgb[:22, 2:])
    assert image.valid[5:27, 0:30].all()
    assert image.valid.sum() == 22 * 30


def test_unknown_channels_are_ignored(tmp_path, ramp):
    light = (ramp / 255).astype(np.float32)
    extra = {"B.depth": light[..., 0].copy(), "RGB": light, "beauty.R": light[..., 1].copy()}
    OpenEXR.File(dict(EXR), extra).write(str(tmp_path / "a.exr"))
    assert np.array_equal(read(tmp_path / "a.exr").rgb, light)


@pytest.mark.parametrize("name", ["white room.png", "Übung 猫.png", "ÅÄÖ é/x y.png"])
def test_unusual_file_names_are_supported(tmp_path, ramp, make_png, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(make_png(ramp))
    assert read(str(path), transfer=SRGB).meta.source == path.name


def test_one_pixel(tmp_path, make_png):
    (tmp_path / "a.png").write_bytes(make_png(np.full((1, 1, 3), 100, np.uint8)))
    assert read(tmp_path / "a.png", transfer=SRGB).size == (1, 1)


def test_invalid_exposure_time_is_ignored(tmp_path):
    """Door: EXIF as some programs write it, two numbers instead of their ratio."""
    exif = Image.Exif()
    exif[0x829A] = (1, 50)
    Image.new("RGB", (8, 8)).save(tmp_path / "odd.jpg", exif=exif)
    assert read(tmp_path / "odd.jpg", transfer=SRGB).meta.exposure_time is None


@pytest.mark.diagonal
@pytest.mark.parametrize("chroma", ["4:4:4", "4:2:2", "4:2:0"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_jpeg_compression_is_read_in_every_orientation(tmp_path, orientation, chroma):
    """Oracle: what it expects of the picture before is what is read, but for a few codes."""
    y, x = np.mgrid[:75, :83] / 80
    before = np.stack([0.3 + 0.4 * x, 0.5 + 0.2 * np.sin(9 * y), 0.4 + 0.3 * x * y], axis=-1)
    before[(x + y) > 1] = (0.8, 0.35, 0.15)
    stored = exif_orientation(orientation).stored(np.rint(255 * before).astype(np.uint8))
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.jpg"
    Image.fromarray(stored).save(path, quality=75, subsampling=chroma, exif=exif)
    image = read(path, transfer=SRGB)
    expected = image.meta.compression.expected(before, 0.5 / 255)
    codes = SRGB.encode(image.rgb.astype(float))
    off, changed = (np.sqrt(np.mean((codes - x) ** 2)) for x in (expected, before))
    assert off < 0.3 * changed


def test_compression_of_other_files_is_unknown(tmp_path, ramp, make_png, make_profile, curve):
    """PNG; gray; red, green and blue that are no luma; other primaries."""
    (tmp_path / "a.png").write_bytes(make_png(ramp))
    Image.fromarray(ramp[..., 0]).save(tmp_path / "gray.jpg")
    Image.fromarray(ramp).save(tmp_path / "rgb.jpg", keep_rgb=True)
    wide = make_profile(curve["curv"](563))
    Image.fromarray(ramp).save(tmp_path / "wide.jpg", icc_profile=wide)
    for path in tmp_path.iterdir():
        assert read(path, None if path.stem == "wide" else SRGB).meta.compression is None, path.name


@pytest.mark.parametrize("orientation", [0, 9])
def test_invalid_orientation_is_ignored(tmp_path, ramp, orientation):
    """Door: some programs write 0."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(ramp).save(tmp_path / "odd.jpg", exif=exif)
    Image.fromarray(ramp).save(tmp_path / "plain.jpg")
    odd, plain = (read(tmp_path / f"{name}.jpg", SRGB) for name in ("odd", "plain"))
    assert np.array_equal(odd.rgb, plain.rgb)
    assert odd.meta.compression == plain.meta.compression


def test_a_jpeg_of_the_coarsest_steps_is_read(tmp_path, ramp):
    """Door: tables of 16 bits hold steps that no baseline file has."""
    Image.fromarray(ramp).save(tmp_path / "a.jpg", quality=50)
    jpeg = read_jpeg((tmp_path / "a.jpg").read_bytes())
    coarse = tuple(table + np.uint16(300) for table in jpeg.quantization)
    (tmp_path / "a.jpg").write_bytes(jpeg_bytes(replace(jpeg, quantization=coarse)))
    image = read(tmp_path / "a.jpg", SRGB)
    assert image.size == (ramp.shape[1], ramp.shape[0])
    assert image.meta.compression is None


def test_light_beyond_a_million_is_counted(tmp_path):
    light = np.full((8, 8, 3), 0.5, np.float32)
    light[2, 3], light[4, 5, 0] = 1e38, -2e6
    save_pixels(tmp_path / "a.exr", [light], "RGB", {})
    with pytest.raises(FileError, match=r"2 of 64 pixels are NaN, infinite, or beyond 1e\+06"):
        read(tmp_path / "a.exr")


SHAPE = np.zeros((6, 8), bool)
SHAPE[1:4, 2:7] = True


@pytest.mark.parametrize("color", ["white", "black", "photograph"])
@pytest.mark.parametrize("extension", ["png", "tif"])
def test_mask_is_the_shape_in_alpha(tmp_path, color, extension):
    """exact: whatever colors a paint program leaves there, with soft rims."""
    light = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    light = {"white": np.full_like(light, 255), "black": np.zeros_like(light)}.get(color, light)
    alpha = np.where(SHAPE, 255, 0).astype(np.uint8)
    alpha[0], alpha[4, 2:7] = 127, 128
    path = tmp_path / f"mask.{extension}"
    Image.fromarray(np.dstack([light, alpha])).save(path)
    right = SHAPE.copy()
    right[4, 2:7] = True
    assert np.array_equal(bm.read_mask(path), right)


@pytest.mark.parametrize("form", ["L", "RGB", "RGBA", "LA"])
def test_mask_without_transparent_pixels_is_where_it_is_white(tmp_path, form):
    """exact: gray, color, with an opaque alpha."""
    picture = Image.fromarray(np.where(SHAPE, 128, 127).astype(np.uint8))
    picture.convert(form).save(tmp_path / "mask.png")
    assert np.array_equal(bm.read_mask(tmp_path / "mask.png"), SHAPE)


def test_mask_of_a_layer_is_its_alpha(tmp_path):
    """exact: premultiplied light is no shape."""
    alpha = np.where(SHAPE, 0.7, 0.2).astype(np.float32)
    bm.write(tmp_path / "layer.exr", bm.Layer(alpha, 0.1 * alpha[..., None].repeat(3, axis=-1)))
    assert np.array_equal(bm.read_mask(tmp_path / "layer.exr"), SHAPE)


def test_mask_with_two_shapes_is_refused(tmp_path):
    """door: black and white below an alpha with another shape."""
    codes = np.where(SHAPE, 255, 0).astype(np.uint8)
    alpha = np.full_like(codes, 255)
    alpha[:, :3] = 0
    Image.fromarray(np.dstack([codes, codes, codes, alpha])).save(tmp_path / "mask.png")
    with pytest.raises(bm.errors.FileError, match="its opaque pixels are both black and white"):
        bm.read_mask(tmp_path / "mask.png")

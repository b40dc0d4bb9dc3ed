import io
import struct
import zlib

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from numpy.testing import assert_allclose
from PIL import Image, ImageCms
from PIL.ExifTags import Base as TiffTag

from blurmatte.errors import FileError, TransferWarning
from blurmatte.files.exif import EXIF_MARK, Tag, shorts, tags_block
from blurmatte.files.inplace import write_changed
from blurmatte.files.reading import read, read_layer
from blurmatte.files.writing import write
from blurmatte.radiometry import LINEAR, REC709, SRGB, gamma
from blurmatte.radiometry.transfer import HLG, PQ

SRGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


@pytest.fixture
def save(tmp_path, ramp, make_png):
    def save(chunks):
        path = tmp_path / "a.png"
        path.write_bytes(make_png(ramp, chunks))
        return path

    return save


def test_untagged_file_is_srgb_with_a_warning(save, ramp):
    with pytest.warns(TransferWarning, match=r"a\.png.*transfer=.*--transfer srgb") as caught:
        image = read(save({}))
    assert caught[0].filename == __file__  # the warning points at the caller
    assert len(caught) == 1
    assert_allclose(image.rgb, SRGB.decode(ramp / 255), atol=1e-7)


@pytest.mark.parametrize("extension", ["jpg", "tif"])
def test_other_untagged_files_warn_too(tmp_path, ramp, extension):
    path = tmp_path / f"a.{extension}"
    Image.fromarray(ramp).save(path)
    with pytest.warns(TransferWarning, match="a color profile|no color profile"):
        assert read(path).meta.transfer is SRGB


def test_a_layer_warns_at_its_caller(tmp_path, ramp, make_png):
    path = tmp_path / "a.png"
    path.write_bytes(make_png(np.dstack([ramp, ramp[..., :1]])))
    with pytest.warns(TransferWarning) as caught:
        read_layer(path)
    assert caught[0].filename == __file__
    assert read_layer(path, transfer=SRGB).size == (32, 24)


@pytest.mark.parametrize(
    ("chunks", "transfer"),
    [
        ({b"sRGB": b"\0"}, SRGB),
        ({b"gAMA": struct.pack(">I", 45455)}, SRGB),
        ({b"gAMA": struct.pack(">I", 100_000)}, LINEAR),
        ({b"sRGB": b"\0", b"gAMA": struct.pack(">I", 100_000)}, SRGB),
        ({b"cICP": bytes([1, 8, 0, 1])}, LINEAR),
        ({b"cICP": bytes([1, 1, 0, 1])}, REC709),
        ({b"cICP": bytes([9, 16, 0, 1])}, PQ),
        ({b"cICP": bytes([9, 18, 0, 1])}, HLG),
    ],
)
def test_png_chunks_state_the_curve(save, chunks, transfer):
    assert read(save(chunks)).meta.transfer is transfer


def test_hlg_of_a_png_is_light_of_the_scene(save, ramp):
    """exact: 1 at the top."""
    image = read(save({b"cICP": bytes([1, 18, 0, 1])}))
    assert_allclose(image.rgb, HLG.decode(ramp / 255), atol=1e-3)


def test_gamma_chunk_is_the_exponent_of_encoding(save, ramp):
    image = read(save({b"gAMA": struct.pack(">I", 50_000)}))
    assert_allclose(image.rgb, (ramp / 255) ** 2, atol=1e-6)


@pytest.mark.parametrize(
    ("cicp", "says"),
    [
        ((3, 13, 0, 1), "primaries 3 and curve 13"),
        ((1, 9, 0, 1), "primaries 1 and curve 9"),
        ((1, 13, 0, 0), "video range"),
        ((1, 13, 1, 1), "Y'CbCr"),
    ],
)
def test_unsupported_cicp_is_rejected_by_name(save, cicp, says):
    with pytest.raises(FileError, match=f"convert the picture to sRGB; .*{says}"):
        read(save({b"cICP": bytes(cicp)}))


LIGHT = np.array([0.8, 0.1, 0.05])
P3, REC2020 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06), (0.708, 0.292, 0.17, 0.797, 0.131, 0.046)
SRGB_XY, AP1 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06), (0.713, 0.293, 0.165, 0.83, 0.128, 0.044)
D65, D60 = (0.3127, 0.329), (0.32168, 0.33767)
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06)


def xyz_of(primaries, white):
    """XYZ of red, green and blue that add to white, one column each."""
    colors = np.array([[x, y, 1 - x - y] for x, y in np.reshape(primaries, (3, 2))]).T
    x, y = white
    return colors * np.linalg.solve(colors, np.array([x, y, 1 - x - y]) / y)


def of_light(primaries, white=D65):
    """LIGHT of sRGB in other primaries."""
    return np.linalg.solve(xyz_of(primaries, white), xyz_of(SRGB_XY, D65) @ LIGHT)


def chrm(primaries, white=D65):
    return struct.pack(">8I", *(round(100_000 * x) for x in (*white, *primaries)))


@pytest.mark.parametrize(
    ("primaries", "curve", "chunks"),
    [
        (P3, SRGB, {b"gAMA": struct.pack(">I", 45455), b"cHRM": chrm(P3)}),
        (REC2020, LINEAR, {b"gAMA": struct.pack(">I", 100_000), b"cHRM": chrm(REC2020)}),
        (ADOBE, gamma(1 / 0.45471), {b"gAMA": struct.pack(">I", 45471), b"cHRM": chrm(ADOBE)}),
        (SRGB_XY, SRGB, {b"sRGB": b"\0", b"cHRM": chrm(P3)}),
        (P3, SRGB, {b"cICP": bytes([12, 13, 0, 1])}),
        (REC2020, REC709, {b"cICP": bytes([9, 14, 0, 1]), b"sRGB": b"\0"}),
        (
            P3,
            SRGB,
            {b"cICP": bytes([12, 13, 0, 1]), b"iCCP": b"s\0\0" + zlib.compress(SRGB_PROFILE)},
        ),
    ],
)
def test_primaries_of_a_png_are_converted(tmp_path, make_png, primaries, curve, chunks):
    path = tmp_path / "a.png"
    codes = np.rint(65535 * curve.encode(of_light(primaries))).astype(np.uint16)
    path.write_bytes(make_png(np.tile(codes, (8, 8, 1)), chunks))
    assert_allclose(read(path).rgb[0, 0], LIGHT, atol=1e-4)


def test_primaries_without_a_curve_are_converted_with_a_warning(tmp_path, make_png):
    path = tmp_path / "a.png"
    codes = np.rint(65535 * SRGB.encode(of_light(P3))).astype(np.uint16)
    path.write_bytes(make_png(np.tile(codes, (8, 8, 1)), {b"cHRM": chrm(P3)}))
    with pytest.warns(TransferWarning):
        assert_allclose(read(path).rgb[0, 0], LIGHT, atol=1e-4)
    with pytest.raises(FileError, match="only a PNG can state its encoding"):
        write_changed(tmp_path / "a.jpg", path, read(path, SRGB), np.zeros((8, 8), bool), SRGB)


def test_primaries_that_are_none_are_rejected(save):
    with pytest.raises(FileError, match="its primaries are no three colors"):
        read(save({b"gAMA": struct.pack(">I", 45455), b"cHRM": bytes(32)}))


def exr(path, numbers, **attributes):
    header = {"type": OpenEXR.scanlineimage, **attributes}
    pixels = np.tile(np.asarray(numbers, np.float32), (8, 8, 1))
    OpenEXR.File(header, {"RGBA" if pixels.shape[2] == 4 else "RGB": pixels}).write(str(path))
    return path


@pytest.mark.parametrize(
    ("primaries", "white", "attributes"),
    [
        (AP1, D60, {"chromaticities": (*AP1, *D60)}),
        (AP1, D60, {"colorInteropID": "lin_ap1_scene"}),
        (AP1, D60, {"colorInteropID": "lin_ap1_scene", "chromaticities": (*AP1, *D60)}),
        (REC2020, D65, {"colorInteropID": "lin_rec2020_scene"}),
        (SRGB_XY, D65, {"colorInteropID": "lin_rec709_scene"}),
        (SRGB_XY, D65, {"colorInteropID": "unknown"}),
    ],
)
def test_primaries_of_an_exr_are_converted(tmp_path, primaries, white, attributes):
    path = exr(tmp_path / "a.exr", of_light(primaries, white), **attributes)
    assert_allclose(read(path).rgb[0, 0], LIGHT, atol=1e-6)


def test_a_layer_with_other_primaries_keeps_what_glows_without_alpha(tmp_path):
    rgba = [*of_light(REC2020), 0.0]
    layer = read_layer(exr(tmp_path / "a.exr", rgba, chromaticities=(*REC2020, *D65)))
    assert_allclose(layer.premultiplied[0, 0], LIGHT, atol=1e-6)


@pytest.mark.parametrize(
    ("attributes", "says"),
    [
        ({"colorInteropID": "pq_rec2020_display"}, "states 'pq_rec2020_display', which is not"),
        ({"colorInteropID": "lin_mine_scene"}, "lin_mine_scene"),
        (
            {"colorInteropID": "lin_ap1_scene", "chromaticities": (*P3, *D65)},
            "chromaticities are not those of its colorInteropID",
        ),
    ],
)
def test_color_spaces_of_an_exr_are_rejected_by_name(tmp_path, attributes, says):
    with pytest.raises(FileError, match=says):
        read(exr(tmp_path / "a.exr", LIGHT, **attributes))


@pytest.mark.parametrize("extension", ["jpg", "tif", "png"])
def test_adobe_rgb_by_exif_is_converted(tmp_path, extension):
    """R03 of DCF 2.0, with the uncalibrated color space."""
    tags = {TiffTag.ExifInteroperabilityOffset: {TiffTag.InteropIndex: Tag(2, 4, b"R03\0")}}
    block = tags_block({TiffTag.ExifOffset: {TiffTag.ColorSpace: shorts(65535), **tags}})
    path = tmp_path / f"a.{'png' if extension == 'png' else 'jpg'}"
    codes = np.rint(255 * of_light(ADOBE) ** (256 / 563)).astype(np.uint8)
    picture = Image.fromarray(np.tile(codes, (16, 16, 1)))
    picture.save(path, exif=EXIF_MARK + block, **({} if extension == "png" else {"quality": 100}))
    image = read(path)
    assert_allclose(image.rgb[0, 0], LIGHT, atol=0.01)
    written = tmp_path / f"b.{extension}"  # by Pillow, a TIFF has no R03
    write_changed(written, path, image, np.zeros((16, 16), bool))
    assert_allclose(read(written).rgb, image.rgb, atol=1e-6)


@pytest.mark.parametrize("extension", ["jpg", "png"])
def test_exif_states_srgb(tmp_path, ramp, extension):
    exif = Image.Exif()
    exif[0x0112] = 1  # Pillow leaves out EXIF that has nothing but what follows
    exif.get_ifd(0x8769)[0xA001] = 1
    Image.fromarray(ramp).save(tmp_path / f"a.{extension}", exif=exif)
    assert read(tmp_path / f"a.{extension}").meta.transfer is SRGB


@pytest.mark.parametrize("extension", ["jpg", "png", "tif"])
def test_an_srgb_profile_is_srgb_to_the_bit(tmp_path, ramp, extension):
    """The table then inverts: the codes of the file can be had back from its light."""
    path = tmp_path / f"a.{extension}"
    Image.fromarray(ramp).save(path, icc_profile=SRGB_PROFILE)
    image = read(path)
    assert image.meta.transfer is SRGB
    assert image.meta.icc_profile == SRGB_PROFILE
    assert np.array_equal(np.rint(255 * SRGB.encode(image.rgb)), np.asarray(Image.open(path)))


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_wide_gamut_profile_agrees_with_little_cms(tmp_path, ramp, make_profile, curve, extension):
    data = make_profile(
        {"r": curve["curv"](563), "g": curve["curv"](512), "b": curve["para"](0, 1.8)}
    )
    muted = (96 + ramp / 4).astype(np.uint8)  # inside the gamut of sRGB
    path = tmp_path / f"a.{extension}"
    Image.fromarray(muted).save(path, icc_profile=data)
    theirs = ImageCms.profileToProfile(
        Image.fromarray(muted),
        ImageCms.ImageCmsProfile(io.BytesIO(data)),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    image = read(path)
    assert_allclose(255 * SRGB.encode(image.rgb), np.asarray(theirs), atol=1.01)
    assert image.rgb.dtype == np.float32


def test_gray_profile(tmp_path, ramp, make_profile, curve):
    gray = ramp[..., 0]
    data = make_profile(curve["curv"](512), space=b"GRAY")
    Image.fromarray(gray).save(tmp_path / "g.png", icc_profile=data)
    image = read(tmp_path / "g.png")
    assert_allclose(image.rgb[..., 1], (gray / 255) ** 2, atol=1e-6)


def test_profile_with_look_up_tables_is_rejected(tmp_path, ramp, make_profile, curve):
    data = make_profile(curve["curv"](512), connection=b"Lab ")
    path = tmp_path / "a.jpg"
    Image.fromarray(ramp).save(path, icc_profile=data)
    with pytest.raises(
        FileError, match="convert the picture to sRGB; its color profile uses look-up tables"
    ):
        read(path)
    assert read(path, transfer=SRGB).meta.transfer is SRGB


def test_transfer_replaces_the_curve_and_keeps_the_primaries(tmp_path, ramp, make_profile, curve):
    path = tmp_path / "a.png"
    Image.fromarray(ramp).save(path, icc_profile=make_profile(curve["curv"](512)))
    square = gamma(2.0)
    by_caller, by_profile = read(path, transfer=square), read(path)
    assert_allclose(by_caller.rgb, by_profile.rgb, atol=1e-6)
    assert by_caller.meta.transfer is square
    assert np.abs(read(path, transfer=LINEAR).rgb - by_profile.rgb).max() > 0.1


def test_floats_are_linear_without_a_profile(tmp_path, ramp):
    codes = (ramp / 255).astype(np.float32)
    for extension in ("exr", "tif"):
        path = str(tmp_path / f"a.{extension}")
        target = oiio.ImageOutput.create(path)
        target.open(path, oiio.ImageSpec(32, 24, 3, oiio.FLOAT))
        target.write_image(codes)
        target.close()
        assert np.array_equal(read(path).rgb, codes)
        assert read(path).meta.transfer is None
        assert_allclose(read(path, transfer=SRGB).rgb, SRGB.decode(codes), atol=1e-6)


def test_written_files_state_their_encoding(tmp_path, ramp):
    """Warnings are errors in these tests."""
    for name in ("a.png", "a.jpg"):
        write(tmp_path / name, ramp)
        assert read(tmp_path / name).meta.transfer is SRGB

import io
import struct

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.testing import assert_allclose
from PIL import Image, ImageCms

from blurmatte.errors import FileError, TransferWarning
from blurmatte.files import read, read_layer, write
from blurmatte.radiometry import LINEAR, REC709, SRGB, gamma

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
    ],
)
def test_png_chunks_state_the_curve(save, chunks, transfer):
    assert read(save(chunks)).meta.transfer is transfer


def test_gamma_chunk_is_the_exponent_of_encoding(save, ramp):
    image = read(save({b"gAMA": struct.pack(">I", 50_000)}))
    assert_allclose(image.rgb, (ramp / 255) ** 2, atol=1e-6)


def test_hdr_colors_are_rejected(save):
    with pytest.raises(FileError, match="convert the picture to sRGB; its cICP chunk"):
        read(save({b"cICP": bytes([9, 16, 0, 1])}))


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

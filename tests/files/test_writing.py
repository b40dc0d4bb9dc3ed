import os
import stat
import time

import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.testing import assert_allclose
from PIL import Image
from tests.disk import room_for

from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.models import read_color_model
from blurmatte.files.reading import read, read_layer
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.radiometry import SRGB, LinearImage, Meta

HALF_STEP = 0.5 / 65535


@pytest.fixture
def light(ramp):
    return SRGB.decode((ramp + 0.3) / 256).astype(np.float32)


@pytest.fixture
def layer(light):
    alpha = np.linspace(0, 1, light.shape[0] * light.shape[1], dtype=np.float32)
    alpha = alpha.reshape(light.shape[:2])
    return Layer(alpha, alpha[..., None] * light)


@pytest.mark.parametrize("extension", ["png", "tif", "TIFF"])
def test_image_round_trips_to_16_bit(tmp_path, light, extension):
    path = tmp_path / f"a.{extension}"
    write(path, LinearImage(light))
    image = read(path)
    assert_allclose(SRGB.encode(image.rgb), SRGB.encode(light), atol=HALF_STEP + 1e-6)
    assert image.meta.levels == 65536
    assert image.meta.transfer is SRGB


def test_exr_holds_unchanged_light(tmp_path, light):
    light = light * 4 - 0.5  # brighter than white, darker than black
    write(tmp_path / "a.exr", LinearImage(light))
    assert np.array_equal(read(tmp_path / "a.exr").rgb, light)
    theirs = OpenEXR.File(str(tmp_path / "a.exr")).channels()["RGB"].pixels
    assert np.array_equal(theirs, light)


def test_integers_are_clipped(tmp_path):
    light = np.array([[[-0.5, 0.0, 7.0]]], np.float32)
    write(tmp_path / "a.tif", LinearImage(light))
    assert tifffile.imread(tmp_path / "a.tif").tolist() == [[[0, 0, 65535]]]


@pytest.mark.parametrize("extension", ["png", "jpg"])
def test_other_programs_see_srgb(tmp_path, light, extension):
    write(tmp_path / f"a.{extension}", LinearImage(light))
    seen = np.asarray(Image.open(tmp_path / f"a.{extension}").convert("RGB")).astype(float)
    assert_allclose(seen, 255 * SRGB.encode(light), atol=1 if extension == "png" else 12)


def test_files_state_srgb(tmp_path, light):
    for extension in ("png", "jpg", "tif"):
        write(tmp_path / f"a.{extension}", LinearImage(light))
    with Image.open(tmp_path / "a.png") as file:
        assert "srgb" in file.info
    with Image.open(tmp_path / "a.jpg") as file:
        assert file.getexif().get_ifd(0x8769)[0xA001] == 1
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].tags["ExifTag"].value["ColorSpace"] == 1


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "exr"])
def test_exposure_time_is_written(tmp_path, light, extension):
    write(tmp_path / f"a.{extension}", LinearImage(light, meta=Meta(exposure_time=1 / 50)))
    assert_allclose(read(tmp_path / f"a.{extension}").meta.exposure_time, 1 / 50, rtol=1e-4)


def test_layer_png_is_straight(tmp_path, layer, light):
    write(tmp_path / "a.png", layer)
    seen = np.asarray(Image.open(tmp_path / "a.png")).astype(float)  # Pillow keeps the upper byte
    assert_allclose(seen[..., 3], 255 * layer.alpha, atol=1)
    there = layer.alpha > 0
    assert_allclose(seen[there][:, :3], 255 * SRGB.encode(light)[there], atol=1)


def test_layer_tiff_is_premultiplied_and_states_it(tmp_path, layer, light):
    write(tmp_path / "a.tif", layer)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].extrasamples == (tifffile.EXTRASAMPLE.ASSOCALPHA,)
        codes = file.asarray() / 65535
    assert_allclose(codes[..., 3], layer.alpha, atol=HALF_STEP + 1e-7)
    assert_allclose(codes[..., :3], SRGB.encode(light) * layer.alpha[..., None], atol=2e-5)


def test_layer_exr_is_premultiplied_light(tmp_path, layer):
    write(tmp_path / "a.exr", layer)
    theirs = OpenEXR.File(str(tmp_path / "a.exr")).channels()["RGBA"].pixels
    assert np.array_equal(theirs[..., :3], layer.premultiplied)
    assert np.array_equal(theirs[..., 3], layer.alpha)


@pytest.mark.parametrize(("extension", "atol"), [("png", 3e-5), ("tif", 1e-4), ("exr", 0)])
def test_layer_round_trips(tmp_path, layer, extension, atol):
    write(tmp_path / f"a.{extension}", layer)
    back = read_layer(tmp_path / f"a.{extension}")
    assert_allclose(back.alpha, layer.alpha, atol=min(atol, HALF_STEP + 1e-7))
    assert_allclose(back.premultiplied, layer.premultiplied, atol=atol)


def test_alpha_is_written_unchanged(tmp_path):
    alpha = np.linspace(-0.1, 1.1, 60).reshape(6, 10)
    write(tmp_path / "alpha.png", alpha)
    seen = np.asarray(Image.open(tmp_path / "alpha.png"))
    assert seen.dtype == np.uint16
    assert np.array_equal(seen, np.rint(65535 * np.clip(alpha, 0, 1)))
    assert_allclose(
        read(tmp_path / "alpha.png").rgb[..., 0], np.clip(alpha, 0, 1), atol=HALF_STEP * 2
    )


def test_code_values_are_written_unchanged(tmp_path, ramp):
    write(tmp_path / "a.png", ramp)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), ramp)
    write(tmp_path / "a.jpg", ramp)
    assert_allclose(np.asarray(Image.open(tmp_path / "a.jpg")).astype(int), ramp, atol=8)


def test_same_input_same_bytes(tmp_path, light, layer):
    """Also at another time of day."""
    things = {"a.exr": layer, "a.tif": layer, "a.png": layer, "a.jpg": LinearImage(light)}
    first = {}
    for name, thing in things.items():
        write(tmp_path / name, thing)
        first[name] = (tmp_path / name).read_bytes()
    time.sleep(1.1)  # dates in files count seconds
    for name, thing in things.items():
        write(tmp_path / name, thing)
        assert (tmp_path / name).read_bytes() == first[name], name


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("a.webp", "image", ".png or .tif or .jpg or .exr"),
        ("a", "image", ".png or .tif or .jpg or .exr"),
        ("a.jpg", "layer", ".png or .tif or .exr"),
        ("a.png", "model", ".json"),
        ("a.tif", "coded", ".png or .jpg"),
        ("a.exr", "alpha", ".png"),
    ],
)
def test_error_for_wrong_extension_lists_the_supported(
    tmp_path, light, layer, ramp, name, kind, says
):
    thing = {
        "image": LinearImage(light),
        "layer": layer,
        "model": ColorModel.from_hex("#d8ff3c"),
        "coded": ramp,
        "alpha": layer.alpha,
    }[kind]
    with pytest.raises(FileError) as caught:
        write(tmp_path / name, thing)
    assert str(caught.value).endswith(f"is written as {says}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "thing", [{1, 2}, None, np.zeros((2, 2), int), np.zeros((2, 2, 4), np.uint8)]
)
def test_other_types_are_rejected(tmp_path, thing):
    with pytest.raises(TypeError):
        write(tmp_path / "a.png", thing)


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "exr"])
def test_full_disk_keeps_the_old_file(tmp_path, extension, capfd):
    noise = np.random.default_rng(0).random((120, 160, 3)).astype(np.float32)
    path = tmp_path / f"a.{extension}"
    write(path, LinearImage(noise[:8, :8]))
    before = path.read_bytes()
    with room_for(6000), pytest.raises(FileError) as caught:
        write(path, LinearImage(noise))
    message = str(caught.value)
    assert message.startswith(f"{path}: check the folder and the free disk space")
    assert "\n" not in message
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    assert capfd.readouterr() == ("", "")


def test_full_disk_is_noticed_for_json(tmp_path):
    path = tmp_path / "a.json"
    with room_for(20), pytest.raises(FileError):
        write(path, ColorModel.from_hex("#d8ff3c"))
    assert not list(tmp_path.iterdir())


def test_nan_is_rejected_in_integer_files(tmp_path, layer):
    path = tmp_path / "a.png"
    write(path, layer.alpha)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="NaN"):
        write(path, np.full((3, 3), np.nan))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_targets_raise_one_line_errors(tmp_path, layer):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.png").mkdir()
    for name, says in (
        ("folder.png", "is a folder"),
        ("nowhere/a.png", "No such file or directory"),
        ("file/a.png", "Not a directory"),
    ):
        with pytest.raises(FileError) as caught:
            write(tmp_path / name, layer)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert says in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder_raises_file_error(tmp_path, layer):
    (tmp_path / "closed").mkdir(mode=0o500)
    with pytest.raises(FileError, match="Permission denied"):
        write(tmp_path / "closed" / "a.png", layer)


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "exr"])
@pytest.mark.parametrize("stem", ["with space", "Übung 猫", "what? a=b&c", "#1 %04d (copy)"])
def test_unusual_file_names_are_supported(tmp_path, light, stem, extension):
    path = tmp_path / f"{stem}.{extension}"
    write(str(path), LinearImage(light))
    assert read(path).size == (32, 24)


def test_files_have_the_usual_permissions(tmp_path, layer):
    (tmp_path / "usual").touch()
    write(tmp_path / "a.png", layer)
    usual, ours = ((tmp_path / name).stat().st_mode for name in ("usual", "a.png"))
    assert stat.S_IMODE(ours) == stat.S_IMODE(usual)


def test_symbolic_link_is_kept(tmp_path, layer):
    (tmp_path / "real").mkdir()
    (tmp_path / "link.png").symlink_to(tmp_path / "real" / "a.png")
    write(tmp_path / "link.png", layer)
    assert (tmp_path / "link.png").is_symlink()
    assert read_layer(tmp_path / "real" / "a.png").size == layer.size


def test_color_model_round_trips(tmp_path):
    model = ColorModel.from_hex("#d8ff3c", "#3c10ff")
    write(tmp_path / "m.json", model)
    assert np.array_equal(read_color_model(tmp_path / "m.json").basis, model.basis)

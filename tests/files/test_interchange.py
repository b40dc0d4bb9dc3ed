"""Interchange: files of blurmatte, read by other libraries and composited by other programs. The
layers are those of every named scene, cropped to the object. The compositing code shares nothing
with `Layer.over`.
"""

import re
import subprocess
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.frames import read_layers, write_frames
from blurmatte.files.reading import read, read_layer
from blurmatte.files.solutions import read_solution
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import render
from blurmatte.scenes import read_shots, scene_names, scene_text

av = pytest.importorskip("av")

STEP = 1 / 1023  # how near other programs must come
SIZE = (192, 256)  # rows, columns
OIIOTOOL = Path(oiio.__file__).parent / "bin" / "oiiotool"
needs_oiiotool = pytest.mark.skipif(
    not OIIOTOOL.exists(), reason="this build of OpenImageIO comes without oiiotool"
)


def window(alpha):
    """The part of SIZE around the object."""
    corners = (np.flatnonzero(alpha.any(axis=axis))[[0, -1]] for axis in (1, 0))
    starts = (
        min(max(0, (first + last - side) // 2), whole - side)
        for (first, last), side, whole in zip(corners, SIZE, alpha.shape, strict=True)
    )
    return tuple(slice(start, start + side) for start, side in zip(starts, SIZE, strict=True))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Name → layer and plate of every scene, with eight time steps and photographs as plates to save
    time.
    """
    found, path = {}, tmp_path_factory.mktemp("scenes") / "scene.toml"
    for name in scene_names():
        photo = '[plate]\nkind = "photo"\nname = "coffee"\n\n'
        text = re.sub(r'\[plate\]\nkind = "colorful"[^\[]*', photo, scene_text(name))
        path.write_text(text, encoding="utf-8")
        rendering = render(read_shots(path)[0].scene, substeps=8)
        place = window(rendering.layer.alpha)
        alpha, light, plate = (
            np.ascontiguousarray(part[place], dtype=np.float32)
            for part in (rendering.layer.alpha, rendering.layer.premultiplied, rendering.plate.rgb)
        )
        found[name] = Layer(alpha, light), LinearImage(plate)
    assert len(found) > 20
    return found


@pytest.fixture(scope="module")
def layers(scenes):
    return [layer for layer, _ in scenes.values()]


def decode_srgb(v):
    """IEC 61966-2-1."""
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def encode_srgb(light):
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055
    )


def composite(red_green_blue, alpha, plate):
    """C = P + (1 − α) B, a pixel and a channel at a time in spirit."""
    seen = np.empty(plate.shape)
    for c in range(3):
        seen[..., c] = red_green_blue[..., c] + (1.0 - alpha) * plate[..., c].astype(float)
    return seen


def white(layer):
    """(H, W) where the layer's color is at most white, as integers require."""
    return (layer.premultiplied <= layer.alpha[..., None]).all(axis=-1)


def test_exr_layers_for_other_readers(tmp_path, scenes):
    # exact: another library finds premultiplied floats under the names that everybody looks for
    for name, (layer, plate) in scenes.items():
        write(tmp_path / "a.exr", layer)
        file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
        assert [part.name() for part in file.parts] == [""], "one part, without a name"
        channels = {channel: part.pixels for channel, part in file.channels().items()}
        assert sorted(channels) == list(channels) == ["A", "B", "G", "R"]
        assert {part.dtype for part in channels.values()} == {np.dtype(np.float32)}
        light = np.dstack([channels[c] for c in "RGB"])
        seen = composite(light, channels["A"], plate.rgb)
        assert_allclose(seen, layer.over(plate).rgb, atol=1e-6, err_msg=name)


def test_exr_headers(tmp_path, scenes):
    layer, _ = scenes["easy"]
    write(tmp_path / "a.exr", layer)
    header = OpenEXR.File(str(tmp_path / "a.exr")).header()
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION  # lossless
    assert header["type"] == OpenEXR.scanlineimage
    assert header["pixelAspectRatio"] == 1
    assert (header["screenWindowWidth"], *header["screenWindowCenter"]) == (1, 0, 0)
    for box in ("dataWindow", "displayWindow"):
        assert [list(corner) for corner in header[box]] == [[0, 0], [SIZE[1] - 1, SIZE[0] - 1]]
    # Without chromaticities an EXR has the primaries of Rec. 709 (OpenEXR, standard attributes).
    assert "chromaticities" not in header


@pytest.fixture
def solution(scenes):
    layer, _ = scenes["easy"]
    rng = np.random.default_rng(0)
    return Solution(
        alpha=layer.alpha - 0.01,
        alpha_std=rng.random(layer.alpha.shape, np.float32),
        premultiplied=layer.premultiplied - 0.01,
        premultiplied_std=rng.random(layer.premultiplied.shape, np.float32),
        quality=(16 * (layer.alpha == 0)).astype(np.uint8),
        model=ColorModel.from_hex("#d8ff3c"),
        solver="Pixelwise()",
    )


def test_exr_solutions_for_other_readers(tmp_path, solution):
    # exact: the picture without a name in front; the numbers as layers of their own
    write(tmp_path / "a.exr", solution)
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    channels = {name: part.pixels for name, part in file.channels().items()}
    assert len(file.parts) == 1
    assert sorted(channels) == list(channels)
    assert all(len(name) <= 31 for name in channels)  # more are no attribute of old readers
    named = [name.split(".") for name in channels if name not in "RGBA"]
    assert {len(parts) for parts in named} == {2}  # layer.channel
    assert {layer for layer, _ in named} == {
        *("alpha", "premultiplied", "premultiplied_std", "quality")
    }
    picture = solution.layer
    assert np.array_equal(np.dstack([channels[c] for c in "RGB"]), picture.premultiplied)
    assert np.array_equal(channels["A"], picture.alpha)
    assert np.array_equal(channels["alpha.raw"], solution.alpha)
    assert np.array_equal(channels["premultiplied_std.G"], solution.premultiplied_std[..., 1])
    layer = read_layer(tmp_path / "a.exr")
    assert np.array_equal(layer.alpha, picture.alpha)
    assert np.array_equal(read_solution(tmp_path / "a.exr").alpha, solution.alpha)


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_pictures_for_other_readers(tmp_path, scenes, extension):
    """Oracle: OpenCV reads 16 bits as they are, PNG straight and TIFF multiplied in code values."""
    worst = 0.0
    for name, (layer, plate) in scenes.items():
        write(tmp_path / f"a.{extension}", layer)
        codes = cv2.imread(str(tmp_path / f"a.{extension}"), cv2.IMREAD_UNCHANGED)
        assert codes.dtype == np.uint16
        blue, green, red, alpha = np.moveaxis(codes / 65535, -1, 0)
        colors = np.dstack([red, green, blue])
        if extension == "tif":
            colors = np.divide(colors, alpha[..., None], out=0 * colors, where=alpha[..., None] > 0)
        seen = composite(decode_srgb(colors) * alpha[..., None], alpha, plate.rgb)
        ours = layer.over(plate).rgb
        apart = np.abs(encode_srgb(seen) - encode_srgb(ours))[white(layer)]
        assert apart.max() <= STEP, name
        worst = max(worst, apart.max())
    print(f"OpenCV and Layer.over of {extension}: at most {worst * 1023:.4f}/1023 apart")


@needs_oiiotool
@pytest.mark.parametrize("extension", ["exr", "png"])
def test_oiiotool_puts_layers_over_plates(tmp_path, scenes, extension):
    """Oracle: the `over` of another program. A PNG must be made linear there before."""
    call = [str(OIIOTOOL)]
    linear = ("srgb_rec709_scene", "lin_rec709_scene")
    for name, (layer, plate) in scenes.items():
        files = [tmp_path / f"{name}.{extension}", tmp_path / f"{name}_plate.exr"]
        write(files[0], layer)
        write(files[1], plate)
        decoded = ["--colorconvert:unpremult=1", *linear] if extension == "png" else []
        call += [str(files[0]), *decoded, str(files[1]), "--ch", "R,G,B,A=1", "--over"]
        call += ["--ch", "R,G,B", "-o", str(tmp_path / f"{name}_seen.exr")]
    done = subprocess.run(call, capture_output=True, text=True)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    worst = 0.0
    for name, (layer, plate) in scenes.items():
        seen = read(tmp_path / f"{name}_seen.exr").rgb
        apart = np.abs(encode_srgb(seen) - encode_srgb(layer.over(plate).rgb))
        worst = max(worst, apart[white(layer)].max() if extension == "png" else apart.max())
    print(f"oiiotool and Layer.over of {extension}: at most {worst * 1023:.4f}/1023 apart")
    assert worst <= STEP


def test_the_library_of_oiiotool_agrees(scenes):
    # oracle
    for name, (layer, plate) in scenes.items():
        above = np.dstack([layer.premultiplied, layer.alpha])
        below = np.dstack([plate.rgb, np.ones_like(layer.alpha)])
        seen = oiio.ImageBufAlgo.over(oiio.ImageBuf(above), oiio.ImageBuf(below))
        rgb = seen.get_pixels(oiio.FLOAT)[..., :3]
        assert_allclose(rgb, layer.over(plate).rgb, atol=1e-6, err_msg=name)


@pytest.fixture(scope="module")
def prores(tmp_path_factory, layers):
    path = tmp_path_factory.mktemp("prores") / "row.mov"
    write_frames(path, iter(layers))
    return path


def rec709(light):
    """ITU-R BT.709-6 §1.2, with its rounded numbers."""
    return np.where(light < 0.018, 4.5 * light, 1.099 * np.maximum(light, 0) ** 0.45 - 0.099)


def planes(path):
    """Y', Cb, Cr and alpha of each frame by the formulas of BT.709 §3: R'G'B' and alpha, 0…1."""
    from_y_cb_cr = [[1, 0, 1.5748], [1, -0.1873, -0.4681], [1, 1.8556, 0]]
    with av.open(str(path)) as clip:
        for frame in clip.decode(video=0):
            bits = frame.format.components[0].bits
            y, cb, cr, alpha = (
                np.frombuffer(plane, np.uint16).reshape(plane.height, -1)[:, : plane.width]
                for plane in frame.planes
            )
            scale = 2 ** (bits - 8)
            luma, chroma = (y / scale - 16) / 219, [(c / scale - 128) / 224 for c in (cb, cr)]
            yield np.dstack([luma, *chroma]) @ np.transpose(from_y_cb_cr), alpha / (2**bits - 1)


def check_prores(layer, alpha, colors, name):
    assert_allclose(alpha, layer.alpha, atol=0.002, err_msg=name)
    there = layer.alpha > 0.02
    apart = np.abs(colors - rec709(np.minimum(layer.straight(), 1)))[there] * 1023
    assert np.sqrt(np.mean(apart**2)) < 1.3, name
    assert np.quantile(apart, 0.99) < 4, name
    assert apart.max() < 12, name  # at hard edges of paint; the codec's steps are that large
    return np.abs(alpha - layer.alpha).max(), np.sqrt(np.mean(apart**2)), apart.max()


def test_prores_agrees_with_the_formulas_of_rec_709(prores, scenes):
    """Oracle: the codes as FFmpeg decodes them, taken as straight Y'CbCr of Rec. 709."""
    worst = []
    for (name, (layer, _)), (colors, alpha) in zip(scenes.items(), planes(prores), strict=True):
        worst.append(check_prores(layer, alpha, colors, name))
    print("ProRes by hand: alpha, rms and largest of colors", np.max(worst, axis=0))


def test_prores_round_trips(prores, scenes):
    row = read_layers(prores)
    assert (len(row), row.size, row.rate) == (len(scenes), SIZE[::-1], 25)
    worst = []
    for (name, (layer, plate)), back in zip(scenes.items(), row, strict=True):
        worst.append(check_prores(layer, back.alpha, rec709(back.straight()), name))
        seen, ours = (encode_srgb(some.over(plate).rgb)[white(layer)] for some in (back, layer))
        assert np.abs(seen - ours).max() < 6 * STEP, name
    print("ProRes by read_layers: alpha, rms and largest of colors", np.max(worst, axis=0))
    assert np.array_equal(row[3].alpha, list(row[:5:3])[1].alpha)


def test_prores_declares_its_colors(prores):
    with av.open(str(prores)) as clip:
        stream = clip.streams.video[0]
        context = stream.codec_context
        assert (context.name, context.codec_tag, stream.profile) == ("prores", "ap4h", "4444")
        assert (stream.average_rate, context.pix_fmt[:8]) == (25, "yuva444p")
        tags = (context.color_primaries, context.color_trc, context.colorspace)
        assert tags == (1, 1, 1)
        assert context.color_range == 1
    content = prores.read_bytes()
    # Apple's programs look into the container (QuickTime, `colr`: nclc and three numbers of H.273) …
    assert b"colrnclc" + bytes([0, 1] * 3) in content
    # … and into each frame (SMPTE RDD 36: primaries, curve, matrix, and 2 for 16 bits of alpha).
    header = content[content.index(b"icpf") + 4 :]
    assert (list(header[14:17]), header[17] & 15) == ([1, 1, 1], 2)


def noisy(layer, plate, std, rng):
    """A layer of the closed form: alpha has noise, which adds light of the plate."""
    errs = std / 0.3 * rng.normal(size=layer.alpha.shape)
    light = layer.premultiplied + errs[..., None] * plate.rgb
    light += std * rng.normal(size=light.shape)
    alpha = np.where(layer.alpha > 0, np.clip(layer.alpha + errs, 0, 1), 0)
    light = np.where(alpha[..., None] > 0, np.maximum(light, 0), 0)
    return Layer(alpha.astype(np.float32), light.astype(np.float32))


@pytest.mark.parametrize("std", [0.003, 0.01, 0.03])
def test_noisy_layers_do_not_look_straight(tmp_path, scenes, std):
    # door: no false alarm
    rng = np.random.default_rng(0)
    for layer, plate in scenes.values():
        write(tmp_path / "a.exr", noisy(layer, plate, std, rng))
        assert read_layer(tmp_path / "a.exr").size == SIZE[::-1]


def save_exr(path, colors, alpha):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    rgba = np.dstack([colors, alpha]).astype(np.float32)
    OpenEXR.File(header, {"RGBA": np.ascontiguousarray(rgba)}).write(str(path))


def test_straight_exr_colors_are_rejected(tmp_path, scenes):
    """Door: the suggested remedy works."""
    path = tmp_path / "a.exr"
    for name, (layer, plate) in scenes.items():
        color = layer.straight()
        for colors in (color, np.where(layer.alpha[..., None] > 0, color, plate.rgb)):
            save_exr(path, colors, layer.alpha)
            with pytest.raises(
                FileError, match=r"a\.exr: multiply .* colors look straight"
            ) as caught:
                read_layer(path)
            assert "\n" not in str(caught.value), name
    if OIIOTOOL.exists():
        subprocess.run([str(OIIOTOOL), str(path), "--premult", "-o", str(path)], check=True)
        assert_allclose(read_layer(path).premultiplied, layer.premultiplied, atol=1e-6)


def test_light_without_alpha_is_accepted_in_layers(tmp_path):
    # door: light without alpha around something opaque; light brighter than white; a fog of it
    y, x = np.mgrid[-60:60, -60:60]
    far = np.hypot(x, y)
    alpha = np.clip(20.5 - far, 0, 1)
    glow = np.exp(-np.maximum(far - 20, 0) / 6)[..., None] * [0.9, 0.6, 0.2]
    soft = np.clip((50 - far) / 30, 0, 1)
    for colors, cover in ((glow, alpha), (glow, 0 * alpha), (soft[..., None] * [20, 15, 8], soft)):
        save_exr(tmp_path / "a.exr", colors, cover)
        assert read_layer(tmp_path / "a.exr").size == (120, 120)

"""Sequences and clips of layers and pictures; test_interchange.py reads them by other programs."""

import sys
import weakref

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from tests.disk import room_for

from blurmatte.errors import FileError
from blurmatte.files.frames import read_frames, read_layers, write_frames
from blurmatte.files.reading import read, read_layer
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.radiometry import REC709, SRGB, LinearImage

av = pytest.importorskip("av")

ENDINGS = ["mov", "mp4", "gif", "webp", "####.exr"]


def pictures(count=4, size=(48, 64)):
    """Smooth colors, darker from frame to frame."""
    y, x = np.mgrid[: size[0], : size[1]] / 64
    light = np.stack([0.1 + 0.5 * x, 0.7 - 0.4 * y, 0.1 + 0.3 * x * y], axis=-1)
    return [LinearImage((light * 0.9**i).astype(np.float32)) for i in range(count)]


def layers(count=4):
    """A soft ball that moves to the right."""
    y, x = np.mgrid[:48, :64]
    for i, picture in enumerate(pictures(count)):
        alpha = np.clip((14 - np.hypot(x - 20 - 5 * i, y - 24)) / 8, 0, 0.8).astype(np.float32)
        yield Layer(alpha, alpha[..., None] * picture.rgb)


@pytest.mark.parametrize("pattern", ["ball.####.exr", "ball.%04d.png", "ball.##.tif"])
def test_numbered_layers_round_trip(tmp_path, pattern):
    # exact, to 16 bits; in a folder that is not there yet
    target = tmp_path / "new" / pattern
    paths = write_frames(target, layers(), start=99)
    digits = 2 if "##." in pattern and "###" not in pattern else 4
    names = [f"ball.{n:0{digits}d}{target.suffix}" for n in range(99, 103)]
    assert [path.name for path in paths] == names
    assert sorted(path.name for path in target.parent.iterdir()) == sorted(names)
    row = read_layers(target)
    assert (len(row), row.size, row.rate) == (4, (64, 48), None)
    for layer, back, path in zip(layers(), row, paths, strict=True):
        assert_allclose(back.alpha, layer.alpha, atol=1e-5)
        assert_allclose(back.premultiplied, layer.premultiplied, atol=1e-4)
        assert np.array_equal(back.alpha, read_layer(path).alpha)
    assert [part.alpha[24, 20] for part in row[1::2]] == [part.alpha[24, 20] for part in row][1::2]
    for source in (target.parent, paths, str(target.parent / f"*{target.suffix}")):
        assert np.array_equal(read_layers(source)[2].premultiplied, row[2].premultiplied)


def test_numbers_begin_at_1(tmp_path):
    paths = write_frames(tmp_path / "a.#.jpg", pictures(2))
    assert [path.name for path in paths] == ["a.1.jpg", "a.2.jpg"]
    assert len(read_frames(tmp_path / "a.#.jpg", SRGB)) == 2


@pytest.mark.parametrize(("name", "pixels"), [("a.mov", "yuv444p"), ("a.mp4", "yuv420p")])
@pytest.mark.parametrize("coded", [False, True])
def test_clips_of_pictures_round_trip(tmp_path, name, pixels, coded):
    """Oracle: the light that went in, as near as the codec holds it."""
    there = pictures(6)
    codes = [np.rint(255 * SRGB.encode(p.rgb)).astype(np.uint8) for p in there]
    write_frames(tmp_path / name, codes if coded else there, rate=30000 / 1001)
    frames = read_frames(tmp_path / name)
    assert (len(frames), frames.size) == (6, (64, 48))
    assert frames.rate == pytest.approx(29.97, abs=1e-3)
    for picture, frame in zip(there, frames, strict=True):
        off = 255 * (REC709.encode(frame.rgb) - REC709.encode(picture.rgb))
        assert np.sqrt(np.mean(off**2)) < (0.5 if name == "a.mov" else 2.5)
        assert np.abs(off.mean(axis=(0, 1))).max() < (0.3 if name == "a.mov" else 2)
        assert frame.meta.transfer.name == "rec709"
    with av.open(str(tmp_path / name)) as clip:
        context = clip.streams.video[0].codec_context
        assert context.pix_fmt.startswith(pixels)
        tags = context.color_primaries, context.color_trc, context.colorspace, context.color_range
        assert tags == (1, 1, 1, 1)


@pytest.mark.parametrize("name", ["a.mov", "a.mp4"])
def test_chroma_is_not_shifted(tmp_path, name):
    """Honest: a green bump on gray; subsampled chroma must not shift by half a column."""
    x = np.arange(64)
    bump = np.exp(-((x - 31.3) ** 2) / 50)[:, None] * np.array([-0.1, 0.15, -0.05])
    picture = LinearImage(np.tile((0.2 + bump).astype(np.float32), (48, 1, 1)))
    write_frames(tmp_path / name, [picture] * 3)
    green = read_frames(tmp_path / name)[1].rgb @ [-0.5, 1, -0.5]
    green = green.mean(axis=0) - green[:, :6].mean()
    assert_allclose(green @ x / green.sum(), 31.3, atol=0.2)


@pytest.mark.parametrize("codec", ["png", "qtrle"])
def test_other_codecs_with_alpha(tmp_path, codec):
    # exact: 8 bits of straight colors, without loss
    codes = np.random.default_rng(0).integers(0, 256, (48, 64, 4), np.uint8)
    with av.open(str(tmp_path / "a.mov"), "w") as clip:
        stream = clip.add_stream(codec, rate=25)
        stream.height, stream.width, stream.pix_fmt = (
            48,
            64,
            {"png": "rgba", "qtrle": "argb"}[codec],
        )
        frame = av.VideoFrame.from_ndarray(codes, format="rgba").reformat(format=stream.pix_fmt)
        clip.mux(stream.encode(frame))
        clip.mux(stream.encode())
    layer = read_layers(tmp_path / "a.mov", SRGB)[0]
    assert_allclose(layer.alpha, codes[..., 3] / 255, rtol=1e-6)
    light = SRGB.decode(codes[..., :3] / 255) * layer.alpha[..., None]
    assert_allclose(layer.premultiplied, light, atol=1e-6)


def test_odd_sizes_of_h264_are_padded(tmp_path):
    odd = pictures(2, size=(47, 63))
    write_frames(tmp_path / "a.mp4", odd)
    frame = read_frames(tmp_path / "a.mp4")[0]
    assert frame.size == (64, 48)
    assert_allclose(frame.rgb[:47, :63], odd[0].rgb, atol=0.03)
    assert_allclose(frame.rgb[47, :63], odd[0].rgb[46], atol=0.03)
    write_frames(tmp_path / "a.mov", odd)
    assert read_frames(tmp_path / "a.mov").size == (63, 47)


@pytest.mark.parametrize("name", ["a.gif", "a.webp"])
def test_animations(tmp_path, name):
    """Oracle: Pillow's own reader."""
    there = pictures(3)
    write_frames(tmp_path / name, iter(there), rate=20)
    with Image.open(tmp_path / name) as file:
        assert (file.n_frames, file.size, file.info["loop"]) == (3, (64, 48), 0)
        file.seek(2)
        file.load()
        assert file.info["duration"] == 50
        seen = np.asarray(file.convert("RGB")).astype(float)
    off = seen - 255 * SRGB.encode(there[2].rgb)
    assert np.abs(off).mean() < 6


def test_gif_keeps_the_colors_of_a_small_object(tmp_path):
    """Also if 256 colors of a textured background are more frequent."""
    codes = np.random.default_rng(0).integers(40, 216, (256, 256, 3)).astype(np.uint8)
    codes[120:128, 120:128] = 250, 120, 10
    write_frames(tmp_path / "a.gif", 2 * [codes])
    with Image.open(tmp_path / "a.gif") as file:
        seen = np.asarray(file.convert("RGB"))[120:128, 120:128].astype(int)
    assert np.abs(seen.mean(axis=(0, 1)) - (250, 120, 10)).max() < 12  # code values


def test_colors_reach_beyond_the_object(tmp_path):
    """Scaled by a program that does not multiply first, the rim does not become dark."""
    alpha = np.zeros((48, 64), np.float32)
    alpha[16:32, 16:48] = 0.4
    light = alpha[..., None] * np.float32([0.8, 0.5, 0.2])
    write_frames(tmp_path / "a.mov", [Layer(alpha, light)])
    with av.open(str(tmp_path / "a.mov")) as clip:
        luma = next(clip.decode(video=0)).to_ndarray(format="gray16le") / 65535
    assert np.ptp(luma[6:42, 6:58]) < 0.01
    assert np.array_equal(read_layers(tmp_path / "a.mov")[0].premultiplied[:16], 0 * light[:16])


def test_one_frame_is_in_memory_at_a_time(tmp_path):
    for ending in ("mov", "####.exr"):
        alive, most = weakref.WeakSet(), 0

        def row(alive=alive):
            nonlocal most
            for layer in layers(8):
                alive.add(layer)
                yield layer
                del layer
                most = max(most, len(alive))

        write_frames(tmp_path / f"a.{ending}", row())
        assert most <= 2, ending


@pytest.mark.parametrize("ending", ENDINGS)
def test_same_input_same_bytes(tmp_path, ending):
    contents = []
    for folder in ("first", "second"):
        paths = (
            write_frames(tmp_path / folder / f"a.{ending}", pictures(3)) if "#" in ending else []
        )
        if not paths:
            (tmp_path / folder).mkdir()
            paths = write_frames(tmp_path / folder / f"a.{ending}", pictures(3))
        contents.append([path.read_bytes() for path in paths])
    assert contents[0] == contents[1]


@pytest.mark.parametrize("ending", ENDINGS)
def test_interrupted_write_leaves_no_files(tmp_path, ending):
    # door: the old file stays as it was, and no part of the new one
    def row():
        yield from pictures(3)
        raise RuntimeError("no more light")

    target = tmp_path / f"a.{ending}"
    with pytest.raises(RuntimeError, match="no more light"):
        write_frames(target, row())
    assert not list(tmp_path.iterdir())
    paths = write_frames(target, pictures(2))
    before = [path.read_bytes() for path in paths]
    with pytest.raises(RuntimeError):
        write_frames(target, row())
    assert sorted(tmp_path.iterdir()) == paths
    assert [path.read_bytes() for path in paths] == before


@pytest.mark.parametrize("ending", ENDINGS)
def test_full_disk_leaves_no_files(tmp_path, ending, capfd):
    # door
    noise = np.random.default_rng(0).random((3, 120, 160, 3)).astype(np.float32)
    with room_for(5000), pytest.raises(FileError, match="cannot be written") as caught:
        write_frames(tmp_path / f"a.{ending}", map(LinearImage, noise))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(
    ("name", "things", "complaint"),
    [
        ("a.mp4", layers, r"a\.mp4: write layers as \.mov .*; \.mp4 cannot hold alpha"),
        ("a.gif", layers, r"a\.gif: write layers as \.mov .*; \.gif cannot hold alpha"),
        (
            "a.exr",
            layers,
            r"a\.exr: name it like a\.####\.exr, .*; the name has no frame number",
        ),
        ("a.####.jpg", layers, r"a\.0001\.jpg: .* a Layer is written as \.png or \.tif or \.exr"),
        (
            "a.avi",
            layers,
            r"a\.avi: .* frames are written as \.mov, \.mp4, \.gif, \.webp, or as numbered",
        ),
        ("a", pictures, r"a: change the extension; frames are written as"),
        ("no/a.mov", pictures, r"a\.mov: check the folder .* cannot be written \(No such file"),
        ("folder.mov", pictures, r"folder\.mov: give the name of a file; this is a folder"),
        ("b.#.exr", pictures, r"b\.2\.exr: move or rename this folder"),
    ],
)
def test_invalid_names_raise_one_line_errors(tmp_path, name, things, complaint):
    # door
    for folder in ("folder.mov", "b.2.exr"):
        (tmp_path / folder).mkdir()
    with pytest.raises(FileError, match=complaint) as caught:
        write_frames(tmp_path / name, things())
    assert "\n" not in str(caught.value)
    assert "blurmatte-" not in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.2.exr", "folder.mov"]


@pytest.mark.parametrize(
    ("things", "error", "complaint"),
    [
        ([], ValueError, "got none"),
        ([*pictures(1), *layers(1)], TypeError, "0 is a LinearImage, 1 is a Layer"),
        ([*pictures(2), *pictures(1, (48, 66))], ValueError, "0 is 64x48, 2 is 66x48"),
        ([np.zeros((4, 4, 3))], TypeError, r"\(height, width, 3\) uint8, got \(4, 4, 3\) float64"),
        (["a.png"], TypeError, "got a str"),
        (
            [Layer(np.full((4, 4), np.nan), np.zeros((4, 4, 3)))],
            ValueError,
            "replace NaN; a clip cannot hold it",
        ),
    ],
)
def test_invalid_frames_are_rejected(tmp_path, things, error, complaint):
    # door
    with pytest.raises(error, match=complaint):
        write_frames(tmp_path / "a.mov", things)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("argument", "complaint"), [({"rate": 0}, "rate must be"), ({"start": -1}, "start must be")]
)
def test_invalid_rate_and_start_are_rejected(tmp_path, argument, complaint):
    # door
    with pytest.raises(ValueError, match=complaint):
        write_frames(tmp_path / "a.mov", pictures(1), **argument)


def test_clips_without_alpha_are_rejected_as_layers(tmp_path):
    # door
    for name in ("a.mov", "a.mp4"):
        write_frames(tmp_path / name, pictures(2))
        with pytest.raises(FileError, match=r"give a \.mov of .* has no alpha and holds no layers"):
            read_layers(tmp_path / name)
    write_frames(tmp_path / "a.##.png", pictures(2))
    with pytest.raises(FileError, match=r"a\.01\.png: .* has no alpha and is no layer"):
        read_layers(tmp_path / "a.##.png")


def test_layers_of_different_sizes_are_rejected(tmp_path):
    # door
    for name, width in (("a.1.exr", 5), ("a.2.exr", 6)):
        write(tmp_path / name, Layer(np.zeros((4, width)), np.zeros((4, width, 3))))
    with pytest.raises(FileError, match=r"a\.2\.exr: .* 6x4 pixels, but a\.1\.exr has 5x4"):
        list(read_layers(tmp_path / "a.#.exr"))


def test_existing_file_takes_precedence_over_a_pattern(tmp_path):
    write(tmp_path / "#1.exr", pictures(1)[0])
    assert len(read_frames(tmp_path / "#1.exr")) == 1
    assert read(tmp_path / "#1.exr").size == (64, 48)
    with pytest.raises(FileError, match="name a clip or pictures; no file matches"):
        read_frames(tmp_path / "b.####.exr")


def test_missing_extra_is_named(tmp_path, monkeypatch):
    # door
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(FileError, match=r'a\.mov: .*pip install "blurmatte\[video\]"'):
        write_frames(tmp_path / "a.mov", layers())
    assert not list(tmp_path.iterdir())

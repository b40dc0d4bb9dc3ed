import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.encoders import encoder

from blurmatte.errors import BlurmatteWarning, FileError, TransferWarning
from blurmatte.files.frames import read_frames, read_layers
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.radiometry import REC709, SRGB, LinearImage, gamma
from blurmatte.radiometry.transfer import HLG, PQ

av = pytest.importorskip("av")


def pictures(count=6, dtype=np.uint8):
    """(64, 96, 3) codes of smooth colors, another brightness for each frame; nothing clipped."""
    y, x = np.mgrid[0:64, 0:96]
    first = np.stack([40 + 2 * x, 230 - 3 * y, 60 + x + y], axis=-1)
    frames = [np.clip(first - 5 * i, 20, 235) for i in range(count)]
    return [(f * (257 if dtype == np.uint16 else 1)).astype(dtype) for f in frames]


def save_clip(
    path, codes, codec="ffv1", pixels="bgr0", curve=1, primaries=1, matrix=None, full=None, turn=0
):
    """A lossless clip of code values with these tags (numbers of H.273), 25 frames a second."""
    from av.video.reformatter import ColorRange, Interpolation

    options = {"qp": "0"} if codec == "libx264" else {}
    with encoder(path, codec, codes[0].shape[1::-1], pixels, options=options) as (stream, add):
        context = stream.codec_context
        context.color_trc, context.color_primaries = curve, primaries
        if matrix is not None:
            context.colorspace = matrix
            context.color_range = ColorRange.JPEG if full else ColorRange.MPEG
        if turn:
            stream.set_display_rotation(turn)
        for code in codes:
            form = "rgb24" if code.dtype == np.uint8 else "rgb48le"
            frame = av.VideoFrame.from_ndarray(code, format=form).reformat(
                format=pixels,
                dst_colorspace=matrix,
                dst_color_range=context.color_range if matrix is not None else None,
                interpolation=Interpolation.BICUBIC | Interpolation.ACCURATE_RND,
            )
            add(frame)
    return path


def test_lossless_clip_round_trips_exactly(tmp_path):
    # exact
    codes = pictures()
    frames = read_frames(save_clip(tmp_path / "a.mkv", codes))
    assert (len(frames), frames.size, frames.rate) == (6, (96, 64), 25)
    for _ in range(2):  # they can be run through again
        lights = [frame.rgb for frame in frames]
        assert len(lights) == 6
        for light, code in zip(lights, codes, strict=True):
            assert_allclose(light, REC709.decode(code / 255), rtol=1e-6)


def test_some_of_the_frames(tmp_path):
    # exact
    frames = read_frames(save_clip(tmp_path / "a.mkv", pictures(9)))
    every = [frame.rgb for frame in frames]
    some = frames[1:8:3]
    assert len(some) == 3
    assert all(np.array_equal(f.rgb, every[i]) for f, i in zip(some, (1, 4, 7), strict=True))
    assert np.array_equal(frames[5].rgb, every[5])
    assert np.array_equal(some[2].rgb, every[7])
    meta = frames[-1].meta
    assert (meta.source, meta.time) == ("a.mkv frame 8 (0.32 s)", pytest.approx(0.32))
    with pytest.raises(IndexError):
        frames[9]
    with pytest.raises(ValueError, match="steps must be 1 or more"):
        frames[::-1]


@pytest.mark.parametrize("matrix", [1, 5])
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("pixels", ["yuv444p", "yuv420p"])
def test_ranges_and_matrices_of_y_cb_cr(tmp_path, matrix, full, pixels):
    # oracle: the codes that went in, as near as 8 bits of Y'CbCr hold them
    codes = pictures(2)
    path = save_clip(tmp_path / "a.mkv", codes, "libx264", pixels, matrix=matrix, full=full)
    seen = 255 * REC709.encode(read_frames(path)[0].rgb)
    off = (seen - codes[0])[4:-4, 4:-4]
    assert np.abs(off).max() < 3.5
    assert np.abs(off.mean(axis=(0, 1))).max() < 1


@pytest.mark.parametrize(
    ("codec", "pixels", "at"),
    [
        ("libx264", "yuv420p", (0, 0.5)),
        ("libx264", "yuv422p", (0, 0)),
        ("prores_ks", "yuv422p10le", (0, 0)),
        ("ffv1", "yuv422p", (0, 0)),
        ("mjpeg", "yuv420p", (0.5, 0.5)),
        ("mjpeg", "yuv422p", (0.5, 0)),
    ],
)
def test_chroma_siting_follows_the_standards(tmp_path, codec, pixels, at):
    # oracle: how far right, and how far down, BT.601 and JFIF say, by a ramp of the red chroma
    for axis, (size, place) in enumerate(zip((96, 64), at, strict=True)):
        step = 1 if axis == 1 and "422" in pixels else 2
        ramp = np.linspace(60, 190, size // step)
        frame = red_ramp(pixels, ramp[:, None] if axis else ramp)
        path = tmp_path / f"{axis}.mkv"
        options = {"libx264": {"qp": "0"}, "mjpeg": {"qmin": "1", "qmax": "1"}}.get(codec)
        with encoder(path, codec, (96, 64), pixels, options=options) as (stream, add):
            context = stream.codec_context
            context.color_trc = context.color_primaries = 1
            context.color_range = 2 if codec == "mjpeg" else 1
            add(frame)
        light = read_frames(path, REC709)[0].rgb[..., 0]
        red = 255 * REC709.encode(light).mean(axis=axis)
        gray, gain = (128, 1.402) if codec == "mjpeg" else (112 * 255 / 219, 1.402 * 255 / 224)
        where = step * np.interp(128 + (red - gray) / gain, ramp, np.arange(len(ramp)))
        off = (np.arange(size) - where)[12:-12]
        assert_allclose(off.mean(), place, atol=0.1)


def red_ramp(pixels, codes):
    """A frame of 96 x 64 pixels, gray but for these codes of Cr, 8 bits."""
    frame = av.VideoFrame(96, 64, pixels)
    kind, top = (np.uint16, 4) if "10" in pixels else (np.uint8, 1)
    for plane, values in zip(frame.planes, (128, 128, codes), strict=True):
        row = np.frombuffer(plane, kind).reshape(plane.height, -1)
        row[:, : plane.width] = np.rint(np.multiply(values, top))
    return frame


@pytest.mark.parametrize("full", [False, True])
def test_ten_bits_stay_ten_bits(tmp_path, full):
    # oracle: code values of Y' by the formulas of BT.709 §3, gray; white is clipped light
    gray = np.linspace(0.1, 0.99, 96)[None].repeat(64, axis=0)
    gray[:8] = 1
    luma = np.rint(1023 * gray if full else 64 + 876 * gray).astype(np.uint16)
    frame = av.VideoFrame(96, 64, "yuv444p10le")
    for plane, codes in zip(frame.planes, (luma, *[np.full_like(luma, 512)] * 2), strict=True):
        np.frombuffer(plane, np.uint16).reshape(64, -1)[:, :96] = codes
    with encoder(tmp_path / "a.mkv", "ffv1", (96, 64), "yuv444p10le") as (stream, add):
        context = stream.codec_context
        context.color_trc = context.color_primaries = context.colorspace = 1
        context.color_range = 2 if full else 1
        add(frame)
    frame = read_frames(tmp_path / "a.mkv")[0]
    assert_allclose(REC709.encode(frame.rgb), gray[..., None].repeat(3, axis=2), atol=1 / 1023)
    assert len(np.unique(frame.rgb[8:, :, 1])) > 90  # of 96; 8 bits have fewer
    assert frame.meta.levels == 1024
    assert not frame.valid[:8].any()
    assert frame.valid[8:].all()


@pytest.mark.parametrize(
    ("number", "curve"), [(1, REC709), (4, gamma(2.2)), (13, SRGB), (14, REC709)]
)
def test_clip_tags_state_the_curve(tmp_path, number, curve):
    codes = pictures(1)
    frame = read_frames(save_clip(tmp_path / "a.mkv", codes, curve=number))[0]
    assert_allclose(frame.rgb, curve.decode(codes[0] / 255), rtol=1e-5)
    assert frame.meta.transfer.name == curve.name


def test_untagged_clip_is_rec_709_with_a_warning(tmp_path):
    codes = pictures(1)
    path = save_clip(tmp_path / "a.mkv", codes, curve=2)
    with pytest.warns(TransferWarning, match="transfer=REC709") as caught:
        frames = read_frames(path)
    assert caught[0].filename == __file__
    assert_allclose(frames[0].rgb, REC709.decode(codes[0] / 255), rtol=1e-5)
    assert_allclose(read_frames(path, SRGB)[0].rgb, SRGB.decode(codes[0] / 255), rtol=1e-5)


def test_primaries_become_those_of_srgb(tmp_path):
    # oracle: the matrix of ITU-R BT.2087, which maps BT.2020 to BT.709
    codes = pictures(1)
    light = REC709.decode(codes[0] / 255)
    path = save_clip(tmp_path / "a.mkv", codes, primaries=9)
    matrix = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
    assert_allclose(read_frames(path)[0].rgb, light @ np.transpose(matrix), atol=2e-4)


@pytest.mark.parametrize(("number", "curve"), [(16, PQ), (18, HLG)])
def test_hdr_clip_is_decoded_by_its_curve(tmp_path, number, curve):
    """exact: as if the curve were given."""
    path = save_clip(tmp_path / "a.mkv", pictures(1), curve=number)
    assert read_frames(path)[0].meta.transfer is curve
    assert_allclose(read_frames(path)[0].rgb, read_frames(path, curve)[0].rgb)


def test_clip_of_another_curve_is_refused_with_the_remedy(tmp_path):
    """door: 9 is logarithmic; the fact precedes the remedy."""
    path = save_clip(tmp_path / "a.mkv", pictures(1), curve=9)
    with pytest.raises(FileError, match=r"number 9 of H.273.*transfer= .* such as slog3"):
        read_frames(path)
    assert len(read_frames(path, REC709)) == 1


def test_pictures_are_sorted_in_natural_order(tmp_path):
    for number in (10, 9, 1):
        light = np.full((4, 5, 3), number / 20, np.float32)
        write(tmp_path / f"shot{number}.exr", LinearImage(light))
    (tmp_path / "notes.txt").write_text("not a picture")
    for source in (tmp_path, str(tmp_path / "*.exr")):
        frames = read_frames(source)
        assert [round(20 * float(f.rgb[0, 0, 0])) for f in frames] == [1, 9, 10]
    names = [tmp_path / "shot9.exr", tmp_path / "shot1.exr"]
    assert [round(20 * float(f.rgb[0, 0, 0])) for f in read_frames(names)] == [9, 1]
    assert frames.rate is None


def test_assumed_curve_is_warned_of_once(tmp_path, make_png):
    for name in "abc":
        (tmp_path / f"{name}.png").write_bytes(make_png(pictures(1)[0]))
    with pytest.warns(TransferWarning) as caught:
        list(read_frames(tmp_path))
    assert len(caught) == 1
    assert caught[0].filename == __file__


def test_assumed_curve_of_later_pictures_is_warned_of(tmp_path, make_png):
    """Exact: of the first untagged one behind an EXR, once, however often they are run through."""
    write(tmp_path / "a.exr", LinearImage(np.zeros((4, 5, 3), np.float32)))
    for name in "bc":
        (tmp_path / f"{name}.png").write_bytes(make_png(np.zeros((4, 5, 3), np.uint8)))
    frames = read_frames(tmp_path)
    with pytest.warns(
        TransferWarning, match=r"b\.png: the file has no color profile.*, pass transfer=SRGB"
    ) as caught:
        assert len([*frames, *frames, frames[2]]) == 7
    assert len(caught) == 1
    list(read_frames(tmp_path, SRGB))


def test_pictures_of_different_sizes_are_rejected(tmp_path):
    # door
    for name, width in (("a", 5), ("b", 6)):
        write(tmp_path / f"{name}.exr", LinearImage(np.zeros((4, width, 3), np.float32)))
    with pytest.raises(FileError, match=r"b\.exr: .* 6x4 pixels, but a\.exr has 5x4"):
        list(read_frames(tmp_path))


def save_sound(path):
    with av.open(str(path), "w") as clip:
        stream = clip.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        sound.sample_rate = 8000
        clip.mux(stream.encode(sound))


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("missing.mp4", None, "there is no such file"),
        ("empty.mp4", b"", "the file is empty"),
        ("text.mp4", b"no clip at all\n" * 50, "is no clip, or it is damaged"),
        ("cut.mp4", "cut", "is no clip, or it is damaged"),
        ("sound.wav", "sound", "holds no video"),
    ],
)
def test_invalid_clip_raises_a_one_line_error(tmp_path, name, content, complaint):
    # door
    path = tmp_path / name
    if content == "sound":
        save_sound(path)
    elif content == "cut":
        save_clip(path, pictures(), "libx264", "yuv420p", matrix=1, full=False)
        path.write_bytes(path.read_bytes()[:1500])
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(FileError, match=complaint) as caught:
        read_frames(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("codec", ["libx264", "libx265", "libsvtav1", "libvpx-vp9"])
def test_single_frames_are_those_of_the_whole_clip(tmp_path, codec):
    """Exact: also after frames that were left out, of codecs with references that are not shown."""
    if codec not in av.codecs_available:
        pytest.skip(f"FFmpeg has no {codec}")
    path = save_clip(tmp_path / "a.mp4", pictures(16), codec, "yuv420p", matrix=1, full=False)
    frames = read_frames(path)
    whole = [frame.rgb for frame in frames]
    for k in (0, 7, 15, 3, 4, 11, 9):
        assert np.array_equal(frames[k].rgb, whole[k])


def test_truncated_clip_is_warned_of(tmp_path):
    # door: an AVI says at its beginning how many frames there are
    path = save_clip(tmp_path / "cut.avi", 8 * pictures(), "ffv1", "bgr0")
    count = len(read_frames(path, REC709))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.warns(
        BlurmatteWarning, match=rf"cut\.avi: copy .* ends after about \d+ of {count} frames"
    ):
        frames = read_frames(path, REC709)
    assert 0 < len(list(frames)) <= len(frames) < count


def test_empty_source_is_rejected(tmp_path):
    # door
    for source in ([], tmp_path, str(tmp_path / "*.png")):
        with pytest.raises(FileError, match="name a clip or pictures"):
            read_frames(source)


@pytest.mark.parametrize("order", ["tff", "bff"])
def test_interlaced_clip_is_rejected(tmp_path, order):
    # door
    path = tmp_path / "a.mp4"
    options = {"x264-params": f"{order}=1"}
    with encoder(path, "libx264", (96, 64), "yuv444p", options=options) as (_, add):
        for code in pictures():
            add(av.VideoFrame.from_ndarray(code).reformat(format="yuv444p"))
    with pytest.raises(FileError, match=r"a\.mp4: deinterlace it .* two fields"):
        read_frames(path, REC709)


def test_clip_of_unknown_codec_and_size_is_rejected(tmp_path):
    # door: the name of the codec is damaged
    path = save_clip(tmp_path / "a.mp4", pictures(), "libx264", "yuv420p", matrix=1, full=False)
    path.write_bytes(path.read_bytes().replace(b"avc1", b"xxxx"))
    with pytest.raises(FileError, match=r"a\.mp4: .*no video, or none of known size"):
        read_frames(path, REC709)


@pytest.mark.parametrize("degrees", [90, 180, 270])
@pytest.mark.parametrize("mirrored", [False, True])
def test_frames_are_shown_upright(tmp_path, degrees, mirrored):
    # oracle: FFmpeg says counterclockwise, then mirrored
    codes, path = pictures(1), tmp_path / "a.mp4"
    with encoder(path, "libx264rgb", (96, 64), "rgb24", options={"qp": "0"}) as (stream, add):
        stream.set_display_rotation(degrees, mirrored, False)
        add(codes[0])
    shown = np.rot90(codes[0], degrees // 90)[:, :: -1 if mirrored else 1]
    frames = read_frames(path, REC709)
    assert frames.size == shown.shape[1::-1]
    assert_allclose(frames[0].rgb, REC709.decode(shown / 255), rtol=1e-5)


def test_missing_pictures_are_warned_of_before_measuring(tmp_path):
    # exact
    for number in (3, 4, 7, 9):
        write(tmp_path / f"f{number}.exr", LinearImage(np.zeros((4, 5, 3), np.float32)))
    frames = read_frames(tmp_path)
    assert frames[1:].frame_numbers == [4, 7, 9]
    with pytest.warns(BlurmatteWarning, match="have them: 5, 6, 8 of 3 to 9 are missing"):
        frames.for_plate(None)


def test_large_frames_are_rejected(tmp_path):
    # door
    path = save_clip(tmp_path / "a.mkv", pictures(1))
    with pytest.raises(FileError, match="96 x 64 pixels are more than the limit of 5000"):
        read_frames(path, max_pixels=5000)


def test_missing_extra_is_named(tmp_path, monkeypatch):
    # door
    path = save_clip(tmp_path / "a.mkv", pictures(1))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(FileError, match=r'pip install "blurmatte\[video\]"'):
        read_frames(path)


def test_transfer_does_not_apply_to_exr_frames(tmp_path, make_png):
    """Exact: EXRs of a sequence are read unchanged, PNGs are decoded by the curve; layers too."""
    light = np.full((4, 5, 3), 0.25, np.float32)
    write(tmp_path / "a0.exr", LinearImage(light))
    (tmp_path / "a1.png").write_bytes(make_png(np.full((4, 5, 3), 51, np.uint8)))
    first, second = read_frames(tmp_path, gamma(2.0))
    assert np.array_equal(first.rgb, light)
    assert_allclose(second.rgb, (51 / 255) ** 2, rtol=1e-6)
    (tmp_path / "layers").mkdir()
    write(tmp_path / "layers" / "b.exr", Layer(np.full((4, 5), 0.5), light))
    (layer,) = read_layers(tmp_path / "layers", gamma(2.0))
    assert np.array_equal(layer.premultiplied, light)

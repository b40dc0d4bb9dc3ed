"""Numbers of frames: each picture once, under one number, in any part of a clip."""

import warnings
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.files.frames import read_frames
from blurmatte.radiometry import REC709

av = pytest.importorskip("av")

SIZE = 32, 32
FORMATS = {"ts": "libx264", "mkv": "libx264", "mpg": "mpeg2video"}


def code_of(k):
    """Code value of the gray of a frame; of few frames neighbors differ by more than coding."""
    return 30 + 6 * k


def packets_of(codec, first, count, group=8, ticks=None, options=None):
    """Coded packets of gray frames, each brighter than the one before, with B-frames; their stream."""
    rate, unit = 25, Fraction(1, 25 if codec == "mpeg2video" else 1000)
    context = av.CodecContext.create(codec, "w")
    context.width, context.height, context.pix_fmt = *SIZE, "yuv420p"
    context.options = options or {}
    context.framerate, context.time_base = Fraction(rate), unit
    context.gop_size, context.bit_rate, context.max_b_frames = group, 2_000_000, 2
    packets = []
    for k in range(count):
        codes = np.full((*SIZE[::-1], 3), code_of(first + k), np.uint8)
        frame = av.VideoFrame.from_ndarray(codes, format="rgb24").reformat(format="yuv420p")
        tick = k if ticks is None else ticks[k]
        frame.pts, frame.time_base = round(tick / rate / unit), unit
        packets += context.encode(frame)
    return context, packets + context.encode()


def save(path, context, packets):
    """Write packets as they are into a file."""
    with av.open(str(path), "w") as clip:
        stream = clip.add_stream(context.codec.name, rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.codec_context.extradata = context.extradata
        stream.time_base = context.time_base
        stream.codec_context.max_b_frames = context.max_b_frames
        for packet in packets:
            packet.stream = stream
            packet.time_base = context.time_base
            clip.mux(packet)
    return path


def shown(frames):
    """Which of the brightnesses each frame has."""
    lights = [REC709.encode(float(np.median(frame.rgb))) for frame in frames]
    return [round((255 * float(light) - 30) / 6) for light in lights]


def check_numbers(path, expected):
    """All parts, single frames and frames in any order are those of the whole clip."""
    whole = read_frames(path, REC709)
    assert len(whole) == len(expected)
    assert shown(whole) == expected
    for start, stop in pairwise(range(0, len(whole), 5)):
        assert shown(whole[start:stop]) == expected[start:stop]
    for k in (len(whole) - 1, 3, 9, 10, 0):
        assert shown([whole[k]]) == [expected[k]]
        coded = next(whole.coded(slice(k, k + 1)))  # the clip stays open
        assert (coded.number, shown([coded.light()])) == (k, [expected[k]])
    return whole


@pytest.mark.filterwarnings("ignore::blurmatte.errors.TransferWarning")
@pytest.mark.parametrize("kind", ["ts", "mpg"])
def test_frames_of_joined_files_are_counted_and_their_times_go_on(tmp_path, kind):
    """Exact: time stamps go back at frame 16."""
    parts = [
        save(tmp_path / f"{first}.{kind}", *packets_of(FORMATS[kind], first, count)).read_bytes()
        for first, count in ((0, 16), (16, 14))
    ]
    path = tmp_path / f"joined.{kind}"
    path.write_bytes(b"".join(parts))
    with pytest.warns(
        bm.errors.BlurmatteWarning, match="time stamps go back at frame 16: each continues"
    ):
        frames = read_frames(path, REC709)
    assert np.allclose(np.diff(frames.times), 1 / 25)
    with pytest.warns(bm.errors.BlurmatteWarning):
        check_numbers(path, list(range(30)))


@pytest.mark.diagonal
@pytest.mark.parametrize("lost", [1, 5])
@pytest.mark.parametrize("kind", ["ts", "mkv", "mpg"])
def test_clip_that_begins_between_key_frames_begins_with_the_first_decoded_frame(
    tmp_path, kind, lost
):
    """Exact: each picture has one number in all parts, and its time of the file."""
    context, packets = packets_of(FORMATS[kind], 0, 30)
    path = save(tmp_path / f"cut.{kind}", context, packets[lost:])
    with pytest.warns(bm.errors.BlurmatteWarning, match=r"\d of \d\d frames .*cannot be decoded"):
        frames = read_frames(path, REC709)
    first = shown(frames[:1])[0]
    assert 0 < first < 11
    with pytest.warns(bm.errors.BlurmatteWarning):
        whole = check_numbers(path, list(range(first, 30)))
    assert np.allclose(np.diff(whole.times), 1 / 25)


def test_clip_without_any_key_frame_is_refused(tmp_path):
    """A decoder of MPEG-4 Part 2 invents what the first frames refer to."""
    one_key = {"sc_threshold": "1000000000"}
    context, packets = packets_of("mpeg4", 0, 12, group=100, options=one_key)
    path = save(tmp_path / "cut.mkv", context, packets[3:])
    with pytest.raises(bm.errors.FileError, match=r"cut it at a key frame.*it has no key frame"):
        read_frames(path, REC709)


@pytest.mark.filterwarnings("ignore:.*it ends after about:blurmatte.errors.BlurmatteWarning")
def test_frames_without_time_stamps_are_counted_from_the_first_decoded_one(tmp_path):
    """Exact: AVI states none for H.264."""
    context, packets = packets_of("libx264", 0, 30)
    for packet in packets:
        packet.pts, packet.dts = packet.pts // 40, packet.dts // 40
        packet.time_base = Fraction(1, 25)
    context.time_base = Fraction(1, 25)
    path = save(tmp_path / "cut.avi", context, packets[5:])
    with pytest.warns(bm.errors.BlurmatteWarning, match="cannot be decoded|ends after"):
        frames = read_frames(path, REC709)
    assert 15 < len(frames) < 25
    assert shown(frames) == list(range(30 - len(frames), 30))
    for k in (3, 12, 2):
        assert shown([frames[k]]) == [shown(frames)[k]]


def test_frames_of_one_time_stamp_lie_between_their_neighbors(tmp_path):
    """Exact: two frames have the stamp of the first of them."""
    context, packets = packets_of("libx264", 0, 12)
    stamps = [packet.pts for packet in packets]
    for packet in packets:
        packet.pts -= 40 if packet.pts == 240 else 0
    assert 240 in stamps
    path = tmp_path / "same.mkv"
    save(path, context, packets)
    with pytest.warns(
        bm.errors.BlurmatteWarning, match="time stamps repeat at frame 6: those frames"
    ):
        frames = check_numbers(path, list(range(12)))
    assert np.allclose(frames.times, np.arange(12) / 25, atol=1e-3)


@pytest.mark.parametrize("kind", ["mkv", "ts"])
def test_variable_rate_with_b_frames_keeps_numbers_and_times(tmp_path, kind):
    """Exact: nothing is warned of."""
    ticks = [0, 1, 2, 5, 6, 9, 10, 11, 12, 15, 16, 17, 21, 22, 23, 24]
    path = save(tmp_path / f"a.{kind}", *packets_of("libx264", 0, 16, ticks=ticks))
    frames = check_numbers(path, list(range(16)))
    assert np.allclose(np.diff(frames.times), np.diff(ticks) / 25)


def test_side_data_of_unknown_types_is_ignored(tmp_path):
    """Exact: Motion JPEG with EXIF, whose orientation is applied all the same."""
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned by 90°
    path = tmp_path / "exif.avi"
    with av.open(str(path), "w") as clip:
        stream = clip.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 48, 32, "yuvj420p"
        for k in range(3):
            picture = tmp_path / "picture.jpg"
            Image.fromarray(np.full((32, 48, 3), code_of(k), np.uint8)).save(picture, exif=exif)
            packet = av.Packet(picture.read_bytes())
            packet.stream, packet.pts, packet.dts = stream, k, k
            packet.time_base, packet.is_keyframe = Fraction(1, 25), True
            clip.mux(packet)
    frames = read_frames(path, REC709)
    assert frames.size == (32, 48)
    assert shown(frames) == [0, 1, 2]


@pytest.mark.parametrize("kind", ["mp4", "mov", "mkv"])
@pytest.mark.parametrize("marked", [True, False])
def test_cover_picture_before_the_video_is_not_the_clip(tmp_path, kind, marked):
    """Exact: a cover that is larger than the video; Matroska does not keep the mark."""
    from av.stream import Disposition

    path = tmp_path / f"a.{kind}"
    with av.open(str(path), "w") as clip:
        cover = clip.add_stream("mjpeg", rate=25)
        cover.width, cover.height, cover.pix_fmt = 64, 48, "yuvj444p"
        if marked:
            cover.disposition = Disposition.attached_pic
        film = clip.add_stream("libx264", rate=25)
        film.width, film.height, film.pix_fmt = *SIZE, "yuv420p"
        picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 200, np.uint8))
        clip.mux(cover.encode(picture.reformat(format="yuvj444p")))
        clip.mux(cover.encode())
        for k in range(8):
            codes = np.full((*SIZE[::-1], 3), code_of(k), np.uint8)
            clip.mux(film.encode(av.VideoFrame.from_ndarray(codes).reformat(format="yuv420p")))
        clip.mux(film.encode())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        frames = read_frames(path, REC709)
    assert (frames.size, shown(frames)) == (SIZE, list(range(8)))
    expected = [] if kind != "mkv" else ["it holds 2 videos, and number 2 is read"]
    assert [str(one.message).rpartition("; ")[2] for one in said] == expected


def test_attachment_of_matroska_is_not_the_clip(tmp_path):
    """Exact: a picture that is attached to the file, as players show it."""
    from PIL import Image

    picture, path = tmp_path / "cover.jpg", tmp_path / "a.mkv"
    Image.new("RGB", (64, 48)).save(picture)
    context, packets = packets_of("libx264", 0, 8)
    with av.open(str(path), "w") as clip:
        clip.add_attachment("cover.jpg", "image/jpeg", picture.read_bytes())
        film = clip.add_stream("libx264")
        film.width, film.height, film.pix_fmt = *SIZE, "yuv420p"
        film.codec_context.extradata = context.extradata
        for packet in packets:
            packet.stream, packet.time_base = film, context.time_base
            clip.mux(packet)
    frames = read_frames(path, REC709)
    assert (frames.size, shown(frames)) == (SIZE, list(range(8)))

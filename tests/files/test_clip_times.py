from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.encoders import encoder

from blurmatte.errors import BlurmatteWarning
from blurmatte.files.frames import read_frames, read_layers
from blurmatte.radiometry import REC709

av = pytest.importorskip("av")


def save_times(path, ticks, unit=Fraction(1, 15360), tags=(), codec="libx264", **options):
    """A clip with frames at these ticks, each brighter than the one before."""
    of_file = {"movflags": "use_metadata_tags"}
    with encoder(path, codec, (32, 32), "yuv444p", 30, options, of_file) as (stream, add):
        stream.container.metadata.update(dict(tags))
        stream.time_base = stream.codec_context.time_base = unit
        for k, tick in enumerate(ticks):
            code = np.full((32, 32, 3), 20 + 10 * k, np.uint8)
            frame = av.VideoFrame.from_ndarray(code).reformat(format="yuv444p")
            frame.pts, frame.time_base = tick, unit
            add(frame)
    return path


def test_times_of_a_variable_rate_are_those_of_the_file(tmp_path):
    # exact
    ticks = np.array([0, 512, 1100, 1536, 3600, 4100])
    frames = read_frames(save_times(tmp_path / "a.mp4", ticks), REC709)
    assert_allclose(frames.times, ticks / 15360)
    assert_allclose([frame.meta.time for frame in frames[2:5]], ticks[2:5] / 15360)
    assert frames.clip.timing.rate_varies
    assert frames.clip.timing.duration == pytest.approx((4100 + 512) / 15360)


def test_stamps_rounded_to_milliseconds_become_exact(tmp_path):
    # exact: Matroska rounds; a missing frame stays missing
    number = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9])
    path = save_times(tmp_path / "a.mkv", np.rint(number / 30 * 15360).astype(int))
    frames = read_frames(path, REC709)
    assert_allclose(frames.times, number / 30, atol=1e-9)
    assert_allclose([frame.meta.time for frame in frames], number / 30, atol=1e-9)


def test_first_frame_may_be_late(tmp_path):
    # exact
    path = save_times(tmp_path / "a.mkv", 15360 * 2 + 512 * np.arange(5))
    frames = read_frames(path, REC709)
    assert_allclose(frames.times, 2 + np.arange(5) / 30, atol=1e-9)
    assert not frames.clip.timing.rate_varies
    assert frames.clip.timing.duration == pytest.approx(5 / 30)


@pytest.mark.parametrize("name", ["com.android.capture.fps", "captureFps"])
def test_slow_motion_has_the_times_of_its_capture(tmp_path, name):
    # exact: layers are still played at the rate of the file
    path = save_times(tmp_path / "a.mp4", 512 * np.arange(6), tags={name: "240.0"})
    with pytest.warns(
        BlurmatteWarning,
        match=rf"taken at 240 .*{name}.*, played at 30: unless a rate is given, times",
    ):
        frames = read_frames(path, REC709)
    assert frames.rate == 240
    assert_allclose(frames.times, np.arange(6) / 240)
    assert frames[3].meta.time == pytest.approx(3 / 240)


def test_slow_motion_of_a_variable_rate_keeps_its_times(tmp_path):
    # exact
    ticks = np.array([0, 64, 128, 640, 1152, 1664, 2176])
    path = save_times(tmp_path / "a.mp4", ticks, tags={"com.android.capture.fps": "240"})
    with pytest.warns(BlurmatteWarning, match="times are as played, not at one rate"):
        frames = read_frames(path, REC709)
    assert_allclose(frames.times, ticks / 15360)


def test_tag_of_the_usual_rate_changes_nothing(tmp_path):
    # exact
    tags = {"com.android.capture.fps": "30.000"}
    frames = read_frames(save_times(tmp_path / "a.mp4", 512 * np.arange(4), tags=tags), REC709)
    assert_allclose(frames.times, np.arange(4) / 30)


@pytest.mark.parametrize("name", ["cut.mkv", "cut.mp4"])
def test_cut_file_is_warned_of(tmp_path, name):
    # door: these state how long they are, a .mp4 for streaming at its beginning
    path = tmp_path / name
    options = {"movflags": "faststart"} if name == "cut.mp4" else {}
    noise = np.random.default_rng(1).integers(0, 255, (20, 64, 64, 3), dtype=np.uint8)
    with encoder(path, "libx264", (64, 64), "yuv444p", 30, {"bf": "0"}, options) as (_, add):
        for code in noise:
            add(av.VideoFrame.from_ndarray(code).reformat(format="yuv444p"))
    assert len(read_frames(path, REC709)) == 20
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.warns(BlurmatteWarning, match=r"ends after about \d+ of 20 frames"):
        frames = read_frames(path, REC709)
    assert 5 < len(frames) < 15


def test_edit_list_is_no_damage(tmp_path):
    # exact: frames before the beginning are not shown
    path = save_times(tmp_path / "a.mp4", 512 * (np.arange(10) - 4), bf="0")
    frames = read_frames(path, REC709)
    assert len(frames) == len(list(frames))


def test_cover_picture_is_not_the_clip(tmp_path):
    # exact
    from av.stream import Disposition

    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as clip:
        cover = clip.add_stream("mjpeg", rate=1)
        cover.width, cover.height, cover.pix_fmt = 16, 16, "yuvj444p"
        cover.disposition = Disposition.attached_pic
        film = clip.add_stream("libx264", rate=25)
        film.width, film.height, film.pix_fmt = 32, 24, "yuv444p"
        picture = av.VideoFrame.from_ndarray(np.zeros((16, 16, 3), np.uint8))
        clip.mux(cover.encode(picture.reformat(format="yuvj444p")))
        clip.mux(cover.encode())
        for _ in range(4):
            frame = av.VideoFrame.from_ndarray(np.full((24, 32, 3), 90, np.uint8))
            clip.mux(film.encode(frame.reformat(format="yuv444p")))
        clip.mux(film.encode())
    frames = read_frames(path, REC709)
    assert (frames.size, len(list(frames))) == ((32, 24), 4)


def test_alpha_of_vp9_is_read(tmp_path):
    # oracle: the alpha that went in, through a lossy codec
    path = tmp_path / "a.webm"
    alpha = np.zeros((64, 64), np.uint8)
    alpha[16:48, 16:48] = 200
    code = np.dstack([np.full((64, 64, 3), 120, np.uint8), alpha])
    options = {"crf": "10", "auto-alt-ref": "0"}
    with encoder(path, "libvpx-vp9", (64, 64), "yuva420p", options=options) as (stream, add):
        stream.metadata["alpha_mode"] = "1"
        for _ in range(3):
            add(av.VideoFrame.from_ndarray(code, format="rgba").reformat(format="yuva420p"))
    layers = list(read_layers(path, REC709))
    assert len(layers) == 3
    assert_allclose(layers[1].alpha[20:44, 20:44], 200 / 255, atol=0.02)
    assert layers[1].alpha[:8].max() < 0.02

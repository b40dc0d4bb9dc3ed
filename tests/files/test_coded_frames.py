"""Frames as code values: the same light as decoded frames, from any frame on."""

import numpy as np
import pytest
from tests.encoders import encoder

import blurmatte as bm
from blurmatte.radiometry.coded import coded_frames, in_codes_of

COUNT, SIZE = 60, (64, 48)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """A clip of 60 frames in which a square moves to the right."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"

    def picture(k):
        light = np.full((48, 64, 3), (0.2, 0.3, 0.4), np.float32)
        light[20:30, k % 50 : k % 50 + 10] = (0.8, 0.3, 0.1)
        return bm.LinearImage(light)

    bm.write_frames(path, (picture(k) for k in range(COUNT)), rate=25)
    return bm.read_frames(path)


@pytest.mark.parametrize("which", [slice(0, 3), slice(40, 44), slice(30, 60, 10)])
def test_light_of_a_box_is_that_of_the_decoded_frame(frames, which):
    box = (10, 5, 40, 31)
    for frame, image in zip(frames.coded(which), frames[which], strict=True):
        part = frame.light(box)
        assert np.array_equal(part.rgb, image.crop(box).rgb)
        assert np.array_equal(part.valid, image.crop(box).valid)
        assert (part.meta.source, part.meta.time) == (image.meta.source, image.meta.time)
        assert np.array_equal(frame.light(every=5).rgb, image.rgb[::5, ::5])


def test_frames_in_any_order_are_those_in_order(frames):
    """Invariant: a clip that stays open gives the frames of one that is opened anew."""
    planes = [frame.planes[0].copy() for frame in frames.coded(slice(None))]
    for which in (*(slice(k, k + 1) for k in (3, 4, 50, 20, 20, 59, 0)), slice(5, None, 9)):
        read = list(frames.coded(which))
        assert [frame.number for frame in read] == list(range(COUNT)[which])
        for frame in read:
            assert np.array_equal(frame.planes[0], planes[frame.number])


def test_frames_far_apart_are_those_in_order_in_clips_of_many_keys(tmp_path):
    """Invariant: frames between them to which no other refers are not decoded."""
    frames = with_keys_every(tmp_path / "clip.mp4", 80, 30)
    planes = [frame.planes[0].copy() for frame in frames.coded(slice(None))]
    for frame in frames.coded(slice(3, None, 11)):
        assert np.array_equal(frame.planes[0], planes[frame.number])


def test_clip_that_was_written_again_is_read_again(tmp_path):
    for light in (0.2, 0.6):
        images = [bm.LinearImage(np.full((48, 64, 3), light, np.float32))] * 3
        bm.write_frames(tmp_path / "clip.mp4", images)
        frame = next(bm.read_frames(tmp_path / "clip.mp4").coded(slice(1, 2)))
        assert frame.light().rgb.mean() == pytest.approx(light, rel=0.02)


def with_keys_every(path, count, distance):
    """A clip whose key frames are so many frames apart."""
    options = {"g": str(distance), "sc_threshold": "0"}
    with encoder(path, "libx264", (64, 48), options=options) as (_, add):
        for k in range(count):
            add(np.full((48, 64, 3), 40 + 2 * k, np.uint8))
    return bm.read_frames(path, bm.radiometry.REC709)


@pytest.mark.parametrize(
    ("distance", "ends"), [(12, [24, 48, 72, 80]), (30, [30, 60, 80]), (70, [20, 40, 70, 80])]
)
def test_parts_begin_at_key_frames_that_are_near(tmp_path, distance, ends):
    """Exact: the first key frame from 20 frames on, if that is within 40."""
    frames = with_keys_every(tmp_path / "clip.mp4", 80, distance)
    parts = list(frames.parts(0, 20))
    assert [part.stop for part in parts] == ends
    assert [part.start for part in parts] == [0, *ends[:-1]]
    assert next(frames.parts(7, 20)).start == 7
    again = [frame.number for part in parts for frame in frames[part].coded(slice(None))]
    assert again == list(range(80))


def test_frames_before_a_key_frame_are_read_after_it(tmp_path):
    """Exact: a key frame to which the decoder jumped does not hide those before it."""
    frames = with_keys_every(tmp_path / "clip.mp4", 80, 12)
    for k in (0, 48, 3, 72, 60, 59):
        assert [frame.number for frame in frames[k : k + 1].coded(slice(None))] == [k]


def test_numbers_are_those_of_the_source(frames):
    assert [frame.number for frame in frames[30:50].coded(slice(3, 9, 2))] == [33, 35, 37]


def test_picture_in_codes_agrees_with_the_frame(frames):
    """Oracle: the decoded frame as a picture has the code values of the frame, but for rounding."""
    frame = next(frames.coded(slice(7, 8)))
    again = in_codes_of(frames, frames[7])
    for a, b in zip(frame.planes, again.planes, strict=True):
        assert a.shape == b.shape
        assert np.median(np.abs(a.astype(int) - b.astype(int))) <= 1
    assert again.zero == frame.zero == (16.0, 128.0, 128.0)


def test_pictures_of_a_sequence_are_coded_too(tmp_path):
    images = [bm.LinearImage(np.full((48, 64, 3), 0.1 * (k + 1))) for k in range(3)]
    bm.write_frames(tmp_path / "shot.####.exr", images)
    found = list(coded_frames(bm.read_frames(tmp_path / "shot.####.exr"), slice(1, None)))
    assert [frame.number for frame in found] == [1, 2]
    assert np.allclose(found[0].planes[0], 0.2, atol=1e-3)


def test_list_of_pictures_is_coded_too():
    images = [bm.LinearImage(np.full((48, 64, 3), 0.1 * (k + 1))) for k in range(3)]
    assert [f.planes[1][0, 0].round(2) for f in coded_frames(images, slice(None))] == [
        np.float32(0.1), np.float32(0.2), np.float32(0.3),
    ]  # fmt: skip

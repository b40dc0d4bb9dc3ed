import struct
from fractions import Fraction

import numpy as np
import pytest
from tests.encoders import encoder

from blurmatte.checks import DIRECTIONS
from blurmatte.errors import BlurmatteWarning, FileError
from blurmatte.files.clip_geometry import orientation_of, siting_of
from blurmatte.files.errors import check_square_pixels
from blurmatte.files.frames import read_frames
from blurmatte.radiometry import REC709, LinearImage
from blurmatte.radiometry.coded import filter_graph
from blurmatte.rendering.plates import textured_plate

NAMED = {
    "none": ((1, 0), (0, 1)),
    "zero": ((0, 0), (0, 0)),
    "mirrored": ((-1, 0), (0, 1)),
    "flipped": ((1, 0), (0, -1)),
    "half turn": ((-1, 0), (0, -1)),
    "clockwise": ((0, 1), (-1, 0)),
    "counterclockwise": ((0, -1), (1, 0)),
    "transposed": ((0, 1), (1, 0)),
    "transposed across": ((0, -1), (-1, 0)),
}
av = pytest.importorskip("av")

SCALE = "flags=bicubic+accurate_rnd:out_color_matrix=bt709:out_range=limited:out_chroma_loc="


class Frame:
    """The side data and size of a VideoFrame."""

    def __init__(self, linear, perspective=0, scale=65536):
        (a, b), (c, d) = np.rint(scale * np.array(linear)).astype(int).tolist()
        matrix = struct.pack("9i", a, b, perspective, c, d, 0, 0, 0, 1 << 30)
        self.side_data = {"DISPLAYMATRIX": matrix if any((a, b, c, d)) else bytes(36)}
        self.width, self.height = 4, 3


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("scale", [65536, 131072])
def test_pixels_are_shown_where_the_matrix_puts_them(name, scale):
    # oracle: every pixel (p, q) by (a p + c q, b p + d q), shifted into the picture
    linear = np.array(NAMED[name])
    frame = Frame(linear, scale=scale)
    stored = np.arange(12).reshape(3, 4)
    if not linear.any():
        linear = np.eye(2, dtype=int)
    q, p = np.indices(stored.shape)
    xy = np.stack([p.ravel(), q.ravel()], axis=1) @ linear
    xy -= xy.min(axis=0)
    right = np.zeros((xy[:, 1].max() + 1, xy[:, 0].max() + 1), int)
    right[xy[:, 1], xy[:, 0]] = stored.ravel()
    orientation = orientation_of("a.mp4", frame)
    assert np.array_equal(orientation.upright(stored), right)
    assert np.array_equal(orientation.stored(right), stored)
    assert orientation.size(frame.width, frame.height) == right.shape[::-1]
    (first_y,), (first_x,) = (at[right == stored[0, 0]] for at in np.indices(right.shape))
    (next_y,), (next_x,) = (at[right == stored[1, 0]] for at in np.indices(right.shape))
    assert DIRECTIONS[orientation.readout] == (next_x - first_x, next_y - first_y)


@pytest.mark.parametrize(
    "frame",
    [
        Frame(((0.866, 0.5), (-0.5, 0.866))),
        Frame(((1, 0), (0.3, 1))),
        Frame(((1, 0), (1, 0))),
        Frame(((1, 0), (0, 0))),
        Frame(((1, 0), (0, 1)), perspective=1 << 20),
    ],
)
def test_other_matrices_are_refused(frame):
    # door
    with pytest.raises(FileError, match=r"a\.mp4: export it upright; its display matrix turns by"):
        orientation_of("a.mp4", frame)


def test_pixels_that_are_not_square_are_refused():
    # door: but not the ratio of a size that is rounded to whole pixels
    with pytest.raises(FileError, match=r"scale=320:240,.* 4:3, 240x240 are shown as 320x240"):
        check_square_pixels("a.mp4", (240, 240), Fraction(4, 3), "scale={}:{},setsar=1")
    with pytest.raises(FileError, match="768x576"):
        check_square_pixels("a.mp4", (720, 576), Fraction(16, 15))
    for aspect in (None, Fraction(1), Fraction(1280, 1281)):
        check_square_pixels("a.mp4", (854, 480), aspect)


def edges(seed=4):
    """(192, 256, 3) codes of patches of many colors, slightly out of focus."""
    from scipy.ndimage import gaussian_filter

    random, codes = np.random.default_rng(seed), np.full((192, 256, 3), 128.0)
    for _ in range(300):
        x, y, w, h = random.integers(0, (250, 186, 60, 60))
        codes[y : y + h + 4, x : x + w + 4] = random.uniform(30, 225, 3)
    return np.rint(gaussian_filter(codes, (0.7, 0.7, 0))).astype(np.uint8)


def texture(seed=3):
    """(192, 256, 3) codes of soft spots, brightness and colors independent."""
    from scipy.ndimage import gaussian_filter

    random = np.random.default_rng(seed)
    noise = gaussian_filter(random.normal(size=(192, 256, 3)), (4, 4, 0))
    return np.clip(128 + 30 * noise / noise.std(), 20, 235).astype(np.uint8)


def sited(codes, siting, pixels="yuv420p"):
    """The frame of these codes, its chroma averaged there by FFmpeg, and not saying so."""
    frame = av.VideoFrame.from_ndarray(codes, format="rgb24")
    graph = filter_graph(frame, ("scale", SCALE + siting), ("format", pixels))
    graph.push(frame)
    return graph.pull()


def save(path, codes, siting):
    with encoder(path, "libx264", (256, 192), options={"qp": "4"}) as (stream, add):
        context = stream.codec_context
        context.color_trc = context.color_primaries = context.colorspace = context.color_range = 1
        for _ in range(3):
            add(sited(codes, siting))
    return path


@pytest.mark.parametrize("siting", ["left", "center", "topleft", "top"])
def test_edges_show_where_chroma_lies(siting):
    # oracle: FFmpeg put it there
    assert siting_of(sited(edges(), siting)) == siting


@pytest.mark.parametrize("siting", ["left", "center"])
def test_edges_show_it_in_ten_bits_and_4_2_2(siting):
    # oracle
    assert siting_of(sited(edges(), siting, "yuv420p10le")) == siting
    assert siting_of(sited(edges(), siting, "yuv422p")) == siting


@pytest.mark.parametrize("siting", ["left", "center"])
def test_textures_of_independent_colors_do_not_favor_one_position(siting):
    # oracle: windows whose chroma follows luma by chance must not be chosen by that at one position
    for seed in (1, 2):
        light = textured_plate((960, 540), seed)
        assert (
            siting_of(sited(np.rint(255 * REC709.encode(light)).astype(np.uint8), siting)) == siting
        )


def test_nothing_is_claimed_without_edges_or_sharing():
    # exact
    assert siting_of(sited(texture(), "center")) == ""
    assert siting_of(sited(np.full((192, 256, 3), 90, np.uint8), "left")) == ""
    assert siting_of(sited(edges(), "left", "yuv444p")) is None


def test_gray_clips_have_no_chroma_to_be_displaced(tmp_path):
    # exact, and without a warning
    codes = texture()[..., :1].repeat(3, axis=-1)
    frames = read_frames(save(tmp_path / "a.mp4", codes, "left"))
    assert frames.clip.siting == ""
    assert frames.for_plate(None).place_std == (0, 0)


@pytest.mark.parametrize("siting", ["left", "center", "topleft", "top"])
def test_a_plate_shows_where_chroma_lies(tmp_path, siting):
    # oracle: colors are then where the plate has them
    codes = texture()
    plate = LinearImage(REC709.decode(codes / 255).astype(np.float32))
    frames = read_frames(save(tmp_path / "a.mp4", codes, siting))
    with pytest.warns(BlurmatteWarning, match="up to 0.65 px off"):
        assert frames.for_plate(None).place_std == (pytest.approx(0.65 / 2**0.5), 0)
    matched = frames.for_plate(plate)
    assert (matched.clip.siting, matched.place_std) == (siting, (0, 0))
    off = 255 * (REC709.encode(matched[1].rgb) - codes / 255)[4:-4, 4:-4]
    assert np.sqrt(np.mean(off**2)) < 2.0

import struct
from fractions import Fraction

import numpy as np
import pytest

from blurmatte.checks import DIRECTIONS
from blurmatte.errors import FileError
from blurmatte.files.clip_geometry import orientation_of
from blurmatte.files.errors import check_square_pixels

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
    assert orientation.size(frame) == right.shape[::-1]
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

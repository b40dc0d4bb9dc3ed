"""Equal blocks of rows of an EXR, compressed once."""

import numpy as np
import OpenImageIO as oiio
import pytest

from blurmatte.files.raster import load
from blurmatte.files.raster_writing import distinct_blocks, save_pixels, written_rows

NAMES = ("R", "G", "B", "A", "quality.flags")
WIDTH = 37


def parts(height, where, seed=0):
    """Light, alpha and flags: noise in some rows, elsewhere 0, 0 and 16."""
    noise = np.random.default_rng(seed).normal(size=(height, WIDTH, 4)).astype(np.float32)
    noise[~np.isin(np.arange(height), where)] = 0
    flags = np.where(noise[..., 0] == 0, 16, 2).astype(np.uint8)
    return [noise[..., :3], noise[..., 3], flags]


def by_the_library(path, values):
    """The same file, written by OpenImageIO alone."""
    height = len(values[0])
    spec = oiio.ImageSpec(WIDTH, height, len(NAMES), "float")
    spec.channelnames, spec.alpha_channel = NAMES, 3
    spec["compression"], spec["DateTime"] = "zip", "1970:01:01 00:00:00"
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(np.dstack(values).astype(np.float32))
    target.close()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("height", "where", "written"),
    [
        (160, range(50, 70), 3),  # two blocks of the streak, one of the others
        (167, range(50, 70), 4),  # and the last, incomplete one
        (160, range(20), 3),
        (160, [], 1),
        (9, [], 1),
        (160, range(160), 10),
        (64, [0], 2),
    ],
)
def test_file_has_the_bytes_of_one_in_which_all_blocks_are_compressed(
    tmp_path, height, where, written
):
    values = parts(height, where)
    save_pixels(tmp_path / "a.exr", values, NAMES, {})
    assert (tmp_path / "a.exr").read_bytes() == by_the_library(tmp_path / "b.exr", values)
    pixels = load(tmp_path / "a.exr", names=NAMES).pixels
    np.testing.assert_array_equal(pixels, np.dstack(values))
    assert len(np.unique(distinct_blocks(values))) == written


def test_minus_zero_is_kept(tmp_path):
    values = parts(64, [])
    values[0][20, 3, 1] = -0.0
    save_pixels(tmp_path / "a.exr", values, NAMES, {})
    assert np.signbit(load(tmp_path / "a.exr", names=NAMES).pixels[20, 3, 1])


def test_rows_compressed_are_those_of_the_streak_whatever_the_height():
    """A solution's files cost what its streak does, not what the picture does."""
    for height in (480, 4800):
        rows = written_rows(distinct_blocks(parts(height, range(100, 140))), height)
        assert len(rows) == 16 * 4

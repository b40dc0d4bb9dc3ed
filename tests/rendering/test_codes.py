"""Pictures through H.264: what comes back, and from which files."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.errors import BlurmatteError
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Camera, colorful_plate, through_h264

pytest.importorskip("av")


@pytest.fixture(scope="module")
def pictures():
    """Four frames of odd sides with noise of their own."""
    plate = colorful_plate((61, 45), 1, tile=15)
    return [Camera(NoiseModel(read_std=0.003)).expose(plate, seed) for seed in range(4)]


def error(frames, pictures):
    return np.sqrt(np.mean((np.array(frames, float) - np.array(pictures, float)) ** 2))


def test_decoded_frames_have_order_and_size(pictures):
    marked = [codes.copy() for codes in pictures]
    for n, codes in enumerate(marked):
        codes[:20, :20] = 60 * n
    frames = through_h264(marked, 10)
    assert [f.shape for f in frames] == [(45, 61, 3)] * 4
    assert all(f.dtype == np.uint8 for f in frames)
    assert_allclose([f[5:15, 5:15].mean() for f in frames], [0, 60, 120, 180], atol=2)


def test_same_pictures_same_bytes(pictures):
    assert_array_equal(through_h264(pictures, 23), through_h264(pictures, 23))


def test_larger_crf_has_larger_error(pictures):
    errors = [error(through_h264(pictures, crf), pictures) for crf in (0, 17, 28, 40)]
    assert errors == sorted(errors)
    assert errors[3] > 1.5 * errors[1]


def test_gray_is_preserved_within_rounding():
    """A lossless clip differs only by rounding to the 219 luma steps of video range."""
    gray = np.random.default_rng(0).integers(0, 256, (32, 48, 1), np.uint8)
    codes = np.repeat(gray, 3, axis=2)
    (frame,) = through_h264([codes], 0)
    assert np.abs(frame.astype(int) - codes).max() <= 1


@pytest.mark.parametrize("color", [(200, 60, 30), (20, 90, 160), (255, 255, 255), (0, 0, 0)])
def test_constant_colors_are_preserved_within_rounding(color):
    codes = np.full((16, 16, 3), color, np.uint8)
    (frame,) = through_h264([codes], 0)
    assert np.abs(frame.astype(int) - codes).max() <= 2


def test_subsampled_pixels_share_chroma():
    """Luma of an edge between two colors stays sharp (Rec. 709), and its chroma does not."""
    codes = np.full((16, 32, 3), (200, 60, 60), np.uint8)
    codes[:, 15:] = (60, 60, 200)
    (frame,) = through_h264([codes], 0)
    luma = np.array([0.2126, 0.7152, 0.0722])
    assert_allclose(frame @ luma, codes @ luma, atol=3)
    assert np.abs(frame[8, 13:17].astype(int) - codes[8, 13:17]).max() > 20


def test_rejects_wrong_arguments(pictures):
    with pytest.raises(ValueError, match="pictures must be one or more, got none"):
        through_h264([], 23)
    with pytest.raises(TypeError, match=r"codes must be \(H, W, 3\) uint8"):
        through_h264([pictures[0].astype(np.uint16)], 23)
    with pytest.raises(ValueError, match="pictures must have one size"):
        through_h264([pictures[0], pictures[1][1:]], 23)
    with pytest.raises(ValueError, match="crf must lie between 0 and 51, got 52"):
        through_h264(pictures, 52)


def test_without_the_package_the_error_names_the_extra(pictures, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(BlurmatteError, match=r"pip install 'blurmatte\[video\]'"):
        through_h264(pictures, 23)

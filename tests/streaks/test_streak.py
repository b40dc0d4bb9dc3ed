"""Streak: a region of the image."""

import io

import numpy as np
import pytest
from benchmarks.rendered import add_noise
from numpy.testing import assert_array_equal
from PIL import Image
from scipy import ndimage

import blurmatte as bm
from blurmatte.rendering import colorful_plate
from blurmatte.streaks import Streak
from blurmatte.streaks.find import expected_false
from blurmatte.streaks.streak import dilated, opened

BOXES = (40, 60, 160, 78), (200, 220, 224, 232)  # x0, y0, x1, y1


def test_from_box_fills_the_box():
    streak = Streak.from_box((2, 1, 5, 4), (8, 6))
    assert streak.mask.shape == (6, 8)
    assert streak.box == (2, 1, 5, 4)
    assert_array_equal(np.argwhere(streak.mask)[[0, -1]], [[1, 2], [3, 4]])
    assert streak.mask[streak.rows_columns].all()
    assert repr(streak) == "Streak(3x3 at 2,1, 9 pixels)"


def test_box_bounds_the_mask():
    mask = np.zeros((6, 8), bool)
    mask[2, 3] = mask[4, 6] = True
    assert Streak(mask).box == (3, 2, 7, 5)


@pytest.mark.parametrize(
    "box", [(-1, 0, 4, 4), (0, 0, 9, 4), (0, 0, 4, 7), (4, 0, 4, 4), (4, 4, 2, 6)]
)
def test_rejects_box_outside_the_picture(box):
    with pytest.raises(ValueError, match="must lie in the picture of 8x6 pixels, with x0 < x1"):
        Streak.from_box(box, (8, 6))


def test_around_is_cut_at_the_border():
    streak = Streak.from_box((3, 5, 10, 12), (20, 30))
    assert streak.around(0) == streak.box
    assert streak.around(2) == (1, 3, 12, 14)
    assert streak.around(100) == (0, 0, 20, 30)


def test_rejects_empty_and_non_boolean_masks():
    with pytest.raises(ValueError, match="at least one pixel; its mask is empty"):
        Streak(np.zeros((4, 4), bool))
    with pytest.raises(TypeError, match="mask must hold booleans, as mask > 0, got"):
        Streak(np.ones((4, 4)))


@pytest.fixture(scope="module")
def light():
    """Plate, and the same with two things; a part is finely striped."""
    plate = 0.7 * colorful_plate((400, 300), rng=3, tile=20)
    y, x = np.mgrid[:300, :400]
    plate += (0.3 * (np.sin(1.3 * x + 0.7 * y) > 0) * (x > 260) * (y > 130))[..., None]
    image = plate.copy()
    for x0, y0, x1, y1 in BOXES:
        image[y0:y1, x0:x1] = 0.7 * image[y0:y1, x0:x1] + (0.02, 0.1, 0.2)
    return image, plate


def saved(light, quality, shift, rng):
    """A picture of noisy light as a JPEG whose blocks are shifted leaves it."""
    noisy = np.clip(add_noise(light, bm.NoiseModel(1e-4, 1e-3), rng), 0, 1)
    codes = np.roll((255 * bm.SRGB.encode(noisy)).round().astype(np.uint8), shift, (0, 1))
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "jpeg", quality=quality)
    return bm.decode(np.roll(np.array(Image.open(file)), (-shift[0], -shift[1]), (0, 1)), bm.SRGB)


@pytest.mark.parametrize(("quality", "shift"), [(95, (0, 0)), (80, (3, 2)), (60, (0, 0))])
def test_things_are_significant_and_compression_is_not(light, quality, shift):
    rng = np.random.default_rng(quality)
    image = saved(light[0], quality, (0, 0), rng)
    found = bm.find_streaks(image, saved(light[1], quality, shift, rng))
    height, width = image.valid.shape
    inside = [s for s in found if s.box[0] > 8 and 8 < s.box[1] < s.box[3] < height - 8]
    inside = [s for s in inside if s.box[2] < width - 8]  # the border is rolled
    significant = {s.box for s in inside if s.significant}
    assert len(significant) == 2
    for box in BOXES:
        (found_box,) = (b for b in significant if abs(b[0] - box[0]) < 10)
        assert np.abs(np.subtract(found_box, box)).max() < 12


def test_expected_number_of_noise_is_right():
    rng = np.random.default_rng(0)
    counts = []
    for _ in range(40):
        T = rng.exponential(1, (128, 128)) ** 2  # a heavy tail
        strongest, other = np.zeros((2, 128, 128), bool)
        strongest[60:64, 60:64] = True
        T[strongest] = 1e6
        y, x = np.unravel_index(np.argmax(np.where(strongest, 0, T)), T.shape)
        other[y, x] = True
        counts.append(expected_false(T, [strongest, other])[1])
    # The largest of noise has an expected number that is about exponential with mean 1.
    assert 0.2 < np.median(counts) < 3
    assert np.mean(np.array(counts) < 0.05) <= 0.15


def test_only_streak_is_significant(light):
    image = bm.LinearImage(light[0].astype(np.float32)[:150], bm.NoiseModel(1e-4, 1e-3))
    plate = bm.LinearImage(light[1].astype(np.float32)[:150], bm.NoiseModel(1e-4, 1e-3))
    (found,) = bm.find_streaks(image, plate)
    assert found.significant


def test_opened_equals_opening_of_scipy():
    """Oracle: SciPy's opening, to the border."""
    rng = np.random.default_rng(5)
    for side in (3, 4, 31):
        mask = ndimage.gaussian_filter(rng.normal(size=(side, 40)), 1.2) > 0
        assert_array_equal(opened(mask), ndimage.binary_opening(mask, np.ones((3, 3))))


@pytest.mark.parametrize("by", [0, 1, 3])
def test_dilated_equals_dilation_of_scipy(by):
    """Oracle: SciPy's dilation, to the border; the argument does not change."""
    mask = np.random.default_rng(6).random((9, 14)) > 0.95
    before = mask.copy()
    expected = ndimage.binary_dilation(mask, iterations=by) if by else before
    assert_array_equal(dilated(mask, by), expected)
    assert_array_equal(mask, before)

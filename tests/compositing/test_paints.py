"""split_exposure: the fraction of the exposure for which each of two paints was in a pixel."""

import numpy as np
import pytest
from benchmarks.rendered import add_noise
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.background import Matching
from blurmatte.color.model import ColorModel
from blurmatte.compositing import split_exposure
from blurmatte.matting import Pixelwise, solve
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import colorful_plate
from blurmatte.streaks import Streak

RED, BLUE = np.array([0.8, 0.15, 0.1]), np.array([0.1, 0.3, 0.7])
NOISE = NoiseModel(read_std=0.002)


def two_paints(size=(60, 40), seed=0):
    """Fractions of two paints under a shade that is the same for both, over a colorful plate."""
    rng = np.random.default_rng(seed)
    fraction = rng.uniform(0, 0.45, (*size[::-1], 2))
    fraction[: size[1] // 3, :, 0] = 0  # one paint alone
    shade = rng.uniform(0.5, 1, (*size[::-1], 1))
    light = shade * (fraction @ np.stack([RED, BLUE]))
    plate = colorful_plate(size, 5, tile=13)
    image = light + (1 - fraction.sum(axis=-1, keepdims=True)) * plate
    return fraction, image, plate


def solved(image, plate, noise):
    pictures = (LinearImage(light, noise) for light in (image, plate))
    model = ColorModel(np.linalg.svd(np.stack([RED, BLUE]).T, full_matrices=False)[0])
    everywhere = Streak(np.ones(image.shape[:2], bool))
    return solve(*pictures, model, Pixelwise(), streak=everywhere, matching=Matching.NONE)


@pytest.mark.filterwarnings("ignore")  # all of the picture moves; nothing is left to compare with
def test_split_of_exact_data_is_exact():
    fraction, image, plate = two_paints()
    exposures = split_exposure(solved(image, plate, NoiseModel(read_std=1e-9)), RED, BLUE)
    assert exposures.known.mean() > 0.95
    assert_allclose(exposures.fraction[exposures.known], fraction[exposures.known], atol=1e-5)


@pytest.mark.filterwarnings("ignore")
def test_split_does_not_depend_on_common_brightness():
    _, image, plate = two_paints()
    solution = solved(image, plate, NOISE)
    one, two = (split_exposure(solution, s * RED, s * BLUE) for s in (1.0, 0.25))
    assert_allclose(one.fraction, two.fraction, atol=1e-6)


@pytest.mark.filterwarnings("ignore")
def test_errors_are_no_larger_than_stated():
    """Honest: the stated error is an upper bound; at least 68 of 100 errors are within it."""
    fraction, image, plate = two_paints((90, 60))
    rng = np.random.default_rng(2)
    noisy = [add_noise(light, NOISE, rng) for light in (image, plate)]
    exposures = split_exposure(solved(*noisy, NOISE), RED, BLUE)
    sure = exposures.fraction_std.max(axis=-1) < 0.05  # where a first-order error is one
    assert sure.mean() > 0.4
    z = (exposures.fraction - fraction)[sure] / exposures.fraction_std[sure]
    assert np.mean(np.abs(z) < 1) >= 0.68
    assert 0.5 < z.std() < 0.8


def test_unknown_pixels_have_fraction_0_and_infinite_std():
    shape = (2, 2)
    light = np.full((*shape, 3), 0.1)
    quality = np.array([[0, 16], [2, 0]], np.uint8)
    solution = Solution(np.full(shape, 0.3), np.full(shape, 0.01), light, 0 * light + 0.01,
                        quality, ColorModel.from_hex("#ff0000", "#0000ff"), "test")  # fmt: skip
    exposures = split_exposure(solution, "#ff0000", "#0000ff")
    assert_array_equal(exposures.known, quality == 0)
    assert not exposures.fraction[quality != 0].any()


def test_rejects_wrong_arguments(paint):
    shape = (2, 2)
    solution = Solution(np.ones(shape), np.ones(shape), np.ones((*shape, 3)), np.ones((*shape, 3)),
                        np.zeros(shape, np.uint8), paint.model, "test")  # fmt: skip
    with pytest.raises(ValueError, match="give two or three"):
        split_exposure(solution, "#ff0000")
    with pytest.raises(ValueError, match="mixtures of one another"):
        split_exposure(solution, "#ff0000", "#800000")

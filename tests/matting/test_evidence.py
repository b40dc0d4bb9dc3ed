"""Evidence of single pixels, noise correlation, and growth of the mask."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.scenes import photographed, rendered

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel
from blurmatte.matting.case import grown_mask
from blurmatte.matting.evidence import (
    information_of,
    min_alpha,
    pixels_of,
    sum_inflation,
    without_fine_structure,
)
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import textured_plate
from blurmatte.statistics import variance_inflation
from blurmatte.streaks import Streak, find_streaks
from blurmatte.trajectory import Trajectory

SHAPE = (64, 80)
STD = 0.01
NOISE = NoiseModel(read_std=STD)
ORANGE = np.array([0.8, 0.4, 0.1])
PLANE = ColorModel(np.linalg.qr(np.stack([ORANGE, (0.1, 0.2, 0.7)], axis=1))[0])
MODEL = ColorModel((ORANGE / np.linalg.norm(ORANGE))[:, None])


def still(noise):
    """Image and plate where nothing moved, the image with this noise; and a region."""
    plate = textured_plate(SHAPE[::-1], 1)
    inside = np.zeros(SHAPE, bool)
    inside[20:40, 30:50] = True
    sure = np.full(plate.shape, 1e-12)
    return LinearImage(plate + noise, NOISE), LinearImage(plate, sure), inside


def test_clipped_and_outside_pixels_have_no_information():
    image, plate, inside = still(0)
    clipped = np.zeros(SHAPE, bool)
    clipped[25:28, 33:36] = True
    image = LinearImage(image.rgb, NOISE, ~clipped)
    for model in (MODEL, ColorModel.any()):
        information, pull = information_of(pixels_of(image, plate, model, inside), np.zeros(SHAPE))
        assert np.all(information[clipped | ~inside] == 0)
        assert np.all(pull[clipped | ~inside] == 0)
        assert np.all(information >= 0)
        assert np.median(information[inside & ~clipped]) > 0


@pytest.mark.parametrize("model", [MODEL, ColorModel.any()], ids=["line", "any"])
def test_error_of_many_pixels_is_their_scatter(model):
    """For alpha 0, pull over the root of the information has unit spread, also for correlated noise."""
    scores = []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(0, STD, (*SHAPE, 3))
        image, plate, inside = still(noise)
        information, pull = information_of(pixels_of(image, plate, model, inside), np.zeros(SHAPE))
        scores.append(pull.sum() / np.sqrt(information.sum()))
    assert abs(np.mean(scores)) < 0.4
    assert 0.8 < np.std(scores) < 1.25


def test_missing_fine_structure_does_not_bias_alpha():
    """Exact if alpha is known; honest where the file has no fine structure over the object."""
    plate, noise = textured_plate(SHAPE[::-1], 1), NoiseModel(read_std=STD)
    inside = np.ones(SHAPE, bool)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    alpha = 0.4 + 0.2 * np.sin(x / 20) * np.cos(y / 20)
    fine = plate - gaussian_filter(plate, (2, 2, 0))

    def pixels(left_out):
        light = alpha[..., None] * ORANGE + (1 - alpha)[..., None] * (plate - left_out * fine)
        sure = LinearImage(plate, NoiseModel(read_std=1e-6))
        return pixels_of(LinearImage(light, noise), sure, PLANE, inside)

    information, pull = information_of(without_fine_structure(pixels(0)), alpha)
    assert_allclose(pull, information * alpha, rtol=1e-6, atol=1e-6 * information.max())

    def bias(given):
        information, pull = information_of(given, np.full(SHAPE, 0.4))
        return abs(pull.sum() / (information * alpha).sum() - 1)

    assert bias(without_fine_structure(pixels(0.5))) < bias(pixels(0.5)) / 2


def test_nonnegative_light_bounds_alpha_of_dark_pixels():
    """Honest: alpha is known where the object is dark; elsewhere the bound has no information."""
    plate = textured_plate(SHAPE[::-1], 1)
    x = np.arange(SHAPE[1])
    alpha = np.broadcast_to(0.6 * np.exp(-0.5 * ((x - 40) / 8) ** 2), SHAPE)
    light = alpha[..., None] * (0.3 * ORANGE)  # hardly any blue
    noise = np.random.default_rng(3).normal(0, STD, plate.shape)
    image = LinearImage(light + (1 - alpha[..., None]) * plate + noise, NOISE)
    sure = LinearImage(plate, np.full(plate.shape, 1e-12))
    least = min_alpha(pixels_of(image, sure, PLANE, np.ones(SHAPE, bool)), 1.0)
    assert np.mean(least > alpha + 0.02) < 0.002
    core = alpha > 0.4
    assert np.median((alpha - least)[core]) < 0.15
    assert np.mean(np.isfinite(least)[alpha < 0.001]) < 0.02


def patch(seed, where=None):
    """Image, plate, a region of them, and noise that is correlated inside a mask."""
    shape = (128, 160)
    rng = np.random.default_rng(seed)
    white, smooth = rng.normal(0, STD, (2, *shape, 3))
    smooth = gaussian_filter(smooth, (1.2, 1.2, 0))
    noise = smooth / smooth.std() * STD
    inside = np.zeros(shape, bool)
    inside[32:104, 32:128] = True
    if where == "within":
        noise = np.where(inside[..., None], noise, white)
    elif where == "nowhere":
        noise = white
    plate = colorful_plate(shape[::-1], 1, tile=30)
    sure = np.full(plate.shape, 1e-12)
    return LinearImage(plate + noise, NOISE), LinearImage(plate, sure), inside, noise


@pytest.mark.parametrize("where", ["everywhere", "within"])
def test_correlated_noise_reduces_information(where):
    """Honest: the error of the sum of a region is its scatter."""
    scores, factors = [], []
    for seed in range(16):
        image, plate, inside, noise = patch(seed, where)
        nothing = np.zeros(inside.shape)
        pixels = pixels_of(image, plate, MODEL, inside)
        information, pull = information_of(pixels, nothing)
        factors.append(sum_inflation(pixels, nothing))
        scores.append(pull.sum() / np.sqrt(information.sum() * factors[-1]))
    blocks = variance_inflation(noise / STD, inside)[:, 2].mean()
    assert_allclose(np.mean(factors), blocks, rtol=0.25)
    assert 0.8 < np.std(scores) < 1.25


def test_independent_noise_keeps_information():
    for seed in range(8):
        image, plate, inside, _ = patch(seed, "nowhere")
        assert sum_inflation(pixels_of(image, plate, MODEL, inside), np.zeros(inside.shape)) == 1


def test_noise_of_rank_2_does_not_depend_on_the_crop():
    """Honest: noise that is stronger within the streak; invariant: shifted by some pixels."""
    factors, blocks = [], []
    for seed in range(4):
        _, plate, inside, noise = patch(seed, "everywhere")
        stronger = np.where(inside[..., None], 1.5 * noise, noise)
        cut = []
        for x, y in ((0, 0), (1, 0), (0, 1), (3, 2)):
            given = LinearImage((plate.rgb + stronger)[y:, x:], NOISE)
            place = x, y, *plate.size
            pixels = pixels_of(given, plate.crop(place), PLANE, inside[y:, x:])
            cut.append(sum_inflation(pixels, np.zeros(pixels.inside.shape)))
        assert_allclose(cut, cut[0], rtol=0.03)
        factors.append(cut[0])
        blocks.append(1.5**2 * variance_inflation(noise / STD, ~inside)[:, 2].mean())
    assert_allclose(np.mean(factors), np.mean(blocks), rtol=0.25)


def test_smooth_alpha_of_rank_2_does_not_inflate_noise():
    """Nor does its fine structure, where noise around the streak is independent."""
    y, x = np.mgrid[:128, :160]
    smooth = 0.5 + 0.4 * np.sin(x / 9) * np.cos(y / 11)
    fine = 0.5 + 0.4 * np.sin(2 * x)
    for where, alpha, most in (("nowhere", fine, 1.0), ("everywhere", smooth, 1.2)):
        image, plate, inside, noise = patch(0, where)
        light = np.where(inside, alpha, 0)[..., None]
        given = LinearImage(light * ORANGE + (1 - light) * plate.rgb + noise, NOISE)
        pair = [pixels_of(picture, plate, PLANE, inside) for picture in (given, image)]
        with_it, without = (
            sum_inflation(pixels, a)
            for pixels, a in zip(pair, (light[..., 0], 0 * alpha), strict=True)
        )
        assert with_it <= most * without


def test_slightly_wrong_color_hardly_inflates_noise():
    """Its residual is everywhere, and equal in neighbors."""
    turned = ORANGE + np.array([0, 0.02, 0])
    for color, most in ((ORANGE, 1.0), (turned, 4.0)):
        image, plate, inside, _ = patch(0, "nowhere")
        alpha = 0.5 * inside
        light = alpha[..., None] * color + (1 - alpha[..., None]) * image.rgb
        given = LinearImage(light, NOISE)
        assert sum_inflation(pixels_of(given, plate, MODEL, inside), alpha) <= most


def test_mask_grows_to_parts_fainter_than_noise():
    size = (192, 144)
    scene = Scene(
        colorful_plate(size, 4, tile=36), Trajectory.line((60, 60), (130, 84)), Ball(20, ORANGE)
    )
    truth = rendered(scene, 160)
    image, plate = with_noise(*photographed(scene, Camera(code_std=3 / 255), 1, substeps=160))
    found = find_streaks(image, plate)[0]
    rows = np.arange(size[1])[:, None] < 78
    part = Streak(found.mask & rows, evidence=found.evidence)  # as if the rest had not been seen
    whole = grown_mask(part, image, plate, truth.model)
    alpha = truth.layer.alpha
    assert alpha[whole.mask].sum() > alpha[part.mask].sum()
    assert alpha[whole.mask].sum() > 0.97 * alpha.sum()
    assert np.all(whole.mask[part.mask])
    assert np.mean(alpha[whole.mask] > 0) > 0.5

"""Observation: the crop, coarse pixels, noise, and color axes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2

from blurmatte.radiometry import LinearImage, NoiseModel, counted_once
from blurmatte.streaks import Streak
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import Observation, observation_around

NOISE = NoiseModel(gain=1e-4, read_std=1e-3)
NOISE_OF_0_01 = NoiseModel(read_std=0.01)
SIZE = (60, 44)
NEUTRAL = ColorPrior(np.eye(3))


def pictures(seed=0):
    rng = np.random.default_rng(seed)
    image, plate = rng.uniform(0, 1, (2, *SIZE[::-1], 3))
    return LinearImage(image, NOISE), LinearImage(plate, NOISE)


def streak():
    """A slanted region of 18x12 pixels, from (20, 15)."""
    mask = np.zeros(SIZE[::-1], bool)
    for i in range(12):
        mask[15 + i, 20 + i : 27 + i] = True
    return Streak(mask)


def random_observation(width=13, height=11, seed=0):
    rng = np.random.default_rng(seed)
    light = rng.uniform(0, 1, (4, height, width, 3))
    valid, moved, near = rng.uniform(0, 1, (3, height, width)) > [[[0.1]], [[0.8]], [[0.5]]]
    weight = np.where(valid, rng.uniform(0.1, 1, valid.shape), 0)
    return Observation(
        *light, valid, (7.0, 3.0), 1.0, weight=weight, streak=moved, near=near, size=SIZE
    )


def blocks(values, by):
    """Each block of an array, and its place."""
    for j in range(values.shape[0] // by):
        for i in range(values.shape[1] // by):
            yield j, i, values[by * j : by * (j + 1), by * i : by * (i + 1)]


def test_coarser_by_one_is_the_same():
    observation = random_observation()
    assert observation.coarser(1) is observation


@pytest.mark.parametrize("by", [2, 3, 5])
def test_coarser_light_is_the_mean_of_blocks(by):
    observation = random_observation()
    coarse = observation.coarser(by)
    assert coarse.weight.shape == (11 // by, 13 // by)
    for j, i, block in blocks(observation.C, by):
        assert_allclose(coarse.C[j, i], block.mean(axis=(0, 1)))
    for j, i, block in blocks(observation.B, by):
        assert_allclose(coarse.B[j, i], block.mean(axis=(0, 1)))


@pytest.mark.parametrize("by", [2, 3, 5])
def test_coarser_variance_is_that_of_a_mean(by):
    observation = random_observation()
    coarse = observation.coarser(by)
    for j, i, block in blocks(observation.C_variance, by):
        assert_allclose(coarse.C_variance[j, i], block.sum(axis=(0, 1)) / by**4)
    for j, i, block in blocks(observation.B_variance, by):
        assert_allclose(coarse.B_variance[j, i], block.sum(axis=(0, 1)) / by**4)


@pytest.mark.parametrize("channels", [1, 3])
def test_correlated_noise_is_the_trimmed_variance_of_block_sums(channels):
    """oracle: noise common to n by n pixels has n² times the mean of the lower 70 % of χ²/channels."""
    rng, std = np.random.default_rng(4), 0.01
    mask = np.zeros((240, 320), bool)
    mask[112:132, 140:180] = True  # the box around it begins with a whole cell

    def measured(by):
        cells = rng.normal(0, std, (2, 240 // by, 320 // by, channels)) * np.ones(3)
        pictures = [
            LinearImage(0.4 + np.kron(x, np.ones((by, by, 1))), NOISE_OF_0_01) for x in cells
        ]
        if channels == 1:
            pictures = [counted_once(picture) for picture in pictures]
        return observation_around(Streak(mask), 100, *pictures, NEUTRAL).correlated_noise()

    quantile = chi2.ppf(0.7, channels)
    trimmed = chi2.cdf(quantile, channels + 2) / 0.7  # the partial mean of χ² is another CDF
    assert measured(1) == 1
    for by in (2, 4):
        assert_allclose(measured(by), by**2 * trimmed, rtol=0.1)


def test_raised_noise_multiplies_the_variance():
    observation = random_observation().raised(2.0).raised(1.5)
    assert_allclose(observation.C_variance, 3 * random_observation().C_variance)
    assert_allclose(observation.B_variance, 3 * random_observation().B_variance)
    assert observation.noise_inflation == 3


def test_light_along_rotated_axes_has_the_same_length():
    """invariant: and the same total variance."""
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    plain = random_observation()
    turned = replace(plain, color=ColorPrior(axes))
    for one, other in zip(plain.light[:2], turned.light[:2], strict=True):
        assert_allclose((one**2).sum(axis=-1), (other**2).sum(axis=-1))
    for one, other in zip(plain.light[2:], turned.light[2:], strict=True):
        assert_allclose(one.sum(axis=-1), other.sum(axis=-1))


def test_axes_are_along_the_mean_color_and_the_largest_spread():
    """exact: colors along a line in color space, without noise."""
    rng = np.random.default_rng(2)
    mean, spread = np.array([0.5, 0.3, 0.2]), np.array([0.1, -0.2, 0.05])
    observation = random_observation()
    alpha = np.full(observation.weight.shape, 0.5)
    k = mean + rng.normal(0, 0.2, (*alpha.shape, 1)) * spread
    observation = observation.with_light(0.5 * observation.B + 0.5 * k)
    color = observation.along_colors(alpha).color
    weight = observation.weight
    measured = np.einsum("yx,yxc->c", weight, k) / weight.sum()
    assert_allclose(color.axes[:, 0], measured / np.linalg.norm(measured), atol=1e-9)
    assert_allclose(color.axes.T @ color.axes, np.eye(3), atol=1e-6)
    assert abs(color.axes[:, 2] @ spread) < 1e-5


def test_axes_of_a_known_color_stay():
    observation = replace(random_observation(), color=ColorPrior(np.eye(3), 1, 1, 0.01))
    assert observation.along_colors(np.full(observation.weight.shape, 0.5)) is observation


@pytest.mark.parametrize("by", [2, 3, 5])
def test_a_coarse_pixel_is_valid_if_all_of_it_is(by):
    observation = random_observation()
    coarse = observation.coarser(by)
    assert 0 < coarse.valid.sum() < coarse.valid.size or by == 5
    for j, i, block in blocks(observation.valid, by):
        assert coarse.valid[j, i] == block.all()
    for j, i, block in blocks(observation.weight, by):
        assert_allclose(coarse.weight[j, i], block.mean() if coarse.valid[j, i] else 0)


def test_a_coarse_pixel_has_moved_if_any_of_it_has():
    observation = random_observation()
    coarse = observation.coarser(3)
    for fine, rough in ((observation.streak, coarse.streak), (observation.near, coarse.near)):
        for j, i, block in blocks(fine, 3):
            assert rough[j, i] == block.any()


def test_coarse_pixels_are_centered_on_their_blocks():
    """The first is centered on the middle of its block."""
    coarse = random_observation().coarser(3)
    assert coarse.origin == (8.0, 4.0)
    assert coarse.scale == 3
    assert random_observation().coarser(2).origin == (7.5, 3.5)
    assert coarse.size == SIZE


def test_twice_coarser_is_once_coarser_by_the_product():
    observation = random_observation(24, 12)
    twice, once = observation.coarser(2).coarser(3), observation.coarser(6)
    for name in ("C", "B", "C_variance", "B_variance", "valid", "streak", "near"):
        assert_allclose(getattr(twice, name), getattr(once, name))
    assert twice.origin == once.origin
    assert twice.scale == once.scale


@pytest.mark.parametrize("margin", [3, 6, 40])
def test_the_observation_is_the_box_around_the_streak(margin):
    image, plate = pictures()
    observation = observation_around(streak(), margin, image, plate, NEUTRAL)
    x0, y0, x1, y1 = streak().around(margin)
    assert observation.origin == (x0, y0)
    assert observation.scale == 1
    assert observation.size == SIZE
    assert observation.color is NEUTRAL
    assert_array_equal(observation.C, image.rgb[y0:y1, x0:x1])
    assert_array_equal(observation.B, plate.rgb[y0:y1, x0:x1])
    assert_array_equal(observation.streak, streak().mask[y0:y1, x0:x1])
    assert observation.C_variance.shape == observation.B_variance.shape == observation.C.shape


def test_near_is_within_the_margin():
    """Oracle: the distance to every pixel of the streak."""
    margin = 6
    observation = observation_around(streak(), margin, *pictures(), NEUTRAL)
    inside = np.argwhere(observation.streak)
    for place in np.ndindex(observation.near.shape):
        apart = np.linalg.norm(inside - place, axis=1).min()
        assert observation.near[place] == (apart <= margin)
    assert np.count_nonzero(~observation.near) > 0


def test_far_pixels_weigh_less_and_invalid_ones_nothing():
    image, plate = pictures()
    clipped, dead = np.ones((2, *SIZE[::-1]), bool)
    clipped[20, 25] = dead[16, 12] = dead[40, 50] = False
    image, plate = (
        LinearImage(picture.rgb, NOISE, valid)
        for picture, valid in ((image, clipped), (plate, dead))
    )
    observation = observation_around(streak(), 8, image, plate, NEUTRAL)
    assert_array_equal(observation.valid, (clipped & dead)[7:35, 12:46])
    assert not observation.valid[13, 13]
    assert not observation.valid[9, 0]
    assert_array_equal(observation.weight == 0, ~observation.valid)
    assert_array_equal(observation.weight[observation.valid & observation.near], 1)
    far = observation.weight[observation.valid & ~observation.near]
    assert 0 < far.min() == far.max() < 0.5


def test_variance_is_that_of_a_neighborhood():
    """Uniform light has the sensor's noise; for noisy light it is nearly independent of the pixel's
    noise.
    """
    image, plate = pictures()
    even = LinearImage(np.full_like(image.rgb, 0.3), NOISE)
    observation = observation_around(streak(), 5, even, plate, NEUTRAL)
    assert_allclose(observation.C_variance, 1e-4 * 0.3 + 1e-6)
    raw = NOISE.variance(observation.B)
    assert observation.B_variance.min() > raw.min()
    assert observation.B_variance.max() < raw.max()
    assert_allclose(observation.B_variance.mean(), raw.mean(), rtol=0.03)
    assert np.std(observation.B_variance) < 0.25 * np.std(raw)


@pytest.mark.parametrize("noise", [NoiseModel(), np.zeros((*SIZE[::-1], 3)), NOISE])
def test_variance_is_finite_and_positive(noise):
    dark = LinearImage(np.zeros((*SIZE[::-1], 3)), noise)
    observation = observation_around(streak(), 5, dark, dark, NEUTRAL)
    for variance in (observation.C_variance, observation.B_variance):
        assert np.all(np.isfinite(variance))
        assert variance.min() > 0

"""The data of a sweep: cropped in the right place, and means of blocks when coarser."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import Streak
from blurmatte.sweep.model.observation import Observation, observation_around

NOISE = NoiseModel(gain=1e-4, read_std=1e-3)
SIZE = (60, 44)


def pictures(seed=0):
    rng = np.random.default_rng(seed)
    image, plate = rng.uniform(0, 1, (2, *SIZE[::-1], 3))
    return LinearImage(image, NOISE), LinearImage(plate, NOISE)


def streak():
    """Something slanted of 18x12 pixels, from (20, 15)."""
    mask = np.zeros(SIZE[::-1], bool)
    for i in range(12):
        mask[15 + i, 20 + i : 27 + i] = True
    return Streak(mask)


def random_data(width=13, height=11, seed=0):
    rng = np.random.default_rng(seed)
    light = rng.uniform(0, 1, (4, height, width, 3))
    valid, moved, near = rng.uniform(0, 1, (3, height, width)) > [[[0.1]], [[0.8]], [[0.5]]]
    weight = np.where(valid, rng.uniform(0.1, 1, valid.shape), 0)
    return Observation(*light, weight, valid, moved, near, SIZE, (7.0, 3.0))


def blocks(values, by):
    """Each block of an array on its own, and where it goes."""
    for j in range(values.shape[0] // by):
        for i in range(values.shape[1] // by):
            yield j, i, values[by * j : by * (j + 1), by * i : by * (i + 1)]


def test_no_coarser_is_the_same():
    data = random_data()
    assert data.coarser(1) is data


@pytest.mark.parametrize("by", [2, 3, 5])
def test_coarser_light_is_the_mean_of_blocks(by):
    data = random_data()
    coarse = data.coarser(by)
    assert coarse.weight.shape == (11 // by, 13 // by)
    for j, i, block in blocks(data.C, by):
        assert_allclose(coarse.C[j, i], block.mean(axis=(0, 1)))
    for j, i, block in blocks(data.B, by):
        assert_allclose(coarse.B[j, i], block.mean(axis=(0, 1)))


@pytest.mark.parametrize("by", [2, 3, 5])
def test_coarser_variance_is_that_of_a_mean(by):
    data = random_data()
    coarse = data.coarser(by)
    for j, i, block in blocks(data.C_variance, by):
        assert_allclose(coarse.C_variance[j, i], block.sum(axis=(0, 1)) / by**4)
    for j, i, block in blocks(data.B_variance, by):
        assert_allclose(coarse.B_variance[j, i], block.sum(axis=(0, 1)) / by**4)


def test_noise_that_hangs_together_is_measured_where_means_hide_it():
    """Honest: of means over pixels of a file that share it the variance is as measured."""
    rng = np.random.default_rng(4)
    light, std = np.broadcast_to(np.linspace(0.1, 0.7, 160)[:, None], (120, 160, 3)), 0.01

    def shared():
        return light + np.repeat(np.repeat(rng.normal(0, std, (60, 80, 3)), 2, 0), 2, 1)

    pictures = [LinearImage(shared(), NoiseModel(read_std=std)) for _ in "ab"]
    mask = np.zeros((120, 160), bool)
    mask[50:70, 60:100] = True
    data = replace(observation_around(Streak(mask), 40, *pictures, None), louder=3.0).coarser(2)
    assert_allclose(data.C_variance.mean(), std**2 / 4, rtol=0.01)
    measured = data.with_noise_measured()
    both = measured.C_variance + measured.B_variance
    assert_allclose(both.mean(), 3 * 2 * std**2, rtol=0.1)
    assert_array_equal(measured.C, data.C)


@pytest.mark.parametrize("by", [2, 3, 5])
def test_a_coarser_pixel_is_believed_if_all_of_it_is(by):
    data = random_data()
    coarse = data.coarser(by)
    assert 0 < coarse.valid.sum() < coarse.valid.size or by == 5
    for j, i, block in blocks(data.valid, by):
        assert coarse.valid[j, i] == block.all()
    for j, i, block in blocks(data.weight, by):
        assert_allclose(coarse.weight[j, i], block.mean() if coarse.valid[j, i] else 0)


def test_a_coarser_pixel_has_moved_if_any_of_it_has():
    data = random_data()
    coarse = data.coarser(3)
    for fine, rough in ((data.streak, coarse.streak), (data.near, coarse.near)):
        for j, i, block in blocks(fine, 3):
            assert rough[j, i] == block.any()


def test_coarser_pixels_are_where_they_were():
    """The first is centered on the middle of its block."""
    coarse = random_data().coarser(3)
    assert coarse.origin == (8.0, 4.0)
    assert coarse.scale == 3
    assert random_data().coarser(2).origin == (7.5, 3.5)
    assert coarse.size == SIZE


def test_twice_coarser_is_once_coarser_by_the_product():
    data = random_data(24, 12)
    twice, once = data.coarser(2).coarser(3), data.coarser(6)
    for name in ("C", "B", "C_variance", "B_variance", "valid", "streak", "near"):
        assert_allclose(getattr(twice, name), getattr(once, name))
    assert twice.origin == once.origin
    assert twice.scale == once.scale


@pytest.mark.parametrize("margin", [3, 6, 40])
def test_the_data_are_those_around_the_streak(margin):
    image, plate = pictures()
    data = observation_around(streak(), margin, image, plate, None)
    x0, y0, x1, y1 = streak().around(margin)
    assert data.origin == (x0, y0)
    assert data.scale == 1
    assert data.size == SIZE
    assert data.known is None
    assert_array_equal(data.C, image.rgb[y0:y1, x0:x1])
    assert_array_equal(data.B, plate.rgb[y0:y1, x0:x1])
    assert_array_equal(data.streak, streak().mask[y0:y1, x0:x1])
    assert data.C_variance.shape == data.B_variance.shape == data.C.shape


def test_near_is_what_lies_within_the_margin():
    """Oracle: the distance to every pixel of the streak."""
    margin = 6
    data = observation_around(streak(), margin, *pictures(), None)
    inside = np.argwhere(data.streak)
    for place in np.ndindex(data.near.shape):
        apart = np.linalg.norm(inside - place, axis=1).min()
        assert data.near[place] == (apart <= margin)
    assert np.count_nonzero(~data.near) > 0


def test_far_pixels_count_less_and_those_not_to_be_believed_nothing():
    image, plate = pictures()
    clipped, dead = np.ones((2, *SIZE[::-1]), bool)
    clipped[20, 25] = dead[16, 12] = dead[40, 50] = False
    image, plate = (
        LinearImage(picture.rgb, NOISE, valid)
        for picture, valid in ((image, clipped), (plate, dead))
    )
    data = observation_around(streak(), 8, image, plate, None)
    assert_array_equal(data.valid, (clipped & dead)[7:35, 12:46])
    assert not data.valid[13, 13]
    assert not data.valid[9, 0]
    assert_array_equal(data.weight == 0, ~data.valid)
    assert_array_equal(data.weight[data.valid & data.near], 1)
    far = data.weight[data.valid & ~data.near]
    assert 0 < far.min() == far.max() < 0.5


def test_variance_is_that_of_a_neighborhood():
    """Of even light it is the sensor's own; of noisy light it hardly goes with a pixel's noise."""
    image, plate = pictures()
    even = LinearImage(np.full_like(image.rgb, 0.3), NOISE)
    data = observation_around(streak(), 5, even, plate, None)
    assert_allclose(data.C_variance, 1e-4 * 0.3 + 1e-6)
    raw = NOISE.variance(data.B)
    assert data.B_variance.min() > raw.min()
    assert data.B_variance.max() < raw.max()
    assert_allclose(data.B_variance.mean(), raw.mean(), rtol=0.03)
    assert np.std(data.B_variance) < 0.25 * np.std(raw)


@pytest.mark.parametrize("noise", [NoiseModel(), np.zeros((*SIZE[::-1], 3)), NOISE])
def test_variance_is_finite_and_never_nothing(noise):
    dark = LinearImage(np.zeros((*SIZE[::-1], 3)), noise)
    data = observation_around(streak(), 5, dark, dark, None)
    for variance in (data.C_variance, data.B_variance):
        assert np.all(np.isfinite(variance))
        assert variance.min() > 0

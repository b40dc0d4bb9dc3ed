"""Noise samples without the scene: of frames, and of a uniform region."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.calibration.noise_samples import noise_of_frames, noise_within, parts_by_light
from blurmatte.radiometry import SRGB, LinearImage, Meta

STD = 0.01


def pictures(count, seed=0, shape=(60, 70, 3)):
    rng = np.random.default_rng(seed)
    light = rng.uniform(0.2, 0.8, shape)
    return light, [LinearImage(light + rng.normal(0, STD, shape)) for _ in range(count)]


@pytest.mark.parametrize("count", [2, 3, 6])
def test_mean_square_of_frames_is_the_variance(count):
    """Honest: their mean, and their scatter as `freedom` says."""
    light, frames = pictures(count)
    sample = noise_of_frames(frames, None)
    assert_allclose(sample.v.mean(), STD**2, rtol=0.03)
    assert_allclose(2 * sample.v.mean() ** 2 / sample.v.var(), sample.freedom, rtol=0.1)
    assert_allclose(np.mean(sample.e**2), STD**2, rtol=0.05)
    assert_allclose(np.std(sample.light - light), STD / np.sqrt(count), rtol=0.05)
    assert sample.frames == count
    assert sample.use.all()


def test_parabola_has_no_residual():
    """Exact; and the variance of the noise is preserved."""
    y, x = np.mgrid[:70, :90] / 50
    even = (0.2 + 0.1 * x + 0.05 * y * y - 0.03 * x * y)[..., None] * [1, 0.8, 0.6]
    region = np.zeros((70, 90), bool)
    region[5:60, 10:85] = True
    sample = noise_within(LinearImage(even), region)
    assert_allclose(sample.v, 0, atol=1e-28)
    noise = np.random.default_rng(0).normal(0, STD, even.shape)
    sample = noise_within(LinearImage(even + noise), region)
    assert sample.use.shape == (55, 75, 3)
    assert_allclose(np.mean(sample.v[sample.use]), STD**2, rtol=0.03)


def test_small_incomplete_tiles_are_dropped():
    """Exact: there a parabola would take up all of the noise."""
    region = np.ones((40, 34), bool)
    sample = noise_within(LinearImage(np.full((40, 34, 3), 0.5)), region)
    assert sample.use[:32, :32].all()
    assert not sample.use[32:, 32:].any()


def test_clipped_pixels_are_not_used():
    """Exact: at white in any channel, at black in that one."""
    meta = Meta(transfer=SRGB, levels=256)
    rgb = np.full((20, 20, 3), 0.5)
    rgb[3, 4, 1] = 0
    valid = np.ones((20, 20), bool)
    valid[7, 8] = False
    frames = [LinearImage(rgb, valid=valid, meta=meta), LinearImage(np.full_like(rgb, 0.5))]
    use = noise_of_frames(frames, None).use
    assert not use[3, 4, 1]
    assert not use[7, 8].any()
    assert np.count_nonzero(~use) == 4
    step = SRGB.slope(np.full(3, 0.5)) / 255
    assert_allclose(noise_of_frames(frames, None).step[0, 0], step, rtol=1e-6)


def test_groups_have_similar_light():
    """Exact: all of them, the darkest first."""
    light = np.random.default_rng(0).uniform(size=1000)
    parts = parts_by_light(light, 100)
    assert len(parts) == 10
    assert sorted(np.concatenate(parts)) == list(range(1000))
    assert all(light[a].max() < light[b].min() for a, b in pairwise(parts))
    assert len(parts_by_light(light, 1)) == 24
    assert len(parts_by_light(light[:3], 100)) == 1

"""How noise hangs together: sums over blocks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from blurmatte.radiometry import BLOCKS, block_squares, block_sums, coherence

SHAPE = (61, 83)


def some(seed=0, share=0.7):
    """Noise of three channels, and which pixels to use; more of some blocks than of others."""
    rng = np.random.default_rng(seed)
    use = rng.uniform(size=SHAPE) < share
    use[:20, :30] = False
    return rng.normal(size=(*SHAPE, 3)), use


@pytest.mark.parametrize("size", [1, 2, 3, 8, 16])
def test_squares_are_those_of_each_block(size):
    """Oracle: one block after the other."""
    e, use = some()
    expected = []
    for y in range(0, SHAPE[0] - size + 1, size):
        for x in range(0, SHAPE[1] - size + 1, size):
            inside = use[y : y + size, x : x + size]
            if inside.sum() > size**2 / 2:
                total = e[y : y + size, x : x + size][inside].sum(axis=0)
                expected.append(total**2 / inside.sum())
    assert_allclose(block_squares(e, use, size), expected, rtol=1e-12)


@pytest.mark.parametrize("size", [1, 3, 8])
def test_sums_are_those_of_each_block(size):
    """Oracle: one block after the other."""
    e, _ = some(2)
    rows = range(0, SHAPE[0] - size + 1, size)
    columns = range(0, SHAPE[1] - size + 1, size)
    expected = [[e[y : y + size, x : x + size].sum(axis=(0, 1)) for x in columns] for y in rows]
    assert_allclose(block_sums(e, size), expected, rtol=1e-10, atol=1e-12)
    assert_allclose(block_sums(e[..., 0], size), np.array(expected)[..., 0], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("size", [4, 8, 16])
def test_planes_may_come_first(size):
    """Oracle: sums of planes, one by one, as the verdict on a sweep once took them."""
    e, use = some(1)
    h, w = (side // size * size for side in use.shape)

    def sums(x):
        return x[:h, :w].reshape(h // size, size, w // size, size).sum((1, 3))

    count = sums(use.astype(float))
    full = count > size**2 / 2
    planes = np.moveaxis(e, -1, 0)
    expected = [sums(np.where(use, x, 0))[full] ** 2 / count[full] for x in planes]
    assert_allclose(block_squares(np.moveaxis(planes, 0, -1), use, size).T, expected, rtol=1e-9)


def test_nothing_is_known_of_blocks_that_are_not_there():
    """Exact."""
    e, use = some()
    assert block_squares(e, np.zeros_like(use), 4).shape == (0, 3)
    assert block_squares(e[:10], use[:10], 16).shape == (0, 3)
    assert_allclose(coherence(e, np.zeros_like(use)), 1)
    assert_allclose(coherence(0 * e, use), 1)


def test_noise_of_each_pixel_and_of_whole_blocks():
    """Exact: 1 for white noise, but for chance; all pixels of a block where they are the same."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=(640, 640, 3))
    use = np.ones((640, 640), bool)
    assert_allclose(coherence(white, use), 1, atol=0.1)
    same = white[::4, ::4].repeat(4, 0).repeat(4, 1)
    assert_allclose(coherence(same, use), np.tile([4, 16, 16, 16], (3, 1)), rtol=0.1)


def test_smoothed_noise_has_the_area_of_its_filter():
    """Oracle: white noise smoothed by a Gaussian of 1 pixel adds up over 4π pixels."""
    rng = np.random.default_rng(0)
    smooth = gaussian_filter(rng.normal(size=(800, 800, 3)), (1, 1, 0))
    found = coherence(smooth, np.ones((800, 800), bool))
    assert np.all(np.diff(found, axis=1) > 0)
    edge = 1 - 1 / np.sqrt(np.pi) * 2 / BLOCKS[-1]  # of each side of a block, what it lacks
    assert_allclose(found[:, -1], 4 * np.pi * edge**2, rtol=0.08)


def test_light_does_not_matter():
    """Invariant: noise of twice the size hangs together as much."""
    e, use = some()
    assert_allclose(coherence(2 * e, use), coherence(e, use), rtol=1e-12)

"""Three colors from one: against slow loops, and against noise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry.sensor import demosaic, tiled, variance_shares

PATTERNS = {
    "RGGB": [[0, 1], [1, 2]],
    "GBRG": [[1, 2], [0, 1]],
    "X-Trans": [
        [1, 2, 1, 1, 0, 1],
        [0, 1, 0, 2, 1, 2],
        [1, 2, 1, 1, 0, 1],
        [1, 0, 1, 1, 2, 1],
        [2, 1, 2, 0, 1, 0],
        [1, 0, 1, 1, 2, 1],
    ],
}


@pytest.fixture(params=PATTERNS)
def pattern(request):
    return np.array(PATTERNS[request.param])


def test_missing_color_is_the_weighted_mean_of_neighbors(pattern):
    """Oracle: pixel by pixel, as the docstring says."""
    mosaic = np.random.default_rng(0).random((13, 15))
    seen = tiled(pattern, mosaic.shape)
    rgb = demosaic(mosaic, pattern)
    for y in range(1, 12):
        for x in range(1, 14):
            near, who = mosaic[y - 1 : y + 2, x - 1 : x + 2], seen[y - 1 : y + 2, x - 1 : x + 2]
            for c in range(3):
                weights = np.array([[1, 2, 1], [2, 0, 2], [1, 2, 1]]) * (who == c)
                mean = np.sum(weights * near) / weights.sum() if seen[y, x] != c else mosaic[y, x]
                assert rgb[y, x, c] == pytest.approx(mean)


def test_constant_light_stays_constant_at_the_border(pattern):
    """Exact."""
    light = np.array([0.3, 0.5, 0.2])
    rgb = demosaic(light[tiled(pattern, (12, 17))], pattern)
    assert_allclose(rgb, np.broadcast_to(light, rgb.shape), rtol=1e-12)


def test_interpolation_is_linear(pattern):
    """Exact: of a sum it is the sum, so alpha may be found after it."""
    a, b = np.random.default_rng(1).random((2, 12, 18))
    both = demosaic(3 * a - 0.5 * b, pattern)
    assert_allclose(both, 3 * demosaic(a, pattern) - 0.5 * demosaic(b, pattern), atol=1e-12)


def test_keeps_the_dtype(pattern):
    """Invariant."""
    assert demosaic(np.zeros((6, 6), np.float32), pattern).dtype == np.float32


def test_shares_are_the_variance_of_interpolated_noise(pattern):
    """Honest."""
    rgb = demosaic(np.random.default_rng(3).standard_normal((600, 600)), pattern)
    assert_allclose(rgb.var(axis=(0, 1)), variance_shares(pattern), rtol=0.03)


def test_shares_of_a_bayer_pattern_by_hand():
    """Exact: of red one pixel of four is seen, two are means of two, and one is a mean of four."""
    shares = variance_shares(np.array(PATTERNS["RGGB"]))
    assert_allclose(shares, [(1 + 1 / 2 + 1 / 2 + 1 / 4) / 4, (2 + 2 / 4) / 4, 2.25 / 4])

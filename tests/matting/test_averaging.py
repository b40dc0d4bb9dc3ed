"""Averages of hypotheses: mean, law of total variance, and the sum of alpha."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.matting.averaging import AlphaEstimate, averaged


def estimate(seed, sum_std=1.0, scale_std=0.0):
    """Random alpha of 5 by 7 pixels and its error."""
    rng = np.random.default_rng(seed)
    return AlphaEstimate(
        rng.uniform(0, 1, (5, 7)), rng.uniform(0.01, 0.1, (5, 7)), sum_std, scale_std
    )


A, B = estimate(0, 1.0, 0.02), estimate(1, 3.0, 0.06)


@pytest.mark.parametrize(("weights", "likeliest"), [((1.0, 0.0), A), ((0.0, 1.0), B)])
def test_average_is_the_hypothesis_of_weight_one(weights, likeliest):
    """exact"""
    average = averaged([A, B], np.array(weights))
    assert_allclose(average.alpha, likeliest.alpha, rtol=1e-12)
    assert_allclose(average.alpha_std, likeliest.alpha_std, rtol=1e-12)
    assert_allclose(average.sum_std, likeliest.sum_std, rtol=1e-12)
    assert_allclose(average.scale_std, likeliest.scale_std, rtol=1e-12)


def test_average_of_one_hypothesis_is_itself():
    """exact"""
    average = averaged([A], np.ones(1))
    assert_allclose(average.alpha, A.alpha, rtol=1e-12)
    assert_allclose(average.alpha_std, A.alpha_std, rtol=1e-12)


def test_variance_is_that_of_the_mixture():
    """oracle: draws from either hypothesis with the probability of its weight."""
    rng, weights = np.random.default_rng(3), np.array([0.3, 0.7])
    average = averaged([A, B], weights)
    of_b = rng.random(200_000) < weights[1]
    noise = rng.standard_normal(len(of_b))
    for pixel in ((0, 0), (2, 3), (4, 6)):
        mean, std = (np.where(of_b, getattr(B, x)[pixel], getattr(A, x)[pixel])
                     for x in ("alpha", "alpha_std"))  # fmt: skip
        drawn = mean + std * noise
        assert_allclose(average.alpha[pixel], drawn.mean(), atol=0.005)
        assert_allclose(average.alpha_std[pixel], drawn.std(), rtol=0.01)


def test_variance_of_the_sum_is_that_of_the_mixture():
    """exact: the mean variance plus the variance of the means of the sums."""
    weights = np.array([0.3, 0.7])
    sums = np.array([A.alpha.sum(), B.alpha.sum()])
    expected = 0.3 * A.sum_std**2 + 0.7 * B.sum_std**2 + 0.3 * 0.7 * (sums[1] - sums[0]) ** 2
    assert_allclose(averaged([A, B], weights).sum_std ** 2, expected)
    assert_allclose(averaged([A, B], weights).alpha.sum(), weights @ sums)


def test_average_does_not_depend_on_the_order():
    """invariant"""
    one, other = averaged([A, B], np.array([0.3, 0.7])), averaged([B, A], np.array([0.7, 0.3]))
    assert_allclose(one.alpha, other.alpha)
    assert_allclose(one.alpha_std, other.alpha_std)
    assert_allclose((one.sum_std, one.scale_std), (other.sum_std, other.scale_std))


def test_equal_hypotheses_add_no_variance():
    """invariant"""
    average = averaged([A, A], np.array([0.4, 0.6]))
    assert_allclose(average.alpha, A.alpha)
    assert_allclose(average.alpha_std, A.alpha_std)
    assert_allclose(average.sum_std, A.sum_std)


def test_unknown_pixels_of_one_hypothesis_are_averaged_over_the_others():
    """exact: also if its weight is large; the error is infinite where all are unknown."""
    alpha, std = A.alpha.copy(), A.alpha_std.copy()
    alpha[0, 0], std[0, 1] = np.nan, np.inf
    std[4, 6] = np.inf
    partly = AlphaEstimate(alpha, std, A.sum_std)
    blind = AlphaEstimate(
        B.alpha, np.where(np.arange(35).reshape(5, 7) == 34, np.inf, B.alpha_std), 1.0
    )
    average = averaged([partly, blind], np.array([0.9, 0.1]))
    for pixel in ((0, 0), (0, 1)):
        assert_allclose(average.alpha[pixel], B.alpha[pixel])
        assert_allclose(average.alpha_std[pixel], B.alpha_std[pixel])
    assert np.isinf(average.alpha_std[4, 6])
    assert_array_equal(np.isfinite(average.alpha_std).sum(), 34)

"""Averages of hypotheses: interquartile mean, the error about it, and the sum of alpha."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.matting.averaging import AlphaEstimate, as_fraction, averaged, with_bounded_errors


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


def test_average_is_the_interquartile_mean():
    """oracle: the mean of the middle half of draws with the probability of the weights."""
    rng, weights = np.random.default_rng(2), np.array([0.15, 0.35, 0.3, 0.2])
    some = [estimate(seed) for seed in range(4)]
    average = averaged(some, weights)
    which = rng.choice(4, 100_000, p=weights)
    for pixel in ((0, 0), (2, 3), (4, 6)):
        drawn = np.sort(np.array([one.alpha[pixel] for one in some])[which])
        assert_allclose(average.alpha[pixel], drawn[25_000:75_000].mean(), atol=0.005)


def test_hypotheses_of_less_than_a_quarter_do_not_move_the_others():
    """invariant: however far away they are."""
    far = AlphaEstimate(A.alpha + 100, A.alpha_std, A.sum_std)
    weights = np.array([0.78, 0.22])
    assert_allclose(averaged([A, far], weights).alpha, A.alpha)


def test_error_is_that_of_the_mixture():
    """oracle: draws from either hypothesis with the probability of its weight."""
    rng, weights = np.random.default_rng(3), np.array([0.3, 0.7])
    average = averaged([A, B], weights)
    of_b = rng.random(200_000) < weights[1]
    noise = rng.standard_normal(len(of_b))
    for pixel in ((0, 0), (2, 3), (4, 6)):
        mean, std = (np.where(of_b, getattr(B, x)[pixel], getattr(A, x)[pixel])
                     for x in ("alpha", "alpha_std"))  # fmt: skip
        drawn = mean + std * noise
        error = np.sqrt(np.mean((drawn - average.alpha[pixel]) ** 2))
        assert_allclose(average.alpha_std[pixel], error, rtol=0.01)


def test_error_of_the_sum_is_that_of_the_mixture():
    """exact: the mean variance plus the mean square of the sums about that of the average."""
    weights = np.array([0.3, 0.7])
    average = averaged([A, B], weights)
    away = np.array([A.alpha.sum(), B.alpha.sum()]) - average.alpha.sum()
    expected = 0.3 * A.sum_std**2 + 0.7 * B.sum_std**2 + weights @ away**2
    assert_allclose(average.sum_std**2, expected)


def test_an_uncertain_hypothesis_that_agrees_adds_no_variance():
    """exact: if it is the nearest, it is off by no more than the likelier one."""
    vague = AlphaEstimate(A.alpha, 10 * A.alpha_std, 10 * A.sum_std, 10 * A.scale_std)
    average = averaged([A, vague], np.array([0.6, 0.4]))
    assert_allclose(average.alpha_std, A.alpha_std)
    assert_allclose((average.sum_std, average.scale_std), (A.sum_std, A.scale_std))
    average = averaged([A, vague], np.array([0.4, 0.6]))
    assert np.all(average.alpha_std > 5 * A.alpha_std)


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


def test_what_is_known_is_no_other_as_a_fraction():
    """exact: also below 0 and above 1, so that sums stay unbiased."""
    alpha, std = np.array([[-0.2, 0.0, 0.3, 1.1]]), np.array([[0.14, 0.01, 0.1, 0.05]])
    for found, given in zip(as_fraction(alpha, std), (alpha, std), strict=True):
        assert_array_equal(found, given)


def test_alpha_of_which_nothing_is_known_is_a_half():
    """exact: mean and standard deviation of a uniform distribution on 0…1."""
    alpha, std = as_fraction(np.array([[0.1, np.nan, 1e6]]), np.array([[np.inf, 0.1, 1e9]]))
    assert_allclose(alpha, 0.5, atol=1e-6)
    assert_allclose(std, 12**-0.5, rtol=1e-6)


@pytest.mark.parametrize(("alpha", "std"), [(13.0, 16.0), (3.9, 3.6), (-5.0, 0.3), (40.0, 0.3)])
def test_alpha_of_little_information_is_a_fraction(alpha, std):
    """oracle: a normal distribution restricted to 0…1."""
    (mean,), (spread,) = as_fraction(np.array([alpha]), np.array([std]))
    x = np.linspace(0, 1, 20_001)
    density = np.exp(((alpha - np.clip(alpha, 0, 1)) ** 2 - (x - alpha) ** 2) / (2 * std**2))
    expected = (density @ x) / density.sum()
    assert_allclose(mean, expected, atol=0.004)
    assert_allclose(spread, np.sqrt(density @ (x - expected) ** 2 / density.sum()), atol=0.004)


@pytest.mark.parametrize("std", [0.16, 0.2, 0.25, 0.3, 0.5, 3.0])
def test_errors_of_fractions_are_right_on_average(std):
    """oracle: any alpha on 0…1 is as probable; its error is not larger than before, and as stated."""
    rng = np.random.default_rng(0)
    true = rng.uniform(0, 1, 100_000)
    raw = true + std * rng.standard_normal(len(true))
    alpha, alpha_std = as_fraction(raw, np.full(len(true), std))
    off = np.sqrt(np.mean((alpha - true) ** 2))
    assert off < min(std, 0.29)
    assert 0.85 < off / np.sqrt(np.mean(alpha_std**2)) < 1.02
    assert_allclose(alpha.mean(), 0.5, atol=0.005)


def test_bounded_errors_are_those_of_a_fraction_at_most():
    """exact: errors that are smaller stay."""
    alpha, std = np.array([[0.0, 0.5, 1.0, 0.2]]), np.array([[9.0, 9.0, 0.01, 9.0]])
    found = with_bounded_errors(AlphaEstimate(alpha, std, 507.0, 4.0))
    expected = [[3**-0.5, 12**-0.5, 0.01, np.sqrt(1 / 12 + 0.09)]]
    assert_allclose(found.alpha_std, expected)
    assert_allclose(found.sum_std, found.alpha_std.sum())
    assert_allclose(found.scale_std, 3**-0.5)
    assert_array_equal(found.alpha, alpha)
    known = with_bounded_errors(A)
    assert_array_equal(known.alpha_std, A.alpha_std)
    assert (known.sum_std, known.scale_std) == (A.sum_std, A.scale_std)

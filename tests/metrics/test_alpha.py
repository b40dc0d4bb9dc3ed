"""Errors of alpha and calibration of standard deviations: by hand, by slow sums, and invariances."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.metrics import (
    Calibration,
    alpha_gradient_error,
    alpha_rmse,
    alpha_sad,
    alpha_sum_bias,
    calibration,
    false_alpha,
)

ALL = [alpha_rmse, alpha_sad, alpha_gradient_error, alpha_sum_bias, false_alpha]

TRUE = np.array([[0.0, 0.0, 0.2], [0.0, 0.5, 0.3]])
ESTIMATED = np.array([[0.3, 0.0, 0.2], [-0.4, 0.8, -0.1]])  # off by 0, 0.3, -0.4 on the streak


@pytest.fixture
def pair():
    """A soft blob that fills 0…1 and reaches beyond the border, and the same with noise."""
    y, x = np.mgrid[:24, :30]
    true = np.clip(1.5 - np.hypot(x - 14, y - 6) / 6, 0, 1)
    return true + np.random.default_rng(3).normal(0, 0.05, true.shape), true


def test_errors_equal_those_computed_by_hand():
    assert alpha_rmse(ESTIMATED, TRUE) == pytest.approx(np.sqrt((0.09 + 0.16) / 3))
    assert alpha_sad(ESTIMATED, TRUE) == pytest.approx(0.7)
    assert alpha_sum_bias(ESTIMATED, TRUE) == pytest.approx(-0.1)
    assert false_alpha(ESTIMATED, TRUE) == pytest.approx(np.sqrt((0.09 + 0.16) / 3))


def test_margin_excludes_pixels_near_the_streak():
    """Distances to the streak: 2 pixels on the left, √2 above it, 1 to the right."""
    true = np.array([[0, 0, 0, 0], [0, 0, 0, 0.5]])
    estimated = np.array([[8.0, 4, 2, 1], [16, 32, 64, 0]])
    assert false_alpha(estimated, true, margin=2.9) == pytest.approx(np.hypot(8, 16) / np.sqrt(2))
    assert false_alpha(estimated, true, margin=3) == pytest.approx(8)


@pytest.mark.parametrize("metric", ALL)
def test_errors_of_the_truth_are_zero(pair, metric):
    assert metric(pair[1], pair[1]) == 0


def slow_gradient(alpha):
    """|∇α| by explicit sums over 9 by 9 neighbors, at each pixel."""
    steps = np.arange(-4, 5)
    gauss = np.exp(-(steps**2) / (2 * 1.4**2)) / (1.4 * np.sqrt(2 * np.pi))
    kernel = np.outer(gauss, -steps * gauss / 1.4**2)  # [y, x]: derivative along x
    kernel /= np.sqrt((kernel**2).sum())
    padded = np.pad(alpha, 4, mode="edge")
    size = np.empty(alpha.shape)
    for y, x in np.ndindex(alpha.shape):
        patch = padded[y : y + 9, x : x + 9]
        size[y, x] = np.sqrt((patch * kernel).sum() ** 2 + (patch * kernel.T).sum() ** 2)
    return size


def test_gradient_error_equals_explicit_sums(pair):
    estimated, true = pair
    slow = (slow_gradient(estimated) - slow_gradient(true)) ** 2
    assert_allclose(alpha_gradient_error(estimated, true), slow[true > 0].sum(), rtol=1e-12)


@pytest.mark.parametrize("metric", ALL)
@pytest.mark.parametrize("turn", [np.flipud, np.fliplr, np.transpose])
def test_errors_of_rotated_pictures_are_equal(pair, metric, turn):
    turned = metric(*map(turn, pair))
    assert_allclose(turned, metric(*pair), rtol=1e-12)


@pytest.mark.parametrize(
    ("metric", "power"),
    [
        (alpha_rmse, 1), (alpha_sad, 1), (alpha_gradient_error, 2),
        (alpha_sum_bias, 0), (false_alpha, 1),
    ],
)  # fmt: skip
def test_errors_scale_with_alpha(pair, metric, power):
    estimated, true = pair
    assert_allclose(metric(estimated / 4, true / 4), metric(estimated, true) / 4**power)


@pytest.mark.parametrize("metric", ALL[:4])
def test_pixels_outside_the_streak_are_ignored(pair, metric):
    """Errors far from the streak belong to `false_alpha`; a larger picture changes nothing."""
    estimated, true = pair
    larger = [np.pad(alpha, 9) for alpha in pair]
    larger[0][0, 0] = 5
    if metric is not alpha_gradient_error:  # its kernel sees the border of the smaller picture
        assert_allclose(metric(*larger), metric(estimated, true))
    assert_allclose(metric(*larger), metric(np.pad(estimated, 9), larger[1]))


def test_single_precision_is_summed_in_double():
    true = np.full((1000, 1000), 0.1, np.float32)
    assert alpha_sum_bias(true * np.float32(1.5), true) == pytest.approx(0.5, abs=1e-6)


def broken(value):
    alpha = ESTIMATED.copy()
    alpha[0, :2] = value
    return alpha


@pytest.mark.parametrize("metric", ALL)
@pytest.mark.parametrize(
    ("estimated", "true", "error", "says"),
    [
        (ESTIMATED[:, :2], TRUE, ValueError, "estimated is 2x2 pixels and true 3x2"),
        (ESTIMATED, TRUE[:1], ValueError, "estimated is 3x2 pixels and true 3x1"),
        (broken(np.nan), TRUE, ValueError, "estimated must be finite, got 2 NaN or infinite of 6"),
        (broken(np.inf), TRUE, ValueError, "estimated must be finite, got 2"),
        (ESTIMATED, broken(np.nan), ValueError, "true must be finite, got 2"),
        (ESTIMATED, 0 * TRUE, ValueError, "true must hold a streak, got alpha up to 0$"),
        (ESTIMATED[..., None], TRUE, ValueError, r"estimated must have the shape \(height, width\)"),
        (ESTIMATED, TRUE[0], ValueError, r"true must have the shape \(height, width\), got \(3,\)"),
        (ESTIMATED.astype(int), TRUE, TypeError, "estimated must hold floats"),
        (None, TRUE, TypeError, "estimated must be a NumPy array, got NoneType"),
    ],
)  # fmt: skip
def test_rejects_wrong_arguments(metric, estimated, true, error, says):
    with pytest.raises(error, match=says):
        metric(estimated, true)


def test_false_alpha_rejects_wrong_arguments():
    with pytest.raises(ValueError, match="margin must be 0 or more pixels, got -1"):
        false_alpha(ESTIMATED, TRUE, margin=-1)
    with pytest.raises(ValueError, match="no pixel is further than 5 pixels from the streak"):
        false_alpha(ESTIMATED, TRUE, margin=5)


@pytest.fixture
def sample():
    """100 000 estimates of different values and stated errors, with correct stated errors."""
    rng = np.random.default_rng(7)
    truth, std = rng.uniform(-5, 5, 100_000), rng.uniform(0.01, 2, 100_000)
    return truth + rng.normal(0, std), std, truth


def test_scores_equal_those_computed_by_hand():
    """z = 0.5, -1.5, 2.5, 10."""
    found = calibration([1.5, -2.0, 6, 11], [1, 2, 2, 1], [1, 1, 1, 1])
    z = np.array([0.5, -1.5, 2.5, 10])
    assert found.count == 4
    assert found.mean == pytest.approx(z.mean())
    assert found.spread == pytest.approx(np.sqrt(np.mean((z - z.mean()) ** 2)))
    assert found.robust_spread == pytest.approx(2 / 0.674490, rel=1e-6)
    assert (found.within_1, found.within_2, found.within_3) == (0.25, 0.5, 0.75)


def test_normal_sample_is_calibrated(sample):
    found = calibration(*sample)
    assert_allclose(
        [found.mean, found.spread, found.robust_spread], [0, 1, 1], atol=5 / np.sqrt(100_000)
    )
    assert_allclose([found.within_1, found.within_2], [0.6827, 0.9545], atol=0.007)
    assert found.within_3 == pytest.approx(0.9973, abs=0.001)


def test_overconfidence_and_bias_are_measured(sample):
    estimate, std, truth = sample
    honest, boasting = calibration(*sample), calibration(estimate, std / 2, truth)
    biased = calibration(estimate + 3 * std, std, truth)
    assert boasting.spread == pytest.approx(2 * honest.spread)
    assert boasting.robust_spread == pytest.approx(2 * honest.robust_spread)
    assert biased.mean == pytest.approx(3 + honest.mean)
    assert biased.spread == pytest.approx(honest.spread)
    assert biased.within_3 == pytest.approx(0.5, abs=0.01)


def test_outliers_change_the_spread_but_not_the_robust_spread(sample):
    estimate, std, truth = sample
    wild = estimate.copy()
    wild[::1000] += 1000
    found = calibration(wild, std, truth)
    assert found.spread > 20
    assert found.robust_spread == pytest.approx(1, abs=0.02)


def test_scores_do_not_depend_on_units(sample):
    scaled = calibration(*(7 * part for part in sample))
    assert_allclose(list(vars(scaled).values()), list(vars(calibration(*sample)).values()))


def test_infinite_std_is_excluded():
    std = np.array([1, np.inf, np.nan, 0, 2])
    found = calibration([1, np.nan, np.nan, 3, 1], std, [0, 0, np.nan, 0, 0])
    assert found == calibration([1, 1], [1, 2], [0, 0])
    assert found.count == 2


def test_where_selects_pixels():
    estimate, std, truth = np.arange(12.0).reshape(2, 2, 3), np.ones((2, 2, 3)), np.zeros((2, 2, 3))
    where = np.array([[True, False], [False, True]])
    expected = calibration([0, 1, 2, 9, 10, 11], np.ones(6), np.zeros(6))
    assert calibration(estimate, std, truth, where) == expected
    assert calibration(estimate, std, truth, np.repeat(where[..., None], 3, -1)) == expected


def test_single_value_is_accepted():
    assert calibration(3, 2, 0) == Calibration(1, 1.5, 0, pytest.approx(2.2239, abs=1e-4), 0, 1, 1)


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        (([1, 2], [1], [1, 2]), ValueError, r"std must have the shape of estimate, \(2,\), got \(1"),
        (([1, 2], [1, 1], 0), ValueError, r"truth must have the shape of estimate, \(2,\), got \(\)"),
        (([1, np.nan], [1, 1], [1, 1]), ValueError, "estimate must be finite, got 1 NaN or infinite"),
        (([1, 1], [1, 1], [np.inf, 1]), ValueError, "truth must be finite, got 1 "),
        (([1, 1], [-1, 1], [1, 1]), ValueError, "std must not be negative, got 1 that are"),
        (([1, 1], [0, np.inf], [1, 1]), ValueError, "std must be finite and above 0 somewhere, got n"),
        (([], [], []), ValueError, "got none in 0 values"),
        (([1], [1], [1], np.array([1])), TypeError, "where must hold booleans"),
        (([1], [1], [1], np.ones(2, bool)), ValueError, r"where must have the shape \(1,\)"),
        (([1], [1], [1], np.zeros(1, bool)), ValueError, "got none in 0 values"),
    ],
)  # fmt: skip
def test_calibration_rejects_wrong_arguments(arguments, error, says):
    with pytest.raises(error, match=says):
        calibration(*arguments)

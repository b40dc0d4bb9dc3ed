"""Calibration of stated errors: correct and overconfident samples."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.metrics import Calibration, calibration


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
        (([1], [1], [1], np.array([1])), TypeError, "where must have a dtype of kind 'b'"),
        (([1], [1], [1], np.ones(2, bool)), ValueError, r"where must have the shape \(1,\)"),
        (([1], [1], [1], np.zeros(1, bool)), ValueError, "got none in 0 values"),
    ],
)  # fmt: skip
def test_rejects_wrong_arguments(arguments, error, says):
    with pytest.raises(error, match=says):
        calibration(*arguments)

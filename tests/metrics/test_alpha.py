"""Errors of alpha: computed by hand, compared with slow sums, and their invariances."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.metrics import (
    alpha_gradient_error,
    alpha_rmse,
    alpha_sad,
    alpha_sum_bias,
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
        (ESTIMATED.astype(int), TRUE, TypeError, "estimated must have a dtype of kind 'f'"),
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

"""Student's t: loss, weight, and the efficiency of estimates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_t

from blurmatte.sweep.model.student_t import DEGREES_OF_FREEDOM, VARIANCE, loss, student_weight


@pytest.mark.parametrize("channels", [1, 3])
def test_loss_is_the_log_density_in_as_many_dimensions_as_channels(channels):
    """oracle: scipy's, relative to the density at 0."""
    zero = np.zeros(channels)
    density = multivariate_t(zero, np.eye(channels), df=DEGREES_OF_FREEDOM)
    e = np.random.default_rng(0).normal(0, 3, (50, channels))
    expected = density.logpdf(zero) - density.logpdf(e)
    assert_allclose(loss((e**2).sum(axis=1), channels), expected, rtol=1e-12)


@pytest.mark.parametrize("channels", [1, 3])
def test_weight_is_twice_the_slope_of_the_loss(channels):
    chi2 = np.linspace(0, 60, 31)
    slope = (loss(chi2 + 1e-5, channels) - loss(chi2 - 1e-5, channels)) / 2e-5
    assert_allclose(student_weight(chi2, channels), 2 * slope, rtol=1e-8)


@pytest.mark.parametrize("channels", [1, 3])
def test_weight_is_one_for_noise_and_vanishes_for_outliers(channels):
    """exact: the mean sum of squares of residuals of unit variance is their number."""
    assert student_weight(np.array(float(channels)), channels) == 1
    assert student_weight(np.array(1e4), channels) < 1e-3


def test_variance_of_estimates_from_normal_noise():
    """oracle: E ψ² / (E ψ')² with ψ = w e, times E w, of three normal numbers [Huber 1964]."""
    r = np.linspace(0, 12, 200001)  # their length
    density = r**2 * np.exp(-(r**2) / 2)
    density /= density.sum()
    w = student_weight(r**2, 3)
    slope = w + r / 3 * np.gradient(w, r)  # of one component, mean over directions
    variance = np.sum(density * w**2 * r**2 / 3) / np.sum(density * slope) ** 2
    assert_allclose(variance * np.sum(density * w), VARIANCE, rtol=5e-3)

"""Student's t: loss, weight, and the efficiency of estimates."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.stats import multivariate_t

from blurmatte.sweep.model.student_t import DEGREES_OF_FREEDOM, VARIANCE, loss, student_weight


def test_loss_is_the_log_density_in_three_dimensions():
    """oracle: scipy's, relative to the density at 0."""
    density = multivariate_t(np.zeros(3), np.eye(3), df=DEGREES_OF_FREEDOM)
    e = np.random.default_rng(0).normal(0, 3, (50, 3))
    expected = density.logpdf(np.zeros(3)) - density.logpdf(e)
    assert_allclose(loss((e**2).sum(axis=1)), expected, rtol=1e-12)


def test_weight_is_twice_the_slope_of_the_loss():
    chi2 = np.linspace(0, 60, 31)
    slope = (loss(chi2 + 1e-5) - loss(chi2 - 1e-5)) / 2e-5
    assert_allclose(student_weight(chi2), 2 * slope, rtol=1e-8)


def test_weight_is_one_for_noise_and_vanishes_for_outliers():
    """exact: three residuals of unit variance have a mean sum of squares of 3."""
    assert student_weight(np.array(3.0)) == 1
    assert student_weight(np.array(1e4)) < 1e-3


def test_variance_of_estimates_from_normal_noise():
    """oracle: E ψ² / (E ψ')² with ψ = w e, times E w, of three normal numbers [Huber 1964]."""
    r = np.linspace(0, 12, 200001)  # their length
    density = r**2 * np.exp(-(r**2) / 2)
    density /= density.sum()
    w = student_weight(r**2)
    slope = w + r / 3 * np.gradient(w, r)  # of one component, mean over directions
    variance = np.sum(density * w**2 * r**2 / 3) / np.sum(density * slope) ** 2
    assert_allclose(variance * np.sum(density * w), VARIANCE, rtol=5e-3)

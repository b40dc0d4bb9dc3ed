"""Student's t: the slope of the loss is what a residual is believed to be."""

import numpy as np
from numpy.testing import assert_allclose

from blurmatte.sweep.model.student_t import VARIANCE, student_weight, bend, loss


def test_belief_is_twice_the_slope():
    chi2 = np.linspace(0, 60, 31)
    slope = (loss(chi2 + 1e-5) - loss(chi2 - 1e-5)) / 2e-5
    assert_allclose(student_weight(chi2), 2 * slope, rtol=1e-8)


def test_noise_is_believed_and_the_rest_is_not():
    assert student_weight(np.array(2.0)) == 1
    assert student_weight(np.array(1e4)) < 1e-3


def test_variance_of_estimates_from_normal_noise():
    """E ψ² / (E ψ')² with ψ = w e, times E w, for the radius r of two normal numbers [Huber 1964]."""
    r = np.linspace(0, 12, 200001)
    density = r * np.exp(-(r**2) / 2)
    density /= density.sum()
    w = student_weight(r**2)
    slope = w + r / 2 * np.gradient(w, r)  # of one component, mean over directions
    variance = np.sum(density * w**2 * r**2 / 2) / np.sum(density * slope) ** 2
    assert_allclose(variance * np.sum(density * w), VARIANCE, rtol=5e-3)


def test_bend_is_what_the_loss_curves_less_along_residuals():
    """And all of it where the loss curves down; across a residual there is no bend."""
    e, d = np.linspace(-4, 4, 81), 1e-4
    along = (loss((e + d) ** 2) - 2 * loss(e**2) + loss((e - d) ** 2)) / d**2
    across = (2 * loss(e**2 + d**2) - 2 * loss(e**2)) / d**2
    w = student_weight(e**2)
    assert_allclose(w * (1 - e**2 * bend(e**2)), np.maximum(along, 0), atol=1e-6)
    assert_allclose(w, across, atol=1e-6)

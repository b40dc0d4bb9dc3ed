"""Student's t: the slope of the loss is what a residual is believed to be."""

import numpy as np
from numpy.testing import assert_allclose

from blurmatte.sweep.student import belief, loss


def test_belief_is_twice_the_slope():
    chi2 = np.linspace(0, 60, 31)
    slope = (loss(chi2 + 1e-5) - loss(chi2 - 1e-5)) / 2e-5
    assert_allclose(belief(chi2), 2 * slope, rtol=1e-8)


def test_noise_is_believed_and_the_rest_is_not():
    assert belief(np.array(2.0)) == 1
    assert belief(np.array(1e4)) < 1e-3

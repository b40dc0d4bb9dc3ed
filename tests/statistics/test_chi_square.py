"""χ² quantiles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from blurmatte.statistics import MEDIAN_3, QUANTILE_999_3, chi_square_quantile


@pytest.mark.parametrize("probability", [0.01, 0.25, 0.5, 1 - 6e-5])
def test_quantiles_are_those_of_scipy(probability):
    """Oracle."""
    dof = np.array([1, 2, 1.5, 3, 300])
    assert_allclose(chi_square_quantile(probability, dof), chi2.ppf(probability, dof), rtol=1e-9)


def test_constants_are_the_quantiles():
    """Oracle: to the digits printed."""
    assert_allclose(MEDIAN_3, chi2.ppf(0.5, 3), atol=5e-4)
    assert_allclose(QUANTILE_999_3, chi2.ppf(0.999, 3), atol=5e-3)

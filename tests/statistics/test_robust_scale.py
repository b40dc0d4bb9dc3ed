"""Robust scale."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.statistics import MAD_TO_STD, robust_std


def test_factor_is_that_of_the_normal_distribution():
    """Oracle: Φ⁻¹(3/4) of SciPy, to the digits printed."""
    scipy_stats = pytest.importorskip("scipy.stats")
    assert_allclose(MAD_TO_STD, 1 / scipy_stats.norm.ppf(0.75), atol=5e-5)


def test_std_of_normal_numbers_despite_outliers():
    """Exact, but for chance: outliers on both sides hardly change it."""
    x = 0.3 * np.random.default_rng(0).normal(size=20_000)
    assert_allclose(robust_std(x), 0.3, rtol=0.03)
    x[:400] = 1e9
    x[400:800] = -1e9
    assert_allclose(robust_std(x), 0.3, rtol=0.08)

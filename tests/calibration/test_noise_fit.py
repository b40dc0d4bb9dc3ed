"""The fit of sensor noise to variances at several levels of light, and rounding."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.calibration import NoiseFit
from blurmatte.calibration.noise_measure import fit_sensor, without_rounding
from blurmatte.radiometry import SRGB, NoiseModel

X = np.linspace(0.01, 0.8, 24)
THETA = np.array([0.002**2, 2e-4, 0.01**2])
A = np.stack([X**0, X, X**2], axis=1)


def fit_of(coherence=None, sensor=None, spread=0.01):
    """A fit as pictures of 8 bits would give it."""
    sensor = sensor or NoiseModel(gain=2e-4, read_std=0.002, relative_std=0.01)
    covariance = np.stack([np.diag((spread * theta) ** 2) for theta in sensor.coefficients])
    light = np.repeat(X[:, None], 3, axis=1)
    rounding = NoiseModel.rounding(256, SRGB)
    y = (sensor.variance(light) + rounding.variance(light)).T
    coherence = np.ones((3, 4)) if coherence is None else coherence
    levels = (tuple(a) for a in (light.T, y, spread * y))
    return NoiseFit(sensor, rounding, covariance, *levels, coherence, 0.02)


def test_exact_variances_give_the_sensor():
    """Exact."""
    theta, _, _ = fit_sensor(X, A @ THETA, np.full(24, 1e-4), np.zeros(24))
    assert_allclose(theta, THETA, rtol=1e-6)


@pytest.mark.parametrize("rounding", [0.0, 3e-5])
def test_covariance_equals_the_scatter_of_fits(rounding):
    """Honest: all three coefficients, over many sets of variances."""
    rng, spread, scores = np.random.default_rng(0), np.full(24, 0.02), []
    for _ in range(300):
        whole = (A @ THETA + rounding) * (1 + spread * rng.normal(size=24))
        theta, covariance, _ = fit_sensor(X, whole - rounding, spread, np.full(24, rounding))
        scores.append((theta - THETA) / np.sqrt(np.diag(covariance)))
    assert_allclose(np.mean(scores, axis=0), 0, atol=0.25)
    assert_allclose(np.std(scores, axis=0), 1, atol=0.2)


def test_outlying_level_hardly_changes_the_fit():
    """Oracle: the answer without it."""
    y, spread = A @ THETA, np.full(24, 0.01)
    y[[3, 15]] *= 4
    theta, _, _ = fit_sensor(X, y, spread, np.zeros(24))
    assert np.all(np.abs(theta / THETA - 1) < [0.05, 0.05, 0.2])


def test_one_level_determines_only_the_sum():
    """Honest: the errors of gain and read noise include their exchange for each other."""
    x = np.full(5, 0.2)
    theta, covariance, _ = fit_sensor(x, np.full(5, 1e-4), np.full(5, 0.01), np.zeros(5))
    assert_allclose(theta[0] + 0.2 * theta[1], 1e-4, rtol=1e-6)
    std = np.sqrt(np.diag(covariance))
    assert 0.5e-4 < std[0] < 1.1e-4
    assert 0.5e-4 < 0.2 * std[1] < 1.1e-4
    sum_ = np.array([1, 0.2, 0.2**2])
    assert np.sqrt(sum_ @ covariance @ sum_) < 0.01e-4


@pytest.mark.parametrize("steps", [0.15, 0.25, 0.4, 1.0, 5.0])
def test_rounding_is_removed_from_variances(steps):
    """Oracle: light of every part of a step, with noise of so many steps, rounded."""
    rng = np.random.default_rng(1)
    light = rng.uniform(100, 200, (40_000, 1))
    codes = np.rint(light + steps * rng.normal(size=(40_000, 20)))
    seen = np.var(codes, axis=1, ddof=1).mean()
    once = np.mean((codes[:, 0] - light[:, 0]) ** 2)
    step2 = np.full(1, 1e-6)
    assert_allclose(without_rounding(seen * step2, step2, True), steps**2 * step2, rtol=0.05)
    assert_allclose(without_rounding(once * step2, step2, False), steps**2 * step2,
                    rtol=0.05, atol=2e-3 * step2[0])  # fmt: skip


def test_variances_of_floats_are_unchanged():
    """Exact."""
    y = np.array([1e-6, 3e-4])
    for repeated in (True, False):
        assert_allclose(without_rounding(y, np.zeros(2), repeated), y, rtol=1e-12)


def test_noise_is_the_sum_of_sensor_and_rounding():
    """Exact."""
    fit = fit_of()
    light = np.array([0.05, 0.2, 0.7])
    whole = fit.sensor.variance(light) + fit.rounding.variance(light)
    assert_allclose(fit.noise.variance(light), whole)
    share = fit.rounding_share(0.2)
    assert_allclose(share[1], fit.rounding.variance(light)[1] / whole[1])


def test_std_of_roots_agrees_with_that_of_squares():
    """Exact: half the relative error; at 0 the root of the error."""
    fit = fit_of(spread=0.01)
    assert_allclose(fit.gain_std, 0.01 * 2e-4)
    assert_allclose(fit.read_std_std, 0.005 * 0.002, rtol=0.01)
    assert_allclose(fit.relative_std_std, 0.005 * 0.01, rtol=0.01)
    none = fit_of(sensor=NoiseModel())
    covariance = np.tile(np.diag([1e-8, 0, 0]), (3, 1, 1))
    open_ = NoiseFit(NoiseModel(), none.rounding, covariance, (), (), (), none.variance_inflation)
    assert_allclose(open_.read_std_std, 1e-8**0.25)


def test_separable_if_gain_or_read_noise_is_certain():
    """Exact."""
    assert fit_of(spread=0.1).separable
    assert not fit_of(spread=0.9).separable


def test_scale_is_the_root_of_the_largest_inflation():
    """Exact: of squares of equal pixels."""
    coherence = np.array([[2, 4, 9, 9], [1, 1, 1, 1], [0.9, 0.8, 0.9, 0.7]])
    assert_allclose(fit_of(coherence).scale, [3, 1, 1])


def test_repr_is_one_line():
    """Exact."""
    assert str(fit_of()) == "NoiseFit(gain 0.0002 ± 2e-06, read_std 0.002 ± 1e-05)"

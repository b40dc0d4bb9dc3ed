"""Banded normal equations against dense ones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.banded import dense

from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.normal_equations import posterior, summed
from blurmatte.deblurring.priors import fit_gaussian, fit_strength, gradient_prior
from blurmatte.deblurring.view import View


@pytest.fixture(scope="module")
def problem(ball):
    """A, light, weight, lattice and equations of the ball."""
    lattice, view = Lattice.of(ball.sweep), View.of(ball.image, ball.plate, ball.sweep)
    A, alpha = blur = view.blur(lattice)
    weight = view.weight(alpha)
    return A, view.light(alpha), weight, lattice, view.equations(blur, lattice, weight)


def test_bands_are_those_of_the_dense_product(problem):
    A, light, weight, _, equations = problem
    for c in range(3):
        N = (A.T @ A.multiply(weight[:, c, None])).toarray()
        assert_allclose(dense(equations.band[c].T), N, rtol=1e-9, atol=1e-9 * N.max())
        assert_allclose(equations.right[c], A.T @ (weight[:, c] * light[:, c]))


def test_prior_is_the_sum_of_squared_differences(problem):
    lattice = problem[3]
    rng = np.random.default_rng(0)
    o = rng.normal(size=lattice.size)
    Q = dense(gradient_prior(lattice, problem[4].width).T)
    i, j = lattice.stencils[0].nodes.T
    assert_allclose(o @ Q @ o, np.sum((o[i] - o[j]) ** 2))


def test_mean_and_variance_are_those_of_the_dense_inverse(problem):
    lattice, equations = problem[3:]
    prior = 5.0 * gradient_prior(lattice, equations.width)
    normal = posterior(equations, prior)
    for c in range(3):
        covariance = np.linalg.inv(dense((equations.band[c] + prior).T))
        assert_allclose(normal.mean[:, c], covariance @ equations.right[c], rtol=1e-7)
        assert_allclose(normal.variances()[:, c], np.diag(covariance), rtol=1e-7)
        i, j = lattice.stencils[0].nodes.T
        assert_allclose(normal.covariance_band()[c, i, j - i], covariance[i, j], rtol=1e-6)


def test_evidence_is_that_of_the_data_as_a_normal_vector(problem):
    """Oracle: differences of log Z equal those of the density of P with a known noise scale."""
    A, light, weight, lattice, equations = problem
    Q = gradient_prior(lattice, equations.width)
    seen = (weight > 0).all(axis=1)
    rows, full = A[seen].toarray(), dense(Q.T)

    def log_density(mu):
        total, misfit = 0.0, 0.0
        for c in range(3):
            cov = (
                np.diag(1 / weight[seen, c])
                + rows @ np.linalg.inv(mu * full + 1e-6 * np.eye(len(full))) @ rows.T
            )
            misfit += light[seen, c] @ np.linalg.solve(cov, light[seen, c])
            total -= np.linalg.slogdet(cov)[1] / 2
        return total - 3 * (equations.count - 1) / 2 * np.log(misfit)

    low, high = (fit_strength(equations, Q, mu) for mu in (5.0, 20.0))
    expected = log_density(20.0) - log_density(5.0)
    assert_allclose(high.log_evidence - low.log_evidence, expected, atol=0.01)


def test_noise_scale_is_one_where_the_model_is_right(problem):
    """A color drawn from the prior, light with the expected noise."""
    A, _, weight, lattice, _ = problem
    rng = np.random.default_rng(3)
    n = lattice.size
    Q = dense(gradient_prior(lattice, n)[:, :n].T)
    color = np.linalg.cholesky(np.linalg.inv(200 * Q + 1e-3 * np.eye(n))) @ rng.normal(size=(n, 3))
    noise = np.where(
        weight > 0, rng.normal(size=weight.shape) / np.sqrt(np.maximum(weight, 1e-9)), 0
    )
    from blurmatte.deblurring.normal_equations import NormalEquations

    fit = fit_gaussian(NormalEquations.of(A, A @ color + noise, weight, lattice), lattice)
    assert 0.9 < fit.noise_scale < 1.1
    assert 100 < fit.strength / fit.noise_scale < 400


def test_two_pictures_add_their_equations(problem):
    equations = problem[4]
    both = summed([equations, equations])
    assert_allclose(both.band, 2 * equations.band)
    assert both.count == 2 * equations.count

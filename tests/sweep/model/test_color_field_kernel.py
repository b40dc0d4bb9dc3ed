"""Banded Cholesky factors and the Gaussian field along one axis, against scipy and dense algebra."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.stats import multivariate_normal
from tests.banded import dense

from blurmatte.sweep.model import color_field_kernel as kernel

NODES, PIXELS, WIDTH = 12, 40, 4


def banded(matrix):
    """(WIDTH, n) lower band of a matrix."""
    n = len(matrix)
    return np.stack(
        [np.pad(np.diag(matrix, -k), (0, n - len(np.diag(matrix, -k)))) for k in range(WIDTH)]
    )


def positive_band(seed=0):
    """A random positive definite matrix of this width."""
    rng = np.random.default_rng(seed)
    L = np.tril(np.triu(rng.normal(size=(NODES, NODES)), 1 - WIDTH)) + 3 * np.eye(NODES)
    return banded(L @ L.T)


def test_factor_is_the_cholesky_factor():
    """oracle: scipy."""
    band = positive_band()
    expected, columns = cholesky_banded(band, lower=True), band.T.copy()
    kernel.factor(columns)
    inside = np.arange(WIDTH)[:, None] + np.arange(NODES) < NODES
    assert_allclose(columns.T[inside], expected[inside], rtol=1e-12)


def test_solve_is_that_of_the_matrix():
    """oracle: scipy, and the dense matrix."""
    band, right = positive_band(), np.random.default_rng(1).normal(size=NODES)
    matrix, factor = dense(band), band.T.copy()
    kernel.factor(factor)
    x = right.copy()
    kernel.solve(factor, x)
    assert_allclose(matrix @ x, right, atol=1e-12)
    expected = cho_solve_banded((cholesky_banded(band, lower=True), True), right)
    assert_allclose(x, expected, rtol=1e-10)


def test_solve_is_self_adjoint():
    """adjoint: ⟨A⁻¹x, y⟩ = ⟨x, A⁻¹y⟩."""
    factor, rng = positive_band().T.copy(), np.random.default_rng(2)
    kernel.factor(factor)
    x, y = rng.normal(size=(2, NODES))
    solved_x, solved_y = x.copy(), y.copy()
    kernel.solve(factor, solved_x)
    kernel.solve(factor, solved_y)
    assert_allclose(solved_x @ y, x @ solved_y, rtol=1e-12)


class Linear:
    """Light y = A k + noise of nodes k on a chain, with the prior of the color field."""

    def __init__(self, seed=0, spread=0.3, change=0.2):
        rng = np.random.default_rng(seed)
        self.spread, self.change = spread, change
        self.A = np.zeros((PIXELS, NODES))
        for row, at in zip(self.A, np.sort(rng.uniform(0, NODES - 1.001, PIXELS)), strict=True):
            i = int(at)
            row[i : i + 2] = i + 1 - at, at - i
        self.A *= rng.uniform(0.1, 1, (PIXELS, 1))
        self.variance = rng.uniform(0.01, 0.05, PIXELS)
        self.y = 0.7 * self.A.sum(axis=1) + rng.normal(0, 0.3, PIXELS)
        steps = np.diff(np.eye(NODES), axis=0)
        self.differences = steps.T @ steps
        self.prior = self.differences / change**2 + np.eye(NODES) / spread**2

    def fitted(self, free):
        """Cost, mean, its deviation, the prior's band, and the mode."""
        W = self.A / self.variance[:, None]
        prior, colors = np.empty((WIDTH, NODES)), np.empty(NODES)
        result = kernel.fit_axis(
            banded(self.A.T @ W), W.T @ self.y, banded(self.differences),
            self.spread, self.change, free, prior, colors,
        )  # fmt: skip
        return *result, prior, colors

    def marginal(self, mean):
        """Negative log density of the light for a mean, less that of the noise alone at 0."""
        noise = np.diag(self.variance)
        covariance = noise + self.A @ np.linalg.inv(self.prior) @ self.A.T
        density = multivariate_normal(mean * self.A.sum(axis=1), covariance).logpdf(self.y)
        return multivariate_normal(np.zeros(PIXELS), noise).logpdf(np.zeros(PIXELS)) - density


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize(("spread", "change"), [(0.3, 0.2), (0.05, 1.0), (2.0, 0.02)])
def test_cost_is_the_marginal_likelihood(free, spread, change):
    """oracle: a dense Gaussian with colors integrated out, plus the residuals of the mode."""
    model = Linear(spread=spread, change=change)
    cost, mean, _, prior, colors = model.fitted(free)
    assert_allclose(dense(prior), model.prior, rtol=1e-12)
    residual = (model.y - model.A @ colors) ** 2 / model.variance
    assert_allclose(cost + residual.sum() / 2, model.marginal(mean), rtol=1e-9)


def test_mode_is_that_of_the_posterior():
    """oracle: dense normal equations."""
    model = Linear()
    _, mean, _, _, colors = model.fitted(True)
    W = model.A / model.variance[:, None]
    right = W.T @ model.y + model.prior @ np.full(NODES, mean)
    assert_allclose(colors, np.linalg.solve(W.T @ model.A + model.prior, right), rtol=1e-9)


def test_free_mean_is_the_generalized_least_squares_estimate():
    """oracle: Aitken's estimate and its variance, under the marginal covariance."""
    model = Linear()
    _, mean, std, _, _ = model.fitted(True)
    covariance = np.diag(model.variance) + model.A @ np.linalg.inv(model.prior) @ model.A.T
    design = model.A.sum(axis=1)
    weighted = np.linalg.solve(covariance, design)
    assert_allclose(mean, weighted @ model.y / (weighted @ design), rtol=1e-9)
    assert_allclose(std, (weighted @ design) ** -0.5, rtol=1e-9)
    assert model.marginal(mean) < min(model.marginal(mean + d) for d in (-1e-3, 1e-3))


def test_a_mean_that_is_not_free_is_zero():
    _, mean, std, _, _ = Linear().fitted(False)
    assert (mean, std) == (0.0, 0.3)


def test_scales_are_those_of_well_known_nodes():
    """oracle: root mean squares where data dominate, without nodes that have no data."""
    rng = np.random.default_rng(0)
    colors, along_a_row = rng.normal(0.5, 0.1, NODES), np.zeros(11, int)
    neighbors = np.stack([np.arange(11), np.arange(1, 12), along_a_row])
    band, prior = np.zeros((WIDTH, NODES)), np.ones((WIDTH, NODES))
    band[0, :6] = 1e9
    spread, change = kernel.scales(band, prior, colors, 0.5, neighbors, np.array([1.0, 1, 0, 0]))
    assert_allclose(spread, np.sqrt(np.mean((colors[:6] - 0.5) ** 2)), rtol=1e-6)
    assert_allclose(change, np.sqrt(np.mean(np.diff(colors[:6]) ** 2)), rtol=1e-6)

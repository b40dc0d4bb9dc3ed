"""Priors of first and second differences against dense matrices; honest errors; edges."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.banded import dense

from blurmatte.deblurring.lattice import Lattice, Sphere
from blurmatte.deblurring.normal_equations import NormalEquations
from blurmatte.deblurring.priors import Differences, fit_gaussian, fit_smooth, fit_sparse, traces
from blurmatte.deblurring.view import View


@pytest.fixture(scope="module")
def lattice(ball):
    return Lattice.of(ball.sweep)


@pytest.fixture(scope="module")
def differences(lattice):
    return Differences.of(lattice)


def places(lattice):
    """(n, 2) of the nodes."""
    found = np.zeros((lattice.size, 2))
    y, x = np.nonzero(lattice.node >= 0)
    found[lattice.node[y, x]] = np.stack([x, y], axis=1)
    return found


def test_first_differences_of_a_slope_are_constant_and_second_ones_vanish(lattice, differences):
    first, second = differences.orders
    d = differences.matrix @ (places(lattice) @ [2.0, 2.0])
    assert_allclose(np.abs(d[first]), 2)
    assert_allclose(d[second], 0, atol=1e-12)


def test_second_differences_of_a_parabola_sum_to_its_laplacian(lattice, differences):
    """x² + x y has the second derivatives 2, 0 and twice 1: squares per node 4 + 2."""
    x, y = places(lattice).T
    square = differences.squares(np.stack([x**2 + x * y], axis=1))[differences.orders[1]]
    line = len(differences.stencils[1].nodes)
    assert set(square[:line].round(9)) == {0, 4}
    assert_allclose(square[line:], 2)


@pytest.mark.parametrize("kind", ["lattice", "sphere"])
def test_bands_and_variances_are_those_of_dense_matrices(lattice, kind):
    one = Differences.of(lattice if kind == "lattice" else Sphere.of(4.0, 2.0))
    rng = np.random.default_rng(0)
    weights = rng.uniform(1, 2, one.matrix.shape[0])
    D = one.matrix.toarray()
    assert_allclose(dense(one.band(weights, one.width).T), D.T @ (weights[:, None] * D), atol=1e-12)
    root = rng.normal(size=(one.size, one.size))
    covariance = root @ root.T
    band = np.array([[covariance[i, min(i + k, one.size - 1)] for k in range(one.width)]
                     for i in range(one.size)])  # fmt: skip
    assert_allclose(one.variances(band), np.diag(D @ covariance @ D.T))


def test_traces_are_those_of_the_pseudoinverse(differences):
    weights = (differences.weights(k) for k in np.eye(2))
    bands = [dense(differences.band(one, differences.width).T) for one in weights]
    inverse = np.linalg.pinv(3 * bands[0] + 5 * bands[1], hermitian=True)
    expected = [np.trace(inverse @ Q) for Q in bands]
    assert_allclose(traces(differences, np.array([3.0, 5.0])), expected, rtol=1e-6)


def posteriors(found, lattice, differences, color):
    """Fits of light of a color with the noise of the ball, and the truth."""
    view = View.of(found.image, found.plate, found.sweep)
    blur = view.blur(lattice)
    weight = view.weight(blur.alpha)
    noise = np.random.default_rng(1).normal(size=weight.shape)
    light = blur.A @ color + np.where(weight > 0, noise / np.sqrt(np.maximum(weight, 1)), 0)
    equations = NormalEquations.of(blur.A, light, weight, lattice).widened(differences.width)
    start = fit_gaussian(equations, lattice)
    smooth, strengths = fit_smooth(equations, differences, start)
    return start, smooth, fit_sparse([equations], differences, smooth, strengths)


def test_errors_of_a_smooth_color_are_smaller_and_honest(ball, lattice, differences):
    """The evidence finds that details are weaker than a prior of first differences says."""
    at = places(lattice) / 5
    color = 0.5 + 0.2 * np.stack([np.sin(at @ k) for k in ([1, 0], [0.3, 1], [0.8, -0.5])], axis=1)
    first, smooth, sparse = posteriors(ball, lattice, differences, color)
    rms = [np.sqrt(np.mean((one.normal.mean - color) ** 2)) for one in (first, smooth, sparse)]
    assert max(rms[1:]) < 0.9 * rms[0]
    for one in (smooth, sparse):
        z = (one.normal.mean - color) / np.sqrt(one.noise_scale * one.normal.variances())
        assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25


def test_edges_are_sharper_under_the_prior_of_edges(ball, lattice, differences):
    x, y = places(lattice).T
    sides = (x > x.mean()).astype(float) + (y > y.mean() + 2)
    color = 0.2 + np.outer(sides, [0.3, 0.1, 0.2])
    _, smooth, sparse = posteriors(ball, lattice, differences, color)
    rms = [np.sqrt(np.mean((one.normal.mean - color) ** 2)) for one in (smooth, sparse)]
    assert rms[1] < 0.97 * rms[0]

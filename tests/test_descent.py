"""Levenberg–Marquardt: the least squares of SciPy, what is held, and where a search ends."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from blurmatte.descent import descended

T = np.linspace(0, 1, 30)
DATA = 2 * np.exp(-3 * T) + 0.01 * np.random.default_rng(0).normal(size=30)
START = np.array([0.5, 0.1])


def residuals(x):
    return x[0] * np.exp(-x[1] * T) - DATA


def jacobian(x):
    decay = np.exp(-x[1] * T)
    return np.stack([decay, -x[0] * T * decay], axis=1)


@dataclass(frozen=True)
class Point:
    x: np.ndarray

    @property
    def cost(self):
        return float(np.sum(residuals(self.x) ** 2)) / 2

    def information(self):
        J = jacobian(self.x)
        return J.T @ J, J.T @ residuals(self.x)

    def moved(self, step):
        return Point(self.x + step)


def test_the_end_is_that_of_least_squares_of_scipy():
    """Oracle"""
    end, converged = descended(Point(START), Point.information, Point.moved, 50, 1e-12)
    assert converged
    assert_allclose(end.x, scipy.optimize.least_squares(residuals, START).x, rtol=1e-5)


def test_what_has_no_information_is_held():
    def information(point):
        H, g = point.information()
        H[1], H[:, 1], g[1] = 0, 0, 0
        return H, g

    end, converged = descended(Point(START), information, Point.moved, 50, 1e-12)
    decay = np.exp(-START[1] * T)
    assert converged
    assert_allclose(end.x, [decay @ DATA / (decay @ decay), START[1]], rtol=1e-8)


@pytest.mark.parametrize("units", [1e-3, 1e3])
def test_units_of_parameters_do_not_matter(units):
    """Invariant: a parameter in other units has the same path."""
    scale = np.array([1.0, units])

    def information(point):
        H, g = Point(point.x * scale).information()
        return H * scale[:, None] * scale, g * scale

    @dataclass(frozen=True)
    class Scaled(Point):
        @property
        def cost(self):
            return Point(self.x * scale).cost

    end, _ = descended(
        Scaled(START / scale), information, lambda p, step: Scaled(p.x + step), 3, 1e-12
    )
    expected, _ = descended(Point(START), Point.information, Point.moved, 3, 1e-12)
    assert_allclose(end.x * scale, expected.x, rtol=1e-5)


def test_a_search_without_data_or_with_too_few_steps_has_not_converged():
    nothing = Point(START), lambda _: (np.zeros((2, 2)), np.zeros(2)), Point.moved
    assert descended(*nothing, 50, 1e-12) == (nothing[0], False)
    end, converged = descended(Point(START), Point.information, Point.moved, 2, 1e-12)
    assert not converged
    assert end.cost < Point(START).cost


def test_a_search_stops_where_it_is_asked_to():
    def stops(point, _):
        return point.x[1] > 1

    search = Point(START), Point.information, Point.moved, 50, 1e-12
    end, converged = descended(*search, stops)
    assert not converged
    assert end.x[1] > 1
    assert end.cost > 1.1 * descended(*search)[0].cost


def test_a_search_knows_the_cost_that_it_reaches_at_the_rate_of_its_last_step():
    reached = []

    def stops(point, reachable):
        reached.append((point.cost, reachable))
        return False

    descended(Point(START), Point.information, Point.moved, 3, 1e-12, stops)
    (first, _), (second, at_this_rate), (third, last) = reached
    assert at_this_rate == second - (first - second)
    assert last == third

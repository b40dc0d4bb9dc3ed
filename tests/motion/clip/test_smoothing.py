"""Measurements: smoothing spline of a curve, one measurement left out at a time."""

import numpy as np
import pytest

from blurmatte.motion.clip.smoothing import Estimate, Measurements, transition

TIMES = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 7.0, 8.0])


def measured(rng, std=0.1):
    """Values and velocities of a curve in one dimension, with three derivatives in the state."""
    n = len(TIMES)
    H = np.zeros((n, 2, 3))
    H[:, 0, 0], H[:, 1, 1] = 1, 0.5
    y = rng.normal(size=(n, 2))
    return Measurements(TIMES, H, y, np.tile(np.diag([std**-2, 4.0]), (n, 1, 1)), 1)


def diffusion(h):
    """Covariance of position, velocity and acceleration after white noise of the third derivative."""
    return np.array(
        [
            [h**5 / 20, h**4 / 8, h**3 / 6],
            [h**4 / 8, h**3 / 3, h**2 / 2],
            [h**3 / 6, h**2 / 2, h],
        ]
    )


def test_states_are_those_of_the_joint_normal_distribution():
    """Oracle: regression on all states at once, with their transitions as measurements."""
    rng, q = np.random.default_rng(0), 0.03
    rows = measured(rng)
    states = Estimate.of(rows.left_out(q))
    n, s = len(TIMES), 3
    for left_out in (0, 3, n - 1):
        H, g = np.zeros((n * s, n * s)), np.zeros(n * s)
        L, v = rows.information
        for k in range(n):
            if k != left_out:
                H[k * s : k * s + s, k * s : k * s + s] += L[k]
                g[k * s : k * s + s] += v[k]
        for k in range(n - 1):
            step = TIMES[k + 1] - TIMES[k]
            J = np.zeros((s, n * s))
            J[:, k * s : k * s + s] = -transition(step, 3, 1)
            J[:, k * s + s : k * s + 2 * s] = np.eye(s)
            H += J.T @ np.linalg.solve(q * diffusion(step), J)
        V = np.linalg.inv(H)
        at = slice(left_out * s, left_out * s + s)
        assert states.mean[left_out] == pytest.approx((V @ g)[at], rel=1e-6, abs=1e-8)
        assert states.covariance[left_out] == pytest.approx(V[at, at], rel=1e-6, abs=1e-8)


def test_without_noise_of_the_curve_it_is_a_polynomial():
    """Exact: a parabola through its own values."""
    rows = measured(np.random.default_rng(0))
    truth = np.stack([2 - TIMES + TIMES**2 / 4, -1 + TIMES / 2, np.full(len(TIMES), 0.5)], axis=1)
    y = np.einsum("kms,ks->km", rows.H, truth)
    states = Estimate.of(Measurements(TIMES, rows.H, y, rows.weights, 1).left_out(0.0))
    assert states.mean == pytest.approx(truth, abs=1e-8)


def test_too_few_measurements_determine_nothing():
    rows = measured(np.random.default_rng(0)).taken(np.arange(2))
    assert not Estimate.of(rows.left_out(0.1)).known.any()


@pytest.mark.parametrize("gap", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("intensity", [1e-8, 1.0, 1e4])
def test_information_is_never_negative(gap, intensity):
    """Exact: after a long gap, and of exact positions that follow an uneven curve."""
    times = TIMES + gap * (np.arange(len(TIMES)) > 3)
    y = np.stack([1e5 * np.cos(TIMES), np.zeros(len(TIMES))], axis=1)
    H = measured(np.random.default_rng(0)).H
    W = np.tile(np.diag([1e6, 0.0]), (len(TIMES), 1, 1))
    L, _ = Measurements(times, H, y, W, 1).left_out(intensity)
    assert np.diagonal(L, axis1=1, axis2=2).min() >= 0
    assert np.linalg.eigvalsh(L).min() > -1e-12 * np.abs(L).max()


def test_each_side_is_what_the_other_lacks():
    """Invariant: information of both sides together is that of all."""
    rows = measured(np.random.default_rng(0))
    before, after = rows.from_each_side(0.02)
    L, _ = rows.information
    others, _ = rows.left_out(0.02)
    k = 3
    both = np.linalg.inv(before.covariance[k]) + np.linalg.inv(after.covariance[k])
    assert both == pytest.approx(others[k] + L[k], rel=1e-6)

"""The posterior of color directions from a likelihood."""

import numpy as np
import pytest

from blurmatte.color import evidence as module
from blurmatte.color.evidence import posterior, unit

BEST = unit(np.array([0.3, 0.36, 0.88]))
AXES = np.linalg.svd(BEST[:, None])[0][:, 1:]


def posterior_of_cost(monkeypatch, cost):
    """The posterior of a cost of two angles from the best direction, degrees."""

    def of(evidence, grid, pixels, phi):
        return cost(*np.degrees((grid / (grid @ BEST)[:, None]) @ AXES).T)

    monkeypatch.setattr(module, "excess_cost", of)
    monkeypatch.setattr(module, "misfit", lambda l, pixels: 1.0)
    monkeypatch.setattr(module, "_best_direction", lambda evidence, pixels: BEST)
    return posterior(None, None)


@pytest.mark.parametrize("stds", [(0.3, 0.3), (0.05, 2.0), (2.0, 0.02)])
def test_posterior_of_a_normal_likelihood_is_its_mean_and_covariance(monkeypatch, stds):
    """exact, up to the grid"""
    mean, covariance = posterior_of_cost(
        monkeypatch, lambda x, y: (x / stds[0]) ** 2 + (y / stds[1]) ** 2
    )
    assert mean @ BEST > np.cos(np.radians(0.02 * max(stds)))
    found = np.degrees(np.sqrt(np.diag(AXES.T @ covariance @ AXES)))
    np.testing.assert_allclose(found, stds, rtol=0.05)


@pytest.mark.parametrize("far", [8.0, 12.0])
def test_posterior_includes_a_mode_behind_a_ridge(monkeypatch, far):
    """invariant: a second mode at a distance has its weight."""

    def cost(x, y):
        before, ridge = (np.minimum(x, 0) / 0.6) ** 2, 8 * np.exp(-(((x - 4) / 1.7) ** 2))
        return before + ridge + np.maximum(x - far, 0) ** 2 + (y / 0.05) ** 2

    _, covariance = posterior_of_cost(monkeypatch, cost)
    assert np.degrees(np.sqrt(np.trace(covariance))) > far / 4

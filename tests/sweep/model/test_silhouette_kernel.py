"""The compiled alpha of an outline compared with counted points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.model import rim_kernel
from blurmatte.sweep.model import silhouette_kernel as kernel
from blurmatte.sweep.model.silhouette import Silhouette

H, W = 70, 90
PARTS = 6  # of a pixel, along its sides
OUTLINE = Silhouette(5)
COEFFICIENTS = [0.1, -0.06, 0.04, 0.05, -0.03, 0.03]


@pytest.mark.diagonal
@pytest.mark.parametrize("turn", [0.0, 1.2])
@pytest.mark.parametrize("stretch", [0.0, 1.0])
@pytest.mark.parametrize("radius", [4.0, 12.0])
def test_alpha_is_the_covered_fraction_of_each_pixel(radius, stretch, turn):
    """Oracle: also a thin outline with both sides in one pixel."""
    shape = np.array([radius, stretch, 0.1, *COEFFICIENTS])
    A, by_A = OUTLINE._stretch(shape)
    times = (np.arange(20) + 0.5) / 20
    xy, turns = [35.3, 30.7] + times[:, None] * [15, 9], turn * (times - 0.5)
    alpha, J = np.zeros((H, W)), np.zeros((H, W, OUTLINE.size))
    weights, D = np.full(20, 1 / 20), np.zeros((20, 2, 0))
    c, s = np.cos(turns), np.sin(turns)
    maps = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0).copy()
    coefficients = OUTLINE._coefficients(shape)
    rim = rim_kernel.lattice_around(A, coefficients, kernel.variance_of(0.0), kernel.reach_of(0.0))
    still = np.zeros((20, 2, 2, 0))
    outline = A, by_A, coefficients
    kernel.sweep((xy, D, weights), maps, still, False, rim, outline, 0.0, alpha, J)
    covered = np.mean([inside(A, at, by) for at, by in zip(xy, turns, strict=True)], axis=0)
    thin = radius * np.exp(-stretch) < 3
    assert_allclose(alpha, covered, rtol=0, atol=0.02 if thin else 0.012)
    assert_allclose(alpha.sum(), covered.sum(), rtol=1e-2 if thin else 2e-3)


def inside(A, center, turn):
    """(h, w) fraction of each pixel inside, from many points."""
    y, x = ((np.arange(n * PARTS) + 0.5) / PARTS - 0.5 for n in (H, W))
    away = np.stack(np.meshgrid(x - center[0], y - center[1])).reshape(2, -1)
    c, s = np.cos(turn), np.sin(turn)
    u, v = np.linalg.solve(A, np.array([[c, s], [-s, c]]) @ away)
    near = np.hypot(u, v) < 2  # the outline is nearer to its center
    u, v, within = u[near], v[near], near.copy()
    k = np.arange(3, 3 + len(COEFFICIENTS) // 2)[:, None]
    waves = np.stack([np.cos(k * np.arctan2(v, u)), np.sin(k * np.arctan2(v, u))], axis=1)
    log_R = np.einsum("kin,ki->n", waves, np.reshape(COEFFICIENTS, (-1, 2)))
    within[near] = np.hypot(u, v) < np.exp(log_R)
    return within.reshape(H, PARTS, W, PARTS).mean(axis=(1, 3))

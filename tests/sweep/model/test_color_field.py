"""The field of colors, against dense linear algebra, and what it tells of alpha."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.model.color_field import Grid, field_of
from blurmatte.sweep.model.student_t import student_weight

SHAPE = 17, 22
PITCH = 3.7


def picture(seed=0):
    """Light, alpha that is 0 around, and weights of nothing in particular."""
    rng = np.random.default_rng(seed)
    alpha = np.zeros(SHAPE)
    alpha[3:13, 4:19] = rng.uniform(0.1, 1, (10, 15))
    alpha[5, 6] = 0
    C, B = rng.uniform(0.1, 0.9, (2, *SHAPE, 3))
    V_C, V_B = rng.uniform(1e-4, 1e-3, (2, *SHAPE, 3))
    return (C, B, V_C, V_B), alpha, rng.uniform(0.1, 1, SHAPE)


def hats(alpha, grid):
    """(pixels, nodes), every hat by its definition."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    told = np.zeros((alpha.size, grid.size))
    for (j, i), node in np.ndenumerate(grid.number):
        if node >= 0:
            v, u = (np.maximum(1 - abs(k / PITCH - n), 0) for k, n in ((y, j), (x, i)))
            told[:, node] = np.where(alpha > 0, v * u, 0).ravel()
    return told


def dense(band):
    """The symmetric matrix that has this lower band."""
    m = band.shape[1]
    full = np.zeros((m, m))
    for k, diagonal in enumerate(band):
        full += np.diag(diagonal[: m - k], -k)
    return full + np.tril(full, -1).T


def test_hats_stand_on_the_nodes_around_the_object_and_sum_to_one():
    _, alpha, _ = picture()
    grid = Grid.over(alpha, PITCH)
    assert_allclose(grid.hats(alpha).reshape(alpha.size, -1), hats(alpha, grid), atol=1e-12)
    assert_allclose(grid.hats(alpha).sum(axis=2), alpha > 0)


def test_differences_are_those_of_neighbors():
    _, alpha, _ = picture()
    grid = Grid.over(alpha, PITCH)
    k = np.random.default_rng(1).normal(size=grid.size)
    i, j = grid.neighbors
    assert_allclose(k @ dense(grid.differences()) @ k, np.sum((k[i] - k[j]) ** 2))
    down, across = np.nonzero((grid.number[:-1] >= 0) & (grid.number[1:] >= 0))
    assert {*zip(grid.number[down, across], grid.number[down + 1, across], strict=True)} <= {
        *zip(i, j, strict=True)
    }


def test_residuals_are_what_the_colors_leave():
    light, alpha, weight = picture()
    C, B, V_C, V_B = light
    field = field_of(light, alpha, weight, PITCH)
    k = (hats(alpha, field.grid) @ field.colors).reshape(*SHAPE, 3)
    through = (1 - alpha)[..., None]
    e = (C - through * B - alpha[..., None] * k) / np.sqrt(V_C + through**2 * V_B)
    assert_allclose(field.residuals(light, alpha), np.moveaxis(e, 2, 0), atol=1e-9)


def test_colors_that_change_little_are_found():
    (C, B, V_C, V_B), alpha, weight = picture()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    k = np.stack([0.5 + 0.01 * y, 0.6 - 0.01 * x, 0.4 + 0 * x], axis=2)
    C = alpha[..., None] * k + (1 - alpha)[..., None] * B
    light = C, B, V_C * 1e-6, V_B * 1e-6
    field = field_of(light, alpha, weight, PITCH)
    assert_allclose(field.colors[:, 2], 0.4, atol=1e-3)
    assert np.abs(field.residuals(light, alpha)).max() < 0.5


def test_information_is_that_of_alpha_when_colors_follow():
    light, alpha, weight = picture()
    _, B, V_C, V_B = light
    J = np.random.default_rng(3).normal(size=(*SHAPE, 4)) * (alpha > 0)[..., None]
    field = field_of(light, alpha, weight, PITCH)
    e = field.residuals(light, alpha)
    H, g = field.information(J, light, alpha, weight, e)
    A, prior = hats(alpha, field.grid) * alpha.reshape(-1, 1), dense(field.prior)
    expected, slope = np.zeros((4, 4)), np.zeros(4)
    for c in range(3):
        V = V_C[..., c] + (1 - alpha) ** 2 * V_B[..., c]
        k = (hats(alpha, field.grid) @ field.colors[:, c]).reshape(SHAPE)
        behind = B[..., c] + (1 - alpha) * V_B[..., c] * e[c] / np.sqrt(V)
        D = ((behind - k) / np.sqrt(V)).reshape(-1, 1) * J.reshape(-1, 4)
        S, w = -A / np.sqrt(V).reshape(-1, 1), weight.reshape(-1, 1)
        cross = S.T @ (w * D)
        expected += D.T @ (w * D) - cross.T @ np.linalg.solve(S.T @ (w * S) + prior, cross)
        slope += D.T @ (w[:, 0] * e[c].ravel())
    assert_allclose(H, expected, rtol=1e-8, atol=1e-6 * np.abs(expected).max())
    assert_allclose(g, slope, rtol=1e-8)


@pytest.mark.parametrize("outlier", [False, True])
def test_what_cannot_be_noise_is_doubted(outlier):
    (C, B, V_C, V_B), alpha, weight = picture()
    C = alpha[..., None] * 0.5 + (1 - alpha)[..., None] * B
    if outlier:
        C[8, 10] += 5
    field = field_of((C, B, V_C, V_B), alpha, weight, PITCH)
    assert_allclose(field.colors, 0.5, atol=0.02)
    chi2 = (field.residuals((C, B, V_C, V_B), alpha) ** 2).sum(axis=0)
    assert (student_weight(chi2)[8, 10] < 1e-3) == outlier


def test_nothing_has_no_colors():
    light, alpha, weight = picture()
    field = field_of(light, 0 * alpha, weight, PITCH)
    assert field.colors.shape == (0, 3)
    assert_allclose(
        field.residuals(light, 0 * alpha),
        np.moveaxis((light[0] - light[1]) / np.sqrt(light[2] + light[3]), 2, 0),
    )

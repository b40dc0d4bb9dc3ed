from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates

from blurmatte.background.warp import (
    Warp,
    derivatives_by_h,
    homography,
    interpolated_variance,
    warped,
    warped_linearly,
    warped_mask,
)

SIZE = (40, 30)


def smooth_picture(x, y):
    return np.stack([np.sin(x / 5) * np.cos(y / 7), x * y / 1000, x * 0 + 2], axis=-1)


def grid():
    return np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0)), axis=-1)


def test_identity_maps_points_to_themselves():
    """exact"""
    xy = grid().reshape(-1, 2)
    assert np.allclose(Warp(np.zeros(8), SIZE).points(xy), xy, atol=1e-12)


def test_points_equal_matrix_product():
    """oracle: the matrix, applied to one point at a time."""
    h = np.array([0.02, -0.03, 0.05, 0.01, 0.04, -0.02, 0.015, -0.01])
    half = 20
    for x, y in ((0.0, 0.0), (39.0, 3.0), (12.5, 28.0)):
        u, v, w = homography(h) @ [(x - 19.5) / half, (y - 14.5) / half, 1]
        at = Warp(h, SIZE).points(np.array([[x, y]]))
        assert np.allclose(at, [[u / w * half + 19.5, v / w * half + 14.5]], atol=1e-12)


@pytest.mark.parametrize("upright", [True, False])
def test_points_satisfy_the_equations_of_lens_and_bends(upright):
    """oracle: each step of the definition, undone where it is an inverse."""
    lens, bends = 0.06, np.array([[0.02, -0.01], [0.015, 0.03]])
    xy, v = grid().reshape(-1, 2)[::61], int(upright)

    def bent(u, c):
        return u + c * u[:, v, None] ** 2

    def without_lens(u):
        return u * (1 + lens * np.sum(u**2, axis=1, keepdims=True))

    u = np.column_stack([without_lens(bent((xy - [19.5, 14.5]) / 20, bends[0])), np.ones(len(xy))])
    U = u @ homography(H).T
    found = (Warp(H, SIZE, lens, bends=bends, upright=upright).points(xy) - [19.5, 14.5]) / 20
    assert np.allclose(without_lens(bent(found, bends[1])), U[:, :2] / U[:, 2:], atol=1e-7)


def test_derivatives_equal_differences():
    """oracle: central differences."""
    h = np.array([0.02, -0.03, 0.05, 0.01, 0.04, -0.02, 0.015, -0.01])
    xy = grid().reshape(-1, 2)[::97]
    slopes = derivatives_by_h(h, xy, SIZE)
    for i in range(8):
        step = 1e-6 * np.eye(8)[i]
        ahead, behind = (Warp(h + s * step, SIZE).points(xy) for s in (1, -1))
        numeric = (ahead - behind) / 2e-6
        assert np.allclose(slopes[..., i], numeric, atol=1e-6)


H = np.array([0.02, -0.03, 0.05, 0.01, 0.04, -0.02, 0.015, -0.01])


@pytest.mark.parametrize(("warp", "order"), [(warped, 3), (warped_linearly, 1)])
def test_warped_picture_equals_splines_of_scipy(warp, order):
    """oracle: SciPy, one channel at a time, up to 12 pixels beyond the border."""
    picture = np.random.default_rng(0).random((30, 40, 3))
    at = Warp(H, SIZE).points(grid().reshape(-1, 2)).T[::-1]
    for c, found in enumerate(np.moveaxis(warp(picture, Warp(H, SIZE)), -1, 0)):
        expected = map_coordinates(picture[..., c], at, order=order, mode="nearest")
        assert np.allclose(found.ravel(), expected, atol=1e-12)


def test_warped_mask_lacks_pixels_that_false_ones_contribute_to():
    """exact: a shift by half a pixel loses a False pixel, its neighbors, and the border."""
    mask = np.ones((30, 40), bool)
    mask[10, 20] = False
    found = warped_mask(mask, Warp(np.array([0, 0, 0.5 / 20, 0, 0, 0, 0, 0]), SIZE))
    expected = np.ones_like(mask)
    expected[10, 18:22] = expected[[9, 11], 19:21] = False
    expected[:, 38:] = False
    assert np.array_equal(found[1:-1, 1:-1], expected[1:-1, 1:-1])


@pytest.mark.parametrize("step", [0.0, 0.25, 0.5])
def test_interpolated_variance_equals_that_of_interpolated_noise(step):
    """honest"""
    noise = np.random.default_rng(1).normal(size=(200, 200, 1))
    h = np.array([0, 0, step / 100, 0, 0, step / 100, 0, 0])
    inner = warped(noise, Warp(h, noise.shape[1::-1]))[20:180, 20:180]
    xy = np.full((1, 2), 20 + step)
    assert inner.var() == pytest.approx(interpolated_variance(xy), rel=0.05)


@pytest.mark.parametrize("upright", [True, False])
def test_a_bent_warp_and_its_inverse_cancel(upright):
    # exact
    bends = np.array([(0.03, -0.02), (-0.01, 0.04)])
    how = Warp(np.array([0.02, 0.01, 0.1, -0.02, 0, 0.05, 0.01, 0]), (90, 60), -0.05)
    how = replace(how, bends=bends, upright=upright)
    xy = np.random.default_rng(0).uniform(0, 60, (50, 2))
    assert_allclose(how.inverse.points(how.points(xy)), xy, atol=1e-6)


@pytest.mark.parametrize("upright", [True, False])
def test_pictures_are_interpolated_where_points_of_a_bent_warp_lie(upright):
    # oracle: light that is linear in x and y
    y, x = np.mgrid[:60, :90].astype(float)
    how = replace(Warp(np.array([0.02, 0, 0.05, 0, 0, 0.02, 0, 0]), (90, 60)), upright=upright)
    how = replace(how, bends=np.array([(0.03, -0.02), (-0.01, 0.04)]))
    xy = np.stack([x, y], axis=-1).reshape(-1, 2)
    found = warped_linearly(np.stack([x, y], axis=-1), how).reshape(-1, 2)
    expected = how.points(xy)
    inside = np.all((expected > 0) & (expected < (89, 59)), axis=1)
    assert_allclose(found[inside], expected[inside], atol=1e-9)

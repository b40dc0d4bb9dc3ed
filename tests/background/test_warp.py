import numpy as np
import pytest

from blurmatte.background.warp import homography, interpolate, interpolated_variance, map_points

SIZE = (40, 30)


def smooth_picture(x, y):
    return np.stack([np.sin(x / 5) * np.cos(y / 7), x * y / 1000, x * 0 + 2], axis=-1)


def grid():
    return np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0)), axis=-1)


def test_identity_maps_points_to_themselves():
    """exact"""
    xy = grid().reshape(-1, 2)
    assert np.allclose(map_points(np.zeros(8), xy, SIZE)[0], xy, atol=1e-12)


def test_map_points_equals_matrix_product():
    """oracle: the matrix, applied to one point at a time."""
    h = np.array([0.02, -0.03, 0.05, 0.01, 0.04, -0.02, 0.015, -0.01])
    half = 20
    for x, y in ((0.0, 0.0), (39.0, 3.0), (12.5, 28.0)):
        u, v, w = homography(h) @ [(x - 19.5) / half, (y - 14.5) / half, 1]
        at, _ = map_points(h, np.array([[x, y]]), SIZE)
        assert np.allclose(at, [[u / w * half + 19.5, v / w * half + 14.5]], atol=1e-12)


def test_derivatives_equal_differences():
    """oracle: central differences."""
    h = np.array([0.02, -0.03, 0.05, 0.01, 0.04, -0.02, 0.015, -0.01])
    xy = grid().reshape(-1, 2)[::97]
    _, slopes = map_points(h, xy, SIZE)
    for i in range(8):
        step = 1e-6 * np.eye(8)[i]
        numeric = (map_points(h + step, xy, SIZE)[0] - map_points(h - step, xy, SIZE)[0]) / 2e-6
        assert np.allclose(slopes[..., i], numeric, atol=1e-6)


def test_interpolate_recovers_smooth_picture():
    """exact up to the spline: a picture that changes little from pixel to pixel."""
    inner = grid()[8:-8, 8:-8].reshape(-1, 2) + np.array([0.37, -0.21])
    picture = smooth_picture(*np.moveaxis(grid(), -1, 0))
    truth = smooth_picture(*inner.T)
    assert np.allclose(interpolate(picture, inner), truth, atol=2e-4)


@pytest.mark.parametrize("step", [0.0, 0.25, 0.5])
def test_interpolated_variance_equals_that_of_interpolated_noise(step):
    """honest"""
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(200, 200, 1))
    xy = np.stack(np.meshgrid(np.arange(20, 180), np.arange(20, 180)), -1).reshape(-1, 2) + step
    assert interpolate(noise, xy).var() == pytest.approx(interpolated_variance(xy), rel=0.05)

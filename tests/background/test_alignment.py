"""Residuals of an alignment and their derivatives, against SciPy and against finite differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import map_coordinates

from blurmatte.background.alignment import ComparedPair, residuals_and_slopes
from blurmatte.background.warp import Warp, spline_coefficients, to_centered

SIZE = WIDTH, HEIGHT = 60, 40
POINTS = np.array([(x, y) for y in range(8, 32, 3) for x in range(8, 52, 3)])
H = np.array([0.01, -0.02, 0.03, 0.015, -0.01, 0.02, 0.004, -0.003])
FREE, ROWS = np.arange(8), np.arange(7)


@pytest.fixture(scope="module")
def plate():
    """A smooth picture (h, w, 3)."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([1 + np.sin(x / (5 + c)) * np.cos(y / (6 - c)) for c in range(3)], axis=-1)


def compared(plate, h, light, valid=None):
    """Residuals and derivatives for a black image and noise of 0.1, and the polynomials."""
    u, v = (POINTS * to_centered(SIZE)[0, 0] + to_centered(SIZE)[:2, 2]).T
    basis = np.stack([np.ones(len(u)), u, v, u * u, u * v, v * v], axis=1)
    slope_y, slope_x = (np.gradient(plate, axis=axis) for axis in (0, 1))
    valid = np.ones(plate.shape[:2], bool) if valid is None else valid
    black, sigma = np.zeros(plate.shape), np.full((len(POINTS), 3), 0.1)
    pictures = black, slope_x, slope_y, spline_coefficients(plate), np.zeros((*plate.shape, 2))
    level = ComparedPair(*pictures, valid, POINTS, sigma, basis)
    return *residuals_and_slopes(level, h, light, [*FREE], [*ROWS]), basis


def light(seed=0):
    """(7, 3) gain of about 1, offset and field."""
    numbers = 0.1 * np.random.default_rng(seed).standard_normal((7, 3))
    numbers[0] += 1
    return numbers


def test_residuals_equal_interpolated_plate(plate):
    """oracle: SciPy's splines."""
    own = light()
    residuals, _, basis = compared(plate, H, own)
    at = Warp(H, SIZE).points(POINTS.astype(float)).T[::-1]
    B = np.stack(
        [map_coordinates(plate[..., c], at, order=3, mode="nearest") for c in range(3)], -1
    )
    expected = (B * (basis @ own[[0, 2, 3, 4, 5, 6]]) + own[1]) / 0.1
    assert_allclose(residuals, expected, rtol=1e-5, atol=1e-5)


def test_homography_derivatives_equal_differences(plate):
    """oracle: central differences; the gradient of the plate is interpolated bilinearly."""
    own, step = light(), 1e-4
    _, slopes, _ = compared(plate, H, own)
    for k in range(8):
        ahead, behind = (compared(plate, H + s * step * (k == FREE), own)[0] for s in (1, -1))
        assert_allclose(slopes[..., k], (ahead - behind) / (2 * step), rtol=0.05, atol=1.5)


def test_light_derivatives_equal_differences(plate):
    """exact: residuals are linear in light."""
    own = light()
    before, slopes, _ = compared(plate, H, own)
    for c in range(3):
        for row in range(len(ROWS)):
            more = own.copy()
            more[row, c] += 1
            change = compared(plate, H, more)[0] - before
            assert_allclose(change[:, c], slopes[:, c, 8 + row], atol=1e-9)
            assert_allclose(np.delete(change, c, axis=1), 0, atol=1e-12)


def test_points_outside_the_plate_have_no_residual(plate):
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[:, : WIDTH // 2] = False
    residuals, slopes, _ = compared(plate, np.zeros(8), light(), valid)
    lost = POINTS[:, 0] < WIDTH // 2
    assert np.isnan(residuals[lost]).all()
    assert np.isfinite(residuals[~lost]).all()
    assert not slopes[lost].any()

"""Intrinsics: projection from space to pixels and its inverse."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte import Intrinsics

LENSES = {
    "pinhole": Intrinsics(800, 810, 320.5, 239),
    "four": Intrinsics(800, 810, 320.5, 239, np.array([-0.2, 0.05, 1e-3, -2e-3])),
    "five": Intrinsics(800, 810, 320.5, 239, np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])),
    "eight": Intrinsics(
        800, 810, 320, 239, np.array([0.2, 0.1, 1e-3, -2e-3, 0.01, 0.3, 0.1, 0.02])
    ),
    "fisheye": Intrinsics(300, 305, 320, 239, np.array([0.02, -0.01, 4e-3, -1e-3]), fisheye=True),
}
lenses = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
X = np.random.default_rng(0).uniform([-0.3, -0.25, 0.9], [0.3, 0.25, 1.5], (50, 3))


def matrix(lens):
    return np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]], float)


@lenses
def test_projection_agrees_with_opencv(lens):
    """oracle: in both directions."""
    cv2 = pytest.importorskip("cv2")
    K, zero = matrix(lens), np.zeros(3)
    if lens.fisheye:
        pixels, _ = cv2.fisheye.projectPoints(X[:, None], zero, zero, K, lens.distortion)
    else:
        pixels, _ = cv2.projectPoints(X[:, None], zero, zero, K, lens.distortion)
    assert_allclose(lens.project(X), pixels[:, 0], atol=1e-9)
    ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    if lens.fisheye:
        m = cv2.fisheye.undistortPoints(pixels, K, lens.distortion, criteria=ends)
    else:
        m = cv2.undistortPoints(pixels, K, lens.distortion, criteria=ends)
    assert_allclose(lens.undistort(pixels[:, 0]), m[:, 0], atol=1e-8)


@lenses
def test_rays_invert_the_projection(lens):
    """exact: to rounding, at the center too."""
    there = np.concatenate([X, [[0, 0, 1.0]]])
    rays = lens.rays(lens.project(there))
    assert_allclose(rays, there / np.linalg.norm(there, axis=1, keepdims=True), atol=1e-11)


@lenses
def test_area_of_a_small_disc_is_that_of_the_magnification(lens):
    """oracle: the area of a narrow cone of rays in the picture."""
    pixel = np.array([420.0, 330.0])
    center, angle = lens.rays(pixel), 2 * np.pi * np.arange(256) / 256
    u, v = np.linalg.svd(center[None])[2][1:]
    rho = 1e-3
    cone = center + np.tan(rho) * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    x, y = (lens.project(cone) - pixel).T
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    assert_allclose(lens.magnification(pixel), np.sqrt(area / np.pi) / rho, rtol=3e-4)


def test_points_outside_the_model_are_nan():
    """exact: beyond the turning point of the distortion, behind the camera, past 90° of a fisheye."""
    barrel = Intrinsics(100, 100, 0, 0, np.array([-0.3, 0, 0, 0]))
    assert np.isnan(barrel.undistort([[90.0, 0]])).all()
    assert np.isnan(barrel.undistort([[600.0, 300.0]])).all()
    assert np.isfinite(barrel.undistort([[40.0, 0]])).all()
    assert np.isnan(barrel.project([0, 0, -1])).all()
    assert np.isnan(Intrinsics(100, 100, 0, 0, fisheye=True).undistort([[160.0, 0]])).all()


def test_focal_lengths_in_millimeters():
    """exact: for a sensor's width, and for the diagonal of the 35 mm equivalent."""
    lens = Intrinsics.from_focal_length(50, (6000, 4000), sensor_width=36, std=0.5)
    assert_allclose(lens.values, [8333.333, 8333.333, 2999.5, 1999.5], rtol=1e-6)
    assert_allclose(lens.std[:2], 8333.333 / 100, rtol=1e-6)
    assert lens.covariance[0, 1] == lens.covariance[0, 0]
    phone = Intrinsics.from_focal_length(26, (4000, 3000))
    assert_allclose(phone.fx, 26 / np.hypot(36, 24) * 5000)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0, 1, 2, 3), "fx and fy must be positive"),
        ((1, 1, np.nan, 3), "fx and fy must be positive and all finite"),
        ((1, 1, 2, 3, np.zeros(3)), "distortion of a lens must have 0, 4, 5 or 8"),
        ((1, 1, 2, 3, np.zeros(5), True), "distortion of a fisheye must have 0 or 4"),
        ((1, 1, 2, 3, np.zeros(4), False, np.eye(4)), r"covariance must be finite, \(8, 8\)"),
    ],
)
def test_rejects_wrong_arguments(arguments, says):
    """door: argument, rule and value."""
    with pytest.raises(ValueError, match=says):
        Intrinsics(*arguments)
    with pytest.raises(ValueError, match="sensor_width must be positive"):
        Intrinsics.from_focal_length(50, (60, 40), -1)
    lens = Intrinsics(300, 300, 160, 120)
    with pytest.raises(ValueError, match=r"points must have the shape \(..., 3\), got \(\)"):
        lens.project(4.0)
    with pytest.raises(ValueError, match=r"pixels must have the shape \(..., 2\), got \(5, 3\)"):
        lens.undistort(np.zeros((5, 3)))


@lenses
def test_slopes_of_rays_are_their_derivatives(lens):
    """oracle: differences."""
    pixels = np.array([[320.5, 239.0], [100, 50], [600, 400]])
    for i, d in enumerate(1e-3 * np.eye(2)):
        numeric = (lens.rays(pixels + d) - lens.rays(pixels - d)) / 2e-3
        assert_allclose(lens.ray_slopes(pixels)[..., i], numeric, atol=1e-9)

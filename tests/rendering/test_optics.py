"""Optics: one linear, self-adjoint operator for light and truth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Camera, colorful_plate

LENSES = {
    "gaussian": {"blur": 0.8},
    "disc": {"defocus": 2.4},
    "both": {"blur": 1.3, "defocus": 1.7},
}


@pytest.fixture(params=LENSES, scope="module")
def lens(request):
    return Camera(bits=None, **LENSES[request.param])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_operator_is_linear(lens, rng):
    x, y = rng.normal(size=(2, 21, 17, 3))
    together = lens.through_optics(2 * x - 3 * y)
    assert_allclose(together, 2 * lens.through_optics(x) - 3 * lens.through_optics(y), atol=1e-14)


def test_operator_is_its_own_adjoint(lens, rng):
    x, y = rng.normal(size=(2, 21, 17))
    assert_allclose(np.vdot(lens.through_optics(x), y), np.vdot(x, lens.through_optics(y)))


def test_sum_and_constants_are_preserved(lens, rng):
    x = rng.uniform(size=(19, 23))
    assert_allclose(lens.through_optics(x).sum(), x.sum(), rtol=1e-12)
    assert_allclose(lens.through_optics(np.full((9, 12, 3), 0.37)), 0.37, rtol=1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_channels_are_filtered_independently(lens, rng, dtype):
    maps = rng.uniform(size=(15, 11, 5)).astype(dtype)
    blurred = lens.through_optics(maps)
    assert blurred.dtype == dtype
    for k in range(5):
        assert_array_equal(blurred[..., k], lens.through_optics(maps[..., k]))


def test_gaussian_has_its_standard_deviation():
    point = np.zeros((41, 41))
    point[20, 20] = 1
    spread = Camera(blur=2.5).through_optics(point)
    x = np.arange(41) - 20
    assert_allclose(spread[20] / spread[20, 20], np.exp(-(x**2) / (2 * 2.5**2)), atol=1e-5)


def test_disc_agrees_with_fine_samples():
    point = np.zeros((11, 11))
    point[5, 5] = 1
    fine = (np.arange(11 * 40) + 0.5) / 40 - 5.5
    inside = (fine[:, None] ** 2 + fine**2 < 3.2**2).reshape(11, 40, 11, 40).mean(axis=(1, 3))
    assert_allclose(Camera(defocus=3.2).through_optics(point), inside / inside.sum(), atol=1e-4)


def test_photographs_are_blurred_by_the_optics(lens):
    plate = colorful_plate((37, 29), 1, tile=9)
    assert_allclose(lens.photograph(plate, 0).rgb, lens.through_optics(plate), atol=1e-15)


def test_blurred_image_is_the_sum_of_its_blurred_parts(lens, rng):
    alpha = rng.uniform(size=(29, 37, 1))
    plate = colorful_plate((37, 29), 1, tile=9)
    light = alpha * [0.9, 0.5, 0.1]
    image = lens.photograph(light + (1 - alpha) * plate, 0).rgb
    parts = lens.through_optics(light) + lens.through_optics((1 - alpha) * plate)
    assert_allclose(image, parts, atol=1e-14)


def test_noise_is_that_of_the_blurred_light():
    noise, plate = NoiseModel(gain=1e-3), np.zeros((20, 20, 3))
    plate[:, 10:] = 0.8
    lens = Camera(noise, code_std=0.001, bits=None, blur=2)
    without_optics = Camera(noise, code_std=0.001, bits=None)
    blurred = without_optics.photograph(lens.through_optics(plate), 3)
    assert_array_equal(lens.photograph(plate, 3).rgb, blurred.rgb)
    assert_array_equal(lens.photograph(plate, 3).noise, blurred.noise)


def test_a_camera_without_optics_returns_its_input():
    x = np.ones((4, 5))
    assert Camera().through_optics(x) is x


def test_rejects_wrong_arguments():
    with pytest.raises(ValueError, match="blur must be finite and not negative, got -1"):
        Camera(blur=-1)
    with pytest.raises(ValueError, match="defocus must be finite and not negative, got nan"):
        Camera(defocus=np.nan)
    with pytest.raises(TypeError, match="values must be a NumPy array of floats, got uint8"):
        Camera(blur=1).through_optics(np.ones((3, 3), np.uint8))
    with pytest.raises(TypeError, match="values must be a NumPy array of floats, got list"):
        Camera(blur=1).through_optics([[1.0]])
    with pytest.raises(ValueError, match=r"values must be \(H, W\) or \(H, W, k\), got .* \(3,\)"):
        Camera(blur=1).through_optics(np.ones(3))

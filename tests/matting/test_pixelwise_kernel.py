"""The closed form against something slow and obvious: a search for the nearest model color."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar

from blurmatte.color import ColorModel
from blurmatte.matting import pixelwise_kernel as kernel
from blurmatte.matting.maps import PixelMaps, Quality
from blurmatte.matting.pixelwise import Pixelwise
from blurmatte.radiometry import NoiseModel

COUNT = 60


@pytest.fixture(params=[1, 2], ids=["line", "plane"])
def pixels(request):
    """Pixels that fit a model of colors badly: (model, C, B, σ_C², σ_B²), all (1, n, 3)."""
    rng = np.random.default_rng(request.param)
    basis = np.linalg.qr(rng.uniform(0.1, 1, (3, request.param)))[0]
    model = ColorModel(basis * np.sign(basis.sum(axis=0)))
    B = rng.uniform(0.2, 1, (1, COUNT, 3))
    P = rng.uniform(0.1, 0.4, (1, COUNT, request.param)) @ model.basis.T
    C = P + rng.uniform(0.2, 0.8, (1, COUNT, 1)) * B + rng.normal(0, 0.02, B.shape)
    return model, C, B, *(rng.uniform(0.5, 2, (2, *B.shape)) * 4e-4)


def nearest_color(C, model, variance):
    """The model's color P nearest to a color C, by weighted least squares; and its distance²."""
    weight = 1 / np.sqrt(variance)
    mixture = np.linalg.lstsq(model.basis * weight[:, None], C * weight)[0]
    P = model.basis @ mixture
    return P, float(np.sum(((C - P) * weight) ** 2))


def brute_force(C, B, vC, vB, model):
    """Search for the α at which C − (1 − α) B is nearest to the model."""
    normals = model.normals
    plain = float(np.sum((B @ normals) * ((B - C) @ normals)) / np.sum((B @ normals) ** 2))
    variance = vC + (1 - np.clip(plain, 0, 1)) ** 2 * vB

    def distance2(alpha):
        return nearest_color(C - (1 - alpha) * B, model, variance)[1]

    alpha = minimize_scalar(distance2, bounds=(-3, 4), method="bounded", options={"xatol": 1e-9}).x
    step = 0.1  # the distance is a parabola: its curvature is twice the information
    curvature = (distance2(alpha + step) + distance2(alpha - step) - 2 * distance2(alpha)) / step**2
    P = nearest_color(C - (1 - alpha) * B, model, variance)[0]
    return alpha, (2 / curvature) ** 0.5, distance2(alpha), P, variance


def closed_form(pixels) -> PixelMaps:
    model, C, B, vC, vB = pixels
    return Pixelwise()(C, B, model, vC, vB)


def test_alpha_std_and_light_equal_those_of_a_search(pixels):
    model, C, B, vC, vB = pixels
    maps = closed_form(pixels)
    for i in range(COUNT):
        alpha, std, _, P, _ = brute_force(C[0, i], B[0, i], vC[0, i], vB[0, i], model)
        assert_allclose(maps.alpha[0, i], alpha, atol=1e-5)
        assert_allclose(maps.alpha_std[0, i], std, rtol=1e-4)
        assert_allclose(maps.premultiplied[0, i], P, atol=1e-5)


def test_light_lies_in_the_model(pixels):
    maps = closed_form(pixels)
    assert_allclose(maps.premultiplied @ pixels[0].normals, 0, atol=1e-14)


def test_error_of_the_light_is_propagated_from_its_derivatives(pixels):
    """Oracle: finite differences of P by each channel of C."""
    model, C, B, vC, vB = pixels
    still = vB * 0  # then the weights do not move with C
    maps, h = Pixelwise()(C, B, model, vC, still), 1e-6
    variance = np.zeros_like(C)
    for c in range(3):
        moved = C + h * np.eye(3)[c]
        slope = (Pixelwise()(moved, B, model, vC, still).premultiplied - maps.premultiplied) / h
        variance += slope**2 * vC[..., c : c + 1]
    assert_allclose(maps.premultiplied_std, np.sqrt(variance), rtol=1e-4)


def test_misfit_is_flagged_beyond_four_sigma(pixels):
    """A pixel off the model by χ = 3.9 fits, by 4.1 it does not; every pixel fits rank 2."""
    model, C, B, *_ = pixels
    flags = {}
    for sigmas in (3.9, 4.1):
        alpha = 0.5
        P = 0.3 * model.basis.sum(axis=1)
        exact = P + (1 - alpha) * B
        if model.rank == 1:  # the direction in which α changes nothing, in units of its noise
            away = np.cross(np.broadcast_to(model.pole, B.shape), B)
            away /= np.linalg.norm(away, axis=-1, keepdims=True)
        else:
            away = np.broadcast_to(model.pole, B.shape)
        quality = exact + sigmas * 0.01 * away
        even = np.full_like(C, 0.01**2)
        flags[sigmas] = Pixelwise()(quality, B, model, even, 0 * even).quality & Quality.MISFIT
    assert not flags[3.9].any()
    assert bool(flags[4.1].all()) == (model.rank == 1)


def test_variance_of_light_is_the_noise_model():
    noise = NoiseModel(gain=(1e-3, 2e-3, 3e-3), read_std=0.01, relative_std=(0.1, 0.2, 0.3))
    coefficients = tuple(noise.coefficients.ravel())
    for light in (-0.5, 0.0, 0.2, 1.5):
        seen = [kernel._variance.py_func(light, coefficients, c) for c in range(3)]
        assert_allclose(seen, noise.variance(np.full(3, light)), rtol=1e-6)


def test_flags_of_the_kernel_are_bytes_with_the_bits_of_quality():
    flags = kernel._PLATE_IN_MODEL, kernel._OUT_OF_RANGE, kernel._MISFIT, kernel._UNKNOWN
    assert [flag.dtype for flag in flags] == [np.uint8] * 4
    assert [int(flag) for flag in flags] == [2, 4, 8, Quality.SATURATED | Quality.OCCLUDED]

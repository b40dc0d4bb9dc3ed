"""Sensor: photon and read noise, and the color filter array."""

import numpy as np

from blurmatte.checks import Floats, check_light
from blurmatte.radiometry import NoiseModel
from blurmatte.radiometry.mosaic import demosaic, tiled

Rng = int | np.random.Generator

BAYER = np.array([[0, 1], [1, 2]])  # red, green over green, blue


def add_noise(light: Floats, noise: NoiseModel, rng: Rng) -> Floats:
    """Add photon and read noise to light; the result has the shape and dtype of `light`.

    Both are drawn together from a normal distribution with their variance at the exact light: a good
    approximation above about 20 electrons per pixel (light > 20 · gain). The parameters are those of
    `Camera.photograph`.
    """
    check_light("light", light)
    return np.asarray(noisy(light, noise, np.random.default_rng(rng)), dtype=light.dtype)


def noisy(light: Floats, noise: NoiseModel, rng: np.random.Generator) -> Floats:
    """Add noise to light that is already checked; float64."""
    with_noise: Floats = light + np.sqrt(noise.variance(light)) * rng.standard_normal(light.shape)
    return with_noise


def through_mosaic(light: Floats) -> Floats:
    """Keep one channel per pixel and interpolate the other two from its neighbors, (H, W, 3)."""
    if min(light.shape[:2]) < 2:
        height, width = light.shape[:2]
        raise ValueError(f"light must be 2x2 pixels or more for a mosaic, got {width}x{height}")
    seen = tiled(BAYER, light.shape[:2])[..., None]
    return demosaic(np.take_along_axis(light, seen, axis=2)[..., 0], BAYER)

"""In a camera: photon and read noise, the color filter array, and processing of code values.

Phones reduce noise, apply a tone curve and sharpen. In this file `values` are R'G'B' code values 0…1,
(H, W, 3). None of the three steps is linear in light, and the file does not record them: decoding it
as sRGB does not recover the light.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array, Floats, check_light, check_not_negative, check_positive
from blurmatte.radiometry import LUMA_WEIGHTS, YCBCR, NoiseModel
from blurmatte.radiometry.sensor import demosaic, tiled

Rng = int | np.random.Generator

BAYER = np.array([[0, 1], [1, 2]])  # red, green over green, blue


@dataclass(frozen=True)
class Processing:
    """Noise reduction, then a tone curve, then sharpening of code values.

    Parameters
    ----------
    noise_reduction : float
        Threshold s of a guided filter, in standard deviations of the noise, 0 or more. A variation of
        luma within 5 x 5 pixels of s times the noise is halved; stronger edges are preserved. In
        uniform regions the noise of luma is divided by about 1 + s², at most by 7. Chroma is smoothed
        within 9 x 9 pixels and at 2 s.
    tone : float
        Contrast added by an S-curve v + tone · (3 v² - 2 v³ - v), 0…1. It fixes code values of 0, 0.5
        and 1; its slope is 1 + tone / 2 in the middle and 1 - tone at both ends.
    sharpening : float
        Amount of an unsharp mask, 0 or more: factor of the difference between luma and blurred luma,
        which is added to all three channels.
    sharpening_radius : float
        Standard deviation of that blur, pixels, above 0.

    Raises
    ------
    ValueError
        For a number outside its range.
    """

    noise_reduction: float = 0.0
    tone: float = 0.0
    sharpening: float = 0.0
    sharpening_radius: float = 1.0

    def __post_init__(self) -> None:
        for name in ("noise_reduction", "sharpening"):
            check_not_negative(name, getattr(self, name))
        if not 0 <= self.tone <= 1:
            raise ValueError(f"tone must lie between 0 and 1, got {self.tone}")
        check_positive("sharpening_radius", self.sharpening_radius, "pixels")

    @property
    def active(self) -> bool:
        """True if any step is active."""
        return self.noise_reduction > 0 or self.tone > 0 or self.sharpening > 0

    def apply(self, values: Floats, variance: Floats) -> Array:
        """Process code values whose noise has a variance; not clipped: sharpening overshoots."""
        result: Array = np.asarray(values, dtype=np.float64)
        if self.noise_reduction > 0:
            result = _denoised(result, variance, self.noise_reduction)
        if self.tone > 0:
            result = tone_curve(result, self.tone)
        if self.sharpening > 0:
            result = _sharpened(result, self.sharpening, self.sharpening_radius)
        return result


def tone_curve(values: Floats, tone: float) -> Array:
    """The S-curve of `Processing`, extrapolated linearly outside 0…1."""
    inside = np.clip(values, 0, 1)
    curve = inside + tone * inside * (1 - inside) * (2 * inside - 1)
    return np.asarray(curve + (1 - tone) * (values - inside))


def _denoised(values: Array, variance: Floats, strength: float) -> Array:
    ycbcr, variance = values @ YCBCR.T, variance @ YCBCR.T**2
    filters = (1, 5), (2, 9), (2, 9)  # factor of the threshold, and window, of Y', Cb and Cr
    parts = [
        _guided_filter(ycbcr[..., c], variance[..., c], factor * strength, window)
        for c, (factor, window) in enumerate(filters)
    ]
    return np.asarray(np.stack(parts, axis=-1) @ np.linalg.inv(YCBCR).T)


def _guided_filter(x: Floats, variance: Floats, strength: float, window: int) -> Floats:
    """Self-guided filter (He, Sun and Tang, 2013) of a map (H, W).

    In each window x is replaced by a x + (1 - a) mean(x) with a = var(x) / (var(x) + strength² · noise
    variance); a and (1 - a) mean(x) are averaged over overlapping windows.
    """
    mean = _window_mean(x, window)
    spread = np.maximum(_window_mean(x**2, window) - mean**2, 0)
    total = spread + strength**2 * _window_mean(variance, window)
    a = np.divide(spread, total, out=np.ones_like(total), where=total > 0)
    return _window_mean(a, window) * x + _window_mean((1 - a) * mean, window)


def _window_mean(x: Floats, window: int) -> Floats:
    return np.asarray(scipy.ndimage.uniform_filter(x, window, mode="reflect"))


def _sharpened(values: Array, amount: float, radius: float) -> Array:
    Y = values @ np.array(LUMA_WEIGHTS)
    return np.asarray(values + amount * (Y - scipy.ndimage.gaussian_filter(Y, radius))[..., None])


def add_noise(light: Floats, noise: NoiseModel, rng: Rng) -> Floats:
    """Add photon and read noise to light; the result has the shape and dtype of `light`.

    Both are drawn together from a normal distribution with their variance at the exact light: a good
    approximation above about 20 electrons per pixel (light > 20 · gain). The parameters are those of
    `Camera.photograph`.
    """
    light = check_light("light", light)
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

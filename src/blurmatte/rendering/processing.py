"""What the processor of a phone does to code values: less noise, more contrast, sharper edges.

In this file `values` are R'G'B' code values 0…1, (H, W, 3). None of the three steps is linear in
light, and the file does not record them: whoever decodes it as sRGB gets light that was not there.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.rendering.ycbcr import from_ycbcr, luma, to_ycbcr, ycbcr_variance

Array = npt.NDArray[np.float64]

# Noise reduction: side of the window, pixels, and threshold relative to that of luma.
_LUMA_WINDOW, _CHROMA_WINDOW = 5, 9
_CHROMA_STRENGTH = 2.0


@dataclass(frozen=True)
class Processing:
    """Noise reduction, then a tone curve, then sharpening, of code values.

    Parameters
    ----------
    noise_reduction : float
        Threshold s of a guided filter, in standard deviations of the noise, 0 or more. A variation of
        luma within 5 x 5 pixels that is s times the noise is halved; stronger edges stay. In even
        regions the noise of luma is divided by about 1 + s², at most by 7. Chroma is smoothed within
        9 x 9 pixels and at 2 s.
    tone : float
        Contrast added by an S-curve v + tone · (3 v² - 2 v³ - v), 0…1: code values of 0, 0.5 and 1
        stay, and the slope is 1 + tone / 2 in the middle and 1 - tone at both ends.
    sharpening : float
        Amount of an unsharp mask, 0 or more: so many times the difference between luma and blurred
        luma is added to all three channels.
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
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be finite and not negative, got {value}")
        if not 0 <= self.tone <= 1:
            raise ValueError(f"tone must lie between 0 and 1, got {self.tone}")
        if not (np.isfinite(self.sharpening_radius) and self.sharpening_radius > 0):
            raise ValueError(
                f"sharpening_radius must be a positive number of pixels, got "
                f"{self.sharpening_radius}"
            )

    @property
    def active(self) -> bool:
        """Whether any step changes anything."""
        return self.noise_reduction > 0 or self.tone > 0 or self.sharpening > 0

    def apply(self, values: Floats, variance: Floats) -> Array:
        """Processed code values.

        Parameters
        ----------
        values : (H, W, 3) float
            Code values; 0…1 is black to white.
        variance : (H, W, 3) float
            Variance of their noise, code values².

        Returns
        -------
        (H, W, 3) float64
            Not clipped: sharpening overshoots beside edges.
        """
        result: Array = np.asarray(values, dtype=np.float64)
        if self.noise_reduction > 0:
            result = _denoised(result, variance, self.noise_reduction)
        if self.tone > 0:
            result = tone_curve(result, self.tone)
        if self.sharpening > 0:
            result = _sharpened(result, self.sharpening, self.sharpening_radius)
        return result


def tone_curve(values: Floats, tone: float) -> Array:
    """The S-curve of `Processing`; beyond 0…1 it goes on straight with its slope there."""
    inside = np.clip(values, 0, 1)
    curve = inside + tone * inside * (1 - inside) * (2 * inside - 1)
    return np.asarray(curve + (1 - tone) * (values - inside))


def _denoised(values: Array, variance: Floats, strength: float) -> Array:
    Y, Cb, Cr = to_ycbcr(values)
    of_Y, of_Cb, of_Cr = np.moveaxis(ycbcr_variance(variance), -1, 0)
    chroma = _CHROMA_STRENGTH * strength
    return np.asarray(
        from_ycbcr(
            _guided_filter(Y, of_Y, strength, _LUMA_WINDOW),
            _guided_filter(Cb, of_Cb, chroma, _CHROMA_WINDOW),
            _guided_filter(Cr, of_Cr, chroma, _CHROMA_WINDOW),
        )
    )


def _guided_filter(x: Floats, variance: Floats, strength: float, window: int) -> Floats:
    """Guided filter (He, Sun and Tang, 2013) of a map (H, W), which is its own guide.

    In each window x is replaced by a x + (1 - a) mean(x) with a = var(x) / (var(x) + strength² · noise
    variance); where windows overlap, a and (1 - a) mean(x) are averaged.
    """
    mean = _window_mean(x, window)
    spread = np.maximum(_window_mean(x**2, window) - mean**2, 0)
    total = spread + strength**2 * _window_mean(variance, window)
    a = np.divide(spread, total, out=np.ones_like(total), where=total > 0)
    return _window_mean(a, window) * x + _window_mean((1 - a) * mean, window)


def _window_mean(x: Floats, window: int) -> Floats:
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(x, window, mode="reflect"))


def _sharpened(values: Array, amount: float, radius: float) -> Array:
    from scipy.ndimage import gaussian_filter

    Y = luma(values)
    return np.asarray(values + amount * (Y - gaussian_filter(Y, radius))[..., None])

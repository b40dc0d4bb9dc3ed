"""A measurement of noise in words."""

import numpy as np

from blurmatte.calibration import NoiseFit
from blurmatte.explain.numbers import channels
from blurmatte.statistics import BLOCK_SIZES

_MIN_VARIANCE_INFLATION = 1.5  # of blocks; chance makes less, except in small pictures


def noise_in_words(fit: NoiseFit) -> list[str]:
    """Sentences."""
    return [*_sensor(fit), *_rounding(fit), *_correlation(fit), *_left_out(fit)]


def _sensor(fit: NoiseFit) -> list[str]:
    """Gain, read noise, and noise proportional to the light."""
    sensor, said = fit.sensor, []
    gain, relative = np.array(sensor.gain), np.array(sensor.relative_std)
    said.append(f"Gain, light per electron: {channels(gain, fit.gain_std)}.")
    if np.all(gain > 3 * fit.gain_std) and np.max(fit.variance_inflation) < _MIN_VARIANCE_INFLATION:
        electrons = channels(1 / gain, fit.gain_std / gain**2)
        said.append(f"White is {electrons} electrons.")
    said.append(f"Read noise, 1 is white: {channels(sensor.read_std, fit.read_std_std)}.")
    if np.any(relative > 3 * fit.relative_std_std):
        said.append(f"And this fraction of the light: {channels(relative, fit.relative_std_std)}.")
    if not fit.separable:
        said.append(
            "The light is too even, or the noise too uncertain, to separate gain from read noise: only "
            "their sum is known; show dark and bright things."
        )
    return said


def _rounding(fit: NoiseFit) -> list[str]:
    if not np.any(fit.rounding.coefficients):
        return []
    share = float(np.mean(fit.rounding_share(0.2)))
    return [f"Rounding to code values makes {share:.2g} of the variance at light 0.2, besides."]


def _correlation(fit: NoiseFit) -> list[str]:
    """The correlation of noise between pixels."""
    if np.max(fit.variance_inflation) < _MIN_VARIANCE_INFLATION:
        return ["Every pixel has noise of its own."]
    ratios = ", ".join(
        f"{size}x{size}: {ratio:.2g}"
        for size, ratio in zip(BLOCK_SIZES, fit.variance_inflation.mean(axis=0), strict=True)
    )
    scale = ", ".join(f"{scale:.1f}" for scale in fit.scale)
    return [
        f"Noise is correlated over {scale} px (R, G, B), which compression, demosaicing, texture and "
        f"movement cause; the variance of sums over blocks is inflated by: {ratios}."
    ]


def _left_out(fit: NoiseFit) -> list[str]:
    if fit.changed < 0.001:
        return []
    return [f"{fit.changed:.1%} of the pixels changed by more than noise and were left out."]

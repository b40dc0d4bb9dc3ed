"""What was measured of noise."""

import numpy as np

from blurmatte.calibration import NoiseFit
from blurmatte.explain.numbers import channels
from blurmatte.statistics import BLOCK_SIZES

_APART = 1.5  # coherence of noise: chance makes less, in pictures that are not small
_MEDIUM = 0.2  # light


def noise_in_words(fit: NoiseFit) -> list[str]:
    """Sentences."""
    return [*_sensor(fit), *_rounding(fit), *_coherence(fit), *_left_out(fit)]


def _sensor(fit: NoiseFit) -> list[str]:
    """Gain, read noise, and what is a fraction of the light."""
    sensor, said = fit.sensor, []
    gain, relative = np.array(sensor.gain), np.array(sensor.relative_std)
    said.append(f"Gain, light per electron: {channels(gain, fit.gain_std)}.")
    if np.all(gain > 3 * fit.gain_std) and np.max(fit.variance_inflation) < _APART:
        electrons = channels(1 / gain, fit.gain_std / gain**2)
        said.append(f"White is {electrons} electrons.")
    said.append(f"Read noise, 1 is white: {channels(sensor.read_std, fit.read_std_std)}.")
    if np.any(relative > 3 * fit.relative_std_std):
        said.append(f"And this fraction of the light: {channels(relative, fit.relative_std_std)}.")
    if not fit.separable:
        said.append(
            "The light is too even, or the noise too uncertain, to tell gain from read noise: only "
            "their sum is known; show dark and bright things."
        )
    return said


def _rounding(fit: NoiseFit) -> list[str]:
    if not np.any(fit.rounding.coefficients):
        return []
    share = float(np.mean(fit.rounding_share(_MEDIUM)))
    return [f"Rounding to code values makes {share:.2g} of the variance at light 0.2, besides."]


def _coherence(fit: NoiseFit) -> list[str]:
    """How noise hangs together."""
    if np.max(fit.variance_inflation) < _APART:
        return ["Every pixel has noise of its own."]
    ratios = ", ".join(
        f"{size}x{size}: {ratio:.2g}"
        for size, ratio in zip(BLOCK_SIZES, fit.variance_inflation.mean(axis=0), strict=True)
    )
    scale = ", ".join(f"{scale:.1f}" for scale in fit.scale)
    return [
        f"Noise hangs together over {scale} px (R, G, B), as compression, demosaicing, texture and "
        f"movement make it; over blocks it adds up to times its variance: {ratios}."
    ]


def _left_out(fit: NoiseFit) -> list[str]:
    if fit.changed < 0.001:
        return []
    return [f"{fit.changed:.1%} of the pixels changed by more than noise and were left out."]

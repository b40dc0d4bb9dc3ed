"""Measurements of a camera and a scene in words: noise, transfer curves, plates."""

from collections.abc import Iterator, Sequence

import numpy as np

from blurmatte.background import ParallaxRegion, PlateFit
from blurmatte.background.registration import CameraPath
from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.explain.numbers import channels
from blurmatte.radiometry import SRGB, Transfer, nearest_transfer
from blurmatte.statistics import BLOCK_SIZES

_MIN_VARIANCE_INFLATION = 1.5  # of blocks; chance makes less, except in small pictures


def curve_in_words(curve: Transfer) -> list[str]:
    """Sentences."""
    nearest, off = nearest_transfer(curve)
    black, middle, white = curve.decode(np.array([0, 0.5, 1]))
    return [
        f"Nearest to {nearest.name}, which is off by up to {off:.1%} of full scale.",
        f"Light {black:.4g}, {middle:.4g} and {white:.4g} at code values 0, 1/2 and 1.",
    ]


def response_in_words(fit: ResponseFit) -> list[str]:
    """Sentences, the curve's own first."""
    low, high = fit.seen
    lines = [
        *curve_in_words(fit.transfer),
        f"The light is known to {np.max(fit.std):.1%} of full scale (one standard deviation), "
        f"{np.max(fit.std[: len(fit.std) // 2]):.1%} in the darker half of the code values.",
        f"{fit.agreement:.0%} of the places agree; noise {255 * fit.noise:.2g} of 255 code values.",
        f"Code values {255 * low:.0f} to {255 * high:.0f} of 255 were seen twice; beyond them the "
        "curve is continued as cameras do.",
        "Exposure times as the pictures have them: "
        + ", ".join(f"{time:.3g} s" for time in fit.exposure_times)
        + ".",
    ]
    if not fit.channels_agree:
        worst = max(fit.channel_difference)
        lines.append(
            f"Red, green and blue do not have one curve: alone, one differs by up to {worst:.1%}; "
            "the camera mixes colors after the curve, and light is known no better than that."
        )
    return lines


def plate_in_words(fit: PlateFit) -> Iterator[str]:
    """Sentences."""
    yield from camera_in_words(fit.camera, range(len(fit.camera.views) if fit.camera else 0))
    plate, frames = fit.plate, len(fit.gain)
    free = fit.coverage[plate.valid]
    yield (
        f"{frames} frames; half of the pixels were free in {np.median(free):.0%} of them or more, "
        f"the rarest 1% in {np.quantile(free, 0.01):.0%}."
    )
    brightness = fit.gain.mean(axis=1)
    change = brightness.max() / brightness.min() - 1
    yield f"The light of the scene changed by {change:.1%}; that is divided out."
    std = np.sqrt(np.median(plate.variance[plate.valid], axis=0))
    light = np.median(plate.rgb[plate.valid], axis=0)
    steps = std / (SRGB.slope(light) / 255)
    yield (
        f"Noise of the plate: {steps.mean():.2f} of a step of 8-bit sRGB at the median pixel "
        f"({std.mean():.2g} of white)."
    )
    clipped = ~plate.valid & (fit.coverage > 0)
    unknown = ~plate.valid & (fit.coverage == 0)
    yield (
        f"Not known, for no light was seen much more often than others: {unknown.mean():.1%} of the "
        f"pixels. Clipped: {clipped.mean():.1%}."
    )


def camera_in_words(camera: CameraPath | None, numbers: Sequence[int]) -> list[str]:
    """Sentences about a camera that moves, and the frames that are not registered, by number."""
    if camera is None:
        return []
    to = "the plate" if camera.reference is None else f"frame {numbers[camera.reference]}"
    said = [
        f"The camera moves: {len(camera.registered)} of {len(camera.views)} frames are registered to "
        f"{to}, displaced by up to {camera.reach:.1f} pixels."
    ]
    if camera.lens:
        said.append(f"The lens bends straight lines: its term is {camera.lens:+.3f}.")
    said += parallax_in_words(camera.parallax)
    return said + [
        f"Frame {numbers[k]} is not registered: {why}." for k, why in camera.unregistered
    ]


def parallax_in_words(regions: Sequence[ParallaxRegion]) -> list[str]:
    """A sentence about the parts of a scene at another depth, if there are any."""
    if not regions:
        return []
    named = "; ".join(map(str, regions[:3])) + (" …" if len(regions) > 3 else "")
    return [
        f"Parallax: the camera moved in space, and the plate is shifted at {named} against the rest; "
        "do not use alpha there, or turn the camera about its lens."
    ]


def noise_in_words(fit: NoiseFit) -> Iterator[str]:
    """Sentences."""
    sensor, independent = fit.sensor, np.max(fit.variance_inflation) < _MIN_VARIANCE_INFLATION
    gain, relative = np.array(sensor.gain), np.array(sensor.relative_std)
    yield f"Gain, light per electron: {channels(gain, fit.gain_std)}."
    if np.all(gain > 3 * fit.gain_std) and independent:
        yield f"White is {channels(1 / gain, fit.gain_std / gain**2)} electrons."
    yield f"Read noise, 1 is white: {channels(sensor.read_std, fit.read_std_std)}."
    if np.any(relative > 3 * fit.relative_std_std):
        yield f"And this fraction of the light: {channels(relative, fit.relative_std_std)}."
    if not fit.separable:
        yield (
            "The light is too even, or the noise too uncertain, to separate gain from read noise: only "
            "their sum is known; show dark and bright things."
        )
    if np.any(fit.rounding.coefficients):
        share = float(np.mean(fit.rounding_share(0.2)))
        yield f"Rounding to code values makes {share:.2g} of the variance at light 0.2, besides."
    yield "Every pixel has noise of its own." if independent else _correlation(fit)
    if fit.changed >= 0.001:
        yield f"{fit.changed:.1%} of the pixels changed by more than noise and were left out."


def _correlation(fit: NoiseFit) -> str:
    """The correlation of noise between pixels."""
    ratios = ", ".join(
        f"{size}x{size}: {ratio:.2g}"
        for size, ratio in zip(BLOCK_SIZES, fit.variance_inflation.mean(axis=0), strict=True)
    )
    scale = ", ".join(f"{scale:.1f}" for scale in fit.scale)
    return (
        f"Noise is correlated over {scale} px (R, G, B), which compression, demosaicing, texture and "
        f"movement cause; the variance of sums over blocks is inflated by: {ratios}."
    )

"""A plate and its noise in words."""

from collections.abc import Iterator

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.radiometry import SRGB


def plate_in_words(fit: PlateFit) -> Iterator[str]:
    """Sentences."""
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

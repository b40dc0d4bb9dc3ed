"""Inpainting of light: normalized convolution of the neighbors' light where a pixel has none.

Where all channels are clipped, or the plate is unknown, alpha may still be known from a sweep or from
neighbors. Without light the layer would have a hole there.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.radiometry import LinearImage

_NOT_FILLED = Quality.OUTSIDE | Quality.OCCLUDED | Quality.PLATE_IN_MODEL


def inpaint_light(maps: PixelMaps, image: LinearImage, plate: LinearImage) -> None:
    """Write light where alpha is known and light is not.

    Color and brightness are the alpha-weighted mean of the nearest neighbors; the error is their
    standard deviation. A channel that the image clips has at least the light that the image shows; the
    excess over the mean is added to light and error.

    The maps, of the same box as the pictures, are changed in place.
    """
    alpha = np.clip(maps.alpha.astype(float), 0, 1)
    here = ~has_flag(maps.quality, _NOT_FILLED) & np.isfinite(maps.alpha_std) & (alpha > 0)
    lit = np.isfinite(maps.premultiplied_std).all(axis=-1)
    dark, known = here & ~lit, here & lit
    if not dark.any() or not known.any():
        return
    color, spread = _of_neighbors(alpha, maps.premultiplied.astype(float), known, dark)
    a, a_std = alpha[dark][:, None], maps.alpha_std[dark][:, None]
    lower_bound = image.rgb[dark] - (1 - a) * plate.rgb[dark]
    bounded = image.clipped[dark] & (plate.usable[dark] | (a == 1))
    excess = np.where(bounded, np.maximum(lower_bound - a * color, 0), 0)
    maps.premultiplied[dark] = a * color + excess
    maps.premultiplied_std[dark] = np.sqrt((a * spread) ** 2 + (a_std * color) ** 2 + excess**2)


def _of_neighbors(alpha: Array, P: Array, known: Bools, dark: Bools) -> tuple[Array, Array]:
    """(n, 3) mean color of the neighbors of each dark pixel, and its standard deviation.

    Gaussian neighborhoods double in width until at least 5 % of their alpha has known light.
    """
    weight = np.where(known, alpha, 0)
    light = np.where(known[..., None], P, 0)
    squares = light**2 / np.maximum(alpha, 1e-6)[..., None]
    color, spread = np.zeros((2, np.count_nonzero(dark), 3))
    missing, std_px = np.ones(len(color), bool), 1.5
    while missing.any():
        sides = std_px, std_px, 0
        within = scipy.ndimage.gaussian_filter(weight, std_px, mode="constant")[dark]
        total = scipy.ndimage.gaussian_filter(alpha * (known | dark), std_px, mode="constant")[dark]
        sums, second = (
            scipy.ndimage.gaussian_filter(m, sides, mode="constant")[dark] for m in (light, squares)
        )
        min_fraction = 0.05 if std_px < max(alpha.shape) else 0.0
        now = missing & (within > min_fraction * total)
        color[now] = sums[now] / within[now, None]
        variance = second[now] / within[now, None] - color[now] ** 2
        spread[now] = np.sqrt(np.maximum(variance, 0))
        missing, std_px = missing & ~now, 2 * std_px
    return color, spread

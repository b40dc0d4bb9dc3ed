"""Light of pixels that do not tell their own: that of their neighbors.

Where all channels are clipped, or the plate is not known, path and shape or neighbors still tell alpha,
and a layer without light would have a hole there.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

_NEAREST = 1.5  # pixels: standard deviation of the first neighborhood; each next is twice as wide
_ENOUGH = 0.05  # of a neighborhood's alpha: where less is told, a wider one is asked
_NEVER_TOLD = Quality.OUTSIDE | Quality.OCCLUDED | Quality.PLATE_IN_MODEL


def carry_light(maps: PixelMaps, image: LinearImage, plate: LinearImage) -> None:
    """Write light where alpha is told and light is not.

    Its color and brightness are the mean of the nearest neighbors, weighted by alpha, its error as
    much as they differ. Channels that the image clips have at least the light that it shows, and may
    have as much more again.

    Parameters
    ----------
    maps : PixelMaps
        Around a streak; changed in place.
    image, plate : LinearImage
        Of the same place.
    """
    alpha = np.clip(maps.alpha.astype(float), 0, 1)
    here = ((maps.quality & np.uint8(_NEVER_TOLD)) == 0) & np.isfinite(maps.alpha_std)
    lit = np.isfinite(maps.premultiplied_std).all(axis=-1)
    dark = here & (alpha > 0) & ~lit
    told = here & (alpha > 0) & lit
    if not dark.any() or not told.any():
        return
    color, spread = _of_neighbors(alpha, maps.premultiplied.astype(float), told, dark)
    a, a_std = alpha[dark][:, None], maps.alpha_std[dark][:, None]
    least = image.rgb[dark] - (1 - a) * plate.rgb[dark]
    shown = image.clipped[dark] & (plate.usable[dark] | (a == 1))
    more = np.where(shown, np.maximum(least - a * color, 0), 0)
    maps.premultiplied[dark] = a * color + more
    maps.premultiplied_std[dark] = np.sqrt((a * spread) ** 2 + (a_std * color) ** 2 + more**2)


def _of_neighbors(alpha: Array, P: Array, told: Bools, dark: Bools) -> tuple[Array, Array]:
    """(n, 3) mean color of the neighbors of each dark pixel, and its standard deviation."""
    from scipy.ndimage import gaussian_filter

    weight = np.where(told, alpha, 0)
    light = np.where(told[..., None], P, 0)
    squares = light**2 / np.maximum(alpha, 1e-6)[..., None]
    color, spread = np.zeros((2, np.count_nonzero(dark), 3))
    left, size = np.ones(len(color), bool), _NEAREST
    while left.any():
        sides = size, size, 0
        within = gaussian_filter(weight, size, mode="constant")[dark]
        all_told = gaussian_filter(alpha * (told | dark), size, mode="constant")[dark]
        sums, second = (gaussian_filter(m, sides, mode="constant")[dark] for m in (light, squares))
        enough = _ENOUGH if size < max(alpha.shape) else 0.0
        now = left & (within > enough * all_told)
        color[now] = sums[now] / within[now, None]
        variance = second[now] / within[now, None] - color[now] ** 2
        spread[now] = np.sqrt(np.maximum(variance, 0))
        left, size = left & ~now, 2 * size
    return color, spread

"""Shadow flags: pixels of the streak that only lost light, if no sweep locates the object.

Black parts of an object look the same, and alpha is that of such a part. If it is a shadow, alpha is
only the light divided by the object's brightness; the difference is added to the error.
"""

import numpy as np

from blurmatte.checks import Bools
from blurmatte.color.model import ColorModel
from blurmatte.color.shadow_test import darker_pixels
from blurmatte.matting.maps import PixelMaps, Quality, has_flag
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.shadow_mask import cast_shadow_mask


def mark_shadow(
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    without_sweep: bool,
    whole: bool,
) -> float:
    """Set the flag SHADOW where the image is only darker than the plate, and increase the error there.

    maps: a solution; flags and errors are changed in place.
    image, plate: noise known.
    without_sweep: whether no sweep locates the object. Then, if it has one color, pixels with
        clearly less light than the rest of the object are shadow.
    whole: whether the whole streak only lost light.

    Returns the error of the sum of alpha if the marked pixels are the object's shadow.
    """
    box = streak.box
    place = slice(box[1], box[3]), slice(box[0], box[2])
    if not whole and not (without_sweep and model.rank == 1):
        return 0.0
    shadow = streak.mask
    if not whole:
        brightness = _brightness(maps, model, streak.mask)
        shadow = cast_shadow_mask(image, plate, streak, model.pole, brightness)
    marked = (shadow & streak.mask)[place] & darker_pixels(image.crop(box), plate.crop(box))
    maps.quality[place] |= marked * np.uint8(Quality.SHADOW)
    if whole or not marked.any():
        return 0.0
    lit = _brightness(maps, model, streak.mask & ~has_flag(maps.quality, Quality.SHADOW))
    return _widen(maps.within(box), marked, model, lit)


def _widen(maps: PixelMaps, marked: Bools, model: ColorModel, brightness: float) -> float:
    """Add the alpha in excess of the light to the error; the sum of the excess."""
    alpha = maps.alpha[marked].astype(float)
    light = np.nan_to_num(maps.premultiplied[marked] @ model.pole)
    excess = np.maximum(alpha - np.clip(light / max(brightness, 1e-12), 0, 1), 0)
    maps.alpha_std[marked] = np.hypot(maps.alpha_std[marked], excess)
    return float(excess.sum())


def _brightness(maps: PixelMaps, model: ColorModel, inside: Bools) -> float:
    """Light of the object along its color at alpha 1."""
    y, x = np.nonzero(inside)
    known = np.isfinite(maps.premultiplied_std[y, x]).all(axis=-1)
    known &= ~has_flag(maps.quality[y, x], Quality.PLATE_IN_MODEL)
    y, x = y[known], x[known]
    alpha = np.clip(maps.alpha[y, x], 0, 1).astype(float)
    light = maps.premultiplied[y, x] @ model.pole
    return float(np.sum(light * alpha) / max(float(np.sum(alpha**2)), 1e-12))

"""Which of the streak's pixels only lost light, as far as no sweep says where the object was.

Black parts of an object look the same, and alpha is told as that of one. If it is a shadow, alpha is
only what the light is of the object's brightness: by as much it may be off.
"""

import numpy as np

from blurmatte.checks import Bools
from blurmatte.color import ColorModel, darker_pixels
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.shadow_mask import shadow_beside


def mark_shadow(
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    alone: bool,
    whole: bool,
) -> float:
    """Mark what is only darker than the plate SHADOW, with an error that says so.

    Parameters
    ----------
    maps : PixelMaps
        A solution; flags and errors are changed in place.
    image, plate : LinearImage
        Noise known.
    streak : Streak
    model : ColorModel
    alone : bool
        Whether no path and shape have said where the object was. Then what brings clearly less light
        than the rest of the object is a shadow, if the object has one color.
    whole : bool
        Whether the whole streak only lost light.

    Returns
    -------
    float
        By how much the sum of alpha is off if what was marked beside an object is its shadow.
    """
    box = streak.box
    place = slice(box[1], box[3]), slice(box[0], box[2])
    if not whole and not (alone and model.rank == 1):
        return 0.0
    shadow = streak.mask
    if not whole:
        brightness = _brightness(maps, model, streak.mask)
        shadow = shadow_beside(image, plate, streak, model.pole, brightness)
    marked = (shadow & streak.mask)[place] & darker_pixels(image.crop(box), plate.crop(box))
    maps.quality[place] |= marked * np.uint8(Quality.SHADOW)
    if whole or not marked.any():
        return 0.0
    lit = _brightness(maps, model, streak.mask & ((maps.quality & np.uint8(Quality.SHADOW)) == 0))
    return _doubt(maps.within(box), marked, model, lit)


def _doubt(maps: PixelMaps, marked: Bools, model: ColorModel, brightness: float) -> float:
    """Widen the error of what was marked by what is not there if it is a shadow; the sum of that."""
    alpha = maps.alpha[marked].astype(float)
    light = np.nan_to_num(maps.premultiplied[marked] @ model.pole)
    off = np.maximum(alpha - np.clip(light / max(brightness, 1e-12), 0, 1), 0)
    maps.alpha_std[marked] = np.hypot(maps.alpha_std[marked], off)
    return float(off.sum())


def _brightness(maps: PixelMaps, model: ColorModel, inside: Bools) -> float:
    """Light of the object along its color, where it is all that is seen."""
    y, x = np.nonzero(inside)
    seen = np.isfinite(maps.premultiplied_std[y, x]).all(axis=-1)
    seen &= (maps.quality[y, x] & np.uint8(Quality.PLATE_IN_MODEL)) == 0
    y, x = y[seen], x[seen]
    alpha = np.clip(maps.alpha[y, x], 0, 1).astype(float)
    light = maps.premultiplied[y, x] @ model.pole
    return float(np.sum(light * alpha) / max(float(np.sum(alpha**2)), 1e-12))

"""Which of the streak's pixels only lost light, as far as no sweep says where the object was."""

import numpy as np

from blurmatte.color import ColorModel, darker
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.shadow import shadow_beside


def mark_shadow(
    maps: PixelMaps,
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    alone: bool,
    whole: bool,
) -> None:
    """Mark what is only darker than the plate SHADOW.

    Parameters
    ----------
    maps : PixelMaps
        A solution; its flags are changed in place.
    image, plate : LinearImage
        Noise known.
    streak : Streak
    model : ColorModel
    alone : bool
        Whether no path and shape have said where the object was. Then what brings clearly less light
        than the rest of the object is a shadow, if the object has one color.
    whole : bool
        Whether the whole streak only lost light.
    """
    box = streak.box
    place = slice(box[1], box[3]), slice(box[0], box[2])
    if whole:
        shadow = streak.mask[place]
    elif alone and model.rank == 1:
        brightness = _brightness(maps, model, streak)
        shadow = shadow_beside(image, plate, streak, model.pole, brightness)[place]
    else:
        return
    shadow = shadow & streak.mask[place] & darker(image.crop(box), plate.crop(box))
    maps.quality[place] |= shadow * np.uint8(Quality.SHADOW)


def _brightness(maps: PixelMaps, model: ColorModel, streak: Streak) -> float:
    """Light of the object along its color, where it is all that is seen."""
    y, x = streak.rows_columns
    seen = streak.mask[y, x] & np.isfinite(maps.premultiplied_std[y, x]).all(axis=-1)
    seen &= (maps.quality[y, x] & np.uint8(Quality.PLATE_IN_MODEL)) == 0
    alpha = np.clip(maps.alpha[y, x][seen], 0, 1).astype(float)
    light = maps.premultiplied[y, x][seen] @ model.pole
    return float(np.sum(light * alpha) / max(float(np.sum(alpha**2)), 1e-12))

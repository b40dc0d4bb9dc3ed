"""Where a streak goes on unseen."""

from dataclasses import replace

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.matting.evidence import evidence_of, pixels_of
from blurmatte.matting.noise_inflation import noise_inflation
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak

_LEAST_RIM = 4.0  # pixels that a streak's rims may reach unseen, and
_RIM = 0.15  # half widths of it
_WINDOW, _SIGMAS = 0.05, 4.0  # half widths of a streak to look for more of it in, and how clearly


def with_faint_rims(
    streak: Streak, image: LinearImage, plate: LinearImage, model: ColorModel
) -> Streak:
    """The streak, and what belongs to it as far as it is wide, now that the colors are known.

    Rims that are weaker than noise, or before a plate of nearly the object's color, are not found as
    something that moved.
    """
    from scipy.ndimage import binary_propagation, distance_transform_edt, gaussian_filter

    y, x = streak.rows_columns
    half_width = float(distance_transform_edt(np.pad(streak.mask[y, x], 1)).max())
    reach = _LEAST_RIM + half_width
    box = streak.around(int(reach) + 1)
    place = slice(box[1], box[3]), slice(box[0], box[2])
    inside = streak.mask[place]
    away = np.asarray(distance_transform_edt(~inside))
    near = away <= reach
    if model.rank < 3:
        image, plate = image.crop(box), plate.crop(box)
        nothing = np.zeros(near.shape)
        pixels = pixels_of(image, plate, model, near)
        evidence = evidence_of(pixels, nothing)
        together = noise_inflation(pixels, nothing)
        window = max(_WINDOW * half_width, 1.0)
        information, pull = (gaussian_filter(e, window) for e in evidence)
        alike = (
            4 * np.pi * window**2 / together
        )  # pixels, of as much noise as a mean of this window
        seen = pull * np.sqrt(alike) > _SIGMAS * np.sqrt(information + 1e-9)
        inside = binary_propagation(inside, mask=inside | (near & seen))
        away = np.asarray(distance_transform_edt(~inside))
    mask = np.zeros(streak.mask.shape, bool)
    mask[place] = away <= _LEAST_RIM + _RIM * half_width
    return replace(streak, mask=mask)

"""Hysteresis growth of a streak's mask, and a margin for pixels below the threshold."""

from dataclasses import replace

import numpy as np

from blurmatte.color.model import ColorModel
from blurmatte.matting.evidence import evidence_of, pixels_of
from blurmatte.matting.noise_inflation import noise_inflation
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak

# Settings of the growth.
_MARGIN_PX = 4.0  # added after growth; also to the reach of growth, half the width
_RELATIVE_MARGIN = 0.15  # half widths of the streak, added after growth
_RELATIVE_WINDOW = 0.05  # half widths: Gaussian over which evidence is averaged
_MIN_STDS = 4.0  # by which the averaged alpha must exceed 0


def grown_mask(streak: Streak, image: LinearImage, plate: LinearImage, model: ColorModel) -> Streak:
    """The streak with connected pixels in which the object's colors are significant, and a margin.

    Rims fainter than noise, or over a plate of nearly the object's color, are not part of a detected
    streak. Growth is limited to half the streak's width.
    """
    from scipy.ndimage import binary_propagation, distance_transform_edt, gaussian_filter

    y, x = streak.rows_columns
    half_width = float(distance_transform_edt(np.pad(streak.mask[y, x], 1)).max())
    reach = _MARGIN_PX + half_width
    box = streak.around(int(reach) + 1)
    place = slice(box[1], box[3]), slice(box[0], box[2])
    inside = streak.mask[place]
    distance = np.asarray(distance_transform_edt(~inside))
    near = distance <= reach
    if model.rank < 3:
        nothing = np.zeros(near.shape)
        pixels = pixels_of(image.crop(box), plate.crop(box), model, near)
        evidence = evidence_of(pixels, nothing)
        inflation = noise_inflation(pixels, nothing)
        window = max(_RELATIVE_WINDOW * half_width, 1.0)
        information, pull = (gaussian_filter(e, window) for e in evidence)
        averaged = 4 * np.pi * window**2 / inflation  # effective number of independent pixels
        significant = pull * np.sqrt(averaged) > _MIN_STDS * np.sqrt(information + 1e-9)
        inside = binary_propagation(inside, mask=inside | (near & significant))
        distance = np.asarray(distance_transform_edt(~inside))
    mask = np.zeros(streak.mask.shape, bool)
    mask[place] = distance <= _MARGIN_PX + _RELATIVE_MARGIN * half_width
    return replace(streak, mask=mask)

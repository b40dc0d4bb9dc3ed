"""Checks that the plate belongs to the image, by brightness around a streak and texture within.

In this file C is the image's light and B the plate's.
"""

import numpy as np

from blurmatte.checks import rows_columns
from blurmatte.errors import PlateWarning, warn
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import MEDIAN_1
from blurmatte.streaks import Streak


def warn_if_plate_differs(image: LinearImage, plate: LinearImage, streak: Streak) -> None:
    """Warn where image and plate look swapped, or differ in brightness around the streak.

    The PlateWarning is one line with the difference and what to do.
    """
    if _looks_swapped(image, plate, streak):
        warn(
            "image and plate look swapped: the plate's texture is fainter than the image's where "
            "something moved; the plate is the picture without the object",
            PlateWarning,
        )
    gain = _brightness_around(image, plate, streak)
    if np.max(np.abs(gain)) > 0.01:  # alpha would be scaled by several percent
        said = ", ".join(
            f"{g:+.1%} in {name}" for g, name in zip(gain, ("R", "G", "B"), strict=True)
        )
        warn(
            f"around the streak the image's brightness differs from the plate's by {said}: alpha and "
            "its sum will be off by several times that; use a plate of the same exposure and light",
            PlateWarning,
        )


def _looks_swapped(image: LinearImage, plate: LinearImage, streak: Streak) -> bool:
    """True if the image has over 10 % and four sigma more of the plate's texture than around it.

    A gain by lens shading, and noise that is stated wrongly, are the same around the streak.
    """
    gained, std = _texture_gained(image, plate, streak)
    x0, y0, x1, y1 = streak.box
    grown = Streak.from_box(streak.around(max(8, (x1 - x0) // 4, (y1 - y0) // 4)), image.size)
    around, around_std = 0.0, 0.0
    if (grown.mask & ~streak.mask).any():
        around, around_std = _texture_gained(image, plate, Streak(grown.mask & ~streak.mask))
    more, std = gained - max(around, 0.0), float(np.hypot(std, around_std))
    return more > 0.1 and more > 4 * std


def _texture_gained(image: LinearImage, plate: LinearImage, streak: Streak) -> tuple[float, float]:
    """Relative excess of the plate's texture in the image, and its standard deviation.

    Behind an object that covers α of the exposure, 1 − α of the texture remains:
    v = Σ⟨∇C, ∇B⟩ / Σ|∇B|², without the noise in the sum, lies below 1. If image and plate are
    swapped, it lies above.
    """
    image, plate = image.crop(streak.box), plate.crop(streak.box)
    inside = streak.mask[streak.rows_columns] & image.valid & plate.valid
    if not inside.any():
        return 0.0, 0.0
    C, B = (np.asarray(p.rgb, float) for p in (image, plate))
    noise = np.asarray(plate.variance, float)
    excess, own = np.zeros(inside.shape), np.zeros(inside.shape)
    for axis in (0, 1):
        both = (inside & np.roll(inside, -1, axis))[..., None]
        step_C, step_B = (np.roll(a, -1, axis) - a for a in (C, B))
        of_step = noise + np.roll(noise, -1, axis)
        excess += np.sum(both * (step_B * (step_C - step_B) + of_step), axis=-1)
        own += np.sum(both * (step_B**2 - of_step), axis=-1)
    # Texture is correlated over many pixels, so the error follows from the scatter of 8-pixel blocks.
    rows, columns = (np.arange(n) // 8 for n in inside.shape)
    block = (rows[:, None] * (columns[-1] + 1) + columns).ravel()
    more, all_own = (np.bincount(block, part.ravel()) for part in (excess, own))
    total = max(float(all_own.sum()), 1e-30)
    gain = float(more.sum()) / total
    return gain, float(np.sqrt(np.sum((more - gain * all_own) ** 2))) / total


def _brightness_around(
    image: LinearImage, plate: LinearImage, streak: Streak
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(3,) relative excess of the image's brightness around the streak; 0 if not significant."""
    x0, y0, x1, y1 = streak.box
    margin = max(8, (x1 - x0) // 4, (y1 - y0) // 4)
    box = streak.around(margin)
    image, plate = image.crop(box), plate.crop(box)
    still = ~streak.mask[rows_columns(box)] & image.valid & plate.valid
    C, B = (np.asarray(p.rgb[still], float) for p in (image, plate))
    if len(B) < 100:
        return np.zeros(3)
    # Medians are robust to other moving objects near the streak.
    bright = B.mean(axis=0)
    difference = np.median(C - B, axis=0)
    # The error of a median is 1.253 times that of a mean.
    std = 1.253 * np.sqrt(np.median((C - B - difference) ** 2, axis=0) / MEDIAN_1 / len(B))
    significant = np.abs(difference) > 5 * std
    return np.asarray(
        np.where(significant & (bright > 0), difference / np.maximum(bright, 1e-6), 0.0)
    )

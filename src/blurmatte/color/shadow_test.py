"""Test whether a streak only removes light: a shadow, or a black object, which look alike.

In this file C is the image's light and B the plate's, both over the noise of C − B. A shadow removes
the fraction a of the plate's light, nearly equal in all channels: with its hue t, of mean 1,

    B − C = a t B.

The residual from this is light of an object, or the plate does not match.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, rows_columns
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.radiometry.compression import BLOCK
from blurmatte.statistics import block_sums, window_sums
from blurmatte.streaks import Streak, dilated, shift_variance

# Limits of the shadow model.
MARGIN_PX = 16  # width of the unchanged surroundings of a streak
# Relative difference of a channel of a shadow from their mean, by illuminants of several colors
_MAX_HUE = 0.1
_ITERATIONS = 6  # of fitting the hue, which converges in three
# Light of an object over the change; less may be an error of the plate
_MIN_OBJECT_LIGHT = 0.06
# Standard deviations by which the residual's energy must exceed that of noise
_NOISE_STD = 3.0
# Change outside the streak, over that within it, that is taken for another moving object
_MIN_OTHER_MOTION = 0.5
_MIN_OTHER_MOTION_CHI2 = 3.0  # the same over the variance of noise
_WINDOW_PX = 3  # width of the window in which single pixels are tested
_DARKER_STD = 4.0  # standard deviations of the loss of light there, and of the residual
_MAX_RESIDUAL = 0.15  # residual there over the light lost


ONLY_DARKER = (
    "only light was lost: the streak is a shadow, or an object that is too dark, or too similar to the "
    "plate in hue, to distinguish from one"
)


def check_no_shadow(image: LinearImage, plate: LinearImage, streak: Streak) -> None:
    """Raise ColorModelError if a streak may be a shadow."""
    if may_be_shadow(image, plate, streak):
        raise ColorModelError(
            f"{ONLY_DARKER}; if it is an object, give its color (--color, model=); or select what "
            "else moved with a region (--region, streak=)"
        )


def may_be_shadow(image: LinearImage, plate: LinearImage, streak: Streak) -> bool:
    """True if a streak only removes light of the plate.

    The mean product of neighbors is the energy of a change free of independent noise; correlated noise
    is measured outside the streak.

    True for shadows, and for objects whose light is less than 6 % of the change, of the plate's hue,
    or below the noise. False where nothing changed. The noise must be known.
    """
    box = streak.around(MARGIN_PX)
    inside = streak.mask[rows_columns(box)]
    image, plate = image.crop(box), plate.crop(box)
    use = image.valid & plate.valid
    variance = smooth_variance(image) + smooth_variance(plate)
    variance += shift_variance(image, plate, use & ~inside)
    lost, B = _over_noise(image, plate, variance)
    rest = lost - _of_shadow(lost, B, inside)
    outside = use & ~inside & ~_other_motion(lost, inside & use)
    change, residual = (_energy(x, inside & use, outside) for x in (lost, rest))
    return change > 0 and residual <= _MIN_OBJECT_LIGHT**2 * change


def darker_pixels(image: LinearImage, plate: LinearImage) -> Bools:
    """(h, w) True where the image, of known noise, is a darker copy of the plate in a small window."""
    lost, B = _over_noise(image, plate, smooth_variance(image) + smooth_variance(plate))
    size, limit = _WINDOW_PX, _DARKER_STD
    dd, db, bb, count = (
        np.maximum(window_sums(x, size), 0)
        for x in (
            (lost**2).sum(axis=-1),
            (lost * B).sum(axis=-1),
            (B * B).sum(axis=-1),
            3.0 * (image.valid & plate.valid),
        )
    )
    part = db / np.maximum(bb, 1e-12)
    rest = dd - part * db
    allowed = count + limit * np.sqrt(2 * count) + (_MAX_RESIDUAL * part) ** 2 * bb
    clear = part * np.sqrt(bb) > limit
    return np.asarray(clear & (rest < allowed) & (count > 0))


def _over_noise(image: LinearImage, plate: LinearImage, variance: Array) -> tuple[Array, Array]:
    """(h, w, 3) B − C and B over the noise of their difference; 0 where a pixel is not valid."""
    use = (image.valid & plate.valid)[..., None]
    std, B = np.sqrt(variance), np.asarray(plate.rgb, float)
    return np.where(use, B - image.rgb, 0) / std, np.where(use, B, 0) / std


def _of_shadow(lost: Array, B: Array, inside: Bools) -> Array:
    """(h, w, 3) a t B of the shadow that fits best.

    The hue t is fitted with a of the neighbors, which is independent of a pixel's noise.
    """
    t, shares, squares = np.ones(3), lost * B, B * B
    for _ in range(_ITERATIONS):
        a = _part(shares, squares, t)
        of_neighbors = sum(np.roll(a * inside, n, axis) for n in (-1, 1) for axis in (0, 1)) / 4
        weight = of_neighbors * inside
        ratio = np.einsum("hw,hwc->c", weight, shares) / np.maximum(
            np.einsum("hw,hwc->c", weight * a, squares), 1e-12
        )
        hue = _MAX_HUE
        t = np.clip(ratio / max(float(ratio.mean()), 1e-12), 1 - hue, 1 + hue)
    return np.asarray(_part(shares, squares, t)[..., None] * t * B)


def _part(shares: Array, squares: Array, t: Array) -> Array:
    """(h, w) a of every pixel, 0…1, from (B − C) B and B² of its channels."""
    return np.asarray(np.clip(shares @ t / np.maximum(squares @ t**2, 1e-12), 0, 1))


def _other_motion(lost: Array, inside: Bools) -> Bools:
    """(h, w) neighborhoods outside a streak of a change similar to that within."""
    around = np.roll(lost, 1, axis=0) + np.roll(lost, 1, axis=1)
    shared: Array = np.einsum("hwc,hwc->hw", lost, around)
    usual = float(shared[inside].sum()) / max(int(np.count_nonzero(inside)), 1)
    threshold = max(_MIN_OTHER_MOTION * usual, _MIN_OTHER_MOTION_CHI2)
    much: Bools = scipy.ndimage.uniform_filter(shared, BLOCK) > threshold
    return dilated(much & ~inside, BLOCK)


def _energy(x: Array, inside: Bools, outside: Bools) -> float:
    """Mean product of neighbors inside, minus an upper bound of that of noise."""
    usual, spread = _neighbor_product(x, outside)
    blocks = max(np.count_nonzero(inside) / BLOCK**2, 1)
    bound = usual + _NOISE_STD * spread / float(np.sqrt(blocks))
    return _neighbor_product(x, inside)[0] - bound


def _neighbor_product(x: Array, where: Bools) -> tuple[float, float]:
    """Mean product of neighbors within a region, and its standard deviation between blocks."""
    total, count = np.zeros(where.shape), np.zeros(where.shape)
    for axis in (0, 1):
        both = where & np.roll(where, -1, axis)
        both[(slice(None),) * axis + (slice(-1, None),)] = False
        total += both * np.einsum("hwc,hwc->hw", x, np.roll(x, -1, axis))
        count += both
    size = BLOCK
    sums, counts = (block_sums(z, size) for z in (total, count))
    full = counts > size**2
    mean = float(total.sum() / max(count.sum(), 1))
    return mean, float(np.std(sums[full] / counts[full])) if full.any() else 0.0

"""Mask of an object's shadow: the plate is darker there, and no light of the object is added.

Light of an object's color and a darker plate are distinguishable where their hues differ. In a small
window, with image C, plate B and the object's unit color l, C − B = k l − a B is a linear regression
for k and a. For the object k is about a times its brightness; for a shadow it is 0.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, rows_columns
from blurmatte.color.shadow_test import darker_pixels
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import MEDIAN_1, window_sums
from blurmatte.streaks import Streak, dilated, opened

# Settings of the detection of a shadow; light is in units of the object's own.
# Widths of the windows: dark shadows may be narrow, faint ones need larger windows
_WINDOWS_PX = (5, 11, 21)
_MAX_SHADOW_LIGHT = 0.2  # upper bound of the light in a shadow on the plate
_MAX_SHADED_LIGHT = 0.85  # the same for a shadow that extends onto the object
# The same if the shape is unknown: less than the light on the underside of a ball below a lamp
_MAX_UNDERSIDE_LIGHT = 0.4
_THRESHOLD_STD = 4.0  # threshold of both tests, in standard deviations of the noise
_RIM_PX = 2  # dilation of the mask
# Bounds of the shadow's fraction of the streak; a shadow is neither negligible nor all of it
_MIN_FRACTION = 0.03
_MAX_FRACTION = 0.8
_BLEED_PX = 4  # distance over which files spread a streak's colors
# Number of windows outside the streak that suffice to measure their noise
_MIN_WINDOWS = 20


def shadow_around(image: LinearImage, plate: LinearImage, streak: Streak, color: Array) -> Bools:
    """Mask of the shadow of an object whose shape is unknown.

    The streak is where light of the object is visible, `color` (3,) its unit color, and the noise is
    known. As `cast_shadow_mask`; without the shape, the part on the object is not found.
    """
    y, x = streak.rows_columns
    use = (streak.mask & image.valid & plate.valid)[y, x]
    sums = _products(image.crop(streak.box), plate.crop(streak.box), color)
    light, lost, _ = _light_and_loss(*(one[use] for one in sums[:4]))
    lost = np.clip(lost, 0, 1)
    brightness = float(np.sum(light * lost) / max(float(np.sum(lost**2)), 1e-12))
    around = Streak.from_box(streak.around(_WINDOWS_PX[-1]), image.size)
    found = cast_shadow_mask(image, plate, around, color, brightness, _MAX_UNDERSIDE_LIGHT)
    return found if (streak.mask & ~found).any() else np.zeros_like(found)


def cast_shadow_mask(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    color: Array,
    brightness: float,
    shaded: float = _MAX_SHADED_LIGHT,
) -> Bools:
    """Mask of the part of a streak that is the shadow of an object elsewhere in it.

    color (3,): unit color of the object.
    brightness: light along it where the object is opaque.
    shaded: fraction of the object's light below which pixels next to the shadow count as shadow.

    Empty if it is not significant. Black parts of an object cannot be distinguished from a shadow.
    """
    box = streak.around(_WINDOWS_PX[-1])
    inside = streak.mask[rows_columns(box)]
    image, plate = image.crop(box), plate.crop(box)
    valid = image.valid & plate.valid
    use, background = valid & inside, valid & ~dilated(inside, _BLEED_PX)
    limits = _MAX_SHADOW_LIGHT * brightness, shaded * brightness
    products = _products(image, plate, color)
    masks = [_darker_than(products, use, background, limits, n) for n in _WINDOWS_PX]
    lightless, dim = np.any(masks, axis=0)
    core = use & lightless  # the shadow may extend onto the object
    found = np.zeros(streak.mask.shape, bool)
    reach = scipy.ndimage.binary_propagation(core, mask=use & dim)
    if _is_part(reach, inside):
        found[rows_columns(box)] = dilated(reach, _RIM_PX)
    whole = not (streak.mask & ~found).any()  # the rim may cover a small streak
    return np.zeros_like(found) if whole else found


def darkness(image: LinearImage, plate: LinearImage, streak: Streak) -> Bools:
    """Mask of the part of a streak that is the plate, but darker; no color is needed.

    Empty if it is hardly any or most of the streak.
    """
    y, x = streak.rows_columns
    inside = streak.mask[y, x]
    dark = opened(darker_pixels(image.crop(streak.box), plate.crop(streak.box)) & inside)
    found = np.zeros(streak.mask.shape, bool)
    if _is_part(dark, inside):
        found[y, x] = dilated(dark, _RIM_PX)
    return found


def _is_part(dark: Bools, inside: Bools) -> bool:
    """True if a shadow is a part of the streak, neither hardly any nor most of it."""
    fraction = np.count_nonzero(dark) / np.count_nonzero(inside)
    return bool(_MIN_FRACTION < fraction < _MAX_FRACTION)


def _products(image: LinearImage, plate: LinearImage, color: Array) -> list[Array]:
    """B·l, B·B, (C − B)·l, (C − B)·B and the noise variance of C − B, each (h, w)."""
    C, B = image.rgb.astype(float), plate.rgb.astype(float)
    D = C - B
    variance = (image.variance + plate.variance).max(axis=-1)
    dots = (np.einsum("hwc,hwc->hw", a, b) for a, b in ((B, B), (D, B)))
    return [B @ color, next(dots), D @ color, next(dots), variance]


def _light_and_loss(p: Array, q: Array, u: Array, w: Array) -> tuple[Array, Array, Array]:
    """Solve the fit for k and a, of the first four `_products` or their means; and its determinant."""
    det = np.maximum(q - p**2, 1e-12)
    return (q * u - p * w) / det, (p * u - w) / det, det


def _darker_than(
    products: list[Array],
    use: Bools,
    background: Bools,
    limits: tuple[float, float],
    window: int,
) -> tuple[Bools, Bools]:
    """Masks where a fraction a of the plate is missing and the light is below a times each limit.

    Both are tests at `threshold_std`. Correlated noise inflates the variance of windows; the
    inflation is measured in the background.
    """
    p, q, k, a, unit = _of_windows(products, use, window)
    far = window_sums(background, window) > (1 - 1 / window) * window**2
    if np.count_nonzero(far) > _MIN_WINDOWS:
        *_, a_far, unit_far = _of_windows(products, background, window)
        z2 = a_far[far] ** 2 / np.maximum(unit_far[far], 1e-30)
        unit = unit * max(float(np.median(z2)) / MEDIAN_1, 1.0)
    lost = (k * p < a * q) & (a > _THRESHOLD_STD * np.sqrt(unit))

    def lacking(limit: float) -> Bools:
        """Where the light is below `limit` times the lost fraction of the plate."""
        std = np.sqrt(np.maximum(unit * (q - 2 * limit * p + limit**2), 0))
        return np.asarray(lost & (k - limit * a < -_THRESHOLD_STD * std))

    return lacking(limits[0]), lacking(limits[1])


def _of_windows(
    products: list[Array], use: Bools, window: int
) -> tuple[Array, Array, Array, Array, Array]:
    """B·l, B·B, k and a of windows, and the variance of a for independent noise."""
    n = np.maximum(window_sums(use, window), 1)
    p, q, u, w, variance = (window_sums(np.where(use, x, 0), window) / n for x in products)
    k, a, det = _light_and_loss(p, q, u, w)
    return p, q, k, a, np.maximum(variance / (n * det), 0)

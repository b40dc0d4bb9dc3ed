"""Shadows in a streak: whether it only removes light, and the part of it that is an object's shadow.

A streak that only removes light is a shadow or a black object, which look alike. In this file C is the
image's light and B the plate's, in this test both over the noise of C − B. A shadow removes the
fraction a of the plate's light, nearly equal in all channels: with its hue t, of mean 1,

    B − C = a t B.

The residual from this is light of an object, or the plate does not match.

Where a streak is the shadow of an object, the plate is darker, and no light of the object is added.
Light of an object's color and a darker plate are distinguishable where their hues differ. In a small
window, with the object's unit color l, C − B = k l − a B is a linear regression for k and a. For the
object k is about a times its brightness; for a shadow it is 0.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, rows_columns
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.radiometry.compression import BLOCK
from blurmatte.statistics import MEDIAN_1, block_sums, window_sums
from blurmatte.streaks import Streak, dilated, opened, shift_variance

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
# Standard deviations of the noise of a window by which it loses light, and of the residual
_DARKER_STD = 4.0
_MAX_RESIDUAL = 0.15  # residual there over the light lost
# Settings of the detection of a shadow; light is in units of the object's own.
# Widths of the windows: dark shadows may be narrow, faint ones need larger windows
_WINDOWS_PX = (5, 11, 21)
_MAX_SHADOW_LIGHT = 0.2  # upper bound of the light in a shadow on the plate
_MAX_SHADED_LIGHT = 0.85  # the same for a shadow that extends onto the object
# The same if the shape is unknown: less than the light on the underside of a ball below a lamp
_MAX_UNDERSIDE_LIGHT = 0.4
_RIM_PX = 2  # dilation of the mask
# Bounds of the shadow's fraction of the streak; a shadow is neither negligible nor all of it
_MIN_FRACTION = 0.03
_MAX_FRACTION = 0.8
_BLEED_PX = 4  # distance over which files spread a streak's colors
# Number of windows outside the streak that suffice to measure their noise
_MIN_WINDOWS = 20

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

    Both are tests at `_DARKER_STD`. Correlated noise inflates the variance of windows; the
    inflation is measured in the background.
    """
    p, q, k, a, unit = _of_windows(products, use, window)
    far = window_sums(background, window) > (1 - 1 / window) * window**2
    if np.count_nonzero(far) > _MIN_WINDOWS:
        *_, a_far, unit_far = _of_windows(products, background, window)
        z2 = a_far[far] ** 2 / np.maximum(unit_far[far], 1e-30)
        unit = unit * max(float(np.median(z2)) / MEDIAN_1, 1.0)
    lost = (k * p < a * q) & (a > _DARKER_STD * np.sqrt(unit))

    def lacking(limit: float) -> Bools:
        """Where the light is below `limit` times the lost fraction of the plate."""
        std = np.sqrt(np.maximum(unit * (q - 2 * limit * p + limit**2), 0))
        return np.asarray(lost & (k - limit * a < -_DARKER_STD * std))

    return lacking(limits[0]), lacking(limits[1])


def _of_windows(
    products: list[Array], use: Bools, window: int
) -> tuple[Array, Array, Array, Array, Array]:
    """B·l, B·B, k and a of windows, and the variance of a for independent noise."""
    n = np.maximum(window_sums(use, window), 1)
    p, q, u, w, variance = (window_sums(np.where(use, x, 0), window) / n for x in products)
    k, a, det = _light_and_loss(p, q, u, w)
    return p, q, k, a, np.maximum(variance / (n * det), 0)

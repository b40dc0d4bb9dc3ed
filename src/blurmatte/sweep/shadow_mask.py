"""Where a shadow lies beside an object: the plate is darker there, and none of its light is seen.

Light of an object's color and a darker plate are told apart wherever they have different hues: in a
small window, with image C, plate B and the object's unit color l, C − B = k l − a B is a straight-line
fit in k and a. The object brings light with it, k is about a times its brightness; a shadow does not.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.color.shadow_test import darker_pixels
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, widened, without_thin_parts

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_WINDOWS = 5, 11, 21  # pixels: dark shadows may be narrow, faint ones need more of them
_LIGHTLESS, _SHADED = 0.2, 0.85  # of the object's light: a shadow, and where it lies on the object
_UNDERSIDE = 0.4  # of the object's light: less than where a lamp above leaves a ball dark
_SIGMAS = 4.0
_RIM = 2  # pixels
_LEAST, _MOST = 0.03, 0.8  # of the streak: of what is darker all over, no part is its shadow
_BESIDE = 4  # pixels: files let a streak's colors run that far
_ENOUGH = 20  # windows beside a streak, to tell noise from
_MEDIAN = 0.455  # of the square of a normal variable


def shadow_around(image: LinearImage, plate: LinearImage, streak: Streak, color: Array) -> Bools:
    """Where a shadow lies around an object that was not measured yet.

    Parameters
    ----------
    image, plate : LinearImage
        Of known noise.
    streak : Streak
        Where light of the object shows.
    color : (3,) float
        Unit color of the object.

    Returns
    -------
    (H, W) bool
        As of `shadow_beside`. Where it lies on the object too is not known before its shape is.
    """
    y, x = streak.rows_columns
    use = (streak.mask & image.valid & plate.valid)[y, x]
    sums = _products(image.crop(streak.box), plate.crop(streak.box), color)
    light, lost, _ = _light_and_loss(*(one[use] for one in sums[:4]))
    lost = np.clip(lost, 0, 1)
    brightness = float(np.sum(light * lost) / max(float(np.sum(lost**2)), 1e-12))
    around = Streak.from_box(streak.around(_WINDOWS[-1]), image.size)
    found = shadow_beside(image, plate, around, color, brightness, _UNDERSIDE)
    return found if (streak.mask & ~found).any() else np.zeros_like(found)


def shadow_beside(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    color: Array,
    brightness: float,
    shaded: float = _SHADED,
) -> Bools:
    """Where a streak is the shadow of an object of another place.

    Parameters
    ----------
    image, plate : LinearImage
        Of known noise.
    streak : Streak
    color : (3,) float
        Unit color of the object.
    brightness : float
        Light along it, where the object is all that is seen.
    shaded : float
        Of the object's light, where the shadow lies on it too: what adjoins the shadow and brings
        less is taken for it.

    Returns
    -------
    (H, W) bool
        Empty if there is no more than noise can feign. Black parts of an object look the same.
    """
    from scipy.ndimage import binary_propagation

    box = streak.around(_WINDOWS[-1])
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    image, plate = image.crop(box), plate.crop(box)
    valid = image.valid & plate.valid
    use, beside = valid & inside, valid & ~widened(inside, _BESIDE)
    least = _LIGHTLESS * brightness, shaded * brightness
    products = _products(image, plate, color)
    less = [_less(products, use, beside, least, window) for window in _WINDOWS]
    lightless, dim = np.any(less, axis=0)
    core = use & lightless  # from here the shadow may reach onto the object
    found = np.zeros(streak.mask.shape, bool)
    reach = binary_propagation(core, mask=use & dim)
    if _LEAST < np.count_nonzero(reach) / np.count_nonzero(inside) < _MOST:
        found[box[1] : box[3], box[0] : box[2]] = widened(reach, _RIM)
    whole = not (streak.mask & ~found).any()  # of a small streak the rim may be all that is left
    return np.zeros_like(found) if whole else found


def darkness(image: LinearImage, plate: LinearImage, streak: Streak) -> Bools:
    """Where a streak is the plate, but darker: a shadow, as far as it is seen without a color.

    Parameters
    ----------
    image, plate : LinearImage
        Of known noise.
    streak : Streak

    Returns
    -------
    (H, W) bool
        Empty if it is hardly any, or most, of the streak.
    """
    y, x = streak.rows_columns
    inside = streak.mask[y, x]
    dark = without_thin_parts(
        darker_pixels(image.crop(streak.box), plate.crop(streak.box)) & inside
    )
    found = np.zeros(streak.mask.shape, bool)
    if _LEAST < np.count_nonzero(dark) / np.count_nonzero(inside) < _MOST:
        found[y, x] = widened(dark, _RIM)
    return found


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


def _less(
    products: list[Array], use: Bools, beside: Bools, leasts: tuple[float, float], window: int
) -> tuple[Bools, Bools]:
    """Where it is darker, a part a of the plate missing, and clearly less light than a · each least.

    Where noise hangs together windows of it say less: how much so is seen beside the streak.
    """
    p, q, k, a, unit = _of_windows(products, use, window)
    far = _sums(beside, window) > (1 - 1 / window) * window**2
    if np.count_nonzero(far) > _ENOUGH:
        *_, a_beside, unit_beside = _of_windows(products, beside, window)
        z2 = a_beside[far] ** 2 / np.maximum(unit_beside[far], 1e-30)
        unit = unit * max(float(np.median(z2)) / _MEDIAN, 1.0)
    lost = (k * p < a * q) & (a > _SIGMAS * np.sqrt(unit))

    def lacking(least: float) -> Bools:
        std = np.sqrt(np.maximum(unit * (q - 2 * least * p + least**2), 0))
        return np.asarray(lost & (k - least * a < -_SIGMAS * std))

    return lacking(leasts[0]), lacking(leasts[1])


def _of_windows(
    products: list[Array], use: Bools, window: int
) -> tuple[Array, Array, Array, Array, Array]:
    """B·l, B·B, k and a of windows, and the variance of a if each pixel has noise of its own."""
    n = np.maximum(_sums(use, window), 1)
    p, q, u, w, variance = (_sums(np.where(use, x, 0), window) / n for x in products)
    k, a, det = _light_and_loss(p, q, u, w)
    return p, q, k, a, np.maximum(variance / (n * det), 0)


def _sums(values: Array | Bools, window: int) -> Array:
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(float), window)) * window**2

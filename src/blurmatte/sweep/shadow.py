"""Where a shadow lies beside an object: the plate is darker there, and none of its light is seen.

Light of an object's color and a darker plate are told apart wherever they have different hues: in a
small window, with image C, plate B and the object's unit color l, C − B = k l − a B is a straight-line
fit in k and a. The object brings light with it, k is about a times its brightness; a shadow does not.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_WINDOWS = 5, 11, 21  # pixels: dark shadows may be narrow, faint ones need more of them
_LIGHTLESS, _SHADED = 0.2, 0.85  # of the object's light: a shadow, and where it lies on the object
_SIGMAS = 4.0
_RIM = 2  # pixels
_LEAST, _MOST = 0.03, 0.8  # of the streak: of what is darker all over, no part is its shadow


def shadow_beside(
    image: LinearImage, plate: LinearImage, streak: Streak, color: Array, brightness: float
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

    Returns
    -------
    (H, W) bool
        Empty if there is no more than noise can feign. Black parts of an object look the same.
    """
    from scipy.ndimage import binary_dilation, binary_propagation

    box = streak.around(_WINDOWS[-1])
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    image, plate = image.crop(box), plate.crop(box)
    use = image.valid & plate.valid & inside
    lightless, shaded = (
        np.any([_less(image, plate, use, color, part * brightness, w) for w in _WINDOWS], axis=0)
        for part in (_LIGHTLESS, _SHADED)
    )
    core = use & lightless  # from here the shadow may reach onto the object
    found = np.zeros(streak.mask.shape, bool)
    reach = binary_propagation(core, mask=use & shaded)
    if _LEAST < np.count_nonzero(reach) / np.count_nonzero(inside) < _MOST:
        found[box[1] : box[3], box[0] : box[2]] = binary_dilation(reach, iterations=_RIM)
    whole = not (streak.mask & ~found).any()  # of a small streak the rim may be all that is left
    return np.zeros_like(found) if whole else found


def _less(
    image: LinearImage, plate: LinearImage, use: Bools, color: Array, least: float, window: int
) -> Bools:
    """Where it is darker, a part a of the plate missing, and clearly less light than a · `least`."""
    C, B = image.rgb.astype(float), plate.rgb.astype(float)
    n = np.maximum(_sums(use, window), 1)
    p, q, u, w, variance = (
        _sums(np.where(use, x, 0), window) / n
        for x in (
            B @ color, np.sum(B * B, axis=-1), (C - B) @ color, np.sum((C - B) * B, axis=-1),
            (image.variance + plate.variance).max(axis=-1),
        )
    )  # fmt: skip
    det = np.maximum(q - p**2, 1e-12)
    k, a = (q * u - p * w) / det, (p * u - w) / det
    unit = variance / (n * det)
    of_light = unit * (q - 2 * least * p + least**2)
    a_std, light_std = (np.sqrt(np.maximum(v, 0)) for v in (unit, of_light))
    return np.asarray((w < 0) & (a > _SIGMAS * a_std) & (k - least * a < -_SIGMAS * light_std))


def _sums(values: Array | Bools, window: int) -> Array:
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(float), window)) * window**2

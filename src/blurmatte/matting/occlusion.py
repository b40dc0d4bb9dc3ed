"""Where something still is in front of what moved: the plate is seen as if nothing had been there.

In this file C is the image's light, B the plate's, s² the noise variance of C − B, and o the usual
light of the object. Where alpha is known it changes a pixel by α (o − B); what is in front does not.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.streaks import widened

Array = npt.NDArray[np.float64]

_NEIGHBORS = 3  # pixels across: one odd pixel is noise, a patch of them is something else
_SEEN = 3.0  # expected change² over noise² of a patch that would not be missed
_SEEN_ALONE = 9.0  # of a single pixel: noise hides it in 1 of 400
_STILL = 2.0  # change² over noise²: the plate, if there is nothing else
_SHADES = 0.3, 2.0  # times its usual light, what an object may send somewhere
_MOST = 0.5  # of alpha, that may be hidden
_CORE = 0.5  # of the largest alpha: a post in front crosses more than the rim


def in_front(alpha: Array, light: Array, C: Array, B: Array, variance: Array, use: Bools) -> Bools:
    """Where a sweep went, but the plate is seen as if it had not.

    Patches in which the object would be seen, and the plate is; or, where a wire is narrower than a
    patch, a few pixels that each say so clearly. At the rims of what is in front each pixel speaks
    for itself. What lies at the rim of the sweep alone is no more than a shape that is not quite right.

    Parameters
    ----------
    alpha : (h, w) float
        Of the sweep.
    light : (3,) float
        Of the object, where it is all that is seen.
    C, B, variance : (h, w, 3) float
        Light of image and plate, and the noise variance of their difference.
    use : (h, w) bool
        Where there is something to be believed.

    Returns
    -------
    (h, w) bool
    """
    from scipy.ndimage import binary_propagation

    use = use & (alpha > 0)
    still = np.where(use, np.mean((C - B) ** 2 / variance, axis=-1), 1)
    # Where a shade of the object looks like the plate, nothing is to be seen of it.
    shade = np.sum(light * B / variance, axis=-1) / np.maximum(
        np.sum(light**2 / variance, axis=-1), 1e-12
    )
    shade = np.clip(shade, *_SHADES)[..., None]
    seen = np.mean((alpha[..., None] * (shade * light - B)) ** 2 / variance, axis=-1)
    core = (mean_of_neighbors(seen) > _SEEN) & (mean_of_neighbors(still) < _STILL)
    alone = use & (seen > _SEEN_ALONE) & (still < _STILL)
    several = (_NEIGHBORS - 0.5) / _NEIGHBORS**2
    core = use & (core | (alone & (mean_of_neighbors(alone.astype(float)) > several)))
    near = widened(core, _NEIGHBORS // 2 + 1)
    found = core | (use & near & (still < np.minimum(seen, _SEEN)))
    found = binary_propagation(found & (alpha > _CORE * alpha.max(initial=0)), mask=found)
    return np.asarray(found & (alpha[found & use].sum() < _MOST * (alpha * use).sum()))


def mean_of_neighbors(values: npt.NDArray[np.floating]) -> Array:
    """Mean over a patch of 3 by 3 pixels."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values, _NEIGHBORS))

"""Did a streak only take light? Then it is a shadow or a black object, and no picture tells which.

In this file C is the image's light and B the plate's, both over the noise of C − B. A shadow takes the
part a of the plate's light, nearly alike in all channels: with t its hue, of mean 1,

    B − C = a t B.

Whatever of B − C is not of this kind was sent by an object, or the plate does not fit.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.streaks import Streak, shift_variance, widened

Array = npt.NDArray[np.float64]

_MARGIN = 16  # pixels around a streak, in which nothing moved
_HUE = (
    0.1  # of a lamp's light: how unlike the channels of a shadow are where other light is colored
)
_ROUNDS = 6  # of fitting the hue, which after three hardly changes
_LEAST_LIGHT = (
    0.06  # of what changed: less may be a plate or a shadow that is not quite as it should be
)
_SIGMAS = 3.0  # by which an object's own light must exceed noise
_BLOCK = 8  # pixels over which noise may hang together
_AS_MUCH, _CLEAR = 0.5, 3.0  # of what changed in a streak; of noise, squared: another thing moved
_WINDOW, _DARKER, _PARALLEL = 3, 4.0, 0.15  # pixels; standard deviations; of the light lost

ONLY_DARKER = (
    "only light was lost: the streak is a shadow, or an object so dark, or so like the plate in hue, "
    "that this picture cannot tell it from one"
)


def refuse_shade(image: LinearImage, plate: LinearImage, streak: Streak) -> None:
    """Raise ColorModelError if a streak only took light, for then it may be a shadow."""
    if only_light_lost(image, plate, streak):
        raise ColorModelError(
            f"{ONLY_DARKER}; if it is an object, give its color (--color, model=); else choose what "
            "moved besides with a region (--region, streak=)"
        )


def only_light_lost(image: LinearImage, plate: LinearImage, streak: Streak) -> bool:
    """Whether a streak shows no light but the plate's, less of it.

    Neighbors share what an object did to them, but not their noise: the mean of their products is the
    energy of what changed, and noise that hangs together is seen beside the streak.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    streak : Streak

    Returns
    -------
    bool
        True for shadows; for objects whose own light is less than 6 % of the light that they
        hide, or in the plate's hue; and where that light is weaker than noise. False where nothing
        changed.
    """
    box = streak.around(_MARGIN)
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    image, plate = image.crop(box), plate.crop(box)
    use = image.valid & plate.valid
    variance = smooth_variance(image) + smooth_variance(plate)
    variance += shift_variance(image, plate, use & ~inside)
    lost, B = _over_noise(image, plate, variance)
    rest = lost - _of_shadow(lost, B, inside)
    beside = use & ~inside & ~_moved_too(lost, inside & use)
    energy, change = (_beyond_noise(x, inside & use, beside) for x in (lost, rest))
    return energy > 0 and change <= _LEAST_LIGHT**2 * energy


def darker(image: LinearImage, plate: LinearImage) -> Bools:
    """(h, w) True where the image is the plate but darker, in the mean of a few pixels.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    """
    from scipy.ndimage import uniform_filter

    lost, B = _over_noise(image, plate, smooth_variance(image) + smooth_variance(plate))
    dd, db, bb, count = (
        np.maximum(uniform_filter(np.asarray(x, float), _WINDOW) * _WINDOW**2, 0)
        for x in (
            (lost**2).sum(axis=-1),
            (lost * B).sum(axis=-1),
            (B * B).sum(axis=-1),
            3 * (image.valid & plate.valid),
        )
    )
    part = db / np.maximum(bb, 1e-12)
    rest = dd - part * db
    noise = count + _DARKER * np.sqrt(2 * count)
    clear = part * np.sqrt(bb) > _DARKER
    return np.asarray(clear & (rest < noise + (_PARALLEL * part) ** 2 * bb) & (count > 0))


def _over_noise(image: LinearImage, plate: LinearImage, variance: Array) -> tuple[Array, Array]:
    """B − C and B over the noise of their difference; 0 where a pixel is not valid."""
    use = (image.valid & plate.valid)[..., None]
    std, B = np.sqrt(variance), np.asarray(plate.rgb, float)
    return np.where(use, B - image.rgb, 0) / std, np.where(use, B, 0) / std


def _of_shadow(lost: Array, B: Array, inside: Bools) -> Array:
    """A t B of the shadow that explains most.

    The hue t is compared with a of the neighbors, which knows nothing of a pixel's own noise.
    """
    t, shares, squares = np.ones(3), lost * B, B * B
    for _ in range(_ROUNDS):
        a = _part(shares, squares, t)
        of_neighbors = sum(np.roll(a * inside, n, axis) for n in (-1, 1) for axis in (0, 1)) / 4
        weight = of_neighbors * inside
        ratio = np.einsum("hw,hwc->c", weight, shares) / np.maximum(
            np.einsum("hw,hwc->c", weight * a, squares), 1e-12
        )
        t = np.clip(ratio / max(float(ratio.mean()), 1e-12), 1 - _HUE, 1 + _HUE)
    return np.asarray(_part(shares, squares, t)[..., None] * t * B)


def _part(shares: Array, squares: Array, t: Array) -> Array:
    """(h, w) a of every pixel, 0…1, from (B − C) B and B² of its channels."""
    return np.asarray(np.clip(shares @ t / np.maximum(squares @ t**2, 1e-12), 0, 1))


def _moved_too(lost: Array, inside: Bools) -> Bools:
    """Around where beside a streak about as much changed as within: no noise, something else."""
    from scipy.ndimage import uniform_filter

    around = np.roll(lost, 1, axis=0) + np.roll(lost, 1, axis=1)
    shared: Array = np.einsum("hwc,hwc->hw", lost, around)
    usual = float(shared[inside].sum()) / max(int(np.count_nonzero(inside)), 1)
    much: Bools = uniform_filter(shared, _BLOCK) > max(_AS_MUCH * usual, _CLEAR)
    return widened(much & ~inside, _BLOCK)


def _beyond_noise(x: Array, inside: Bools, beside: Bools) -> float:
    """Mean product of neighbors inside, by how much it clearly exceeds that beside."""
    usual, spread = _shared(x, beside)
    blocks = max(np.count_nonzero(inside) / _BLOCK**2, 1)
    return _shared(x, inside)[0] - usual - _SIGMAS * spread / float(np.sqrt(blocks))


def _shared(x: Array, where: Bools) -> tuple[float, float]:
    """Mean product of neighbors within a region, and how much it differs from block to block."""
    total, count = np.zeros(where.shape), np.zeros(where.shape)
    for axis in (0, 1):
        both = where & np.roll(where, -1, axis)
        both[(slice(None),) * axis + (slice(-1, None),)] = False
        total += both * np.einsum("hwc,hwc->hw", x, np.roll(x, -1, axis))
        count += both
    h, w = (side // _BLOCK * _BLOCK for side in where.shape)
    sums, counts = (
        z[:h, :w].reshape(h // _BLOCK, _BLOCK, w // _BLOCK, _BLOCK).sum(axis=(1, 3))
        for z in (total, count)
    )
    full = counts > _BLOCK**2
    mean = float(total.sum() / max(count.sum(), 1))
    return mean, float(np.std(sums[full] / counts[full])) if full.any() else 0.0

"""Colors of the object alone: picked by hand, or where it hid the plate all the time.

They feed `ColorModel.from_samples`. In this file C is the image's light and B the plate's. Behind
an object that was there for α of the exposure, 1 − α of the plate's texture is left in the image:

    v = Σ⟨∇C, ∇B⟩ / (Σ|∇B|² − noise)

over a neighborhood estimates 1 − α, whatever the object's color. Its standard deviation comes from
the scatter of the terms, so an object with a texture of its own counts as noise.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, check_same_size
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, check_picture, with_noise
from blurmatte.streaks import Streak, require_streaks

Array = npt.NDArray[np.float64]

_NEAR = 7  # pixels: side of the neighborhood that v speaks for
_SIGMAS = 2.0  # v this near zero is zero
_MAX_STD = 0.15  # v less certain than this says nothing
_MAX_PIECE_STD = 0.05  # the same for a piece of the core as a whole
_LEAST_STD = 0.01  # v is not better known than this: a plate never fits its image exactly
_LEAST_AREA = 9  # pixels of a piece of the core


def pick_colors(image: LinearImage, x: float, y: float, radius: float = 2) -> Array:
    """Colors of the pixels around a point that shows nothing but the object.

    Parameters
    ----------
    image : LinearImage
        The picture with the streak, where the object is opaque; or one where it is sharp.
    x, y : float
        The point, pixels: x right, y down, pixel centers at whole numbers.
    radius : float
        How far around it, pixels, >= 0. The nearest pixel always belongs.

    Returns
    -------
    (n, 3) float64
        Linear light of the pixels that are not clipped.

    Raises
    ------
    ValueError
        If the point lies outside the picture or the radius is negative.
    ColorModelError
        If all of the pixels are clipped.
    """
    check_picture("image", image)
    width, height = image.size
    if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
        raise ValueError(
            f"the point {x:g},{y:g} must lie in the picture of {width}x{height} pixels"
        )
    if not (np.isfinite(radius) and radius >= 0):
        raise ValueError(f"radius must be finite and not negative, got {radius:g}")
    column, row = min(round(x), width - 1), min(round(y), height - 1)
    rows, columns = np.ogrid[:height, :width]
    near = (columns - x) ** 2 + (rows - y) ** 2 <= radius**2
    near[row, column] = True
    colors = image.rgb[near & image.valid]
    if len(colors) == 0:
        raise ColorModelError(
            f"every pixel within {radius:g} of {x:g},{y:g} is clipped; pick a darker place"
        )
    return colors.astype(float)


def core_colors(image: LinearImage, plate: LinearImage, streak: Streak | None = None) -> Array:
    """Colors of the streak's opaque core: where the plate's texture is gone from the image.

    Parameters
    ----------
    image, plate : LinearImage
        The same size; noise that is not known is measured.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given.

    Returns
    -------
    (n, 3) float64
        Linear light of the core's pixels that are not clipped.

    Raises
    ------
    ValueError
        If the sizes differ.
    ColorModelError
        If the plate is too flat to tell, or the object hid it nowhere all the time.
    MotionError
        If no streak was given and nothing moved.
    """
    from scipy import ndimage

    check_same_size("image", image.size, "plate", plate.size)
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    terms = _terms(image, plate, streak)
    v, v_std = _share(*terms, _neighborhood)
    told = ndimage.binary_erosion(streak.mask[streak.rows_columns], np.ones((_NEAR, _NEAR), bool))
    told &= v_std < _MAX_STD
    if not told.any():
        raise ColorModelError(
            "the plate is too flat behind the streak to tell where the object hides it; give the "
            "color, or pick pixels that show nothing but the object"
        )
    core = _opaque_pieces(told & (np.abs(v) < _SIGMAS * v_std), terms)
    core &= image.valid[streak.rows_columns]
    if not core.any():
        raise ColorModelError(
            "no opaque core can be told in the streak: the plate shines through it, or is too flat "
            "to be sure that it does not; give the color, or pick it in a sharp picture"
        )
    return image.rgb[streak.rows_columns][core].astype(float)


def _terms(image: LinearImage, plate: LinearImage, streak: Streak) -> tuple[Array, Array, Array]:
    """(h, w) each, of the streak's box: ⟨∇C, ∇B⟩, |∇B|², and what noise adds to the latter."""
    image, plate = image.crop(streak.box), plate.crop(streak.box)
    C, B = (np.asarray(picture.rgb, dtype=float) for picture in (image, plate))
    noise = np.asarray(plate.variance, dtype=float).sum(axis=-1)
    valid = image.valid & plate.valid
    shared, own, extra = (np.zeros(valid.shape) for _ in range(3))
    for first, second in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = valid[first] & valid[second]
        step_C, step_B = C[second] - C[first], B[second] - B[first]
        shared[first] += both * np.sum(step_C * step_B, axis=-1)
        own[first] += both * np.sum(step_B**2, axis=-1)
        extra[first] += both * (noise[first] + noise[second])
    return shared, own, extra


def _neighborhood(terms: Array) -> Array:
    from scipy import ndimage

    return np.asarray(_NEAR**2 * ndimage.uniform_filter(terms, _NEAR, mode="constant"))


def _share(
    shared: Array, own: Array, noise: Array, total: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """The share v and its standard deviation; a texture that noise hides has an infinite one."""
    texture = np.maximum(total(own - noise), 1e-30)
    v = total(shared) / texture
    scatter = total(shared**2) - 2 * v * total(shared * own) + v**2 * total(own**2)
    hidden = total(own - noise) < 0.5 * total(noise)
    return v, np.where(hidden, np.inf, np.sqrt(np.maximum(scatter, 0)) / texture)


def _opaque_pieces(candidates: Bools, terms: tuple[Array, Array, Array]) -> Bools:
    """The connected pieces whose v is zero as a whole too, which tells it far more sharply."""
    from scipy import ndimage

    pieces, count = ndimage.label(candidates)
    numbers = np.arange(1, count + 1)

    def in_each(values: Array) -> Array:
        return np.asarray(ndimage.sum_labels(values, pieces, numbers), dtype=float)

    v, v_std = _share(*terms, in_each)
    area = in_each(np.ones(pieces.shape))
    opaque = (v < _SIGMAS * np.maximum(v_std, _LEAST_STD)) & (v_std < _MAX_PIECE_STD)
    opaque &= area >= _LEAST_AREA
    core = np.isin(pieces, numbers[opaque])
    deep = ndimage.binary_erosion(core, iterations=1)  # a rim may owe its v to the inside
    return np.asarray(deep if np.count_nonzero(deep) >= _LEAST_AREA else core)

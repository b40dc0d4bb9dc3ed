"""Samples of the object's color: picked by hand, or from the opaque core of a streak.

They are the input of `ColorModel.from_samples`. In this file C is the image's light and B the plate's.
The contrast of the plate's texture in the image is 1 − α. It is estimated over a neighborhood by

    v = Σ⟨∇C, ∇B⟩ / (Σ|∇B|² − noise)

independently of the object's color. The standard deviation of v comes from the scatter of the terms,
so that texture of the object counts as noise.
"""

from collections.abc import Callable

import numpy as np
import scipy

from blurmatte.calibration import with_noise
from blurmatte.checks import Array, Bools, check_same_size
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, check_picture
from blurmatte.statistics import window_sums
from blurmatte.streaks import Streak, require_streaks

# Which pixels count as opaque.
_WINDOW_PX = 7  # width of the neighborhood of v
_ZERO_STD = 2.0  # standard deviations within which v is zero
# Largest standard deviation of v for a pixel, and for a connected piece of the core
_MAX_STD = 0.15
_MAX_PIECE_STD = 0.05
# Standard deviation of v for a perfect fit: a plate has errors of its own
_MIN_PIECE_STD = 0.01
_MIN_AREA_PX = 9  # pixels of a piece


def pick_colors(image: LinearImage, x: float, y: float, radius: float = 2) -> Array:
    """Colors of the pixels around a point at which only the object is visible.

    Parameters
    ----------
    image : LinearImage
        The picture with the streak, where the object is opaque; or a sharp picture of the object.
    x, y : float
        The point, pixels: x right, y down, pixel centers at whole numbers.
    radius : float
        Pixels, >= 0. The nearest pixel is always included.

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

    Examples
    --------
    >>> bm.color.pick_colors(plate, 20, 12, radius=1).mean(axis=0).round(2)
    array([0.3 , 0.33, 0.07])
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
    """Colors of the streak's opaque core, where the image lacks the plate's texture.

    Parameters
    ----------
    image, plate : LinearImage
        The same size; unknown noise is measured.
    streak : Streak, optional
        Where the object moved; by default the strongest of `find_streaks`.

    Returns
    -------
    (n, 3) float64
        Linear light of the core's pixels that are not clipped.

    Raises
    ------
    ValueError
        If the sizes differ.
    ColorModelError
        If the plate is too flat, or the object is opaque nowhere.
    MotionError
        If no streak was given and nothing moved.

    Examples
    --------
    >>> slow = bm.Trajectory.line((56, 36), (66, 36))
    >>> scene = bm.rendering.Scene(wall, slow, bm.rendering.Ball(20, orange))
    >>> colors = bm.color.core_colors(bm.rendering.render(scene, 40).image, bm.LinearImage(wall))
    >>> print(bm.ColorModel.from_samples(colors))
    ColorModel(#ffc048, rank 1, ±0.033°)
    """
    check_same_size("image", image.size, "plate", plate.size)
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    terms = _terms(image, plate, streak)
    v, v_std = _share(*terms, lambda x: window_sums(x, _WINDOW_PX, "constant"))
    window = np.ones((_WINDOW_PX, _WINDOW_PX), bool)
    known = scipy.ndimage.binary_erosion(streak.mask[streak.rows_columns], window)
    known &= v_std < _MAX_STD
    if not known.any():
        raise ColorModelError(
            "the plate behind the streak has too little texture to find opaque pixels; give the color, "
            "or pick pixels of the object alone"
        )
    core = _opaque_pieces(known & (np.abs(v) < _ZERO_STD * v_std), terms)
    core &= image.valid[streak.rows_columns]
    if not core.any():
        raise ColorModelError(
            "the streak has no opaque core: the plate is visible through it, or has too little "
            "texture; give the color, or pick it in a sharp picture"
        )
    return image.rgb[streak.rows_columns][core].astype(float)


def _terms(image: LinearImage, plate: LinearImage, streak: Streak) -> tuple[Array, Array, Array]:
    """(h, w) each, of the streak's box: ⟨∇C, ∇B⟩, |∇B|², and the noise in the latter."""
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


def _share(
    shared: Array, own: Array, noise: Array, total: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """V and its standard deviation, infinite where noise exceeds the texture."""
    texture = np.maximum(total(own - noise), 1e-30)
    v = total(shared) / texture
    scatter = total(shared**2) - 2 * v * total(shared * own) + v**2 * total(own**2)
    hidden = total(own - noise) < 0.5 * total(noise)
    return v, np.where(hidden, np.inf, np.sqrt(np.maximum(scatter, 0)) / texture)


def _opaque_pieces(candidates: Bools, terms: tuple[Array, Array, Array]) -> Bools:
    """The connected pieces whose v over the whole piece is zero, a sharper test than by pixel."""
    pieces, count = scipy.ndimage.label(candidates)
    numbers = np.arange(1, count + 1)

    def in_each(values: Array) -> Array:
        """Sums of values over each piece."""
        return np.asarray(scipy.ndimage.sum_labels(values, pieces, numbers), dtype=float)

    v, v_std = _share(*terms, in_each)
    area = in_each(np.ones(pieces.shape))
    opaque = v < _ZERO_STD * np.maximum(v_std, _MIN_PIECE_STD)
    opaque &= (v_std < _MAX_PIECE_STD) & (area >= _MIN_AREA_PX)
    core = np.isin(pieces, numbers[opaque])
    deep = scipy.ndimage.binary_erosion(core, iterations=1)  # v of a rim contains the inside
    return np.asarray(deep if np.count_nonzero(deep) >= _MIN_AREA_PX else core)

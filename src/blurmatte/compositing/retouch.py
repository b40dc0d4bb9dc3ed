"""Change an object in its own picture, or remove it.

With premultiplied light P and alpha before, and P' and alpha' after the edit, a picture C over the
plate B becomes

    C' = C + (P' + (1 − alpha') B) − (P + (1 − alpha) B).

Grain, shadows and reflections that the layer does not explain are preserved, as is every pixel in
which the layer did not change.
"""

from dataclasses import replace

import numpy as np
import scipy

from blurmatte.background import Match, PlateGuess
from blurmatte.checks import Bools, check_map, check_same_size, rows_columns
from blurmatte.layer import Layer, box_around, check_layer
from blurmatte.radiometry import LinearImage, check_picture


def retouch(
    image: LinearImage, layer: Layer, edited: Layer, plate: LinearImage | None = None
) -> tuple[LinearImage, Bools]:
    """Replace the object of an image by an edited layer.

    Parameters
    ----------
    image : LinearImage
        The picture of the layer.
    layer, edited : Layer
        The object before and after the edit.
    plate : LinearImage, optional
        The scene without the object; required if alpha changes.

    Returns
    -------
    picture : LinearImage
        In sRGB, unclipped; its noise is unknown.
    changed : (H, W) bool
        True where the layer, and so the picture, changed.

    Raises
    ------
    ValueError
        If sizes differ, or alpha changes and there is no plate.

    Examples
    --------
    >>> blue, changed = bm.retouch(image, layer, layer.recolor("#2040ff"), plate)
    """
    check_picture("image", image)
    check_layer("layer", layer)
    check_layer("edited", edited)
    check_same_size("the layer", layer.size, "the image", image.size)
    check_same_size("the layer", layer.size, "the edited layer", edited.size)
    if plate is not None:
        check_picture("plate", plate)
        check_same_size("the plate", plate.size, "the image", image.size)
    image = image.in_srgb()
    rgb, changed = image.rgb.copy(), np.zeros(image.valid.shape, bool)
    box = box_around(layer, edited)
    if box is not None:
        place = rows_columns(box)
        light = edited.premultiplied[place] - layer.premultiplied[place]
        uncovered = layer.alpha[place] - edited.alpha[place]
        changed[place] = (uncovered != 0) | light.any(axis=-1)
        if plate is not None:
            light = light + uncovered[..., None] * plate.crop(box).in_srgb().rgb
        elif uncovered.any():
            raise ValueError("where alpha changes the scene behind comes out: give the plate, too")
        rgb[place][changed[place]] += light[changed[place]].astype(rgb.dtype)
    return replace(image, rgb=rgb, noise=None), changed


def remove(
    image: LinearImage,
    plate: LinearImage,
    streak: Bools,
    grow: int = 0,
    match: Match | None = None,
) -> tuple[LinearImage, Bools]:
    """Replace the streak, with the object and its shadow, by the plate.

    The clipped light of the plate is used as it was recorded, so that no pixel of the object is kept
    in a highlight.

    Parameters
    ----------
    image, plate : LinearImage
        The picture, and the scene without the object. Of a `PlateGuess`, the scene with grain.
    streak : (H, W) bool
        Pixels to replace, e.g. `solution.streak`.
    grow : int
        Pixels by which the streak is dilated on every side.
    match : Match, optional
        From `fit_match`; applied to the plate. By default the plate matches already.

    Returns
    -------
    picture : LinearImage
        In sRGB; its noise is unknown.
    changed : (H, W) bool
        The dilated streak without pixels in which the plate is unknown.

    Raises
    ------
    TypeError, ValueError
        If sizes differ, the streak is no array of bools, or `grow` is negative.

    Examples
    --------
    >>> gone, changed = bm.remove(image, plate, solution.streak)
    >>> int(changed.sum())
    2136
    """
    check_picture("image", image)
    check_picture("plate", plate)
    check_same_size("the plate", plate.size, "the image", image.size)
    streak = check_map("streak", streak, image.rgb.shape[:2], kinds="b")
    if grow < 0:
        raise ValueError(f"grow must be 0 or more pixels, got {grow}")
    if grow > 0:
        streak = scipy.ndimage.maximum_filter(streak, 2 * grow + 1)
    if isinstance(plate, PlateGuess):
        plate = plate.with_grain
    # Interpolation spreads `valid` but not `clipped`: declare what was recorded valid before it.
    plate = replace(plate, valid=plate.valid | plate.clipped.any(axis=-1))
    if match is not None:
        plate = match.apply(plate)
    changed = np.asarray(streak & plate.valid)
    image, behind = image.in_srgb(), plate.in_srgb()
    rgb = np.where(changed[..., None], behind.rgb, image.rgb).astype(image.rgb.dtype)
    return replace(image, rgb=rgb, noise=None), changed

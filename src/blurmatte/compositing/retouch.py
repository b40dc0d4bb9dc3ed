"""The object changed within its own picture, or removed from it.

With P, alpha of the object before and P', alpha' after, a picture C over the plate B becomes

    C' = C + (P' + (1 − alpha') B) − (P + (1 − alpha) B):

what the layer does not explain, grain, shadow or reflection, stays, and where nothing of the layer
changed, so does every pixel.
"""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools, check_map, check_same_size
from blurmatte.layer import Layer, box_around, check_layer
from blurmatte.radiometry import LinearImage, check_picture


def retouch(
    image: LinearImage, layer: Layer, edited: Layer, plate: LinearImage | None = None
) -> tuple[LinearImage, Bools]:
    """The image with its object changed.

    Parameters
    ----------
    image : LinearImage
        The picture that the layer was taken from.
    layer, edited : Layer
        The object as it is, and as it shall be.
    plate : LinearImage, optional
        The scene without it; needed where alpha changes.

    Returns
    -------
    picture : LinearImage
        In sRGB, unclipped; its noise is not known.
    changed : (H, W) bool
        Where it is another than `image`: where the layer changed.

    Raises
    ------
    ValueError
        If sizes differ, or alpha changes and there is no plate.
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
        x0, y0, x1, y1 = box
        place = np.s_[y0:y1, x0:x1]
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
    image: LinearImage, plate: LinearImage, streak: Bools, grow: int = 0
) -> tuple[LinearImage, Bools]:
    """The image with the plate where the streak was: nothing of the object stays, nor its shadow.

    Parameters
    ----------
    image, plate : LinearImage
        The picture, and the scene without the object, matched to it.
    streak : (H, W) bool
        What to replace, e.g. `solution.streak`.
    grow : int
        How many pixels more on every side.

    Returns
    -------
    picture : LinearImage
        In sRGB; its noise is not known.
    changed : (H, W) bool
        The streak, but for pixels of which the plate knows no light.

    Raises
    ------
    TypeError, ValueError
        If sizes differ, the streak is no array of bools, or `grow` is negative.
    """
    check_picture("image", image)
    check_picture("plate", plate)
    check_same_size("the plate", plate.size, "the image", image.size)
    check_map("streak", streak, image.rgb.shape[:2], kinds="b")
    if grow < 0:
        raise ValueError(f"grow must be 0 or more pixels, got {grow}")
    if grow > 0:
        from scipy.ndimage import maximum_filter

        streak = maximum_filter(streak, 2 * grow + 1)
    changed = np.asarray(streak & (plate.valid | plate.clipped.any(axis=-1)))
    image, behind = image.in_srgb(), plate.in_srgb()
    rgb = np.where(changed[..., None], behind.rgb, image.rgb).astype(image.rgb.dtype)
    return replace(image, rgb=rgb, noise=None), changed

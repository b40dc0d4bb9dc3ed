"""Layers in pictures: over backgrounds, back in their own picture, and combined; exposures of paints.

With premultiplied light P and alpha before, and P' and alpha' after the edit, a picture C over the
plate B becomes

    C' = C + (P' + (1 − alpha') B) − (P + (1 − alpha) B).

Grain, shadows and reflections that the layer does not explain are preserved, as is every pixel in
which the layer did not change.

The premultiplied light of an object of several paints is a mixture P = s (a₁ c₁ + a₂ c₂ + …) of their
colors cᵢ with their exposure fractions aᵢ and a common shading factor s. The fractions sum to alpha, so
with P = x₁ c₁ + x₂ c₂ + … they are aᵢ = alpha · xᵢ / Σ x, for any shading ([GC07 §4]).
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import scipy

from blurmatte.background import Match, PlateGuess
from blurmatte.checks import Array, Bools, Floats, check_map, check_same_size, rows_columns
from blurmatte.layer import Color, Layer, box_around, check_layer, colors_of, resized, split
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.radiometry import LinearImage, check_picture, light_in_srgb


def cover(picture: LinearImage, size: tuple[int, int]) -> LinearImage:
    """Scale a picture to cover `size` and crop it to the center.

    Resampling is in linear light.

    Parameters
    ----------
    picture : LinearImage
    size : (int, int)
        Width and height of the result.

    Returns
    -------
    LinearImage
        Of that size; `valid` where all contributing pixels are. Its noise is unknown.

    Raises
    ------
    ValueError
        If a side is less than 1.

    Examples
    --------
    >>> beach = bm.LinearImage(np.full((200, 300, 3), [0.2, 0.4, 0.7]))
    >>> background = bm.compositing.cover(beach, image.size)
    >>> background.size
    (128, 72)
    >>> picture = layer.over(background)
    """
    check_picture("picture", picture)
    width, height = size
    if min(size) < 1:
        raise ValueError(f"size must be (width, height), both 1 or more, got {size}")
    if picture.size == size:
        return picture
    scale = max(width / picture.size[0], height / picture.size[1])
    whole = [
        max(side, math.ceil(scale * old - 1e-9))
        for side, old in zip(size, picture.size, strict=True)
    ]
    left, top = ((side - wanted) // 2 for side, wanted in zip(whole, size, strict=True))
    scaled = resized(np.dstack([picture.rgb, ~picture.valid]), whole)
    kept = scaled[top : top + height, left : left + width]
    rgb = np.ascontiguousarray(kept[..., :3]).astype(picture.rgb.dtype, copy=False)
    return LinearImage(rgb, valid=kept[..., 3] < 1e-3, meta=picture.meta)


def light_gain(background: LinearImage, plate: LinearImage) -> Array:
    """Ratio of the light of a background to that of the plate, for relighting a layer.

    Parameters
    ----------
    background : LinearImage
        The new background, of any size.
    plate : LinearImage
        The plate of the layer.

    Returns
    -------
    (3,) float
        Mean light of the background over that of the plate, per channel, for `Layer.relight`. It
        assumes that both scenes have the same mean reflectance (gray world).

    Raises
    ------
    ValueError
        If a channel of the plate is black, or a picture has no valid pixels.

    Examples
    --------
    >>> evening = bm.LinearImage(plate.rgb * [0.5, 0.4, 0.3])
    >>> gain = bm.compositing.light_gain(evening, plate)
    >>> gain.round(2)
    array([0.5, 0.4, 0.3])
    >>> picture = layer.relight(gain).over(evening)
    """
    check_picture("background", background)
    check_picture("plate", plate)
    means = []
    for name, picture in (("background", background), ("plate", plate)):
        seen = picture.in_srgb()
        if not seen.valid.any():
            raise ValueError(f"no pixel of the {name} is valid; its light cannot be measured")
        means.append(seen.rgb[seen.valid].mean(axis=0, dtype=float))
    if means[1].min() <= 0:
        raise ValueError("a channel of the plate has no light on average; give the gain yourself")
    return np.asarray(np.maximum(means[0], 0) / means[1])


def fade_between(first: LinearImage, second: LinearImage, count: int = 24) -> Iterator[LinearImage]:
    """Frames of a periodic cross-fade between two pictures, in linear light.

    With a plate as `first` and a layer over it as `second`, the layer fades in and out.

    Parameters
    ----------
    first, second : LinearImage
        Pictures of one size.
    count : int
        Number of frames, 2 or more.

    Yields
    ------
    LinearImage
        The frames in order; their noise is unknown.

    Raises
    ------
    ValueError
        If sizes differ or `count` is below 2.

    Examples
    --------
    >>> steps = list(bm.compositing.fade_between(image, plate, count=5))
    >>> len(steps)
    5
    >>> half = steps[2]
    """
    check_picture("first", first)
    check_picture("second", second)
    check_same_size("the first picture", first.size, "the second", second.size)
    if count < 2:
        raise ValueError(f"count must be 2 or more frames, got {count}")
    first, second = first.in_srgb(), second.in_srgb()
    for number in range(count):
        share = np.float32((1 - np.cos(2 * np.pi * number / count)) / 2)
        yield replace(second, rgb=first.rgb + share * (second.rgb - first.rgb), noise=None)


def stack(layers: Iterable[Layer]) -> Layer:
    """Composite layers one over another, the first lowest.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size, e.g. the layers of a clip in order. Only one is in memory at a time.

    Returns
    -------
    Layer
        Equivalent to compositing the layers one after another.

    Raises
    ------
    ValueError
        If there are no layers, or sizes differ.

    Examples
    --------
    >>> layers = [bm.rendering.render(part, 40).layer for part in throw.exposures(6, duty=0.5)]
    >>> picture = bm.compositing.stack(layers).over(plate)
    """
    return reduce(_above, _of_one_size(layers))


def long_exposure(layers: Iterable[Layer]) -> Layer:
    """Combine layers of successive exposures into the layer of one long exposure.

    Parameters
    ----------
    layers : iterable of Layer
        Of one size, from contiguous exposures of equal length. Only one is in memory at a time.

    Returns
    -------
    Layer
        Means of alpha and light, as with a slower shutter.

    Raises
    ------
    ValueError
        If there are no layers, or sizes differ.

    Examples
    --------
    >>> layers = [bm.rendering.render(part, 40).layer for part in throw.exposures(6, duty=0.5)]
    >>> exposed = bm.compositing.long_exposure(layers)
    >>> picture = exposed.over(plate)
    """
    row = _of_one_size(layers)
    first = next(row)
    alpha, light = first.alpha.astype(float), first.premultiplied.astype(float)
    count = 1
    for layer in row:
        count += 1
        alpha += layer.alpha
        light += layer.premultiplied
    kind = first.alpha.dtype
    return Layer((alpha / count).astype(kind), (light / count).astype(kind))


def _above(below: Layer, layer: Layer) -> Layer:
    """`layer` over `below`."""
    through = 1 - layer.alpha
    alpha = layer.alpha + through * below.alpha
    return Layer(alpha, layer.premultiplied + through[..., None] * below.premultiplied)


def _of_one_size(layers: Iterable[Layer]) -> Iterator[Layer]:
    """Yield the layers; raises ValueError if there are none or sizes differ."""
    size = None
    for number, layer in enumerate(layers):
        check_layer(f"layer {number}", layer)
        size = size or layer.size
        check_same_size(f"layer {number}", layer.size, "the first", size)
        yield layer
    if size is None:
        raise ValueError("there are no layers; give one at least")


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


@dataclass(frozen=True, eq=False)
class Exposures:
    """Exposure fraction of each paint in every pixel.

    Parameters
    ----------
    fraction : (H, W, n) float
        Exposure fraction of each of n paints; the sum is alpha. 0 where it is unknown.
    fraction_std : (H, W, n) float
        Upper bound of its standard deviation: the errors of alpha and of the channels in one pixel are
        correlated, so their absolute values are added. Infinite where the fraction is unknown.
    paints : (n, 3) float
        Linear light.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> paints.fraction.shape, int(paints.known.sum())
    ((72, 128, 2), 1592)
    """

    fraction: Floats
    fraction_std: Floats
    paints: Array

    @property
    def known(self) -> Bools:
        """(H, W) True where the split is known."""
        return np.asarray(np.isfinite(self.fraction_std).all(axis=-1))


def split_exposure(solution: Solution, *paints: Color) -> Exposures:
    """Split alpha into the exposure fractions of an object's paints.

    Parameters
    ----------
    solution : Solution
        Usually with a color model of rank 2, for two paints.
    *paints : str or (3,) float
        Two or three colors under the object's lighting, sRGB-coded hex or linear light. Only their
        ratios matter, not a common factor.

    Returns
    -------
    Exposures

    Raises
    ------
    ValueError
        If there is only one paint, or the colors are almost linearly dependent.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> total = paints.fraction.sum(axis=-1)
    >>> print(f"{total.max():.2f}, alpha {solution.alpha.max():.2f}")
    0.34, alpha 0.34
    """
    check_solution("solution", solution)
    colors = colors_of(paints)
    if len(colors) < 2:
        raise ValueError("one paint was there for all of alpha; give two or three")
    light = light_in_srgb(solution.premultiplied, solution.model.to_srgb)
    x = split(light, colors)
    whole = x.sum(axis=-1, keepdims=True)
    known = solution.streak & solution.known & (whole[..., 0] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = x / whole
        fraction = solution.alpha[..., None] * share
        std = solution.alpha_std[..., None] * np.abs(share) + _std_from_light(
            solution, colors, x, whole
        )
    fraction = np.where(known[..., None], fraction, 0)
    std = np.where(known[..., None] & np.isfinite(std), std, np.inf)
    kind = solution.alpha.dtype
    return Exposures(fraction.astype(kind), std.astype(kind), colors)


def _std_from_light(solution: Solution, colors: Array, x: Floats, whole: Floats) -> Floats:
    """Contribution of errors of the light: ∂aᵢ/∂x = alpha (δ − share) / Σx, x linear in light."""
    to_sum = np.linalg.pinv(colors)  # (3, n): light to x
    std = np.zeros_like(x)
    for channel, row in enumerate(to_sum):
        slope = (row - x / whole * row.sum()) / whole
        std += np.abs(slope) * solution.premultiplied_std[..., channel, None]
    return np.asarray(np.abs(solution.alpha[..., None]) * std)

"""Layer: the moving object without its background, for compositing and editing.

`alpha` is the fraction of the exposure, `premultiplied` the object's light: alpha times its color.
Straight color is computed only for output (`Layer.straight`). Every edit returns a new layer; edits
are linear in light and clip only alpha.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import (
    Array,
    Box,
    Floats,
    Floats32,
    box_of,
    check_box,
    check_kind,
    check_light,
    check_map,
    check_same_size,
    enclosing,
    rows_columns,
)
from blurmatte.formats import MAX_PIXELS
from blurmatte.notebook import Displayed
from blurmatte.radiometry import LinearImage, check_picture, light_of_hex

Color = str | Sequence[float] | Floats


@dataclass(frozen=True, eq=False)
class Layer(Displayed):
    """Exposure fraction and premultiplied light of an object.

    Parameters
    ----------
    alpha : (H, W) float
        Fraction of the exposure, 0…1, times the opacity; 0 of an object that only adds light.
    premultiplied : (H, W, 3) float
        Linear light, alpha times the object's color.

    Raises
    ------
    TypeError, ValueError
        For arrays of another dtype or shape.

    Examples
    --------
    >>> layer = bm.Layer(solution.layer.alpha, solution.layer.premultiplied)
    >>> layer.box
    (20, 20, 99, 55)
    >>> blue = layer.recolor("#2040ff").fade(2)
    >>> picture = blue.over(plate)
    """

    alpha: Floats
    premultiplied: Floats

    def __post_init__(self) -> None:
        light = check_light("premultiplied", self.premultiplied)
        object.__setattr__(self, "premultiplied", light)
        object.__setattr__(self, "alpha", check_map("alpha", self.alpha, light.shape[:2]))

    def __repr__(self) -> str:
        width, height = self.size
        return f"Layer({width}x{height}, alpha up to {np.nanmax(self.alpha):.2f})"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.alpha.shape
        return width, height

    @property
    def empty(self) -> bool:
        """True if alpha and light are 0 everywhere."""
        return self._box is None

    @property
    def only_adds_light(self) -> bool:
        """True if alpha is 0 everywhere, and light is not."""
        return not self.empty and not self.alpha[rows_columns(self.box)].any()

    @property
    def box(self) -> Box:
        """(x0, y0, x1, y1) bounding box of the nonzero pixels, x1 and y1 exclusive.

        Raises
        ------
        ValueError
            If the layer is empty.
        """
        if self._box is None:
            raise ValueError("the layer is empty: alpha is 0 everywhere")
        return self._box

    @cached_property
    def _box(self) -> Box | None:
        there = np.asarray(self.alpha != 0)
        for channel in range(3):  # several times as fast as `any` over the last axis
            there |= self.premultiplied[..., channel] != 0
        return box_of(there) if there.any() else None

    @property
    def color(self) -> Array:
        """(3,) linear color of the object, the mean weighted by alpha.

        Of a layer that only adds light its brightest channel is 1.

        Raises
        ------
        ValueError
            If the layer is empty.
        """
        place = rows_columns(self.box)
        light = self.premultiplied[place].sum(axis=(0, 1), dtype=float)
        amount = light.max() if self.only_adds_light else self.alpha[place].sum(dtype=float)
        return np.asarray(light / max(float(amount), 1e-12))

    def over(self, background: LinearImage) -> LinearImage:
        """Put the layer over a background of the same size [GC07 Eq. 3].

        Returns
        -------
        LinearImage
            premultiplied + (1 − alpha) · background, unclipped, of unknown noise, in linear sRGB.

        Raises
        ------
        ValueError
            If the sizes differ.
        """
        check_picture("background", background)
        check_same_size("the layer", self.size, "the background", background.size)
        background = background.in_srgb()
        through = (1 - self.alpha[..., None]).astype(background.rgb.dtype, copy=False)
        return replace(background, rgb=self.premultiplied + through * background.rgb, noise=None)

    def straight(self) -> Floats:
        """(H, W, 3) linear color of the object; 0 where alpha is 0."""
        straight = np.zeros(self.premultiplied.shape, self.premultiplied.dtype)
        if self._box is None:
            return straight
        place = rows_columns(self._box)
        alpha = self.alpha[place][..., None]
        np.divide(self.premultiplied[place], alpha, out=straight[place], where=alpha > 0)
        return straight

    def fade(self, factor: float) -> "Layer":
        """Alpha times a factor, at most 1; color and shading are kept [GC07 §4].

        Raises
        ------
        ValueError
            If the factor is negative or not finite.
        """
        _check_factor("factor", factor)

        def faded(part: Layer) -> Layer:
            """A layer with alpha times the factor, at most 1."""
            alpha = np.minimum(factor * part.alpha, np.maximum(part.alpha, 1))
            share = np.full_like(alpha, factor)
            np.divide(alpha, part.alpha, out=share, where=part.alpha > 0)
            return Layer(alpha, part.premultiplied * share[..., None])

        return self._changed(faded)

    def relight(self, gain: npt.ArrayLike) -> "Layer":
        """The object's light times a gain, one number or one for each channel.

        Raises
        ------
        ValueError
            If the gain is neither, negative, or not finite.
        """
        with np.errstate(over="ignore"):  # infinity is rejected below
            gains = np.asarray(gain, dtype=self.premultiplied.dtype)
        if gains.shape not in ((), (1,), (3,)):
            raise ValueError(f"gain must be one number or three, got {gain!r}")
        _check_factor("gain", gains)
        return self._changed(lambda part: Layer(part.alpha, part.premultiplied * gains))

    def amplify(self, factor: float, brightness: float = 1.0) -> "Layer":
        """Enhance a faint object: alpha times a factor, color scaled to a brightness.

        The enhancement of [GC07 Fig. 4]. The color is scaled so that the quantile `brightest` becomes
        `brightness`. Hue and shading are kept.

        Parameters
        ----------
        factor : float
            As in `fade`.
        brightness : float
            Linear light, 1 = white.

        Raises
        ------
        ValueError
            If a number is negative or not finite, or the layer is empty.
        """
        _check_factor("brightness", brightness)
        top = self.brightest
        faded = self if self.only_adds_light else self.fade(factor)
        return faded if top <= 0 else faded.relight(brightness / top)

    @property
    def brightest(self) -> float:
        """The 99 % quantile of the color's brightest channel, weighted by alpha.

        Of a layer that only adds light, the light is its own weight.

        Raises
        ------
        ValueError
            If the layer is empty.
        """
        place = rows_columns(self.box)
        lit = self.only_adds_light
        brightest = (self.premultiplied if lit else self.straight())[place].max(axis=-1).ravel()
        weight = (np.maximum(brightest, 0) if lit else self.alpha[place].ravel()).astype(float)
        order = np.argsort(brightest, kind="stable")
        share = np.cumsum(weight[order])
        return float(brightest[order[np.searchsorted(share, 0.99 * share[-1])]])

    def recolor(self, *colors: Color, paints: Sequence[Color] | None = None) -> "Layer":
        """The object with other hues and the same shading.

        Light is divided between paints by least squares, and the color of each paint is replaced, so
        that mixtures of two paints become mixtures of their new colors. Without `paints` the only paint
        is the object's mean color.

        Parameters
        ----------
        *colors : str or (3,) float
            New colors, as sRGB-coded hex or as linear light; one for each paint.
        paints : sequence of str or (3,) float, optional
            One to three colors of the object, of different hues, such as a paint and white for its
            highlights.

        Raises
        ------
        ValueError
            If the numbers of colors and paints differ, paints have one hue, or the layer is empty.
        """
        old, new = colors_of([self.color] if paints is None else paints), colors_of(colors)
        if len(new) != len(old):
            raise ValueError(f"give as many colors as paints, {len(old)}, got {len(new)}")

        def painted(part: Layer) -> Layer:
            """A layer with the new colors."""
            amounts = split(part.premultiplied, old)
            return Layer(part.alpha, amounts @ new.astype(amounts.dtype))

        return self._changed(painted)

    def crop(self, box: Box) -> "Layer":
        """The part inside a box (x0, y0, x1, y1) of pixels, x1 and y1 exclusive; a view.

        Raises
        ------
        ValueError
            If the box is empty or begins outside the layer.
        """
        check_box(box, self.size)
        place = rows_columns(box)
        return Layer(self.alpha[place], self.premultiplied[place])

    def place(
        self,
        size: tuple[int, int],
        center: tuple[float, float] | None = None,
        scale: float = 1.0,
    ) -> "Layer":
        """The object at another position in a layer of another size; parts outside are cut off.

        Parameters
        ----------
        size : (int, int)
            (width, height) of the new layer.
        center : (float, float), optional
            (x, y) of the middle of its `box`, rounded to a whole pixel; by default that of the new
            layer.
        scale : float
            Factor of the size; light is averaged or interpolated. 1 keeps every pixel unchanged.

        Raises
        ------
        ValueError
            If a side or the scale is not above 0, the object becomes larger than 200 million pixels, it
            lies outside, or the layer is empty.
        """
        if min(size) < 1:
            raise ValueError(f"size must be (width, height), both 1 or more, got {size}")
        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"scale must be above 0, got {scale}")
        middle = ((size[0] - 1) / 2, (size[1] - 1) / 2) if center is None else center
        part = self.crop(self.box)._scaled(scale)
        first = [round(m - (side - 1) / 2) for m, side in zip(middle, part.size, strict=True)]
        spans = [
            (max(at, 0), min(at + side, whole))
            for at, side, whole in zip(first, part.size, size, strict=True)
        ]
        (x0, x1), (y0, y1) = spans
        if x0 >= x1 or y0 >= y1:
            raise ValueError(
                f"the object would lie outside the picture: around ({middle[0]:g}, {middle[1]:g}) of "
                f"{size[0]}x{size[1]} pixels"
            )
        seen = part.crop((x0 - first[0], y0 - first[1], x1 - first[0], y1 - first[1]))
        return seen.embedded(size, (x0, y0))

    def _changed(self, change: Callable[["Layer"], "Layer"]) -> "Layer":
        """Apply a change that keeps 0 at 0, within the box of the object."""
        if self.empty:
            return self
        return change(self.crop(self.box)).embedded(self.size, self.box[:2])

    def embedded(self, size: tuple[int, int], corner: Sequence[int]) -> "Layer":
        """In a larger, empty layer of a size (width, height); the first pixel is at `corner` (x, y)."""
        (x, y), (width, height) = corner, self.size
        place = np.s_[y : y + height, x : x + width]
        alpha = np.zeros(size[::-1], self.alpha.dtype)  # untouched rows take no memory
        light = np.zeros((*size[::-1], 3), self.premultiplied.dtype)
        alpha[place], light[place] = self.alpha, self.premultiplied
        return Layer(alpha, light)

    def _scaled(self, scale: float) -> "Layer":
        size = [max(1, round(scale * side)) for side in self.size]
        if size == list(self.size):
            return self
        if size[0] * size[1] > MAX_PIXELS:
            raise ValueError(
                f"a scale of {scale:g} makes the object {size[0]:.6g} x {size[1]:.6g} pixels; give a "
                "smaller one"
            )
        pixels = resized(np.dstack([self.premultiplied, self.alpha]), size)
        light = np.ascontiguousarray(pixels[..., :3]).astype(self.premultiplied.dtype)
        return Layer(pixels[..., 3].astype(self.alpha.dtype), light)


def resized(pixels: Floats, size: Sequence[int]) -> Floats32:
    """An array (h, w, 4) in another size (width, height), averaged or interpolated."""
    import OpenImageIO as oiio

    source = oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))
    roi = oiio.ROI(0, size[0], 0, size[1], 0, 1, 0, 4)
    # A filter without negative lobes: no ringing.
    scaled = oiio.ImageBufAlgo.resize(source, "blackman-harris", roi=roi)
    return np.asarray(scaled.get_pixels(oiio.FLOAT))


def empty_layer(size: tuple[int, int]) -> Layer:
    """A transparent layer of a size (width, height)."""
    width, height = size
    return Layer(np.zeros((height, width), np.float32), np.zeros((height, width, 3), np.float32))


def box_around(*layers: Layer) -> Box | None:
    """The bounding box of several layers; None if all are empty."""
    boxes = [layer.box for layer in layers if not layer.empty]
    return enclosing(boxes) if boxes else None


def colors_of(colors: Iterable[Color]) -> Array:
    """(n, 3) linear light of one to three colors, each sRGB-coded hex or linear.

    Raises ValueError for another number, or values that are no colors.
    """
    rows = [
        light_of_hex(color)[0] if isinstance(color, str) else np.asarray(color, dtype=float)
        for color in colors
    ]
    if not 1 <= len(rows) <= 3 or any(row.shape != (3,) for row in rows):
        raise ValueError("give one to three colors, each #rrggbb or three numbers of linear light")
    return np.array(rows)


def split(light: Floats, paints: Array) -> Floats:
    """(..., n) amounts of each paint in light (..., 3), by least squares.

    Raises ValueError if a paint is black, or paints are mixtures of one another to 3 degrees.
    """
    size = np.linalg.norm(paints, axis=1)
    if size.min() < 1e-6:
        raise ValueError("a paint is black; give a color that is not")
    if np.linalg.svd(paints / size[:, None], compute_uv=False)[-1] < 0.05:  # sine of 3°
        raise ValueError("the paints are shades or mixtures of one another; give other colors")
    return np.asarray(light @ np.linalg.pinv(paints).astype(light.dtype))


def _check_factor(name: str, value: float | Floats) -> None:
    if not (np.all(np.isfinite(value)) and np.min(value) >= 0):
        raise ValueError(f"{name} must be 0 or more, got {value}")


def check_layer(name: str, value: object) -> None:
    """Raise TypeError unless it is a Layer."""
    check_kind(name, value, Layer, "use blurmatte.read_layer(file), or solution.layer")

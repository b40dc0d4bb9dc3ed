"""A quick look at pictures and results, as notebooks show them."""

from io import BytesIO
from typing import Any

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.checks import Codes8, check_kind
from blurmatte.deblurring.sharp import Sharp
from blurmatte.figures.drawing import round_up, srgb_codes
from blurmatte.figures.edit import around
from blurmatte.figures.motion import draw_path, draw_sharp
from blurmatte.figures.sheet import Canvas, Panel, size_text
from blurmatte.figures.solution import draw_plate
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage

Shown = LinearImage | Layer | Solution | Motion | Sharp | PlateFit
_MAX_BYTES = 300_000  # of a picture that is stored in a notebook


def draw_look(thing: Shown) -> Codes8:
    """Draw a picture or a result for a quick look.

    Parameters
    ----------
    thing : LinearImage, Layer, Solution, Motion, Sharp or PlateFit

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide: a picture; a layer over a checkerboard, whole, and the layer, its
        color and its alpha around the object; a path on an empty ground, with its errors; the sheets of
        `draw_sharp` and of `draw_plate`.

    Raises
    ------
    TypeError
        For any other type.

    Examples
    --------
    >>> sheet = bm.figures.draw_look(layer)
    >>> bm.write("look.png", sheet)
    """
    check_kind("thing", thing, Shown, "other results have a draw_ function of their own")
    match thing:
        case LinearImage():
            sheet = Canvas()
            sheet.title(thing.meta.source or "picture", f"{size_text(thing.size)} px")
            sheet.grid([Panel(srgb_codes(thing.in_srgb().rgb), "")], "as a screen shows it")
            return sheet.pixels()
        case Motion():
            return draw_path(thing)
        case Sharp():
            return draw_sharp(thing, thing.shutter(0, 1))
        case PlateFit():
            return draw_plate(thing)
    return _layer(thing)


def _layer(thing: Layer | Solution) -> Codes8:
    """A layer, whole and around its object."""
    sheet, layer = Canvas(), thing if isinstance(thing, Layer) else thing.layer
    sheet.title(str(thing), "" if isinstance(thing, Layer) else thing.solver)
    sheet.grid([Panel.layer(layer, "")], "the layer over a checkerboard")
    if not layer.empty:
        part = layer.crop(around(layer))
        panels = [
            Panel.layer(part, "layer"),
            Panel(srgb_codes(part.straight()), "color"),
            Panel.gray(part.alpha, round_up(float(part.alpha.max())), "alpha"),
        ]
        sheet.grid(panels, "the object")
    return sheet.pixels()


def png_of_look(thing: Shown) -> bytes:
    """The sheet of `draw_look` as a PNG of at most 300 kB, for which it is reduced if necessary."""
    from PIL import Image

    sheet = Image.fromarray(draw_look(thing))
    factor = 1.0
    while len(png := _png(sheet, factor)) > _MAX_BYTES:
        # The size of a PNG is nearly proportional to its pixels.
        factor *= max(0.5, min(0.9, float(np.sqrt(_MAX_BYTES / len(png)))))
    return png


def _png(sheet: Any, factor: float) -> bytes:
    """A picture as PNG, its sides times a factor."""
    size = tuple(max(1, round(factor * side)) for side in sheet.size)
    file = BytesIO()
    (sheet if size == sheet.size else sheet.resize(size)).save(file, "png", optimize=True)
    return file.getvalue()

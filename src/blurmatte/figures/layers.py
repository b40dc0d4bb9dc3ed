"""Sheets of layers, before and after an edit and of exposures; and a quick look at any result."""

from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.checks import Box, Codes8, check_kind, check_same_size, grown, rows_columns
from blurmatte.compositing import Exposures
from blurmatte.deblurring.sharp import Sharp
from blurmatte.figures import style
from blurmatte.figures.drawing import fitted, round_up, srgb_codes
from blurmatte.figures.motion import draw_path, draw_sharp
from blurmatte.figures.sheet import Canvas, Layout, Panel, column_width, size_text
from blurmatte.figures.solution import draw_plate
from blurmatte.layer import Layer, box_around, check_layer
from blurmatte.matting.solution import Solution
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage

Shown = LinearImage | Layer | Solution | Motion | Sharp | PlateFit
_MAX_BYTES = 300_000  # of a picture that is stored in a notebook


def draw_edit(
    layer: Layer,
    edited: Layer,
    before: LinearImage | None = None,
    after: LinearImage | None = None,
    remark: str = "",
) -> Codes8:
    """Draw an object before and after an edit, alone and in its picture.

    Parameters
    ----------
    layer, edited : Layer
        The object before and after; either may be empty, but not both.
    before, after : LinearImage, optional
        The picture with each of them; both or none.
    remark : str
        Description of the edit.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    ValueError
        If sizes differ, or both layers are empty.

    Examples
    --------
    >>> sheet = bm.figures.draw_edit(layer, layer.recolor("#2040ff"))
    """
    check_same_size("the layer", layer.size, "the edited layer", edited.size)
    box = around(layer, edited)
    part, new = layer.crop(box), edited.crop(box)
    peak = round_up(float(max(part.alpha.max(), new.alpha.max())))
    sheet = Canvas()
    sheet.title("before and after", f"{size_text(layer.size)} px{remark and f', {remark}'}")
    panels = [
        [
            Panel.layer(one, f"layer {name}", "over a checkerboard"),
            Panel.gray(one.alpha, peak, f"alpha {name}"),
        ]
        for one, name in ((part, "before"), (new, "after"))
    ]
    if before is not None and after is not None:
        strip = [("before", before.in_srgb()), ("after", after.in_srgb())]
        for row, (name, picture) in zip(panels, strip, strict=True):
            check_same_size(name, picture.size, "the layer", layer.size)
            row.insert(0, Panel(srgb_codes(picture.crop(box).rgb), name))
        room = column_width(len(strip)), style.MAX_PICTURE_HEIGHT
        whole = [Panel(np.asarray(fitted(picture, room)[0]), name) for name, picture in strip]
        sheet.row(whole, "the picture")
    rows = [panel for row in panels for panel in row]
    sheet.grid(rows, "the object", Layout.best(part.size, len(rows), len(panels[0])))
    return sheet.pixels()


def draw_exposures(layer: Layer, exposures: Exposures) -> Codes8:
    """Draw the exposure fraction of each paint of an object.

    Parameters
    ----------
    layer : Layer
        The object.
    exposures : Exposures
        Its result of `split_exposure`.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.

    Raises
    ------
    ValueError
        If sizes differ, or the layer is empty.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> sheet = bm.figures.draw_exposures(layer, paints)
    """
    check_layer("layer", layer)
    check_kind(
        "exposures",
        exposures,
        Exposures,
        "use blurmatte.compositing.split_exposure(solution, *paints)",
    )
    height, width, count = exposures.fraction.shape
    check_same_size("the exposures", (width, height), "the layer", layer.size)
    box = around(layer)
    place, part = rows_columns(box), layer.crop(box)
    peak = round_up(float(part.alpha.max()))
    panels = [Panel.layer(part, "layer", "over a checkerboard")]
    codes = srgb_codes(np.minimum(exposures.paints, 1))
    for k in range(count):
        red, green, blue = (int(code) for code in codes[k])
        legend = [((red, green, blue), f"#{red:02x}{green:02x}{blue:02x}")]
        panel = Panel.gray(exposures.fraction[place][..., k], peak, f"paint {k + 1}")
        panels.append(replace(panel, remark=f"{panel.remark} of the exposure", legend=legend))
    sheet = Canvas()
    sheet.title("how long each paint was there", f"{size_text(layer.size)} px")
    sheet.grid(panels, "the object")
    return sheet.pixels()


def around(*layers: Layer) -> Box:
    """The box of all content of layers of one size, with a margin of 15 %, at least 4 pixels."""
    box = box_around(*layers)
    if box is None:
        raise ValueError("both layers are empty: there is nothing to show")
    x0, y0, x1, y1 = box
    return grown(box, max(4, int(0.15 * max(x1 - x0, y1 - y0))), layers[0].size)


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

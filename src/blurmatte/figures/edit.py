"""Sheets of layers: before and after an edit, and exposures of paints."""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Box, Codes8, check_kind, check_same_size, rows_columns
from blurmatte.compositing import Exposures
from blurmatte.figures.drawing import (
    fitted,
    round_up,
    srgb_codes,
)
from blurmatte.figures.sheet import Canvas, Layout, Page, Panel, column_width, size_text
from blurmatte.layer import Layer, box_around, check_layer
from blurmatte.radiometry import LinearImage


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
        room = column_width(len(strip)), Page.picture_height
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
    rim, (width, height) = max(4, int(0.15 * max(x1 - x0, y1 - y0))), layers[0].size
    return max(x0 - rim, 0), max(y0 - rim, 0), min(x1 + rim, width), min(y1 + rim, height)

"""The sheet of a plate: its light, the coverage of each pixel, and its error."""

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.checks import Codes8
from blurmatte.explain.explain import explain
from blurmatte.figures.drawing import Palette, heat_codes, round_up, srgb_codes
from blurmatte.figures.sheet import Canvas, Layout, Panel, size_text


def draw_plate(fit: PlateFit) -> Codes8:
    """Draw a plate, the share of frames that show each pixel, and its error on one sheet.

    Parameters
    ----------
    fit : PlateFit
        Result of `make_plate`.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.
    """
    plate = fit.plate
    known, std = plate.valid, np.sqrt(plate.variance.mean(axis=-1))
    light = np.where(known[..., None], srgb_codes(plate.rgb), np.array(Palette.unknown, np.uint8))
    top = round_up(float(np.percentile(std[known], 98)))
    errors = heat_codes(np.clip(std / top, 0, 1))
    errors[~known] = Palette.unknown
    unknown = (Palette.unknown, f"not known or clipped {1 - known.mean():.1%}")
    sheet = Canvas()
    sheet.title("plate", f"{size_text(plate.size)} px of {len(fit.gain)} frames")
    sheet.sentences(explain(fit))
    panels = [
        Panel(light, "plate", legend=[unknown]),
        Panel(heat_codes(fit.coverage), "free", "share of frames", [(None, "0 to 1")]),
        Panel(errors, "error", "std of light, 1 is white", [(None, f"0 to {top:g}"), unknown]),
    ]
    sheet.grid(panels, Layout.best(plate.size, len(panels)), "what the frames say")
    return sheet.pixels()

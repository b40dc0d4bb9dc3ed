"""The sheet of a plate: it, how often each pixel was free, and its error."""

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.explain import explain
from blurmatte.figures.panels import (
    HEAT,
    UNKNOWN,
    Layout,
    Panel,
    Pixels,
    by,
    heat,
    round_up,
    shown,
)
from blurmatte.figures.sheet import Sheet


def draw_plate(fit: PlateFit) -> Pixels:
    """Draw a plate, how often each pixel was free, and its error, on one sheet.

    Parameters
    ----------
    fit : PlateFit
        What `make_plate` made.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-coded, 1800 pixels wide.
    """
    plate = fit.plate
    known, std = plate.valid, np.sqrt(plate.variance.mean(axis=-1))
    light = np.where(known[..., None], shown(plate.rgb), np.array(UNKNOWN, np.uint8))
    top = round_up(float(np.percentile(std[known], 98)))
    errors = heat(np.clip(std / top, 0, 1) * (len(HEAT) - 1))
    errors[~known] = UNKNOWN
    unknown = (UNKNOWN, f"not known or clipped {1 - known.mean():.1%}")
    sheet = Sheet()
    sheet.title("plate", f"{by(plate.size)} px of {len(fit.gain)} frames")
    sheet.sentences(explain(fit))
    panels = [
        Panel(light, "plate", legend=[unknown]),
        Panel(heat(fit.coverage * (len(HEAT) - 1)), "free", "share of frames", [(None, "0 to 1")]),
        Panel(errors, "error", "std of light, 1 is white", [(None, f"0 to {top:g}"), unknown]),
    ]
    sheet.grid(panels, Layout.around(plate.size, len(panels)), "what the frames say")
    return sheet.pixels()

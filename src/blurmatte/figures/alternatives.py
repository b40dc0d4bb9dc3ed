"""Swatches of what else fits a streak, with how much alpha."""

import numpy as np

from blurmatte.explain import alternatives_in_words, alternatives_of
from blurmatte.figures.panels import BRIGHT, DIM, MARGIN, WIDTH
from blurmatte.figures.sheet import BODY, Sheet
from blurmatte.matting import Alternative, Solution
from blurmatte.matting.alternatives import MAX_ALTERNATIVES

_APART, _WIDEST, _HEIGHT = 10, 130, 48  # pixels, of swatches
_LEAST_WEIGHT = 0.01  # that is shown as a number


def draw_alternatives(sheet: Sheet, x: int, y: int, solution: Solution) -> int:
    """A row of swatches, the answer's own first, and sentences; returns where they end.

    Nothing if the grade is confirmed or no hypotheses were compared.
    """
    found, width = alternatives_of(solution), WIDTH - MARGIN - x
    if not found:
        return y
    y = sheet.heading(x, y + 14, "what else fits")
    column = min((width + _APART) // MAX_ALTERNATIVES - _APART, _WIDEST)
    bottoms = [
        _draw_swatch(sheet, x + i * (column + _APART), y, column, one)
        for i, one in enumerate(found)
    ]
    y = max(bottoms) + 6
    for line in alternatives_in_words(solution):
        y += sheet.words(x, y, width, f"{line[0].upper()}{line[1:]}.", BODY, BRIGHT) + 3
    return y


def _draw_swatch(sheet: Sheet, x: int, y: int, width: int, one: Alternative) -> int:
    """One with its color, factor of alpha and weight below; returns where it ends."""
    color = np.array(list(bytes.fromhex(one.hex[1:])), np.uint8)
    sheet.paste(np.broadcast_to(color, (_HEIGHT, width, 3)), x, y)
    y += _HEIGHT + 6
    weight = f"weight {one.weight:.2f}" if one.weight >= _LEAST_WEIGHT else "weight < 0.01"
    for line in (one.hex, f"alpha x {one.alpha_factor:.2f}", weight):
        y += sheet.words(x, y, width, line, BODY, BRIGHT if one.matters else DIM)
    return y

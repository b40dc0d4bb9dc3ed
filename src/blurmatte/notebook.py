"""Displayed: pictures and results as a notebook shows them."""

from importlib import import_module


class Displayed:
    """What a notebook shows as the sheet of `draw_look` below the cell that evaluates it."""

    def _repr_png_(self) -> bytes:
        """The sheet as PNG."""
        # By name, when it is shown: sheets draw these types, which do not depend on sheets.
        sheet: bytes = import_module("blurmatte.figures.layers").png_of_look(self)
        return sheet

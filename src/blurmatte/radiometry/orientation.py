"""The orientation of stored pictures, of cameras that were not held upright."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Direction


@dataclass(frozen=True)
class Orientation:
    """How stored pictures become upright: transposed first, then flipped."""

    transposed: bool = False  # true if rows become columns
    # True if the (transposed) picture is flipped along x, along y
    left_right: bool = False
    upside_down: bool = False

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Width and height of an upright picture, from those that are stored."""
        return (height, width) if self.transposed else (width, height)

    @property
    def readout(self) -> Direction:
        """Where the next stored row lies in the upright picture."""
        if self.transposed:
            return "left" if self.left_right else "right"
        return "up" if self.upside_down else "down"

    def upright(self, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """(H, W, …) pixels as they are shown; a view."""
        return self._flipped(np.swapaxes(pixels, 0, 1) if self.transposed else pixels)

    def stored(self, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The inverse of `upright`."""
        pixels = self._flipped(pixels)
        return np.swapaxes(pixels, 0, 1) if self.transposed else pixels

    def _flipped(self, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return pixels[:: -1 if self.upside_down else 1, :: -1 if self.left_right else 1]


def exif_orientation(number: int) -> Orientation:
    """The orientation that EXIF states by a number from 1 to 8; others stand for upright pictures."""
    turned = {
        2: (False, True, False),
        3: (False, True, True),
        4: (False, False, True),
        5: (True, False, False),
        6: (True, True, False),
        7: (True, True, True),
        8: (True, False, True),
    }
    return Orientation(*turned.get(number, ()))

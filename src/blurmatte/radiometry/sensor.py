"""How a sensor stores a picture: one color for each pixel, and an orientation.

A missing color is the weighted mean of the neighbors that have it; edge neighbors weigh twice as much
as corner neighbors. The interpolation is linear in the light and does not depend on the data, so that
C = P + (1 − α) B also holds after it. Edge-directed methods interpolate image and plate differently
where the object was.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import AnyArray, Array, Direction, Floats, Ints


def demosaic(mosaic: Floats, pattern: Ints) -> Floats:
    """Interpolate the missing colors of each pixel.

    mosaic (H, W): light of one color in each pixel; 2 x 2 pixels or more.
    pattern (h, w): index of that color: 0 red, 1 green, 2 blue; repeated to the right and downwards.
        Any 3 x 3 pixels contain all three colors, as in Bayer and X-Trans patterns.

    Returns (H, W, 3) of the dtype of `mosaic`.
    """
    rgb = np.empty((*mosaic.shape, 3), mosaic.dtype)
    for c in range(3):
        seen = tiled((pattern == c).astype(mosaic.dtype), mosaic.shape)
        rgb[..., c] = np.where(seen, mosaic, _spread(mosaic * seen) / _spread(seen))
    return rgb


def sees_all_colors(pattern: Ints) -> bool:
    """True if any 3 x 3 pixels contain all three colors."""
    seen = (np.tile(pattern == c, (3, 3)).astype(float) for c in range(3))
    return all(bool(_spread(color).min() > 0) for color in seen)


def variance_shares(pattern: Ints) -> Array:
    """(3,) mean noise variance of a color after `demosaic`, relative to that of a measured pixel.

    Demosaicing correlates the noise of neighbors: sums over several pixels have a larger variance than
    this implies.
    """
    height, width = pattern.shape
    shares = np.empty(3)
    for c in range(3):
        seen = np.tile((pattern == c).astype(float), (3, 3))  # the middle tile is free of borders
        variance = np.where(seen, 1, _spread(seen, 4) / _spread(seen) ** 2)
        shares[c] = variance[height : 2 * height, width : 2 * width].mean()
    return shares


def tiled(tile: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    """The tile, repeated to the right and downwards and cut to (H, W)."""
    counts = [-(-whole // part) for whole, part in zip(shape, tile.shape, strict=True)]
    return np.tile(tile, counts)[: shape[0], : shape[1]]


def _spread(values: Floats, weight: float = 2) -> Floats:
    """Weighted sums over 3 x 3 pixels: corners 1, edges `weight`, the center `weight`²."""
    w = values.dtype.type(weight)
    # "reflect" repeats no pixel, so that it continues a Bayer pattern.
    x = np.pad(values, 1, mode="reflect")
    x = x[:-2] + w * x[1:-1] + x[2:]
    return np.asarray(x[:, :-2] + w * x[:, 1:-1] + x[:, 2:])


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

    def upright(self, pixels: AnyArray) -> AnyArray:
        """(H, W, …) pixels as they are shown; a view."""
        return self._flipped(np.swapaxes(pixels, 0, 1) if self.transposed else pixels)

    def stored(self, pixels: AnyArray) -> AnyArray:
        """The inverse of `upright`."""
        pixels = self._flipped(pixels)
        return np.swapaxes(pixels, 0, 1) if self.transposed else pixels

    def _flipped(self, pixels: AnyArray) -> AnyArray:
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

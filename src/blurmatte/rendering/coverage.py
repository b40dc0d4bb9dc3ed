"""Exact area of a shape in each cell of a grid, without sampling.

In this file `x` (w + 1,) and `y` (h + 1,) are increasing cell edges, in pixels from the center of
the shape. Areas are (h, w), in pixels².
"""

import numpy as np

from blurmatte.checks import Array
from blurmatte.rendering import kernel


def disc_coverage(x: Array, y: Array, radius: float) -> Array:
    """Area of a disc of `radius` pixels in each cell.

    Let F(x, y) be the area of the unit disc left of x and above y, and S(x) the integral of
    √(1 − u²) from 0 to x. For y <= 0 the disc reaches above y only where |u| < c = √(1 − y²), so

        F(x, y) = ∫ (√(1 − u²) + y) du   from −c to x, x clipped to ±c;

    for y > 0 it is the area of the strip left of x, 2 S(x) + π/2, minus F(x, −y). The area in a cell
    is the mixed difference of F over the cell's corners.
    """
    x, y = np.clip(x / radius, -1, 1), np.clip(y / radius, -1, 1)
    c = np.sqrt(1 - y**2)
    area = np.empty((len(y) - 1, len(x) - 1))
    kernel.disc(x, y, _half_area(x), _half_area(c), c, float(radius), area)
    return area


def box_coverage(x: Array, y: Array, width: float, height: float) -> Array:
    """Area of an axis-aligned box of `width` by `height` pixels in each cell."""
    across = np.diff(np.clip(x, -width / 2, width / 2))
    down = np.diff(np.clip(y, -height / 2, height / 2))
    return np.asarray(down[:, None] * across)


def polygon_coverage(x: Array, y: Array, vertices: Array) -> Array:
    """Area of a simple polygon in each cell.

    `vertices` (n, 2) are in order, in either orientation, and may lie outside the grid.
    """
    area = np.zeros((len(y) - 1, len(x) - 1))
    kernel.polygon(x, y, np.ascontiguousarray(vertices, dtype=float), area)
    return area


def disc_kernel(radius: float) -> Array:
    """(n, n) fraction of a disc of `radius` pixels that lies in each pixel; the sum is 1."""
    pixels = cell_edges(np.arange(-np.ceil(radius), np.ceil(radius) + 1))
    return np.asarray(disc_coverage(pixels, pixels, radius) / (np.pi * radius**2))


def cell_edges(centers: Array, cells: int = 1) -> Array:
    """Edges of `cells` cells per pixel; `centers` are consecutive pixel centers.

    Cell widths that are powers of two sum to 1 exactly.
    """
    return np.asarray(centers[0] - 0.5 + np.arange(len(centers) * cells + 1) / cells)


def _half_area(x: Array) -> Array:
    """S(x), the integral of √(1 − u²) from 0 to x."""
    area: Array = (x * np.sqrt(1 - x**2) + np.arcsin(x)) / 2
    return area

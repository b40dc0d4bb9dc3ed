"""How much of each cell of a grid a shape covers: exact areas, no sampling.

In this file `x` (w + 1,) and `y` (h + 1,) are increasing cell edges, in pixels from the center of
the shape. Areas are (h, w), in pixels².
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_ROUNDING = 1e-12  # areas below are what floating point left of nothing, pixels²


def disc_coverage(x: Array, y: Array, radius: float) -> Array:
    """Area that a disc of `radius` pixels covers in each cell.

    Let F(x, y) be the area of the unit disc left of x and above y, and S(x) the integral of
    √(1 − u²) from 0 to x. For y <= 0 the disc reaches above y only where |u| < c = √(1 − y²), so

        F(x, y) = ∫ (√(1 − u²) + y) du   from −c to x, x clipped to ±c;

    for y > 0 take the whole strip left of x, 2 S(x) + π/2, less F(x, −y). A cell is the mixed
    difference of F over its corners.
    """
    x, y = np.clip(x / radius, -1, 1), np.clip(y / radius, -1, 1)[:, None]
    c = np.sqrt(1 - y**2)
    S, S_c = _half_area(x), _half_area(c)
    upper = np.clip(S, -S_c, S_c) + S_c - np.abs(y) * (np.clip(x, -c, c) + c)
    F = np.where(y > 0, 2 * S + np.pi / 2 - upper, upper)
    area = radius**2 * np.diff(np.diff(F, axis=0), axis=1)
    return np.where(area > _ROUNDING, area, 0)


def box_coverage(x: Array, y: Array, width: float, height: float) -> Array:
    """Area that an upright box of `width` by `height` pixels covers in each cell."""
    across = np.diff(np.clip(x, -width / 2, width / 2))
    down = np.diff(np.clip(y, -height / 2, height / 2))
    return np.asarray(down[:, None] * across)


def cell_edges(centers: Array, cells: int = 1) -> Array:
    """Edges of `cells` cells across each of neighboring pixels; powers of two sum to 1 exactly."""
    return np.asarray(centers[0] - 0.5 + np.arange(len(centers) * cells + 1) / cells)


def _half_area(x: Array) -> Array:
    """S(x), the integral of √(1 − u²) from 0 to x."""
    area: Array = (x * np.sqrt(1 - x**2) + np.arcsin(x)) / 2
    return area

"""Means over cells of several pixels, which stand for a picture where its details do not matter."""

import numpy as np

from blurmatte.checks import Floats


def cell_means(values: Floats, side: int) -> Floats:
    """Means over squares of side × side pixels; what is left over at the far sides is cut off.

    Parameters
    ----------
    values : (H, W, …) float
    side : int
        1 or more.

    Returns
    -------
    (H // side, W // side, …) float
    """
    height, width = (n // side for n in values.shape[:2])
    cut = values[: height * side, : width * side]
    if side == 1:
        return cut
    # Whole rows, then columns: several times as fast as a mean over two axes.
    rows = cut[::side].copy()
    for i in range(1, side):
        rows += cut[i::side]
    cells = rows[:, ::side].copy()
    for i in range(1, side):
        cells += rows[:, i::side]
    return np.asarray(cells / side**2)

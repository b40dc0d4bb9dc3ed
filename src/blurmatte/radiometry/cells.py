"""Means over cells of several pixels, which stand for a picture where its details do not matter."""

import numpy as np

from blurmatte.checks import Floats
from blurmatte.radiometry.blocks import block_sums


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
    sums = block_sums(values, side)
    return sums if side == 1 else np.asarray(sums / side**2)

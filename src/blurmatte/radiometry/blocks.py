"""How noise hangs together: what it adds up to over blocks of pixels.

Demosaicing, compression and color shared by neighbors leave noise that is partly the same in
neighboring pixels. Their sums scatter more than those of noise that every pixel has of its own.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats

BLOCKS = (2, 4, 8, 16)  # pixels: compression has blocks of up to 16


def block_sums(values: Floats, size: int) -> Floats:
    """(H // size, W // size, ...) sums over blocks; what is left over at the far sides is cut.

    Parameters
    ----------
    values : (H, W, ...) float
    size : int
        Pixels across a block.
    """
    h, w = (side // size * size for side in values.shape[:2])
    cut = values[:h, :w]
    if size == 1:
        return cut
    # Whole rows, then columns: several times as fast as a sum over two axes.
    rows = cut[::size].copy()
    for i in range(1, size):
        rows += cut[i::size]
    sums = rows[:, ::size].copy()
    for i in range(1, size):
        sums += rows[:, i::size]
    return sums


def block_squares(e: Floats, use: Bools, size: int) -> npt.NDArray[np.float64]:
    """(K, channels) squared sums over blocks of `size` by `size` pixels, by the pixels summed.

    Of noise that every pixel has of its own, their mean is its variance. Only blocks count of which
    more than half is used; what is left over at the far sides is cut.

    Parameters
    ----------
    e : (H, W, channels) float
        Noise, of mean zero.
    use : (H, W) bool
        The pixels to sum.
    size : int
    """
    count = block_sums(use.astype(float), size)
    full = count > size**2 / 2
    squares: npt.NDArray[np.floating] = block_sums(np.where(use[..., None], e, 0), size)[full] ** 2
    return squares / count[full][:, None]


def coherence(e: Floats, use: Bools) -> npt.NDArray[np.float64]:
    """(channels, 4) by how much more noise adds up over blocks of `BLOCKS` than over single pixels.

    1 where every pixel has its own; the number of pixels in a block where all have the same. 1, too,
    for blocks larger than the part that is used. The parameters are those of `block_squares`.
    """
    single = block_squares(e, use, 1).mean(axis=0) if use.any() else np.zeros(e.shape[-1])
    columns = []
    for size in BLOCKS:
        squares = block_squares(e, use, size)
        known = (single > 0) & (len(squares) > 0)
        total = squares.mean(axis=0) if len(squares) else np.ones_like(single)
        columns.append(np.where(known, total / np.where(known, single, 1), 1.0))
    return np.stack(columns, axis=-1)

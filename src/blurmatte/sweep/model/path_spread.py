"""The time that a moving point spends in each pixel, its point spread function."""

import numpy as np

from blurmatte.checks import Array
from blurmatte.sweep.model.path import PathFamily
from blurmatte.sweep.model.pixels import Pixels

_MAX_STEP_PX = 0.125  # of the polyline that replaces the path


def path_spread(family: PathFamily, path: Array, pixels: Pixels) -> Array:
    """(h, w) fractions of the exposure; exact for a polyline of short pieces.

    A piece is split where it crosses the border of a pixel in x or y.
    """
    curve = family.at(path, np.linspace(0, 1, 257))[0]
    speed = 256 * np.linalg.norm(np.diff(curve, axis=0), axis=1).max()
    t = np.linspace(0, 1, int(np.ceil(speed / _MAX_STEP_PX)) + 2)
    xy = family.at(path, t)[0] - np.array(pixels.origin) + 0.5  # borders at whole numbers
    times = [t]
    for x in xy.T:
        before, after = x[:-1], x[1:]
        crosses = np.floor(before) != np.floor(after)
        border = np.floor(np.maximum(before, after)[crosses])
        part = (border - before[crosses]) / (after - before)[crosses]
        times.append(t[:-1][crosses] + part * np.diff(t)[crosses])
    edges = np.unique(np.concatenate(times))
    middles = (edges[:-1] + edges[1:]) / 2
    column, row = (np.floor(np.interp(middles, t, x)).astype(int) for x in xy.T)
    h, w = pixels.shape
    inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    flat = np.bincount((row * w + column)[inside], np.diff(edges)[inside], minlength=h * w)
    return np.asarray(flat.reshape(h, w), dtype=float)

"""Pixel filters wider than the pixel: the four-term Blackman-Harris window.

A pixel is the average of the picture, weighted by the window around the pixel's center. The window
is piecewise constant on cells of a quarter of a pixel, with its exact integral over each cell.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from blurmatte.checks import Array

CELLS_PER_PIXEL = 4  # along each axis

_BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)  # Harris, Proc. IEEE 66, 1978


def filter_margin(width: float) -> int:
    """Pixels on each side of a pixel that a window of `width` pixels covers."""
    return int(np.ceil(max(width / 2 - 0.5, 0)))


def filter_peak(width: float) -> float:
    """Largest weight of the window relative to that of a box of one pixel."""
    return 1 / (_BLACKMAN_HARRIS[0] * width)


def filter_weights(width: float) -> Array:
    """Weights of the cells of one pixel and its margins along one axis; the sum is 1."""
    cells = (2 * filter_margin(width) + 1) * CELLS_PER_PIXEL
    s = np.clip((np.arange(cells + 1) - cells / 2) / CELLS_PER_PIXEL / width, -0.5, 0.5)
    mean, *amplitudes = _BLACKMAN_HARRIS
    integral = mean * s
    for k, amplitude in enumerate(amplitudes, 1):
        integral += amplitude * np.sin(2 * np.pi * k * s) / (2 * np.pi * k)
    return np.asarray(np.diff(integral) / mean)


def filter_cells(centers: Array, width: float) -> Array:
    """Centers of the cells of consecutive pixels and their margins, in cell widths."""
    margin = filter_margin(width)
    padded = np.arange(centers[0] - margin, centers[-1] + margin + 0.5)
    steps = np.arange(len(padded) * CELLS_PER_PIXEL) / CELLS_PER_PIXEL
    return np.asarray(CELLS_PER_PIXEL * (padded[0] - 0.5 + steps) + 0.5)


def filtered(values: Array, width: float) -> Array:
    """Average values (h, w, ...) on the cells of `filter_cells` to pixels."""
    weights = filter_weights(width)
    for axis in (0, 1):
        windows = sliding_window_view(values, len(weights), axis)  # the window is the last axis
        every = np.s_[::CELLS_PER_PIXEL] if axis == 0 else np.s_[:, ::CELLS_PER_PIXEL]
        values = windows[every] @ weights
    return values

"""Pixel filters wider than the pixel: the four-term Blackman-Harris window.

A pixel is the average of the picture before it, weighted by the window around its center. The window
is taken as constant within cells of a quarter of a pixel, with its exact integral over each.
"""

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from blurmatte.rendering.coverage import cell_edges
from blurmatte.rendering.pose import Pose
from blurmatte.rendering.scene import Body

Array = npt.NDArray[np.float64]

_CELLS = 4  # across a pixel
_BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)  # Harris, Proc. IEEE 66, 1978


def filter_margin(width: float) -> int:
    """How many pixels beyond its own a pixel sees on each side."""
    return int(np.ceil(max(width / 2 - 0.5, 0)))


def filter_peak(width: float) -> float:
    """Largest weight of the window relative to that of a box of one pixel."""
    return 1 / (_BLACKMAN_HARRIS[0] * width)


def filter_weights(width: float) -> Array:
    """Weights of the cells of one pixel and its margins, in one direction; their sum is 1."""
    cells = (2 * filter_margin(width) + 1) * _CELLS
    s = np.clip((np.arange(cells + 1) - cells / 2) / _CELLS / width, -0.5, 0.5)
    mean, *amplitudes = _BLACKMAN_HARRIS
    integral = mean * s
    for k, amplitude in enumerate(amplitudes, 1):
        integral += amplitude * np.sin(2 * np.pi * k * s) / (2 * np.pi * k)
    return np.asarray(np.diff(integral) / mean)


def filtered_body(body: Body, x: Array, y: Array, pose: Pose, width: float) -> tuple[Array, Array]:
    """Coverage (h, w) and premultiplied light (h, w, 3) of a body through a window of `width` pixels.

    As `Body.sharp`, which has the box of one pixel.
    """
    weights = filter_weights(width)
    cells_x, cells_y = (_cells(centers, filter_margin(width)) for centers in (x, y))
    coverage, light = body.sharp(cells_x, cells_y, pose.magnified(_CELLS))
    return _averaged(coverage, weights), _averaged(light, weights)


def _cells(centers: Array, margin: int) -> Array:
    """Centers of the cells of neighboring pixels and their margins, in widths of a cell."""
    padded = np.arange(centers[0] - margin, centers[-1] + margin + 0.5)
    return np.asarray(_CELLS * cell_edges(padded, _CELLS)[:-1] + 0.5)


def _averaged(values: Array, weights: Array) -> Array:
    for axis in (0, 1):
        windows = sliding_window_view(values, len(weights), axis)  # the window comes last
        every = np.s_[::_CELLS] if axis == 0 else np.s_[:, ::_CELLS]
        values = windows[every] @ weights
    return values

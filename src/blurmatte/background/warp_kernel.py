"""Compiled interpolation of a warped picture; see `warp`.

All channels of a pixel share its position and its weights, and positions are not stored.
"""

import numpy as np

from blurmatte.compiling import njit


@njit()
def cubic(u, weights):  # type: ignore[no-untyped-def]
    """Write the weights (4,) of a cubic B-spline at the fraction u between two nodes."""
    t = 1 - u
    weights[0] = t * t * t / 6
    weights[1] = 2 / 3 - u * u * (2 - u) / 2
    weights[2] = 2 / 3 - t * t * (2 - t) / 2
    weights[3] = u * u * u / 6


@njit(inline="always")
def _within(x, first, last):  # type: ignore[no-untyped-def]
    """x, at least `first` and at most `last`; `first` if it is NaN."""
    if x > last:
        return last
    return x if x > first else first


@njit()
def warp(nodes, pad, taps, match, first, out):  # type: ignore[no-untyped-def]
    """Write the rows of a warped picture from row `first` on into `out` (rows, w, channels).

    nodes (h + 2 pad, w + 2 pad, channels): of the picture and `pad` pixels around it. With 4 `taps`
    they are coefficients of a cubic spline, with 2 values between which is interpolated linearly.
    match is (H, to): the homography and the matrix to its centered coordinates, (3, 3).
    Positions beyond the nodes are moved to the nearest.
    """
    H, to = match
    size, x_off, y_off = to[0, 0], to[0, 2], to[1, 2]
    height, width, channels = nodes.shape
    p, q, before = np.empty(taps), np.empty(taps), taps // 2 - 1
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            a, b = column * size + x_off, (first + row) * size + y_off
            depth = H[2, 0] * a + H[2, 1] * b + H[2, 2]
            x = ((H[0, 0] * a + H[0, 1] * b + H[0, 2]) / depth - x_off) / size
            y = ((H[1, 0] * a + H[1, 1] * b + H[1, 2]) / depth - y_off) / size
            x = _within(x + pad, before, width - 1 - before)
            y = _within(y + pad, before, height - 1 - before)
            i, j = min(int(x), width - 2 - before), min(int(y), height - 2 - before)
            if taps == 4:
                cubic(x - i, p)
                cubic(y - j, q)
            else:
                p[0], p[1] = 1 - (x - i), x - i
                q[0], q[1] = 1 - (y - j), y - j
            i, j = i - before, j - before
            for c in range(channels):
                value = 0.0
                for s in range(taps):
                    along = 0.0
                    for r in range(taps):
                        along += p[r] * nodes[j + s, i + r, c]
                    value += q[s] * along
                out[row, column, c] = value

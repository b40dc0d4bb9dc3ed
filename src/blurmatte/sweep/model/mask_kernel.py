"""Compiled loops of masks that move: alpha, its derivatives, and the normal equations of the cells.

In this file `mask` (n, m) are the parts of cells that a shape covers, `offsets` (S, 2) the pixels (row,
column) that cell (0, 0) reaches, and `dwell` (S, 1 + p) the fractions of the exposure that it spends
there, with their derivatives by p parameters of the path.
"""

import numpy as np

from blurmatte.compiling import FAST_MATH, njit


@njit()
def _overlaps(first, width, count, size, pixels, parts, by_first, by_width):  # type: ignore[no-untyped-def]
    """Lengths (count, k) of cells in pixels of width 1, the first pixel of each, and derivatives.

    Cell c is from first + c width to first + (c + 1) width; pixel p from p − ½ to p + ½.
    """
    for c in range(count):
        low, high = first + c * width, first + (c + 1) * width
        pixels[c] = int(np.floor(low + 0.5))
        for k in range(size):
            left, right = pixels[c] + k - 0.5, pixels[c] + k + 0.5
            a, b = max(low, left), min(high, right)
            parts[c, k] = max(b - a, 0.0)
            by_first[c, k], by_width[c, k] = 0.0, 0.0
            if b > a:
                ends, starts = high < right, low > left
                by_first[c, k] = (1.0 if ends else 0.0) - (1.0 if starts else 0.0)
                by_width[c, k] = ((c + 1) if ends else 0.0) - (c if starts else 0.0)


@njit()
def sweep(mask, width, xy, D, weights, alpha, J):  # type: ignore[no-untyped-def]
    """Add alpha (h, w) and its derivatives J (h, w, p + 1) by the path and the width of a cell.

    xy (T, 2): positions of the mask's middle, pixels; D (T, 2, p): by the path; weights (T,).
    """
    n, m = mask.shape
    size = int(np.ceil(width)) + 2
    h, w = alpha.shape
    count = D.shape[2]
    columns, rows = np.empty(m, np.int64), np.empty(n, np.int64)
    in_x, in_y = np.empty((m, size)), np.empty((n, size))
    dx, dy = np.empty((m, size)), np.empty((n, size))
    wx, wy = np.empty((m, size)), np.empty((n, size))
    for t in range(len(weights)):
        _overlaps(xy[t, 0] - m / 2 * width, width, m, size, columns, in_x, dx, wx)
        _overlaps(xy[t, 1] - n / 2 * width, width, n, size, rows, in_y, dy, wy)
        for i in range(n):
            for j in range(m):
                value = weights[t] * mask[i, j]
                if value == 0:
                    continue
                for k in range(size):
                    y = rows[i] + k
                    if y < 0 or y >= h or in_y[i, k] == 0:
                        continue
                    grown_y = wy[i, k] - n / 2 * dy[i, k]
                    for q in range(size):
                        x = columns[j] + q
                        if x < 0 or x >= w or in_x[j, q] == 0:
                            continue
                        alpha[y, x] += value * in_y[i, k] * in_x[j, q]
                        by_x = value * in_y[i, k] * dx[j, q]
                        by_y = value * dy[i, k] * in_x[j, q]
                        for p in range(count):
                            J[y, x, p] += by_x * D[t, 0, p] + by_y * D[t, 1, p]
                        grown_x = wx[j, q] - m / 2 * dx[j, q]
                        J[y, x, count] += value * (grown_y * in_x[j, q] + in_y[i, k] * grown_x)


@njit()
def dwell(at, D, weights, first, size):  # type: ignore[no-untyped-def]
    """(1 + p, a, b) fractions of the exposure that a cell spends in pixels, and their derivatives.

    at (T, 2): positions of the cell, as wide as a pixel; first (2,): column and row of the result's
    first pixel, and its size (a, b).
    """
    count = D.shape[2]
    out = np.zeros((1 + count, size[0], size[1]))
    for t in range(len(weights)):
        x, y = at[t, 0] - first[0], at[t, 1] - first[1]
        column, row = int(np.floor(x)), int(np.floor(y))
        for i in range(2):
            b, by_y = (y - row, 1.0) if i == 1 else (1 - y + row, -1.0)
            for j in range(2):
                a, by_x = (x - column, 1.0) if j == 1 else (1 - x + column, -1.0)
                out[0, row + i, column + j] += weights[t] * a * b
                for p in range(count):
                    slope = D[t, 0, p] * by_x * b + D[t, 1, p] * a * by_y
                    out[1 + p, row + i, column + j] += weights[t] * slope
    return out


@njit(fastmath=FAST_MATH)
def moved(mask, offsets, spent, alpha):  # type: ignore[no-untyped-def]
    """Add the mask, spread by each column of spent (S, k), to alpha (k, h, w)."""
    count, h, w = alpha.shape
    for s in range(len(offsets)):
        row, column = offsets[s]
        for i in range(max(0, -row), min(mask.shape[0], h - row)):
            for j in range(max(0, -column), min(mask.shape[1], w - column)):
                value = mask[i, j]
                if value != 0:
                    for k in range(count):
                        alpha[k, i + row, j + column] += spent[s, k] * value


@njit(fastmath=FAST_MATH)
def gathered(maps, offsets, spent, cells):  # type: ignore[no-untyped-def]
    """Add the adjoint of `moved` by the first column of `spent`: maps (k, h, w) to cells (k, n, m)."""
    count, h, w = maps.shape
    for s in range(len(offsets)):
        row, column = offsets[s]
        for k in range(count):
            for i in range(max(0, -row), min(cells.shape[1], h - row)):
                for j in range(max(0, -column), min(cells.shape[2], w - column)):
                    cells[k, i, j] += spent[s, 0] * maps[k, i + row, j + column]


@njit(fastmath=FAST_MATH)
def normal_matrix(q, offsets, spent, number, size):  # type: ignore[no-untyped-def]
    """(size, size) curvature Kᵀ q K of the cells that have a number (n, m) of 0 or more; q (h, w)."""
    H = np.zeros((size, size))
    n, m = number.shape
    which, by = np.empty(len(offsets), np.int64), np.empty(len(offsets))
    for y in range(q.shape[0]):
        for x in range(q.shape[1]):
            if q[y, x] == 0:
                continue
            known = 0
            for s in range(len(offsets)):
                i, j = y - offsets[s, 0], x - offsets[s, 1]
                if 0 <= i < n and 0 <= j < m and number[i, j] >= 0:
                    which[known], by[known] = number[i, j], spent[s, 0]
                    known += 1
            for a in range(known):
                one = q[y, x] * by[a]
                for b in range(known):
                    H[which[a], which[b]] += one * by[b]
    return H

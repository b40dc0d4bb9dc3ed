"""Banded symmetric matrices, compiled: normal equations, of a sparse matrix.

In this file a symmetric matrix S of n rows and b bands below the diagonal is stored as (n, b + 1),
band[i, k] = S[i + k, i]; as (b + 1, n) in Fortran's order this is the lower form of LAPACK.
"""

import numpy as np

from blurmatte.compiling import njit


@njit(fastmath=True)
def width_of(first, columns):  # type: ignore[no-untyped-def]
    """Bands of Aᵀ A, from the ascending columns of the rows of A."""
    width = 0
    for p in range(len(first) - 1):
        if first[p + 1] > first[p]:
            width = max(width, columns[first[p + 1] - 1] - columns[first[p]])
    return width


@njit(fastmath=True)
def add_normal(first, columns, values, weights, band):  # type: ignore[no-untyped-def]
    """Add Aᵀ W A to a band (n, b + 1), for weights (pixels,)."""
    row = np.zeros(band.shape[1])
    for p in range(len(first) - 1):
        begin, end = first[p], first[p + 1]
        if begin == end or weights[p] == 0:
            continue
        left, last = columns[begin], columns[end - 1]
        for r in range(begin, end):
            row[columns[r] - left] = values[r]
        for q in range(begin, end):
            i, scaled = columns[q], weights[p] * values[q]
            sums, later = band[i], row[i - left :]
            for k in range(last - i + 1):  # zeros, too: a loop without gaps is vectorized
                sums[k] += scaled * later[k]
        row[: last - left + 1] = 0


@njit()
def block(band, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """Rows and columns of the lower triangular matrix of a band."""
    found = np.zeros((bottom - top, right - left))
    for i in range(left, right):
        for j in range(max(top, i), min(bottom, i + band.shape[1])):
            found[j - top, i - left] = band[i, j - i]
    return found

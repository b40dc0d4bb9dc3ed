"""Banded symmetric matrices, compiled: normal equations, of a sparse matrix.

In this file a symmetric matrix S of n rows and b bands below the diagonal is stored as (n, b + 1),
band[i, k] = S[i + k, i]; as (b + 1, n) in Fortran's order this is the lower form of LAPACK.
"""

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
def add_normal(first, columns, values, weights, bands):  # type: ignore[no-untyped-def]
    """Add Aᵀ W A of three channels to bands (3, n, b + 1); weights (pixels, 3)."""
    for p in range(len(first) - 1):
        w0, w1, w2 = weights[p, 0], weights[p, 1], weights[p, 2]
        if w0 == 0 and w1 == 0 and w2 == 0:
            continue
        end = first[p + 1]
        for q in range(first[p], end):
            i, value = columns[q], values[q]
            s0, s1, s2 = w0 * value, w1 * value, w2 * value
            row0, row1, row2 = bands[0, i], bands[1, i], bands[2, i]
            for r in range(q, end):
                k = columns[r] - i
                row0[k] += s0 * values[r]
                row1[k] += s1 * values[r]
                row2[k] += s2 * values[r]


@njit(fastmath=True)
def add_normal_of_one(first, columns, values, weights, bands):  # type: ignore[no-untyped-def]
    """Add Aᵀ W A to bands (1, n, b + 1), for weights (pixels, 1) that all channels have."""
    for p in range(len(first) - 1):
        weight, end = weights[p, 0], first[p + 1]
        if weight == 0:
            continue
        for q in range(first[p], end):
            i, scaled = columns[q], weight * values[q]
            for r in range(q, end):
                bands[0, i, columns[r] - i] += scaled * values[r]

"""Banded symmetric matrices, compiled: normal equations, of a sparse matrix.

In this file a symmetric matrix S of n rows and b bands below the diagonal is stored as (n, b + 1),
band[i, k] = S[i + k, i]; as (b + 1, n) in Fortran's order this is the lower form of LAPACK.
"""

from typing import Any

from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True, "fastmath": True}


@njit(**_COMPILED)
def width_of(first, columns):  # type: ignore[no-untyped-def]
    """Bands of Aᵀ A, from the ascending columns of the rows of A."""
    width = 0
    for p in range(len(first) - 1):
        if first[p + 1] > first[p]:
            width = max(width, columns[first[p + 1] - 1] - columns[first[p]])
    return width


@njit(**_COMPILED)
def add_normal(first, columns, values, weights, band):  # type: ignore[no-untyped-def]
    """Add Aᵀ W A to a band (n, b + 1); weights (pixels,)."""
    for p in range(len(first) - 1):
        if weights[p] == 0:
            continue
        end = first[p + 1]
        for q in range(first[p], end):
            i, scaled = columns[q], weights[p] * values[q]
            for r in range(q, end):
                band[i, columns[r] - i] += scaled * values[r]

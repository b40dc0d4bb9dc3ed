"""The recursion of `smoothing` from one time to the next, compiled; symbols are those of that file."""

import numpy as np

from blurmatte.compiling import njit


@njit()
def carry(L, v, intensity, inverses, diffusions, carried_L, carried_v):  # type: ignore[no-untyped-def]
    """Information (n, s, s), (n, s) at each time from the measurements before it.

    L, v: information of each measurement.
    inverses, diffusions (n, s, s): F⁻¹, and Cov w for q = 1, of the step to each time.
    carried_L, carried_v: results, 0 at the first time.
    """
    s = L.shape[1]
    half, M = np.empty((s, s)), np.empty((s, s))
    rows = np.empty((s, 2 * s + 1))  # of the equations: I + q M Q, M, η
    for k in range(1, len(L)):
        F, Q = inverses[k], diffusions[k]
        for i in range(s):
            for j in range(s):
                half[i, j] = 0.0
                for m in range(s):
                    half[i, j] += (carried_L[k - 1, i, m] + L[k - 1, i, m]) * F[m, j]
        for i in range(s):
            rows[i, 2 * s] = 0.0
            for m in range(s):
                rows[i, 2 * s] += F[m, i] * (carried_v[k - 1, m] + v[k - 1, m])
            for j in range(s):
                M[i, j] = 0.0
                for m in range(s):
                    M[i, j] += F[m, i] * half[m, j]
                rows[i, s + j] = M[i, j]
        for i in range(s):
            for j in range(s):
                rows[i, j] = 1.0 if i == j else 0.0
                for m in range(s):
                    rows[i, j] += intensity * M[i, m] * Q[m, j]
        _eliminate(rows)
        for i in range(s):
            carried_v[k, i] = rows[i, 2 * s]
            for j in range(s):
                carried_L[k, i, j] = (rows[i, s + j] + rows[j, s + i]) / 2


@njit()
def _eliminate(rows):  # type: ignore[no-untyped-def]
    """Solve linear equations by Gauss–Jordan elimination with partial pivoting.

    rows (s, s + n): coefficients and right sides, which become the solutions.
    """
    s, width = rows.shape
    for i in range(s):
        pivot = i
        for r in range(i + 1, s):
            if abs(rows[r, i]) > abs(rows[pivot, i]):
                pivot = r
        for j in range(i, width):
            rows[i, j], rows[pivot, j] = rows[pivot, j], rows[i, j]
        inverse = 1 / rows[i, i]
        for j in range(i, width):
            rows[i, j] *= inverse
        for r in range(s):
            if r != i:
                factor = rows[r, i]
                for j in range(i, width):
                    rows[r, j] -= factor * rows[i, j]

"""The recursion of `smoothing` from one time to the next, compiled; symbols are those of that file.

It carries a square root of the information [Paige and Saunders 1977]: R with RᵀR = Λ, and z = R s.
Sums of squares do not become negative by rounding, as differences of large terms do.
"""

import numpy as np

from blurmatte.compiling import njit


@njit()
def carry(S, z, intensity, inverses, roots, carried_L, carried_v):  # type: ignore[no-untyped-def]
    """Information (n, s, s), (n, s) at each time from the measurements before it.

    S (n, m, s), z (n, m): square root of the information of each measurement, and what it measured.
    inverses, roots (n, s, s): F⁻¹, and G with G Gᵀ = Cov w for q = 1, of the step to each time.
    carried_L, carried_v: results, 0 at the first time.
    """
    n, m, s = S.shape
    std = intensity**0.5
    known = np.zeros((s + m, s + 1))  # R and z, and those of the measurement below
    both = np.zeros((2 * s, 2 * s + 1))  # equations of noise u of variance 1 and of the state
    for k in range(1, n):
        for i in range(m):
            known[s + i, :s], known[s + i, s] = S[k - 1, i], z[k - 1, i]
        _reduce(known, s)
        both[:] = 0.0
        for i in range(s):
            both[i, i] = 1.0
            both[s + i, 2 * s] = known[i, s]
            for j in range(s):
                for c in range(i, s):
                    both[s + i, s + j] += known[i, c] * inverses[k, c, j]
        for i in range(s):
            for j in range(s):
                for c in range(s):
                    both[s + i, j] -= std * both[s + i, s + c] * roots[k, c, j]
        _reduce(both, 2 * s)
        known[:s] = both[s:, s:]
        for i in range(s):
            for c in range(i + 1):
                carried_v[k, i] += known[c, i] * known[c, s]
                for j in range(s):
                    carried_L[k, i, j] += known[c, i] * known[c, j]


@njit()
def _reduce(rows, columns):  # type: ignore[no-untyped-def]
    """Make equations upper triangular in their first columns by Householder reflections."""
    height, width = rows.shape
    for j in range(columns):
        norm = 0.0
        for r in range(j, height):
            norm += rows[r, j] ** 2
        norm = norm**0.5
        if norm == 0.0:
            continue
        if rows[j, j] > 0:
            norm = -norm
        head = rows[j, j] - norm  # of the vector that is reflected; the others are below it
        scale = -1 / (norm * head)
        for c in range(j + 1, width):
            dot = head * rows[j, c]
            for r in range(j + 1, height):
                dot += rows[r, j] * rows[r, c]
            dot *= scale
            rows[j, c] -= dot * head
            for r in range(j + 1, height):
                rows[r, c] -= dot * rows[r, j]
        rows[j, j] = norm
        rows[j + 1 :, j] = 0.0

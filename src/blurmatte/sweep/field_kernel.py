"""Light of a field of colors, and what it leaves unexplained, pixel by pixel, compiled.

In this file `number` (rows, columns) tells the nodes of a grid of `pitch` pixels, −1 for those that are
none; the nodes lie in the corners of its cells, the first in pixel (0, 0). See `field` for the rest.
"""

from typing import Any

import numpy as np
from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}


@njit(**_COMPILED)
def touched(alpha, pitch, number):  # type: ignore[no-untyped-def]
    """Write 0 to the corners of all cells in which the object was."""
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            if alpha[y, x] > 0:
                j, i = int(y / pitch), int(x / pitch)
                number[j : j + 2, i : i + 2] = 0


@njit(**_COMPILED)
def _hats(y, x, pitch, number, nodes, hats):  # type: ignore[no-untyped-def]
    """Write the four nodes around a pixel, and their hats there."""
    j, i = int(y / pitch), int(x / pitch)
    v, u = y / pitch - j, x / pitch - i
    nodes[0], nodes[1] = number[j, i], number[j, i + 1]
    nodes[2], nodes[3] = number[j + 1, i], number[j + 1, i + 1]
    hats[0], hats[1] = (1 - v) * (1 - u), (1 - v) * u
    hats[2], hats[3] = v * (1 - u), v * u


@njit(**_COMPILED)
def write_hats(alpha, pitch, number, all_hats):  # type: ignore[no-untyped-def]
    """Write the hats of all nodes to (h, w, m)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            if alpha[y, x] > 0:
                _hats(y, x, pitch, number, nodes, hats)
                for i in range(4):
                    all_hats[y, x, nodes[i]] = hats[i]


@njit(**_COMPILED)
def equations(C, B, V_C, V_B, alpha, weight, pitch, number, band, right):  # type: ignore[no-untyped-def]
    """Add the nodes' normal equations: lower bands (3, width, m) and right sides (3, m)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            if a == 0 or weight[y, x] == 0:
                continue
            _hats(y, x, pitch, number, nodes, hats)
            for c in range(3):
                V = V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c]
                P = C[y, x, c] - (1 - a) * B[y, x, c]
                for i in range(4):
                    w = weight[y, x] * a * hats[i] / V
                    right[c, nodes[i]] += w * P
                    for j in range(4):
                        if nodes[j] <= nodes[i]:
                            band[c, nodes[i] - nodes[j], nodes[j]] += w * a * hats[j]


@njit(**_COMPILED)
def _color(a, nodes, hats, colors, c):  # type: ignore[no-untyped-def]
    k = 0.0
    if a > 0:
        for i in range(4):
            k += hats[i] * colors[nodes[i], c]
    return k


@njit(**_COMPILED)
def residuals(C, B, V_C, V_B, alpha, pitch, number, colors, e):  # type: ignore[no-untyped-def]
    """Write residuals e (3, h, w) of unit variance, one of each channel."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            if a > 0:
                _hats(y, x, pitch, number, nodes, hats)
            for c in range(3):
                k = _color(a, nodes, hats, colors, c)
                V = V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c]
                e[c, y, x] = (C[y, x, c] - (1 - a) * B[y, x, c] - a * k) / np.sqrt(V)


@njit(**_COMPILED)
def by_alpha(J, C, B, V_C, V_B, alpha, weight, pitch, number, colors, e, cross):  # type: ignore[no-untyped-def]
    """Half the curvature (n, n) and gradient (n,) of a sum of squares; J (h, w, n) are derivatives.

    Adds those by the nodes' colors too to cross (3, m, n). The noise depends on alpha as well: that
    comes to the same as if the plate were its best estimate, as in `residuals`.
    """
    h, w, n = J.shape
    H, g = np.zeros((n, n)), np.zeros(n)
    nodes, hats, d = np.empty(4, np.int64), np.empty(4), np.empty(3)
    for y in range(h):
        for x in range(w):
            a = alpha[y, x]
            if weight[y, x] == 0 or not np.any(J[y, x]):
                continue
            if a > 0:
                _hats(y, x, pitch, number, nodes, hats)
            dd, de = 0.0, 0.0
            for c in range(3):
                s = np.sqrt(V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c])
                behind = B[y, x, c] + (1 - a) * V_B[y, x, c] * e[c, y, x] / s
                d[c] = (behind - _color(a, nodes, hats, colors, c)) / s
                dd += d[c] * d[c]
                de += d[c] * e[c, y, x]
                if a > 0:
                    for i in range(4):
                        slope = -weight[y, x] * d[c] * a * hats[i] / s
                        for p in range(n):
                            cross[c, nodes[i], p] += slope * J[y, x, p]
            for p in range(n):
                slope = weight[y, x] * J[y, x, p]
                g[p] += slope * de
                for q in range(p + 1):
                    H[p, q] += slope * dd * J[y, x, q]
    for p in range(n):
        for q in range(p):
            H[q, p] = H[p, q]
    return H, g

"""The field of light on the plate, compiled: its normal equations, values and residuals.

See `color_field_kernel` for grids and bands, and `lighting` for the model.
"""

import numpy as np

from blurmatte.compiling import njit
from blurmatte.sweep.model.color_field_kernel import corners


@njit()
def equations(C, B, V_C, V_B, weight, pitch, number, band, right):  # type: ignore[no-untyped-def]
    """Add the nodes' normal equations: lower band (width, n) and right side (n,)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            if weight[y, x] == 0:
                continue
            s, t = 0.0, 0.0
            for c in range(3):
                V = V_C[y, x, c] + V_B[y, x, c]
                s += B[y, x, c] ** 2 / V
                t += B[y, x, c] * (C[y, x, c] - B[y, x, c]) / V
            corners(y, x, pitch, number, nodes, hats)
            for i in range(4):
                w = weight[y, x] * hats[i]
                right[nodes[i]] += w * t
                for j in range(4):
                    if nodes[j] <= nodes[i]:
                        band[nodes[i] - nodes[j], nodes[j]] += w * s * hats[j]


@njit()
def values(pitch, number, at_nodes, out):  # type: ignore[no-untyped-def]
    """Write a field (h, w) of the values of its nodes (n,)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            corners(y, x, pitch, number, nodes, hats)
            out[y, x] = 0.0
            for i in range(4):
                out[y, x] += hats[i] * at_nodes[nodes[i]]


@njit()
def chi2(C, B, V_C, V_B, change, out):  # type: ignore[no-untyped-def]
    """Write the sum of the three squared residuals (h, w), given the change (h, w) of light."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x] = 0.0
            for c in range(3):
                e = C[y, x, c] - B[y, x, c] * (1 + change[y, x])
                out[y, x] += e * e / (V_C[y, x, c] + V_B[y, x, c])


@njit()
def chi2_of_best(C, B, V_C, V_B, out):  # type: ignore[no-untyped-def]
    """As `chi2` for the best change of each pixel: the residual is light of other hues."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            s, t, total = 1e-30, 0.0, 0.0
            for c in range(3):
                V, e = V_C[y, x, c] + V_B[y, x, c], C[y, x, c] - B[y, x, c]
                s += B[y, x, c] ** 2 / V
                t += B[y, x, c] * e / V
                total += e * e / V
            out[y, x] = max(total - t * t / s, 0.0)

"""The compiled loops over what each pixel knows of alpha.

In this file C, B, V_C, V_B, N are image, plate, their variances and the normals of the color model as
in `kernel`, and l is the unit direction of a line of colors. Maps of a color are (h, w, 3).
"""

from typing import Any

import numpy as np
from numba import njit

_FAST: dict[str, Any] = {
    "error_model": "numpy",
    "cache": True,
    "nogil": True,
    "fastmath": {"nsz", "arcp", "contract", "reassoc"},
}

_DOUBT = 5.0  # degrees of freedom of a t distribution: pixels that leave the model count less


@njit(inline="always", **_FAST)
def _across(N, i, light):  # type: ignore[no-untyped-def]
    return N[0, i] * light[0] + N[1, i] * light[1] + N[2, i] * light[2]


@njit(inline="always", **_FAST)
def _both(N, i, j, V):  # type: ignore[no-untyped-def]
    return (
        N[0, i] * N[0, j] * V[0] + N[1, i] * N[1, j] * V[1] + N[2, i] * N[2, j] * V[2]
    )  # fmt: skip


@njit(inline="always", **_FAST)
def _told(b, d, s, v, t, lines):  # type: ignore[no-untyped-def]
    """Information and pull of the equations d = α b with covariance s, of which t² v is the plate's."""
    (b0, b1), (d0, d1), (s00, s01, s11), (v00, v01, v11) = b, d, s, v
    det = s00 * s11 - s01 * s01
    q00, q01, q11 = s11 / det, -s01 / det, s00 / det
    A = b0 * b0 * q00 + 2 * b0 * b1 * q01 + b1 * b1 * q11
    p = b0 * d0 * q00 + (b0 * d1 + b1 * d0) * q01 + b1 * d1 * q11
    trust = 1.0
    if lines == 2:
        total = d0 * d0 * q00 + 2 * d0 * d1 * q01 + d1 * d1 * q11
        left = max(total - p * p / max(A, 1e-30), 0.0)
        trust = (_DOUBT + 1) / (_DOUBT + left)
    feigned = v00 * q00 + 2 * v01 * q01 + v11 * q11
    return trust * A, trust * (p - t * feigned)


@njit(**_FAST)
def evidence(C, B, V_C, V_B, N, alpha, mask, information, pull):  # type: ignore[no-untyped-def]
    """Write what each pixel of the mask says: information A, and pull A times its own alpha.

    Noise in the plate is on both sides of the equation: the pull is without what that feigns. The
    weights come from `alpha`, that of the neighborhood, so that they know nothing of the noise.
    """
    lines = N.shape[1]
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            t = 1.0 - alpha[y, x]
            B0, B1, B2 = float(B[y, x, 0]), float(B[y, x, 1]), float(B[y, x, 2])
            V = V_B[y, x, 0], V_B[y, x, 1], V_B[y, x, 2]
            left_over = B0 - C[y, x, 0], B1 - C[y, x, 1], B2 - C[y, x, 2]
            S = (
                V_C[y, x, 0] + t * t * V[0],
                V_C[y, x, 1] + t * t * V[1],
                V_C[y, x, 2] + t * t * V[2],
            )
            b1, d1, v01, v11, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
            if lines == 2:
                b1, d1 = _across(N, 1, (B0, B1, B2)), _across(N, 1, left_over)
                v01, v11 = _both(N, 0, 1, V), _both(N, 1, 1, V)
                s01, s11 = _both(N, 0, 1, S), _both(N, 1, 1, S)
            b = _across(N, 0, (B0, B1, B2)), b1
            d = _across(N, 0, left_over), d1
            s, v = (_both(N, 0, 0, S), s01, s11), (_both(N, 0, 0, V), v01, v11)
            information[y, x], pull[y, x] = _told(b, d, s, v, t, lines)


@njit(**_FAST)
def evidence_of_matrices(C, B, V_C, V_B, K, N, alpha, information, pull):  # type: ignore[no-untyped-def]
    """The same of pixels (n, 3) of which the plate's error is the matrix V_B + K."""
    lines = N.shape[1]
    b, d, s, v = np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    s[1, 1] = 1.0
    for k in range(len(alpha)):
        t = 1.0 - alpha[k]
        b[:], d[:] = 0.0, 0.0
        for i in range(lines):
            for c in range(3):
                b[i] += N[c, i] * B[k, c]
                d[i] += N[c, i] * (B[k, c] - C[k, c])
            for j in range(i + 1):
                of_image, of_plate = 0.0, 0.0
                for c in range(3):
                    of_image += N[c, i] * N[c, j] * V_C[k, c]
                    of_plate += N[c, i] * N[c, j] * V_B[k, c]
                    for e in range(3):
                        of_plate += N[c, i] * N[e, j] * K[k, c, e]
                v[i, j], s[i, j] = of_plate, of_image + t * t * of_plate
        information[k], pull[k] = _told(
            (b[0], b[1]), (d[0], d[1]), (s[0, 0], s[1, 0], s[1, 1]), (v[0, 0], v[1, 0], v[1, 1]),
            t, lines,
        )  # fmt: skip


@njit(**_FAST)
def left_over(C, B, V_C, V_B, l, alpha, use, out):  # type: ignore[no-untyped-def]
    """Write (l × B)·C, of which nothing is alpha, and its variance, (2, h, w); 0 where not used."""
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            out[0, y, x], out[1, y, x] = 0.0, 0.0
            if not use[y, x]:
                continue
            t, rest, variance = 1.0 - alpha[y, x], 0.0, 0.0
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                m = l[j] * B[y, x, k] - l[k] * B[y, x, j]
                rest += m * C[y, x, i]
                variance += m * m * (V_C[y, x, i] + t * t * V_B[y, x, i])
            out[0, y, x], out[1, y, x] = rest, variance


@njit(**_FAST)
def along(C, B, V_C, V_B, l, alpha, out):  # type: ignore[no-untyped-def]
    """Write m·C, m·B, m·V_B m and Var q of each pixel, as `shading` has them, (4, h, w)."""
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            t, total, c, b, v = 1.0 - alpha[y, x], 0.0, 0.0, 0.0, 0.0
            for i in range(3):
                m = l[i] / (V_C[y, x, i] + t * t * V_B[y, x, i])
                total += m * l[i]
                c += m * C[y, x, i]
                b += m * B[y, x, i]
                v += m * m * V_B[y, x, i]
            variance = 1.0 / total
            out[0, y, x], out[1, y, x] = c * variance, b * variance
            out[2, y, x], out[3, y, x] = v * variance * variance, variance

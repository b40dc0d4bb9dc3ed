"""The compiled loops of `Smooth`: what each pixel knows of alpha, and the equations of all of them.

In this file C, B, V_C, V_B, N are image, plate, their variances and the normals of the color model as
in `kernel`, D the differences of first or second order between neighbors, and γ how strongly each of
them is held at zero. Maps have a border of two pixels in which the mask is False.
"""

from typing import Any

import numpy as np
from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}
_FAST: dict[str, Any] = {**_COMPILED, "fastmath": {"nsz", "arcp", "contract", "reassoc"}}

_ROOT2 = np.sqrt(2.0)
_DOUBT = 5.0  # degrees of freedom of a t distribution: pixels that leave the model count less


@njit(**_COMPILED)
def evidence(C, B, V_C, V_B, N, alpha, mask, information, pull):  # type: ignore[no-untyped-def]
    """Write what each pixel of the mask says: information A, and pull A times its own alpha.

    Noise in the plate is on both sides of the equation: the pull is without what that feigns. The
    weights come from `alpha`, that of the neighborhood, so that they know nothing of the noise.
    """
    k = N.shape[1]
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            t = 1 - alpha[y, x]
            b, d, v, s = np.zeros(2), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
            s[1, 1] = 1.0
            for i in range(k):
                for c in range(3):
                    b[i] += N[c, i] * B[y, x, c]
                    d[i] += N[c, i] * (B[y, x, c] - C[y, x, c])
                for j in range(k):
                    s[i, j] = 0.0
                    for c in range(3):
                        both = N[c, i] * N[c, j]
                        v[i, j] += both * V_B[y, x, c]
                        s[i, j] += both * (V_C[y, x, c] + t * t * V_B[y, x, c])
            det = s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0]
            q00, q01, q11 = s[1, 1] / det, -s[0, 1] / det, s[0, 0] / det
            A = b[0] * b[0] * q00 + 2 * b[0] * b[1] * q01 + b[1] * b[1] * q11
            p = b[0] * d[0] * q00 + (b[0] * d[1] + b[1] * d[0]) * q01 + b[1] * d[1] * q11
            total = d[0] * d[0] * q00 + 2 * d[0] * d[1] * q01 + d[1] * d[1] * q11
            trust = 1.0
            if k == 2:
                left = max(total - p * p / max(A, 1e-30), 0.0)
                trust = (_DOUBT + 1) / (_DOUBT + left)
            feigned = v[0, 0] * q00 + 2 * v[0, 1] * q01 + v[1, 1] * q11
            information[y, x] = trust * A
            pull[y, x] = trust * (p - t * feigned)


@njit(**_FAST)
def forward(x, order, t):  # type: ignore[no-untyped-def]
    """Write the differences D x, (3, h, w)."""
    h, w = x.shape
    if order == 1:
        for i in range(1, h - 1):
            for j in range(1, w - 1):
                t[0, i, j] = x[i, j + 1] - x[i, j]
                t[1, i, j] = x[i + 1, j] - x[i, j]
        return
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            t[0, i, j] = x[i, j - 1] - 2 * x[i, j] + x[i, j + 1]
            t[1, i, j] = x[i - 1, j] - 2 * x[i, j] + x[i + 1, j]
            t[2, i, j] = _ROOT2 * (x[i, j] - x[i, j + 1] - x[i + 1, j] + x[i + 1, j + 1])


@njit(**_FAST)
def backward(t, order, mask, y):  # type: ignore[no-untyped-def]
    """Add Dᵀ t to y, within the mask."""
    h, w = y.shape
    if order == 1:
        for i in range(1, h - 1):
            for j in range(1, w - 1):
                y[i, j] += mask[i, j] * (t[0, i, j - 1] - t[0, i, j] + t[1, i - 1, j] - t[1, i, j])
        return
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            y[i, j] += mask[i, j] * (
                t[0, i, j - 1] - 2 * t[0, i, j] + t[0, i, j + 1]
                + t[1, i - 1, j] - 2 * t[1, i, j] + t[1, i + 1, j]
                + _ROOT2 * (t[2, i, j] - t[2, i, j - 1] - t[2, i - 1, j] + t[2, i - 1, j - 1])
            )  # fmt: skip


@njit(**_FAST)
def product(x, information, gamma, order, mask, y):  # type: ignore[no-untyped-def]
    """Write (A + DᵀγD) x within the mask, in one pass; x is 0 outside."""
    h, w = x.shape
    for i in range(2, h - 2):
        up, row, down = x[i - 1], x[i], x[i + 1]
        g_up, g, g_down = gamma[i - 1], gamma[i], gamma[i + 1]
        if order == 1:
            for j in range(2, w - 2):
                c = row[j]
                y[i, j] = mask[i, j] * (
                    information[i, j] * c
                    + g[j] * (2 * c - row[j + 1] - down[j])
                    + g[j - 1] * (c - row[j - 1])
                    + g_up[j] * (c - up[j])
                )
            continue
        top, bottom = x[i - 2], x[i + 2]
        for j in range(2, w - 2):
            c = row[j]
            along = (
                g[j - 1] * (row[j - 2] - 2 * row[j - 1] + c)
                - 2 * g[j] * (row[j - 1] - 2 * c + row[j + 1])
                + g[j + 1] * (c - 2 * row[j + 1] + row[j + 2])
            )
            across = (
                g_up[j] * (top[j] - 2 * up[j] + c)
                - 2 * g[j] * (up[j] - 2 * c + down[j])
                + g_down[j] * (c - 2 * down[j] + bottom[j])
            )
            twist = (
                g[j] * (c - row[j + 1] - down[j] + down[j + 1])
                - g[j - 1] * (row[j - 1] - c - down[j - 1] + down[j])
                - g_up[j] * (up[j] - up[j + 1] - c + row[j + 1])
                + g_up[j - 1] * (up[j - 1] - up[j] - row[j - 1] + c)
            )
            y[i, j] = mask[i, j] * (information[i, j] * c + along + across + 2 * twist)


@njit(**_FAST)
def diagonal(information, gamma, order, mask):  # type: ignore[no-untyped-def]
    """The diagonal of A + DᵀγD; 1 outside the mask."""
    h, w = mask.shape
    out = np.ones_like(information)
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            if not mask[i, j]:
                continue
            g = gamma[i, j]
            left, up, corner = gamma[i, j - 1], gamma[i - 1, j], gamma[i - 1, j - 1]
            if order == 1:
                out[i, j] = information[i, j] + 2 * g + left + up
            else:
                sides = left + gamma[i, j + 1] + up + gamma[i + 1, j]
                out[i, j] = information[i, j] + 8 * g + sides + 2 * (g + left + up + corner)
    return out


@njit(**_FAST)
def conjugate_gradients(information, gamma, order, mask, b, x, steps, tolerance):  # type: ignore[no-untyped-def]
    """Improve x towards (A + DᵀγD) x = b; how many steps it took.

    Ends where a step gains less than `tolerance` in log likelihood per pixel.
    """
    h, w = mask.shape
    inverse = mask / diagonal(information, gamma, order, mask)
    q, r, p = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    product(x, information, gamma, order, mask, q)
    rz, count = 0.0, 1
    for i in range(h):
        row = 0.0
        for j in range(w):
            r[i, j] = mask[i, j] * (b[i, j] - q[i, j])
            p[i, j] = inverse[i, j] * r[i, j]
            row += r[i, j] * p[i, j]
            count += mask[i, j]
        rz += row
    for step in range(steps):
        if rz == 0:
            return step
        product(p, information, gamma, order, mask, q)
        pq = 0.0
        for i in range(h):
            row = 0.0
            for j in range(w):
                row += p[i, j] * q[i, j]
            pq += row
        if pq <= 0:  # nothing left but rounding
            return step
        along, new = rz / pq, 0.0
        for i in range(h):
            row = 0.0
            for j in range(w):
                x[i, j] += along * p[i, j]
                r[i, j] -= along * q[i, j]
                row += r[i, j] * r[i, j] * inverse[i, j]
            new += row
        if along * rz < tolerance * count:
            return step + 1
        for i in range(h):
            for j in range(w):
                p[i, j] = inverse[i, j] * r[i, j] + new / rz * p[i, j]
        rz = new
    return steps

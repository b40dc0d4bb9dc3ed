"""The compiled loops of `Smooth`: what each pixel knows of alpha, and the equations of all of them.

In this file C, B, V_C, V_B, N are image, plate, their variances and the normals of the color model as
in `kernel`, D the differences of first or second order between neighbors, and Γ the precision of
those of each place: the lower triangle of a symmetric matrix, row by row, (3 or 6, h, w), with its
Cholesky factor L. Maps have a border of two pixels in which the mask is False.
"""

from typing import Any

import numpy as np
from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}
_FAST: dict[str, Any] = {**_COMPILED, "fastmath": {"nsz", "arcp", "contract", "reassoc"}}

_ROOT2 = np.sqrt(2.0)
_ROUNDING = 1e-20  # of all that was gained
_LEAST = 1e-30  # of a square that rounding may leave negative
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
def weigh(gamma, order, t):  # type: ignore[no-untyped-def]
    """Multiply each place's differences by its precision, in place."""
    h, w = t.shape[1:]
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            a, b = t[0, i, j], t[1, i, j]
            if order == 1:
                t[0, i, j] = gamma[0, i, j] * a + gamma[1, i, j] * b
                t[1, i, j] = gamma[1, i, j] * a + gamma[2, i, j] * b
            else:
                c = t[2, i, j]
                t[0, i, j] = gamma[0, i, j] * a + gamma[1, i, j] * b + gamma[3, i, j] * c
                t[1, i, j] = gamma[1, i, j] * a + gamma[2, i, j] * b + gamma[4, i, j] * c
                t[2, i, j] = gamma[3, i, j] * a + gamma[4, i, j] * b + gamma[5, i, j] * c


@njit(**_FAST)
def product(x, information, gamma, order, mask, t, y):  # type: ignore[no-untyped-def]
    """Write (A + DᵀΓD) x within the mask; x is 0 outside. t is for the differences, (3, h, w)."""
    h, w = x.shape
    forward(x, order, t)
    weigh(gamma, order, t)
    for i in range(h):
        for j in range(w):
            y[i, j] = mask[i, j] * information[i, j] * x[i, j]
    backward(t, order, mask, y)


@njit(**_FAST)
def diagonal(information, gamma, order, mask):  # type: ignore[no-untyped-def]
    """The diagonal of A + DᵀΓD; 1 outside the mask."""
    h, w = mask.shape
    out = np.ones_like(information)
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            if not mask[i, j]:
                continue
            g = gamma[:, i, j]
            left, up, corner = gamma[:, i, j - 1], gamma[:, i - 1, j], gamma[:, i - 1, j - 1]
            if order == 1:
                out[i, j] = information[i, j] + g[0] + 2 * g[1] + g[2] + left[0] + up[2]
            else:
                out[i, j] = (
                    information[i, j]
                    + 4 * (g[0] + g[2]) + 8 * g[1] + 2 * g[5] - 4 * _ROOT2 * (g[3] + g[4])
                    + gamma[0, i, j + 1] + left[0] + 2 * left[5] - 2 * _ROOT2 * left[3]
                    + gamma[2, i + 1, j] + up[2] + 2 * up[5] - 2 * _ROOT2 * up[4]
                    + 2 * corner[5]
                )  # fmt: skip
    return out


@njit(**_FAST)
def outer(t, order, weight, total):  # type: ignore[no-untyped-def]
    """Add the outer products of the differences, times the weight."""
    h, w = t.shape[1:]
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            a, b = t[0, i, j], t[1, i, j]
            total[0, i, j] += weight * a * a
            total[1, i, j] += weight * a * b
            total[2, i, j] += weight * b * b
            if order == 2:
                c = t[2, i, j]
                total[3, i, j] += weight * a * c
                total[4, i, j] += weight * b * c
                total[5, i, j] += weight * c * c


@njit(**_COMPILED)
def precision(squares, order, least, factor, gamma, root):  # type: ignore[no-untyped-def]
    """Write Γ = factor (least I + S)⁻¹, and L of Γ = LLᵀ."""
    h, w = squares.shape[1:]
    for i in range(h):
        for j in range(w):
            a, b, c = squares[0, i, j] + least, squares[1, i, j], squares[2, i, j] + least
            d, e, f = 0.0, 0.0, 1.0
            if order == 2:
                d, e, f = squares[3, i, j], squares[4, i, j], squares[5, i, j] + least
            g = gamma[:, i, j]
            cofactors = c * f - e * e, d * e - b * f, b * e - c * d
            scale = factor / (a * cofactors[0] + b * cofactors[1] + d * cofactors[2])
            g[0], g[1], g[2] = scale * cofactors[0], scale * cofactors[1], scale * (a * f - d * d)
            r = root[:, i, j]
            r[0] = np.sqrt(g[0])
            r[1] = g[1] / r[0]
            r[2] = np.sqrt(max(g[2] - r[1] ** 2, _LEAST))
            if order == 2:
                g[3], g[4], g[5] = (
                    scale * cofactors[2],
                    scale * (b * d - a * e),
                    scale * (a * c - b * b),
                )
                r[3] = g[3] / r[0]
                r[4] = (g[4] - r[3] * r[1]) / r[2]
                r[5] = np.sqrt(max(g[5] - r[3] ** 2 - r[4] ** 2, _LEAST))


@njit(**_FAST)
def spread(root, order, n, t):  # type: ignore[no-untyped-def]
    """Write L n."""
    h, w = t.shape[1:]
    for i in range(h):
        for j in range(w):
            t[0, i, j] = root[0, i, j] * n[0, i, j]
            t[1, i, j] = root[1, i, j] * n[0, i, j] + root[2, i, j] * n[1, i, j]
            if order == 2:
                t[2, i, j] = (
                    root[3, i, j] * n[0, i, j] + root[4, i, j] * n[1, i, j]
                    + root[5, i, j] * n[2, i, j]
                )  # fmt: skip


@njit(**_FAST)
def conjugate_gradients(information, gamma, order, mask, b, x, steps, tolerance):  # type: ignore[no-untyped-def]
    """Improve x towards (A + DᵀΓD) x = b; how many steps it took.

    Ends where a step gains less than `tolerance` in log likelihood per pixel, or nothing but rounding.
    """
    h, w = mask.shape
    inverse = mask / diagonal(information, gamma, order, mask)
    q, r, p = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    t = np.zeros((3, h, w))
    product(x, information, gamma, order, mask, t, q)
    rz, count = 0.0, 1
    for i in range(h):
        row = 0.0
        for j in range(w):
            r[i, j] = mask[i, j] * (b[i, j] - q[i, j])
            p[i, j] = inverse[i, j] * r[i, j]
            row += r[i, j] * p[i, j]
            count += mask[i, j]
        rz += row
    gained = 0.0
    for step in range(steps):
        if rz == 0:
            return step
        product(p, information, gamma, order, mask, t, q)
        pq = 0.0
        for i in range(h):
            row = 0.0
            for j in range(w):
                row += p[i, j] * q[i, j]
            pq += row
        along, new = rz / pq, 0.0
        gained += along * rz
        for i in range(h):
            row = 0.0
            for j in range(w):
                x[i, j] += along * p[i, j]
                r[i, j] -= along * q[i, j]
                row += r[i, j] * r[i, j] * inverse[i, j]
            new += row
        if along * rz <= max(tolerance * count, _ROUNDING * gained):
            return step + 1
        for i in range(h):
            for j in range(w):
                p[i, j] = inverse[i, j] * r[i, j] + new / rz * p[i, j]
        rz = new
    return steps

"""The compiled loops of `Smooth`: what each pixel knows of alpha, and the equations of all of them.

In this file C, B, V_C, V_B, N are image, plate, their variances and the normals of the color model as
in `kernel`, D the differences of first or second order between neighbors, and L the Cholesky factor of
the precision Γ = LLᵀ of those of each place: a lower triangle, row by row, (3 or 6, h, w). Γ itself is
kept nowhere: rounded to float32 it may no longer be positive. Maps have a border of two pixels in which
the mask is False, and all of them one dtype, which is the one computed in.
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
def evidence_at_edges(C, B, V_C, V_B, K, N, alpha, information, pull):  # type: ignore[no-untyped-def]
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


@njit(**_FAST)
def doubled(values, border, out):  # type: ignore[no-untyped-def]
    """Write a map of cells, but for its border, in cells of half the width, in between linear."""
    h, w = out.shape[0] - 2 * border, out.shape[1] - 2 * border
    bottom, right = values.shape[0] - border - 1, values.shape[1] - border - 1
    for i in range(h):
        here = border + i // 2
        next_to = min(max(here + 2 * (i % 2) - 1, border), bottom)
        for j in range(w):
            k = border + j // 2
            n = min(max(k + 2 * (j % 2) - 1, border), right)
            out[border + i, border + j] = (
                9 * values[here, k]
                + 3 * (values[here, n] + values[next_to, k])
                + values[next_to, n]
            ) / 16


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
    root2 = x.dtype.type(_ROOT2)  # a float64 would make all slower
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            twice = x[i, j] + x[i, j]
            t[0, i, j] = x[i, j - 1] - twice + x[i, j + 1]
            t[1, i, j] = x[i - 1, j] - twice + x[i + 1, j]
            t[2, i, j] = root2 * (x[i, j] - x[i, j + 1] - x[i + 1, j] + x[i + 1, j + 1])


@njit(**_FAST)
def backward(t, order, mask, y):  # type: ignore[no-untyped-def]
    """Add Dᵀ t to y, within the mask."""
    h, w = y.shape
    zero, root2 = y.dtype.type(0), y.dtype.type(_ROOT2)
    if order == 1:
        for i in range(1, h - 1):
            for j in range(1, w - 1):
                change = t[0, i, j - 1] - t[0, i, j] + t[1, i - 1, j] - t[1, i, j]
                y[i, j] += change if mask[i, j] else zero
        return
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            once = t[0, i, j] + t[1, i, j]
            change = (
                t[0, i, j - 1] + t[0, i, j + 1] - once + t[1, i - 1, j] + t[1, i + 1, j] - once
                + root2 * (t[2, i, j] - t[2, i, j - 1] - t[2, i - 1, j] + t[2, i - 1, j - 1])
            )  # fmt: skip
            y[i, j] += change if mask[i, j] else zero


@njit(**_FAST)
def weigh(root, order, t):  # type: ignore[no-untyped-def]
    """Multiply each place's differences by its precision, in place."""
    h, w = t.shape[1:]
    if order == 1:
        for i in range(1, h - 1):
            for j in range(1, w - 1):
                p = root[0, i, j] * t[0, i, j] + root[1, i, j] * t[1, i, j]
                q = root[2, i, j] * t[1, i, j]
                t[0, i, j] = root[0, i, j] * p
                t[1, i, j] = root[1, i, j] * p + root[2, i, j] * q
        return
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            c = t[2, i, j]
            p = root[0, i, j] * t[0, i, j] + root[1, i, j] * t[1, i, j] + root[3, i, j] * c
            q = root[2, i, j] * t[1, i, j] + root[4, i, j] * c
            r = root[5, i, j] * c
            t[0, i, j] = root[0, i, j] * p
            t[1, i, j] = root[1, i, j] * p + root[2, i, j] * q
            t[2, i, j] = root[3, i, j] * p + root[4, i, j] * q + root[5, i, j] * r


@njit(**_FAST)
def product(x, information, root, order, mask, t, y):  # type: ignore[no-untyped-def]
    """Write (A + DᵀΓD) x within the mask; x is 0 outside. t is for the differences, (3, h, w)."""
    h, w = x.shape
    zero = x.dtype.type(0)
    forward(x, order, t)
    weigh(root, order, t)
    for i in range(h):
        for j in range(w):
            y[i, j] = information[i, j] * x[i, j] if mask[i, j] else zero
    backward(t, order, mask, y)


@njit(**_FAST)
def diagonal(information, root, order, mask):  # type: ignore[no-untyped-def]
    """The diagonal of A + DᵀΓD; of no meaning outside the mask."""
    h, w = mask.shape
    out = information.copy()
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            l0, l1, l2 = root[0, i, j], root[1, i, j], root[2, i, j]
            if order == 1:
                out[i, j] += (l0 + l1) ** 2 + l2**2
                out[i, j + 1] += l0**2
                out[i + 1, j] += l1**2 + l2**2
                continue
            l3, l4, l5 = _ROOT2 * root[3, i, j], _ROOT2 * root[4, i, j], _ROOT2 * root[5, i, j]
            across, down = l0**2, l1**2 + l2**2
            out[i, j] += (l3 - 2 * (l0 + l1)) ** 2 + (l4 - 2 * l2) ** 2 + l5**2
            out[i, j - 1] += across
            out[i - 1, j] += down
            out[i, j + 1] += (l0 - l3) ** 2 + l4**2 + l5**2
            out[i + 1, j] += (l1 - l3) ** 2 + (l2 - l4) ** 2 + l5**2
            out[i + 1, j + 1] += l3**2 + l4**2 + l5**2
    return out


@njit(**_FAST)
def outer(t, order, weight, total):  # type: ignore[no-untyped-def]
    """Add the outer products of the differences, times the weight, in float64."""
    h, w = t.shape[1:]
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            a, b = float(t[0, i, j]), float(t[1, i, j])
            total[0, i, j] += weight * a * a
            total[1, i, j] += weight * a * b
            total[2, i, j] += weight * b * b
            if order == 2:
                c = float(t[2, i, j])
                total[3, i, j] += weight * a * c
                total[4, i, j] += weight * b * c
                total[5, i, j] += weight * c * c


@njit(**_COMPILED)
def precision(squares, order, least, factor, root):  # type: ignore[no-untyped-def]
    """Write L of Γ = factor (least I + S)⁻¹ = LLᵀ, from S in float64."""
    h, w = squares.shape[1:]
    for i in range(h):
        for j in range(w):
            a, b, c = squares[0, i, j] + least, squares[1, i, j], squares[2, i, j] + least
            d, e, f = 0.0, 0.0, 1.0
            if order == 2:
                d, e, f = squares[3, i, j], squares[4, i, j], squares[5, i, j] + least
            p, q, r = c * f - e * e, d * e - b * f, b * e - c * d
            scale = factor / (a * p + b * q + d * r)
            l0 = np.sqrt(scale * p)
            l1 = scale * q / l0
            l2 = np.sqrt(max(scale * (a * f - d * d) - l1 * l1, _LEAST))
            root[0, i, j], root[1, i, j], root[2, i, j] = l0, l1, l2
            if order == 2:
                l3 = scale * r / l0
                l4 = (scale * (b * d - a * e) - l3 * l1) / l2
                root[3, i, j], root[4, i, j] = l3, l4
                root[5, i, j] = np.sqrt(max(scale * (a * c - b * b) - l3 * l3 - l4 * l4, _LEAST))


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
def conjugate_gradients(information, root, order, mask, b, x, steps, tolerance):  # type: ignore[no-untyped-def]
    """Improve x towards (A + DᵀΓD) x = b; how many steps it took.

    Ends where a step gains less than `tolerance` in log likelihood per pixel, or nothing but rounding.
    """
    h, w = mask.shape
    inverse = diagonal(information, root, order, mask)
    q, r, p = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    t = np.zeros((3, h, w), x.dtype)
    zero, one = x.dtype.type(0), x.dtype.type(1)
    product(x, information, root, order, mask, t, q)
    rz, count = 0.0, 1
    for i in range(h):
        row = zero
        for j in range(w):
            inverse[i, j] = one / inverse[i, j] if mask[i, j] else zero
            r[i, j] = b[i, j] - q[i, j] if mask[i, j] else zero
            p[i, j] = inverse[i, j] * r[i, j]
            row += r[i, j] * p[i, j]
            count += mask[i, j]
        rz += row
    gained = 0.0
    for step in range(steps):
        if rz == 0:
            return step
        product(p, information, root, order, mask, t, q)
        pq = 0.0
        for i in range(h):
            row = zero
            for j in range(w):
                row += p[i, j] * q[i, j]
            pq += row
        along, new = rz / pq, 0.0
        gained += along * rz
        far = x.dtype.type(along)
        for i in range(h):
            row = zero
            for j in range(w):
                x[i, j] += far * p[i, j]
                r[i, j] -= far * q[i, j]
                row += r[i, j] * r[i, j] * inverse[i, j]
            new += row
        if along * rz <= max(tolerance * count, _ROUNDING * gained):
            return step + 1
        kept = x.dtype.type(new / rz)
        for i in range(h):
            for j in range(w):
                p[i, j] = inverse[i, j] * r[i, j] + kept * p[i, j]
        rz = new
    return steps

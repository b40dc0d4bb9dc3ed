"""Compiled loops of `Smooth`: the equations of all pixels.

In this file A is the information of each pixel, D the differences of first or second order between
neighbors, and L the Cholesky factor of the precision Γ = LLᵀ of the differences at each place: a lower
triangle, row by row, (3 or 6, h, w). Γ itself is not stored: rounded to float32 it may not be positive
definite. Maps have a border of two pixels in which the mask is False, and all have the dtype of the
computation.
"""

import numpy as np

from blurmatte.compiling import FAST_MATH, njit

_ROOT2 = np.sqrt(2.0)


@njit(fastmath=FAST_MATH)
def doubled(values, border, out):  # type: ignore[no-untyped-def]
    """Write a map, without its border, in cells of half the width, interpolated linearly."""
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


@njit(fastmath=FAST_MATH)
def forward(x, order, t):  # type: ignore[no-untyped-def]
    """Write the differences D x, (3, h, w)."""
    h, w = x.shape
    if order == 1:
        for i in range(1, h - 1):
            for j in range(1, w - 1):
                t[0, i, j] = x[i, j + 1] - x[i, j]
                t[1, i, j] = x[i + 1, j] - x[i, j]
        return
    root2 = x.dtype.type(_ROOT2)  # float64 would be slower
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            twice = x[i, j] + x[i, j]
            t[0, i, j] = x[i, j - 1] - twice + x[i, j + 1]
            t[1, i, j] = x[i - 1, j] - twice + x[i + 1, j]
            t[2, i, j] = root2 * (x[i, j] - x[i, j + 1] - x[i + 1, j] + x[i + 1, j + 1])


@njit(fastmath=FAST_MATH)
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


@njit(fastmath=FAST_MATH)
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


@njit(fastmath=FAST_MATH)
def product(x, information, root, order, mask, t, y):  # type: ignore[no-untyped-def]
    """Write (A + DᵀΓD) x within the mask; x is 0 outside. t is scratch for differences, (3, h, w)."""
    h, w = x.shape
    zero = x.dtype.type(0)
    forward(x, order, t)
    weigh(root, order, t)
    for i in range(h):
        for j in range(w):
            y[i, j] = information[i, j] * x[i, j] if mask[i, j] else zero
    backward(t, order, mask, y)


@njit(fastmath=FAST_MATH)
def diagonal(information, root, order, mask):  # type: ignore[no-untyped-def]
    """The diagonal of A + DᵀΓD; undefined outside the mask."""
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


@njit(fastmath=FAST_MATH)
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


@njit()
def precision(squares, order, least, factor, root):  # type: ignore[no-untyped-def]
    """Write L of Γ = factor (least I + S)⁻¹ = LLᵀ, from S in float64; least is (h, w)."""
    h, w = squares.shape[1:]
    for i in range(h):
        for j in range(w):
            own = least[i, j]
            a, b, c = squares[0, i, j] + own, squares[1, i, j], squares[2, i, j] + own
            d, e, f = 0.0, 0.0, 1.0
            if order == 2:
                d, e, f = squares[3, i, j], squares[4, i, j], squares[5, i, j] + own
            p, q, r = c * f - e * e, d * e - b * f, b * e - c * d
            scale = factor / (a * p + b * q + d * r)
            l0 = np.sqrt(scale * p)
            l1 = scale * q / l0
            l2 = np.sqrt(max(scale * (a * f - d * d) - l1 * l1, 1e-30))
            root[0, i, j], root[1, i, j], root[2, i, j] = l0, l1, l2
            if order == 2:
                l3 = scale * r / l0
                l4 = (scale * (b * d - a * e) - l3 * l1) / l2
                root[3, i, j], root[4, i, j] = l3, l4
                root[5, i, j] = np.sqrt(max(scale * (a * c - b * b) - l3 * l3 - l4 * l4, 1e-30))


@njit(fastmath=FAST_MATH)
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


@njit(fastmath=FAST_MATH)
def conjugate_gradients(information, root, order, mask, b, x, steps, tolerance):  # type: ignore[no-untyped-def]
    """Solve (A + DᵀΓD) x = b by conjugate gradients, starting at x, in place; the number of steps.

    Stops when a step gains less than `tolerance` in log likelihood per pixel, or only rounding errors.
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
        length, new = rz / pq, 0.0
        gained += length * rz
        step_x = x.dtype.type(length)
        for i in range(h):
            row = zero
            for j in range(w):
                x[i, j] += step_x * p[i, j]
                r[i, j] -= step_x * q[i, j]
                row += r[i, j] * r[i, j] * inverse[i, j]
            new += row
        if length * rz <= max(tolerance * count, 1e-20 * gained):
            return step + 1
        beta = x.dtype.type(new / rz)
        for i in range(h):
            for j in range(w):
                p[i, j] = inverse[i, j] * r[i, j] + beta * p[i, j]
        rz = new
    return steps

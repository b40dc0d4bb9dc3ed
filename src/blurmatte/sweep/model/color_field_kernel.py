"""The field of colors, compiled: its nodes, their normal equations and fit, light and residuals.

In this file `number` (rows, columns) has the number of each node of a grid of `pitch` pixels, −1 for
those that are none; the nodes lie in the corners of its cells, the first in pixel (0, 0). A symmetric
banded matrix is its lower band: band[k, j] is the element (j + k, j). See `color_field` for the rest.
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
def light(alpha, pitch, number, colors, P):  # type: ignore[no-untyped-def]
    """Write alpha times the color to P (h, w, 3)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            if a > 0:
                _hats(y, x, pitch, number, nodes, hats)
                for c in range(3):
                    P[y, x, c] = a * _color(a, nodes, hats, colors, c)


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


@njit(**_COMPILED)
def factor(band):  # type: ignore[no-untyped-def]
    """Replace a band (width, n) by that of its Cholesky factor."""
    width, n = band.shape
    for j in range(n):
        pivot = np.sqrt(max(band[0, j], 1e-300))
        band[0, j] = pivot
        last = min(width, n - j)
        for k in range(1, last):
            band[k, j] /= pivot
        for k in range(1, last):
            by = band[k, j]
            for i in range(k, last):
                band[i - k, j + k] -= band[i, j] * by


@njit(**_COMPILED)
def solve(band, x):  # type: ignore[no-untyped-def]
    """Replace right sides x (n, m) by the solutions, given the band of the Cholesky factor."""
    width, n = band.shape
    for c in range(x.shape[1]):
        for j in range(n):
            x[j, c] /= band[0, j]
            for k in range(1, min(width, n - j)):
                x[j + k, c] -= band[k, j] * x[j, c]
        for j in range(n - 1, -1, -1):
            for k in range(1, min(width, n - j)):
                x[j, c] -= band[k, j] * x[j + k, c]
            x[j, c] /= band[0, j]


@njit(**_COMPILED)
def fit_axis(band, right, differences, spread, change, free, prior, colors):  # type: ignore[no-untyped-def]
    """Write the prior's band (width, n) and the mode (n,); returns cost, mean and its deviation.

    The mean is 0 unless it is free.
    """
    width, n = band.shape
    posterior, volume = np.empty((width, n)), np.empty((width, n))
    for k in range(width):
        for j in range(n):
            prior[k, j] = differences[k, j] / change**2
    for j in range(n):
        prior[0, j] += spread**-2
    for k in range(width):
        for j in range(n):
            posterior[k, j], volume[k, j] = band[k, j] + prior[k, j], prior[k, j]
    factor(posterior)
    factor(volume)
    both = np.empty((n, 2))
    for j in range(n):
        both[j, 0], both[j, 1] = right[j], spread**-2
    solve(posterior, both)
    mean, std = 0.0, spread
    if free:
        by_zero, by_mean = 0.0, 0.0
        for j in range(n):
            by_zero += both[j, 0] * spread**-2
            by_mean += both[j, 1] * spread**-2
        known = max(n * spread**-2 - by_mean, 1e-9)
        mean, std = by_zero / known, known**-0.5
    cost = 0.0
    for j in range(n):
        colors[j] = both[j, 0] + mean * both[j, 1]
        cost += np.log(posterior[0, j]) - np.log(volume[0, j])
    for j in range(n):
        a = colors[j] - mean
        cost += prior[0, j] * a * a / 2
        for k in range(1, min(width, n - j)):
            cost += prior[k, j] * a * (colors[j + k] - mean)
    return cost, mean, std


@njit(**_COMPILED)
def scales(band, prior, colors, mean, neighbors):  # type: ignore[no-untyped-def]
    """Spread and change of the nodes (n,), weighted by how well these are known."""
    away, sure = 0.0, 1e-9
    n = len(colors)
    known = np.empty(n)
    for j in range(n):
        known[j] = band[0, j] / (band[0, j] + prior[0, j])
        away += known[j] * (colors[j] - mean) ** 2
        sure += known[j]
    steps, both = 0.0, 1e-9
    for p in range(neighbors.shape[1]):
        i, j = neighbors[0, p], neighbors[1, p]
        w = min(known[i], known[j])
        steps += w * (colors[i] - colors[j]) ** 2
        both += w
    return np.sqrt(away / sure), np.sqrt(steps / both)


@njit(**_COMPILED)
def fit(C, B, V_C, V_B, alpha, weight, pitch, number, differences, neighbors, settings):  # type: ignore[no-untyped-def]
    """Colors (n, 3) and the prior's bands (3, width, n) of a field; mean, its deviation, spread and
    change (3,) of each; the cost, and the residuals (3, h, w).

    `settings` are: rounds, rank, varied, the deviation of colors across the model, the degrees of
    freedom of the residuals' t distribution, the first spreads (3) and the least one, of the mean
    color's length, and the least length.
    """
    rounds, rank, varied = int(settings[0]), int(settings[1]), int(settings[2])
    across, freedom, least, shortest = settings[3], settings[4], settings[8], settings[9]
    width, n = differences.shape
    band, right = np.zeros((3, width, n)), np.zeros((3, n))
    equations(C, B, V_C, V_B, alpha, weight, pitch, number, band, right)
    length = 0.0
    for c in range(3):
        total = band[c, 0].sum() + 2 * band[c, 1:].sum()
        length += (right[c].sum() / max(total, 1e-9)) ** 2
    length = max(np.sqrt(length), shortest)
    spread, change = np.empty(3), np.empty(3)
    for c in range(3):
        spread[c] = length * (settings[5 + c] if c < varied else max(across, least))
        change[c] = spread[c]
    used, changed = spread.copy(), change.copy()
    prior, colors = np.empty((3, width, n)), np.empty((n, 3))
    mean, std = np.zeros(3), np.zeros(3)
    e, own = np.empty((3, *alpha.shape)), np.empty(n)
    cost = 0.0
    weights = weight.copy()
    for turn in range(rounds):
        cost = 0.0
        used[:], changed[:] = spread, change
        for c in range(3):
            one, mean[c], std[c] = fit_axis(
                band[c], right[c], differences, spread[c], change[c], c < rank, prior[c], own
            )
            cost += one
            colors[:, c] = own
            if c < varied:
                away, step = scales(band[c], prior[c], own, mean[c], neighbors)
                spread[c], change[c] = max(away, least * length), max(step, least * length)
        residuals(C, B, V_C, V_B, alpha, pitch, number, colors, e)
        if turn + 1 < rounds:
            for y in range(alpha.shape[0]):
                for x in range(alpha.shape[1]):
                    chi2 = e[0, y, x] ** 2 + e[1, y, x] ** 2 + e[2, y, x] ** 2
                    weights[y, x] = weight[y, x] * (freedom + 3) / (freedom + chi2)
            band[:], right[:] = 0, 0
            equations(C, B, V_C, V_B, alpha, weights, pitch, number, band, right)
    return colors, prior, mean, std, used, changed, cost, e


@njit(**_COMPILED)
def marginalize(H, cross, C, B, V_C, V_B, alpha, weight, pitch, number, prior, rank):  # type: ignore[no-untyped-def]
    """Subtract from a curvature H (p, p) what colors could explain; cross is (3, n, p).

    Along the first `rank` axes the mean color is free, too.
    """
    width, n = prior.shape[1:]
    band, right = np.zeros((3, width, n)), np.zeros((3, n))
    equations(C, B, V_C, V_B, alpha, weight, pitch, number, band, right)
    for c in range(3):
        posterior, x = band[c] + prior[c], cross[c].copy()
        factor(posterior)
        solve(posterior, x)
        for p in range(H.shape[0]):
            for q in range(H.shape[1]):
                total = 0.0
                for j in range(n):
                    total += cross[c, j, p] * x[j, q]
                H[p, q] -= total
        if c >= rank:
            continue
        ones = np.empty((n, 1))  # the prior times 1, a row's sum
        for j in range(n):
            ones[j, 0] = prior[c, 0, j]
        for k in range(1, width):
            for j in range(n - k):
                ones[j, 0] += prior[c, k, j]
                ones[j + k, 0] += prior[c, k, j]
        mean = ones.copy()
        solve(posterior, mean)
        known = 0.0
        for j in range(n):
            known += ones[j, 0] * (1 - mean[j, 0])
        by_mean = np.zeros(H.shape[0])
        for p in range(H.shape[0]):
            for j in range(n):
                by_mean[p] += cross[c, j, p] * mean[j, 0]
        if known > 1e-9:
            for p in range(H.shape[0]):
                for q in range(H.shape[1]):
                    H[p, q] -= by_mean[p] * by_mean[q] / known

"""The field of colors, compiled: its nodes, their normal equations and fit, light and residuals.

In this file `number` (rows, columns) has the number of each node of a grid of `pitch` pixels, −1 for
places without a node; the nodes lie in the corners of its cells, the first in pixel (0, 0). A symmetric
banded matrix is its lower band: band[k, j] is the element (j + k, j). `observed` are C, B, V_C and V_B,
(h, w, 3) each. See `color_field` for the rest.
"""

import numpy as np

from blurmatte.compiling import njit


@njit()
def touched(alpha, pitch, number):  # type: ignore[no-untyped-def]
    """Write 0 to the corners of all cells that the object covered."""
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            if alpha[y, x] > 0:
                j, i = int(y / pitch), int(x / pitch)
                number[j : j + 2, i : i + 2] = 0


@njit()
def numbered(number):  # type: ignore[no-untyped-def]
    """Number the nodes that are 0 along the shorter side, and return the pairs of adjacent ones.

    The pairs (2, m) have the lower number first. Then the largest difference of the numbers of two
    nodes of one cell, and the number of nodes.
    """
    rows, columns = number.shape
    n, m, apart = 0, 0, 0
    if rows > columns:
        for j in range(rows):
            for i in range(columns):
                if number[j, i] == 0:
                    number[j, i] = n
                    n += 1
    else:
        for i in range(columns):
            for j in range(rows):
                if number[j, i] == 0:
                    number[j, i] = n
                    n += 1
    pairs = np.empty((2, 2 * n), np.int64)
    for down, right, adjacent in ((0, 1, True), (1, 0, True), (1, 1, False), (1, -1, False)):
        for j in range(rows - down):
            for i in range(max(-right, 0), columns - max(right, 0)):
                a, b = number[j, i], number[j + down, i + right]
                if a < 0 or b < 0:
                    continue
                apart = max(apart, abs(b - a))
                if adjacent:
                    pairs[0, m], pairs[1, m] = min(a, b), max(a, b)
                    m += 1
    return pairs[:, :m].copy(), apart, n


@njit()
def squared_differences(neighbors, width, n):  # type: ignore[no-untyped-def]
    """Lower band (width, n) of the matrix of the sum of squared differences of neighbors (2, m)."""
    band = np.zeros((width, n))
    for p in range(neighbors.shape[1]):
        i, j = neighbors[0, p], neighbors[1, p]
        band[0, i] += 1
        band[0, j] += 1
        band[j - i, i] = -1
    return band


@njit()
def corners(y, x, pitch, number, nodes, hats):  # type: ignore[no-untyped-def]
    """Write the four nodes around a pixel, and the values of their hats."""
    j, i = int(y / pitch), int(x / pitch)
    v, u = y / pitch - j, x / pitch - i
    nodes[0], nodes[1] = number[j, i], number[j, i + 1]
    nodes[2], nodes[3] = number[j + 1, i], number[j + 1, i + 1]
    hats[0], hats[1] = (1 - v) * (1 - u), (1 - v) * u
    hats[2], hats[3] = v * (1 - u), v * u


@njit()
def seen(observed, alpha, pitch, number):  # type: ignore[no-untyped-def]
    """Row and column (n, 2), nodes (n, 4) and alpha times their hats (n, 4) of the n covered pixels.

    Then their residual light C − (1 − α) B over the noise, and 1 over the noise, (n, 3) each.
    """
    C, B, V_C, V_B = observed
    h, w = alpha.shape
    count = np.count_nonzero(alpha)
    at, nodes = np.empty((count, 2), np.int64), np.empty((count, 4), np.int64)
    hats, P, sharp = np.empty((count, 4)), np.empty((count, 3)), np.empty((count, 3))
    k = 0
    for y in range(h):
        for x in range(w):
            a = alpha[y, x]
            if a == 0:
                continue
            at[k, 0], at[k, 1] = y, x
            corners(y, x, pitch, number, nodes[k], hats[k])
            for i in range(4):
                hats[k, i] *= a
            for c in range(3):
                sharp[k, c] = 1 / np.sqrt(V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c])
                P[k, c] = (C[y, x, c] - (1 - a) * B[y, x, c]) * sharp[k, c]
            k += 1
    return at, nodes, hats, P, sharp


@njit()
def _weights_at(at, weight):  # type: ignore[no-untyped-def]
    """Weights (n,) of pixels in rows and columns `at` (n, 2)."""
    found = np.empty(len(at))
    for k in range(len(at)):
        found[k] = weight[at[k, 0], at[k, 1]]
    return found


@njit()
def _add(nodes, hats, P, sharp, weight, band, right):  # type: ignore[no-untyped-def]
    """Add the normal equations of pixels, as `seen` has them, of weight (n,)."""
    pull, known = np.empty(3), np.empty(3)
    for k in range(len(weight)):
        if weight[k] == 0:
            continue
        for c in range(3):
            pull[c], known[c] = weight[k] * sharp[k, c] * P[k, c], weight[k] * sharp[k, c] ** 2
        for i in range(4):
            node, hat = nodes[k, i], hats[k, i]
            for c in range(3):
                right[c, node] += pull[c] * hat
            for j in range(i + 1):
                other, by = nodes[k, j], hats[k, j]
                low, apart = min(node, other), abs(node - other)
                of_low, of_high = (by, hat) if other <= node else (hat, by)
                for c in range(3):
                    band[c, apart, low] += known[c] * of_high * of_low


@njit()
def _color(a, nodes, hats, colors, c):  # type: ignore[no-untyped-def]
    k = 0.0
    if a > 0:
        for i in range(4):
            k += hats[i] * colors[nodes[i], c]
    return k


@njit()
def residuals(observed, alpha, pitch, number, colors, e):  # type: ignore[no-untyped-def]
    """Write residuals e (3, h, w) of unit variance, one of each channel."""
    C, B, V_C, V_B = observed
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            if a > 0:
                corners(y, x, pitch, number, nodes, hats)
            for c in range(3):
                k = _color(a, nodes, hats, colors, c)
                V = V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c]
                e[c, y, x] = (C[y, x, c] - (1 - a) * B[y, x, c] - a * k) / np.sqrt(V)


@njit()
def light(alpha, pitch, number, colors, P):  # type: ignore[no-untyped-def]
    """Write alpha times the color to P (h, w, 3)."""
    nodes, hats = np.empty(4, np.int64), np.empty(4)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            if a > 0:
                corners(y, x, pitch, number, nodes, hats)
                for c in range(3):
                    P[y, x, c] = a * _color(a, nodes, hats, colors, c)


@njit()
def _any(J, y, x):  # type: ignore[no-untyped-def]
    """True if a derivative at a pixel is not 0; a loop is much faster than NumPy here."""
    for p in range(J.shape[2]):  # noqa: SIM110  compiled
        if J[y, x, p] != 0:
            return True
    return False


@njit()
def by_alpha(J, observed, alpha, weight, pitch, number, colors, e, cross):  # type: ignore[no-untyped-def]
    """Half the curvature (n, n) and gradient (n,) of a sum of squares; J (h, w, n) are derivatives.

    Adds the mixed curvature with the nodes' colors to cross (3, m, n). The noise depends on alpha as
    well, which is equivalent to replacing the plate by its best estimate, as in `residuals`.
    """
    _, B, V_C, V_B = observed
    h, w, n = J.shape
    H, g = np.zeros((n, n)), np.zeros(n)
    nodes, hats, d = np.empty(4, np.int64), np.empty(4), np.empty(3)
    for y in range(h):
        for x in range(w):
            a = alpha[y, x]
            if weight[y, x] == 0 or not _any(J, y, x):
                continue
            if a > 0:
                corners(y, x, pitch, number, nodes, hats)
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


@njit()
def factor(columns):  # type: ignore[no-untyped-def]
    """Replace the band's transpose (n, width) by that of the Cholesky factor.

    Elements read in turn are contiguous: several times as fast as in the band itself.
    """
    n, width = columns.shape
    for j in range(n):
        pivot = np.sqrt(max(columns[j, 0], 1e-300))
        columns[j, 0] = pivot
        last = min(width, n - j)
        for k in range(1, last):
            columns[j, k] /= pivot
        for k in range(1, last):
            by = columns[j, k]
            for i in range(k, last):
                columns[j + k, i - k] -= columns[j, i] * by


@njit()
def solve(columns, x):  # type: ignore[no-untyped-def]
    """Replace a right side x (n,) by the solution, given the transpose of the factor's band."""
    n, width = columns.shape
    for j in range(n):
        x[j] /= columns[j, 0]
        by = x[j]
        for k in range(1, min(width, n - j)):
            x[j + k] -= columns[j, k] * by
    for j in range(n - 1, -1, -1):
        total = x[j]
        for k in range(1, min(width, n - j)):
            total -= columns[j, k] * x[j + k]
        x[j] = total / columns[j, 0]


@njit()
def _prior_of(differences, spread, change, prior):  # type: ignore[no-untyped-def]
    """Write a prior's band (width, n); the sum of the logs of its factor's diagonal."""
    prior[:] = differences / change**2
    prior[0] += spread**-2
    columns = prior.T.copy()
    factor(columns)
    return np.log(columns[:, 0]).sum()


@njit()
def fit_axis(band, right, differences, spread, change, free, prior, colors):  # type: ignore[no-untyped-def]
    """Write the prior's band (width, n) and the mode (n,); returns cost, mean and its deviation.

    The mean is 0 unless it is free.
    """
    volume = _prior_of(differences, spread, change, prior)
    return _mode_of(band, right, spread, free, prior, volume, colors)


@njit()
def _mode_of(band, right, spread, free, prior, volume, colors):  # type: ignore[no-untyped-def]
    """As `fit_axis`, given the prior and the sum of the logs of its factor's diagonal."""
    width, n = band.shape
    posterior = (band + prior).T.copy()
    factor(posterior)
    by_light, by_one = right.copy(), np.full(n, spread**-2)
    solve(posterior, by_light)
    mean, std = 0.0, spread
    if free:
        solve(posterior, by_one)
        by_zero, by_mean = 0.0, 0.0
        for j in range(n):
            by_zero += by_light[j] * spread**-2
            by_mean += by_one[j] * spread**-2
        known = max(n * spread**-2 - by_mean, 1e-9)
        mean, std = by_zero / known, known**-0.5
    cost = np.log(posterior[:, 0]).sum() - volume
    for j in range(n):
        colors[j] = by_light[j] + mean * by_one[j]
    for j in range(n):
        a = colors[j] - mean
        cost += prior[0, j] * a * a / 2
        for k in range(1, min(width, n - j)):
            cost += prior[k, j] * a * (colors[j + k] - mean)
    return cost, mean, std


@njit()
def scales(band, prior, colors, mean, neighbors):  # type: ignore[no-untyped-def]
    """Spread and change of the nodes (n,), weighted by the precision of their data."""
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


@njit()
def fit(observed, alpha, weight, pitch, number, differences, neighbors, settings):  # type: ignore[no-untyped-def]
    """Colors (n, 3) and the prior's bands (3, width, n) of a field; mean, its deviation, spread and
    change (3,) of each; the cost, and the residuals (3, h, w).

    `settings` are: rounds, rank, varied, the deviation of colors across the model, the degrees of
    freedom of the residuals' t distribution, the first spreads (3) and the smallest one, of the mean
    color's length, and the smallest length.
    """
    rounds, rank, varied = int(settings[0]), int(settings[1]), int(settings[2])
    across, freedom, min_spread, min_length = settings[3], settings[4], settings[8], settings[9]
    width, n = differences.shape
    at, nodes, hats, P, sharp = seen(observed, alpha, pitch, number)
    own_weight = _weights_at(at, weight)
    band, right = np.zeros((3, width, n)), np.zeros((3, n))
    _add(nodes, hats, P, sharp, own_weight, band, right)
    length = 0.0
    for c in range(3):
        total = band[c, 0].sum() + 2 * band[c, 1:].sum()
        length += (right[c].sum() / max(total, 1e-9)) ** 2
    length = max(np.sqrt(length), min_length)
    spread, change = np.empty(3), np.empty(3)
    for c in range(3):
        spread[c] = length * (settings[5 + c] if c < varied else max(across, min_spread))
        change[c] = spread[c]
    used, changed = spread.copy(), change.copy()
    prior, colors = np.empty((3, width, n)), np.empty((n, 3))
    mean, std = np.zeros(3), np.zeros(3)
    own, cost, weights, volumes = np.empty(n), 0.0, np.empty(len(at)), np.empty(3)
    for turn in range(rounds):
        cost = 0.0
        used[:], changed[:] = spread, change
        for c in range(3):
            if turn == 0 or c < varied:
                volumes[c] = _prior_of(differences, spread[c], change[c], prior[c])
            one, mean[c], std[c] = _mode_of(
                band[c], right[c], spread[c], c < rank, prior[c], volumes[c], own
            )
            cost += one
            colors[:, c] = own
            if c < varied:
                away, step = scales(band[c], prior[c], own, mean[c], neighbors)
                spread[c], change[c] = (
                    max(away, min_spread * length),
                    max(step, min_spread * length),
                )
        if turn + 1 < rounds:
            for k in range(len(at)):
                chi2 = 0.0
                for c in range(3):
                    left = P[k, c]
                    for i in range(4):
                        left -= hats[k, i] * colors[nodes[k, i], c] * sharp[k, c]
                    chi2 += left * left
                weights[k] = own_weight[k] * (freedom + 3) / (freedom + chi2)
            band[:], right[:] = 0, 0
            _add(nodes, hats, P, sharp, weights, band, right)
    e = np.empty((3, *alpha.shape))
    residuals(observed, alpha, pitch, number, colors, e)
    return colors, prior, mean, std, used, changed, cost, e


@njit()
def marginalize(H, cross, observed, alpha, weight, pitch, number, prior, rank):  # type: ignore[no-untyped-def]
    """Subtract from a curvature H (p, p) the part that colors can explain; cross is (3, n, p).

    Along the first `rank` axes the mean color is free, too.
    """
    width, n = prior.shape[1:]
    x, band, right = np.empty((n, H.shape[0])), np.zeros((3, width, n)), np.zeros((3, n))
    at, nodes, hats, P, sharp = seen(observed, alpha, pitch, number)
    _add(nodes, hats, P, sharp, _weights_at(at, weight), band, right)
    for c in range(3):
        posterior = (band[c] + prior[c]).T.copy()
        factor(posterior)
        for p in range(H.shape[0]):
            solved = cross[c, :, p].copy()
            solve(posterior, solved)
            x[:, p] = solved
        for j in range(n):
            for p in range(H.shape[0]):
                for q in range(H.shape[1]):
                    H[p, q] -= cross[c, j, p] * x[j, q]
        if c >= rank:
            continue
        ones = prior[c, 0].copy()  # the prior times 1, a row's sum
        for k in range(1, width):
            for j in range(n - k):
                ones[j] += prior[c, k, j]
                ones[j + k] += prior[c, k, j]
        mean = ones.copy()
        solve(posterior, mean)
        known = 0.0
        for j in range(n):
            known += ones[j] * (1 - mean[j])
        by_mean = np.zeros(H.shape[0])
        for p in range(H.shape[0]):
            for j in range(n):
                by_mean[p] += cross[c, j, p] * mean[j]
        if known > 1e-9:
            for p in range(H.shape[0]):
                for q in range(H.shape[1]):
                    H[p, q] -= by_mean[p] * by_mean[q] / known

"""The field of colors, compiled: its nodes, their normal equations and fit.

In this file `number` (rows, columns) has the number of each node of a grid of `pitch` pixels, −1 for
places without a node; the nodes lie in the corners of its cells, the first in pixel (0, 0). A symmetric
banded matrix is its lower band: band[k, j] is the element (j + k, j). `observed` are C, B, V_C and V_B,
(h, w, 3) each. See `color_field` for the rest.
"""

import numpy as np

from blurmatte.compiling import FAST_MATH, njit
from blurmatte.sweep.model.student_t import DEGREES_OF_FREEDOM

# Settings of the fit of a field.
_ROUNDS = 4  # of the colors, then their spread and the pixels' weights
# Along each axis, of the mean color's length
_FIRST_SPREAD = (0.5, 0.2, 0.2)
_MIN_SPREAD = 0.004  # of the mean color's length
_MIN_LENGTH = 1e-3  # of the mean color, linear light


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
    """Number the nodes that are 0 along the shorter side, and return the pairs within cells.

    The pairs (3, m) have the lower number first, and then the way from one to the other: 0 is along a
    row, 1 along a column, 2 down and to the right, 3 down and to the left. Then the largest difference
    of the numbers of two nodes of one cell, and the number of nodes.
    """
    rows, columns = number.shape
    n, m, apart = 0, 0, 0
    for k in range(rows * columns):
        j, i = (k // columns, k % columns) if rows > columns else (k % rows, k // rows)
        if number[j, i] == 0:
            number[j, i] = n
            n += 1
    pairs = np.empty((3, 4 * n), np.int64)
    for way, (down, right) in enumerate(((0, 1), (1, 0), (1, 1), (1, -1))):
        for j in range(rows - down):
            for i in range(max(-right, 0), columns - max(right, 0)):
                a, b = number[j, i], number[j + down, i + right]
                if a < 0 or b < 0:
                    continue
                apart = max(apart, abs(b - a))
                pairs[0, m], pairs[1, m], pairs[2, m] = min(a, b), max(a, b), way
                m += 1
    return pairs[:, :m].copy(), apart, n


@njit()
def squared_differences(neighbors, stiffness, width, n):  # type: ignore[no-untyped-def]
    """Lower band (width, n) of the matrix of the sum of squared differences of neighbors (3, m).

    stiffness (4,): weights of the differences each way.
    """
    band = np.zeros((width, n))
    for p in range(neighbors.shape[1]):
        i, j = neighbors[0, p], neighbors[1, p]
        weight = stiffness[neighbors[2, p]]
        band[0, i] += weight
        band[0, j] += weight
        band[j - i, i] -= weight
    return band


@njit()
def _first_of_cells(size, pitch):  # type: ignore[no-untyped-def]
    """First row or column of each cell, and the size."""
    first = np.empty(int((size - 1) / pitch) + 2, np.int64)
    cell = -1
    for x in range(size):
        if int(x / pitch) > cell:
            cell += 1
            first[cell] = x
    first[cell + 1] = size
    return first


@njit()
def seen(observed, alpha, pitch, number):  # type: ignore[no-untyped-def]
    """The n covered pixels, cell by cell: first pixel (m + 1,) and nodes (m, 4) of each cell.

    Then the pixels' place (n,) in the flat picture, alpha times their hats (4, n), their residual light
    C − (1 − α) B over the noise, and 1 over the noise, (3, n) each.
    """
    C, B, V_C, V_B = observed
    h, w = alpha.shape
    rows, columns = _first_of_cells(h, pitch), _first_of_cells(w, pitch)
    count, cells = 0, (len(rows) - 1) * (len(columns) - 1)
    for y in range(h):
        for x in range(w):
            count += alpha[y, x] > 0
    first, nodes = np.empty(cells + 1, np.int64), np.empty((cells, 4), np.int64)
    at, hats = np.empty(count, np.int64), np.empty((4, count))
    P, sharp = np.empty((3, count)), np.empty((3, count))
    k, m = 0, 0
    for j in range(len(rows) - 1):
        for i in range(len(columns) - 1):
            first[m] = k
            for y in range(rows[j], rows[j + 1]):
                v = y / pitch - j
                for x in range(columns[i], columns[i + 1]):
                    a = alpha[y, x]
                    if not a > 0:
                        continue
                    u = x / pitch - i
                    at[k] = y * w + x
                    hats[0, k], hats[1, k] = a * (1 - v) * (1 - u), a * (1 - v) * u
                    hats[2, k], hats[3, k] = a * v * (1 - u), a * v * u
                    for c in range(3):
                        V = V_C[y, x, c] + (1 - a) * (1 - a) * V_B[y, x, c]
                        sharp[c, k] = 1 / np.sqrt(V)
                        P[c, k] = (C[y, x, c] - (1 - a) * B[y, x, c]) * sharp[c, k]
                    k += 1
            if k > first[m]:
                nodes[m, 0], nodes[m, 1] = number[j, i], number[j, i + 1]
                nodes[m, 2], nodes[m, 3] = number[j + 1, i], number[j + 1, i + 1]
                m += 1
    first[m] = k
    return first[: m + 1], nodes[:m], at, hats, P, sharp


@njit(fastmath=FAST_MATH)
def _add(first, nodes, hats, P, sharp, weight, band, right):  # type: ignore[no-untyped-def]
    """Add the normal equations of pixels, as `seen` has them, of weight (n,)."""
    pull, known = np.empty(4), np.empty((4, 4))
    for m in range(len(nodes)):
        for c in range(3):
            r0, r1, r2, r3 = 0.0, 0.0, 0.0, 0.0
            k00 = k01 = k02 = k03 = k11 = k13 = k22 = k23 = k33 = 0.0
            for k in range(first[m], first[m + 1]):
                h0, h1, h2, h3 = hats[0, k], hats[1, k], hats[2, k], hats[3, k]
                by = weight[k] * sharp[c, k]
                p, by = by * P[c, k], by * sharp[c, k]
                r0, r1, r2, r3 = r0 + p * h0, r1 + p * h1, r2 + p * h2, r3 + p * h3
                b0, b1, b2, b3 = by * h0, by * h1, by * h2, by * h3
                k00, k01, k02, k03 = k00 + b0 * h0, k01 + b0 * h1, k02 + b0 * h2, k03 + b0 * h3
                k11, k13, k22 = k11 + b1 * h1, k13 + b1 * h3, k22 + b2 * h2
                k23, k33 = k23 + b2 * h3, k33 + b3 * h3
            pull[0], pull[1], pull[2], pull[3] = r0, r1, r2, r3
            known[0, 0], known[1, 0], known[1, 1] = k00, k01, k11
            known[2, 0], known[2, 1], known[2, 2] = k02, k03, k22
            known[3, 0], known[3, 1], known[3, 2], known[3, 3] = k03, k13, k23, k33
            for i in range(4):
                right[c, nodes[m, i]] += pull[i]
                for j in range(i + 1):
                    node, other = nodes[m, i], nodes[m, j]
                    band[c, abs(node - other), min(node, other)] += known[i, j]


@njit(fastmath=FAST_MATH)
def _by_alpha(J, observed, alpha, pixels, weight, colors, e):  # type: ignore[no-untyped-def]
    """Half the curvature (p, p) and gradient (p,) of a sum of squares of `pixels`, as `seen` has them.

    J (h w, p) are derivatives of alpha, weight (n,) is of the pixels, e (3, h, w) are residuals. Then
    the mixed curvature with the nodes' colors (3, m, p). Of H the lower triangle is written.

    The noise depends on alpha as well, which is equivalent to replacing the plate by its best
    estimate.
    """
    first, nodes, at, hats, _, sharp = pixels
    B, V_B = observed[1].reshape(-1, 3), observed[3].reshape(-1, 3)
    left, covered = e.reshape(3, -1), alpha.ravel()
    count = J.shape[1]
    H, g = np.zeros((count, count)), np.zeros(count)
    cross, own = np.zeros((3, len(colors), count)), np.empty((3, 4, count))
    known, d = np.empty((3, 4)), np.empty(3)
    for m in range(len(nodes)):
        own[:] = 0
        for i in range(4):
            for c in range(3):
                known[c, i] = colors[nodes[m, i], c]
        for k in range(first[m], first[m + 1]):
            place = at[k]
            through, by = 1 - covered[place], J[place]
            dd, de = 0.0, 0.0
            for c in range(3):
                light = 0.0
                for i in range(4):
                    light += hats[i, k] * known[c, i]
                unit = left[c, place]
                behind = B[place, c] + through * V_B[place, c] * unit * sharp[c, k]
                d[c] = (behind - light / covered[place]) * sharp[c, k]
                dd += d[c] * d[c]
                de += d[c] * unit
            for p in range(count):
                one = weight[k] * by[p]
                if one == 0:
                    continue
                g[p] += one * de
                for q in range(p + 1):
                    H[p, q] += one * dd * by[q]
            for c in range(3):
                slope = -weight[k] * d[c] * sharp[c, k]
                for i in range(4):
                    for p in range(count):
                        own[c, i, p] += slope * hats[i, k] * by[p]
        for c in range(3):
            for i in range(4):
                cross[c, nodes[m, i]] += own[c, i]
    return H, g, cross


@njit(fastmath=FAST_MATH)
def factor(columns):  # type: ignore[no-untyped-def]
    """Replace the band's transpose (n, width) by that of the Cholesky factor.

    Elements read in turn are contiguous: several times as fast as in the band itself.
    """
    n, width = columns.shape
    row = np.empty(width)
    for j in range(n):
        pivot = np.sqrt(max(columns[j, 0], 1e-300))
        columns[j, 0] = pivot
        last = min(width, n - j)
        for k in range(1, last):
            row[k] = columns[j, k] / pivot
            columns[j, k] = row[k]
        for k in range(1, last):
            for i in range(last - k):
                columns[j + k, i] -= row[k + i] * row[k]


@njit(fastmath=FAST_MATH)
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
def _write_prior(differences, spread, change, prior):  # type: ignore[no-untyped-def]
    """Write a prior's band (width, n)."""
    prior[:] = differences / change**2
    prior[0] += spread**-2


@njit()
def _volume_of(prior):  # type: ignore[no-untyped-def]
    """The sum of the logs of the diagonal of a prior's factor."""
    columns = prior.T.copy()
    factor(columns)
    return np.log(columns[:, 0]).sum()


@njit()
def fit_axis(band, right, differences, spread, change, free, prior, colors):  # type: ignore[no-untyped-def]
    """Write the prior's band (width, n) and the mode (n,); returns cost, mean and its deviation.

    The mean is 0 unless it is free.
    """
    _write_prior(differences, spread, change, prior)
    return _mode_of(band, right, spread, free, prior, _volume_of(prior), colors)


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
def scales(band, prior, colors, mean, neighbors, stiffness):  # type: ignore[no-untyped-def]
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
        i, j, way = neighbors[0, p], neighbors[1, p], neighbors[2, p]
        w = min(known[i], known[j])
        steps += stiffness[way] * w * (colors[i] - colors[j]) ** 2
        if way < 2:
            both += w
    return np.sqrt(away / sure), np.sqrt(steps / both)


@njit(fastmath=FAST_MATH)
def _unexplained(first, nodes, hats, P, sharp, colors, e):  # type: ignore[no-untyped-def]
    """Write residuals e (3, n) of pixels as `seen` has them, given colors (n, 3)."""
    for m in range(len(nodes)):
        for c in range(3):
            k0, k1 = colors[nodes[m, 0], c], colors[nodes[m, 1], c]
            k2, k3 = colors[nodes[m, 2], c], colors[nodes[m, 3], c]
            for k in range(first[m], first[m + 1]):
                own = hats[0, k] * k0 + hats[1, k] * k1 + hats[2, k] * k2 + hats[3, k] * k3
                e[c, k] = P[c, k] - own * sharp[c, k]


@njit()
def _replace(at, own, weight, channels, e):  # type: ignore[no-untyped-def]
    """Replace residuals e (3, h, w) of pixels by their own (3, n); the change of the loss of all."""
    flat, known, freedom = e.reshape(3, -1), weight.ravel(), DEGREES_OF_FREEDOM
    gained = 0.0
    for k in range(len(at)):
        before, after = 0.0, 0.0
        for c in range(3):
            before += flat[c, at[k]] ** 2
            after += own[c, k] ** 2
            flat[c, at[k]] = own[c, k]
        gained += known[at[k]] * np.log((freedom + after) / (freedom + before))
    return (freedom + channels) / 2 * gained


@njit()
def _length_of_mean(band, right):  # type: ignore[no-untyped-def]
    """Length of the one color of all nodes that fits best, given the normal equations."""
    squared = 0.0
    for c in range(3):
        total = band[c, 0].sum() + 2 * band[c, 1:].sum()
        squared += (right[c].sum() / max(total, 1e-9)) ** 2
    return np.sqrt(squared)


@njit()
def fit(observed, alpha, weight, pitch, grid, known, e):  # type: ignore[no-untyped-def]
    """Colors (n, 3) and the prior's bands (3, width, n) of a field; mean, its deviation, spread and
    change (3,) of each; the cost, and the change of the loss of the residuals e (3, h, w).

    `grid` are `number`, bands (2, width, n) of squared differences of even and of uneven stiffness,
    the neighbors, and both stiffnesses (2, 4): the uneven one is that of the axes from the second to
    the last varied one. e are those without the object, and are replaced where it was. `known` are
    rank, number of varied axes, angle and number of independent channels of a `ColorPrior`.
    """
    (rank, varied, across, channels), freedom = known, DEGREES_OF_FREEDOM
    number, differences, neighbors, stiffness = grid
    _, width, n = differences.shape
    first, nodes, at, hats, P, sharp = seen(observed, alpha, pitch, number)
    own_weight = weight.ravel()[at]
    band, right = np.zeros((3, width, n)), np.zeros((3, n))
    _add(first, nodes, hats, P, sharp, own_weight, band, right)
    length = max(_length_of_mean(band, right), _MIN_LENGTH)
    spread, change = np.empty(3), np.empty(3)
    for c in range(3):
        spread[c] = length * (_FIRST_SPREAD[c] if c < varied else max(across, _MIN_SPREAD))
        change[c] = spread[c]
    used, changed = spread.copy(), change.copy()
    prior, colors = np.empty((3, width, n)), np.empty((n, 3))
    mean, std = np.zeros(3), np.zeros(3)
    own, weights, cost, volume = np.empty(n), np.empty(len(at)), 0.0, 0.0
    left = np.empty((3, len(at)))
    for turn in range(_ROUNDS):
        cost = 0.0
        used[:], changed[:] = spread, change
        for c in range(3):
            uneven = int(0 < c < varied)
            if turn == 0 or c < varied:
                _write_prior(differences[uneven], spread[c], change[c], prior[c])
            if turn + 1 == _ROUNDS:  # that of axes with the same prior is the same
                volume = volume if c > varied else _volume_of(prior[c])
            one, mean[c], std[c] = _mode_of(
                band[c], right[c], spread[c], c < rank, prior[c], volume, own
            )
            cost += one
            colors[:, c] = own
            if c < varied:
                away, step = scales(band[c], prior[c], own, mean[c], neighbors, stiffness[uneven])
                spread[c] = max(away, _MIN_SPREAD * length)
                change[c] = max(step, _MIN_SPREAD * length)
        _unexplained(first, nodes, hats, P, sharp, colors, left)
        if turn + 1 < _ROUNDS:
            for k in range(len(at)):
                chi2 = left[0, k] ** 2 + left[1, k] ** 2 + left[2, k] ** 2
                weights[k] = own_weight[k] * (freedom + channels) / (freedom + chi2)
            band[:], right[:] = 0, 0
            _add(first, nodes, hats, P, sharp, weights, band, right)
    loss = _replace(at, left, weight, channels, e)
    return colors, prior, mean, std, used, changed, cost, loss


@njit(fastmath=FAST_MATH)
def _add_product(x, by, H):  # type: ignore[no-untyped-def]
    """Add `by` times xᵀx of a matrix x (n, p) to the lower triangle of H (p, p)."""
    for j in range(len(x)):
        for p in range(H.shape[0]):
            one = by * x[j, p]
            for q in range(p + 1):
                H[p, q] += one * x[j, q]


@njit()
def _halfway(columns, x):  # type: ignore[no-untyped-def]
    """Replace right sides x (n, p) by L⁻¹ x, given the transpose of the band of a factor L."""
    n, width = columns.shape
    for j in range(n):
        scale = 1 / columns[j, 0]
        for p in range(x.shape[1]):
            x[j, p] *= scale
        for k in range(1, min(width, n - j)):
            by = columns[j, k]
            for p in range(x.shape[1]):
                x[j + k, p] -= by * x[j, p]


@njit()
def information(J, observed, alpha, weight, pitch, number, colors, e, prior, rank):  # type: ignore[no-untyped-def]
    """Curvature (p, p) and gradient (p,) of the cost by parameters; J (h, w, p) is alpha by them.

    Colors are marginalized, and along the first `rank` axes their mean, too.
    """
    pixels = seen(observed, alpha, pitch, number)
    first, nodes, at, hats, P, sharp = pixels
    known = weight.ravel()[at]
    flat = J.reshape(-1, J.shape[2])
    H, g, cross = _by_alpha(flat, observed, alpha, pixels, known, colors, e)
    width, n = prior.shape[1:]
    band, right = np.zeros((3, width, n)), np.zeros((3, n))
    _add(first, nodes, hats, P, sharp, known, band, right)
    for c in range(3):
        posterior = (band[c] + prior[c]).T.copy()
        factor(posterior)
        if c < rank:
            _add_mean(posterior, prior[c], cross[c], H)
        _halfway(posterior, cross[c])
        _add_product(cross[c], -1.0, H)
    for p in range(len(g)):
        for q in range(p):
            H[q, p] = H[p, q]
    return H, g


@njit()
def _add_mean(posterior, prior, cross, H):  # type: ignore[no-untyped-def]
    """Subtract from the lower triangle of H (p, p) what the mean color can explain.

    posterior (n, width): transpose of the band of its factor; prior (width, n): its band; cross (n, p):
    the mixed curvature of nodes and parameters.
    """
    width, n = prior.shape
    ones = prior[0].copy()  # the prior times 1, a row's sum
    for k in range(1, width):
        for j in range(n - k):
            ones[j] += prior[k, j]
            ones[j + k] += prior[k, j]
    mean = ones.copy()
    solve(posterior, mean)
    known, by_mean = 0.0, np.zeros((1, len(H)))
    for j in range(n):
        known += ones[j] * (1 - mean[j])
        by_mean[0] += mean[j] * cross[j]
    if known > 1e-9:
        _add_product(by_mean, -1 / known, H)

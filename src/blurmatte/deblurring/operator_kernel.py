"""Rows of the blur operator of a moving silhouette, compiled.

In this file a pixel at p is seen at the moment k at the point s = Lₖ⁻¹ (p − cₖ) of the body, where
cₖ is the center and Lₖ (2, 2) the linear map from the body to the picture. The row of the pixel is

    A(p, ·) = Σₖ wₖ · coverage(p, k) · interpolation weights of s,

with the duration wₖ and the coverage of the pixel by the silhouette. The interpolation is bilinear
between nodes of a lattice, of which those far outside the silhouette are missing; the weights of the
others are normalized, so that a row sums to the pixel's alpha.
"""

import math

import numpy as np

from blurmatte.compiling import njit
from blurmatte.deblurring.sphere_kernel import with_row
from blurmatte.sweep.model.rim_kernel import reach_of, variance_of
from blurmatte.sweep.model.silhouette_kernel import (
    between,
    covered_softly,
    largest_stretch,
    spans,
    stretched,
)


@njit()
def coverage(rim, inverse, soft, far, dx, dy):  # type: ignore[no-untyped-def]
    """Fraction of a pixel inside the mapped rim; (dx, dy) from the center, `inverse` of the map.

    The mapped rim is that of `silhouette_kernel.stretched`.
    """
    lattice, x0, y0, h, _ = rim
    a, b, c, d = inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1]
    u, v = (a * dx + b * dy - x0) / h, (c * dx + d * dy - y0) / h
    if not (0 <= u < lattice.shape[1] - 1 and 0 <= v < lattice.shape[0] - 1):
        return 0.0
    i, j = int(u), int(v)
    u, v = u - i, v - j
    inside = between(lattice, i, j, u, v, 0)
    if inside < -far:
        return 0.0
    if inside > far:
        return 1.0
    nx, ny = between(lattice, i, j, u, v, 1), between(lattice, i, j, u, v, 2)
    bent = between(lattice, i, j, u, v, 3)
    variance, area = variance_of(soft), 1 / (a * d - b * c)
    mapped = a * nx + c * ny, b * nx + d * ny
    inside, bent, _, _, mx, my = stretched(inside, bent, (nx, ny), mapped, area, variance)
    return covered_softly(inside, mx, my, soft, 1 / np.sqrt(variance), bent)[0]


@njit()
def covered_moments(xy, maps, rim, soft, shape):  # type: ignore[no-untyped-def]
    """Pixels, the moments at which they are covered, and by how much, moment by moment."""
    height, width = shape
    left, right = np.empty(height), np.empty(height)
    count, capacity = 0, 1024
    pixel, moment = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    part = np.empty(capacity)
    for k in range(len(xy)):
        L, (cx, cy) = maps[k], xy[k]
        det = L[0, 0] * L[1, 1] - L[0, 1] * L[1, 0]
        inverse = np.array([[L[1, 1], -L[0, 1]], [-L[1, 0], L[0, 0]]]) / det
        far = reach_of(soft) * largest_stretch(inverse)
        top, bottom = spans(rim[4], L, cx, cy, left, right)
        for j in range(top, bottom + 1):
            begin, end = math.ceil(max(left[j], 0.0)), math.floor(min(right[j], width - 1))
            if count + end - begin + 1 > capacity:
                more = capacity + width
                pixel = np.concatenate((pixel, np.empty(more, np.int32)))
                moment = np.concatenate((moment, np.empty(more, np.int32)))
                part = np.concatenate((part, np.empty(more)))
                capacity += more
            for i in range(begin, end + 1):
                covered = coverage(rim, inverse, soft, far, i - cx, j - cy)
                if covered > 0:
                    pixel[count], moment[count], part[count] = j * width + i, k, covered
                    count += 1
    return pixel[:count], moment[:count], part[:count]


@njit()
def covered_again(xy, maps, rim, soft, shape, first, moment, part):  # type: ignore[no-untyped-def]
    """The same moments as for a near motion, with coverage where it was partial."""
    inverse, again = np.empty_like(maps), part.copy()
    for k in range(len(maps)):
        inverse[k] = np.linalg.inv(maps[k])
    for p in range(len(first) - 1):
        j, i = divmod(p, shape[1])
        for q in range(first[p], first[p + 1]):
            if part[q] < 1:
                k = moment[q]
                far = reach_of(soft) * largest_stretch(inverse[k])
                again[q] = coverage(rim, inverse[k], soft, far, i - xy[k, 0], j - xy[k, 1])
    return first, moment, again


@njit()
def interpolation(node, x, y, indices, weights):  # type: ignore[no-untyped-def]
    """Indices and normalized weights (4,) of the nodes around lattice coordinates; count of them.

    `node` (rows, columns) is the index of each node, −1 where it is missing.
    """
    rows, columns = node.shape
    i, j = math.floor(x), math.floor(y)
    u, v, count, total = x - i, y - j, 0, 0.0
    for dj in range(2):
        for di in range(2):
            if not (0 <= i + di < columns and 0 <= j + dj < rows) or node[j + dj, i + di] < 0:
                continue
            weight = (u if di else 1 - u) * (v if dj else 1 - v)
            if weight > 0:
                indices[count], weights[count] = node[j + dj, i + di], weight
                total += weight
                count += 1
    for q in range(count):
        weights[q] /= total
    return count


@njit()
def rows_of(durations, xy, to_lattice, corner, node, width, covered):  # type: ignore[no-untyped-def]
    """The operator as compressed sparse rows: first (pixels + 1,), columns, values; columns ascend.

    to_lattice (T, 2, 2) maps an offset from the center to lattice coordinates from `corner` (2,).
    """
    first, moment, part = covered
    count = len(first) - 1
    size = node.max() + 1
    total = np.zeros(size)
    indices, weights = np.empty(4, np.int32), np.empty(4)
    begin = np.zeros(count + 1, np.int64)
    columns, values = np.empty(16 * count, np.int32), np.empty(16 * count)
    for p in range(count):
        i, j, low, high = p % width, p // width, size, 0
        for q in range(first[p], first[p + 1]):
            k = moment[q]
            dx, dy, M = i - xy[k, 0], j - xy[k, 1], to_lattice[k]
            x = M[0, 0] * dx + M[0, 1] * dy - corner[0]
            y = M[1, 0] * dx + M[1, 1] * dy - corner[1]
            for r in range(interpolation(node, x, y, indices, weights)):
                total[indices[r]] += durations[k] * part[q] * weights[r]
                low, high = min(low, indices[r]), max(high, indices[r] + 1)
        touched = low + np.flatnonzero(total[low:high])
        begin[p + 1] = begin[p] + len(touched)
        columns, values = with_row(columns, values, begin[p], total, touched)
        total[low:high] = 0
    return begin, columns[: begin[-1]].copy(), values[: begin[-1]].copy()

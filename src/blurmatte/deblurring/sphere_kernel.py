"""Rows of the blur operator of a ball that spins, compiled.

In this file a pixel sees, at the moment k, the point of the ball with the outward unit normal n in the
camera's frame: x right, y down, z towards the camera. It is the point Rₖᵀ n of the body. The row of the
pixel is

    A(p, ·) = Σₖ wₖ · coverage(p, k) · shading(n) · interpolation weights of Rₖᵀ n.
"""

import math

import numpy as np

from blurmatte.compiling import njit

_STEEPEST = 0.9999  # distance from the center of a visible point, of the radius


@njit()
def normals_of(covered, xy, to_disc, width):  # type: ignore[no-untyped-def]
    """Unit normals (m, 3) at the covered moments of pixels; to_disc (T, 2, 2): pixels → unit disc.

    Of a pixel on the rim it is the normal in the middle of the covered part.
    """
    first, moment, _ = covered
    normal = np.empty((len(moment), 4, 3))
    for p in range(len(first) - 1):
        i, j = p % width, p // width
        for q in range(first[p], first[p + 1]):
            k = moment[q]
            dx, dy, M = i - xy[k, 0], j - xy[k, 1], to_disc[k]
            half = 0.25 * np.sqrt(abs(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]))
            for r in range(4):
                ex, ey = dx + 0.5 * (r % 2) - 0.25, dy + 0.5 * (r // 2) - 0.25
                x, y = M[0, 0] * ex + M[0, 1] * ey, M[1, 0] * ex + M[1, 1] * ey
                rho = np.sqrt(x * x + y * y)
                inside = min(rho, (rho - half + 1) / 2, _STEEPEST)
                scale = inside / rho if rho > 0 else 0.0
                normal[q, r, 0], normal[q, r, 1] = x * scale, y * scale
                normal[q, r, 2] = np.sqrt(1 - inside * inside)
    return normal


@njit()
def cell_of(cells, x, y, z):  # type: ignore[no-untyped-def]
    """Face, row, column and fractions (u, v) inside it of the cell around a point of the sphere."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, a, b = (1 if x > 0 else 0), y / ax, z / ax
    elif ay >= az:
        face, a, b = (3 if y > 0 else 2), z / ay, x / ay
    else:
        face, a, b = (5 if z > 0 else 4), x / az, y / az
    u = cells * (0.5 + 2 / np.pi * math.atan(a))
    v = cells * (0.5 + 2 / np.pi * math.atan(b))
    i, j = min(max(int(u), 0), cells - 1), min(max(int(v), 0), cells - 1)
    return face, i, j, u - i, v - j


@njit()
def seen(rotations, k, normal, q, point):  # type: ignore[no-untyped-def]
    """The point (x, y, z) of the body that is seen with a normal at a moment."""
    nx, ny, nz = normal[q, point, 0], normal[q, point, 1], normal[q, point, 2]
    x = rotations[k, 0, 0] * nx + rotations[k, 1, 0] * ny + rotations[k, 2, 0] * nz
    y = rotations[k, 0, 1] * nx + rotations[k, 1, 1] * ny + rotations[k, 2, 1] * nz
    z = rotations[k, 0, 2] * nx + rotations[k, 1, 2] * ny + rotations[k, 2, 2] * nz
    return x, y, z


@njit()
def turned(entries, rotations, jacobians, node, color):  # type: ignore[no-untyped-def]
    """Derivatives (pixels, 3, 3) by the rotation vector of the light of a color (n, 3), see `rows_of`.

    A change δ of the rotation vector turns the body at the moment k by the small rotation vector
    jacobiansₖ δ. Rows are channels, columns components of the rotation vector.
    """
    first, moment, weight, normal = entries
    cells, count = node.shape[1] - 1, normal.shape[1]
    light, slope, g = np.zeros((len(first) - 1, 3, 3)), np.empty((3, 3)), np.empty(3)
    for p in range(len(first) - 1):
        for q in range(first[p], first[p + 1]):
            m, share = moment[q], weight[q] / count
            for point in range(count):
                x, y, z = seen(rotations, m, normal, q, point)
                face, i, j, u, v = cell_of(cells, x, y, z)
                gradient(cells, face, x, y, z, slope)
                n = normal[q, point]
                for c in range(3):
                    o00, o01 = color[node[face, i, j], c], color[node[face, i, j + 1], c]
                    o10, o11 = color[node[face, i + 1, j], c], color[node[face, i + 1, j + 1], c]
                    by_u = (1 - v) * (o10 - o00) + v * (o11 - o01)
                    by_v = (1 - u) * (o01 - o00) + u * (o11 - o10)
                    for axis in range(3):
                        g[axis] = 0.0
                        for body in range(3):
                            along = by_u * slope[body, 0] + by_v * slope[body, 1]
                            g[axis] += rotations[m, axis, body] * along
                    tx = share * (g[1] * n[2] - g[2] * n[1])
                    ty = share * (g[2] * n[0] - g[0] * n[2])
                    tz = share * (g[0] * n[1] - g[1] * n[0])
                    for k in range(3):
                        light[p, c, k] += (
                            jacobians[m, 0, k] * tx
                            + jacobians[m, 1, k] * ty
                            + jacobians[m, 2, k] * tz
                        )
    return light


@njit()
def gradient(cells, face, x, y, z, slope):  # type: ignore[no-untyped-def]
    """Set slope (3, 2) to the derivatives of the fractions (u, v) of `cell_of` by the point."""
    axis = face // 2
    first, second = (axis + 1) % 3, (axis + 2) % 3
    p = (x, y, z)
    depth, sign = abs(p[axis]), (1.0 if face % 2 else -1.0)
    a, b = p[first] / depth, p[second] / depth
    per_angle = cells * 2 / np.pi / depth
    by_a, by_b = per_angle / (1 + a * a), per_angle / (1 + b * b)
    slope[first, 0], slope[second, 0], slope[axis, 0] = by_a, 0.0, -sign * a * by_a
    slope[first, 1], slope[second, 1], slope[axis, 1] = 0.0, by_b, -sign * b * by_b


@njit()
def accumulate(entries, rotations, node, p, total, stamp, touched):  # type: ignore[no-untyped-def]
    """Sum the row of the pixel p into total, and return the number of its columns, in touched.

    entries are first, moment, weight and normal, see `rows_of`; stamp is that of `add_to_row`.
    """
    first, moment, weight, normal = entries
    points, cells, found = normal.shape[1], node.shape[1] - 1, 0
    for q in range(first[p], first[p + 1]):
        share = weight[q] / points
        for point in range(points):
            x, y, z = seen(rotations, moment[q], normal, q, point)
            face, i, j, u, v = cell_of(cells, x, y, z)
            for r in range(4):
                column = node[face, i + r // 2, j + r % 2]
                part = (u if r // 2 else 1 - u) * (v if r % 2 else 1 - v)
                found = add_to_row(p, column, share * part, total, stamp, touched, found)
    return found


@njit()
def add_to_row(row, column, value, total, stamp, touched, found):  # type: ignore[no-untyped-def]
    """Add an entry to a row of a sparse matrix; the number of columns that the row touches.

    total (columns,) are the sums of the row, stamp (columns,) the last row that touched a column, and
    touched[:found] the columns of this one.
    """
    if stamp[column] != row:
        stamp[column], total[column], touched[found] = row, 0.0, column
        found += 1
    total[column] += value
    return found


@njit()
def with_row(columns, values, at, total, touched):  # type: ignore[no-untyped-def]
    """Columns and values with a row of ascending columns from `at` on, in longer arrays if need be."""
    end = at + len(touched)
    if end > len(columns):
        columns = np.concatenate((columns, np.empty(2 * end - len(columns), np.int32)))
        values = np.concatenate((values, np.empty(2 * end - len(values))))
    for r in range(len(touched)):
        columns[at + r], values[at + r] = touched[r], total[touched[r]]
    return columns, values


@njit()
def rows_of(entries, rotations, node, size):  # type: ignore[no-untyped-def]
    """The operator as compressed sparse rows: first (pixels + 1,), columns, values; columns ascend.

    rotations (T, 3, 3) map the body to the camera's frame; weight (m,) has all factors but the
    interpolation.
    """
    count = len(entries[0]) - 1
    total, stamp, touched = np.zeros(size), np.full(size, -1), np.empty(size, np.int32)
    begin = np.zeros(count + 1, np.int64)
    columns, values = np.empty(32 * count, np.int32), np.empty(32 * count)
    for p in range(count):
        found = accumulate(entries, rotations, node, p, total, stamp, touched)
        begin[p + 1] = begin[p] + found
        columns, values = with_row(columns, values, begin[p], total, np.sort(touched[:found]))
    return begin, columns[: begin[-1]].copy(), values[: begin[-1]].copy()


@njit()
def add_equations(entries, rotations, node, weights, light, N, right):  # type: ignore[no-untyped-def]
    """Add the upper triangle of Aᵀ W A to N (n, n), and Aᵀ light to right (n, k), see `rows_of`.

    weights (pixels,) are the diagonal of W; light (pixels, k).
    """
    size = len(N)
    total, stamp, touched = np.zeros(size), np.full(size, -1), np.empty(size, np.int32)
    for p in range(len(entries[0]) - 1):
        found = accumulate(entries, rotations, node, p, total, stamp, touched)
        for q in range(found):
            row = touched[q]
            scaled = weights[p] * total[row]
            for r in range(found):
                if touched[r] >= row:
                    N[row, touched[r]] += scaled * total[touched[r]]
            for k in range(light.shape[1]):
                right[row, k] += total[row] * light[p, k]

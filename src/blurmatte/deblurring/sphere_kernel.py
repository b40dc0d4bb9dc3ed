"""Rows of the blur operator of a ball that spins, compiled.

In this file a pixel sees, at the moment k, the point of the ball with the outward unit normal n in the
camera's frame: x right, y down, z towards the camera. It is the point Rₖᵀ n of the body. The row of the
pixel is

    A(p, ·) = Σₖ wₖ · coverage(p, k) · shading(n) · interpolation weights of Rₖᵀ n.
"""

import math
from typing import Any

import numpy as np

from blurmatte.compiling import njit
from blurmatte.deblurring.operator_kernel import add_to_row, with_row

_COMPILED: dict[str, Any] = {"error_model": "numpy", "nogil": True}
_STEEPEST = 0.9999  # distance from the center of a visible point, of the radius


@njit(**_COMPILED)
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


@njit(**_COMPILED)
def interpolation(node, x, y, z, indices, weights):  # type: ignore[no-untyped-def]
    """Indices and bilinear weights (4,) of the nodes around a point of the sphere."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, a, b = (1 if x > 0 else 0), y / ax, z / ax
    elif ay >= az:
        face, a, b = (3 if y > 0 else 2), z / ay, x / ay
    else:
        face, a, b = (5 if z > 0 else 4), x / az, y / az
    cells = node.shape[1] - 1
    u = cells * (0.5 + 2 / np.pi * math.atan(a))
    v = cells * (0.5 + 2 / np.pi * math.atan(b))
    i, j = min(max(int(u), 0), cells - 1), min(max(int(v), 0), cells - 1)
    u, v = u - i, v - j
    indices[0], weights[0] = node[face, i, j], (1 - u) * (1 - v)
    indices[1], weights[1] = node[face, i, j + 1], (1 - u) * v
    indices[2], weights[2] = node[face, i + 1, j], u * (1 - v)
    indices[3], weights[3] = node[face, i + 1, j + 1], u * v


@njit(**_COMPILED)
def seen(node, R, normal, indices, weights):  # type: ignore[no-untyped-def]
    """`interpolation` at the point of the body that is seen with a normal."""
    nx, ny, nz = normal[0], normal[1], normal[2]
    x = R[0, 0] * nx + R[1, 0] * ny + R[2, 0] * nz
    y = R[0, 1] * nx + R[1, 1] * ny + R[2, 1] * nz
    z = R[0, 2] * nx + R[1, 2] * ny + R[2, 2] * nz
    interpolation(node, x, y, z, indices, weights)


@njit(**_COMPILED)
def projected(entries, rotations, node, factors, color, spread):  # type: ignore[no-untyped-def]
    """Light (pixels, 3, k) of a color (n, 3) by `rows_of`, for factors (m, k) of the weights.

    And (k,) sums of the entries of these rows times those of `spread` (pixels, n).
    """
    first, moment, weight, normal = entries
    light = np.zeros((len(first) - 1, 3, factors.shape[1]))
    total, found = np.zeros(factors.shape[1]), np.empty(4)
    indices, weights = np.empty(4, np.int32), np.empty(4)
    for p in range(len(first) - 1):
        for q in range(first[p], first[p + 1]):
            found[:] = 0
            for point in range(normal.shape[1]):
                seen(node, rotations[moment[q]], normal[q, point], indices, weights)
                for r in range(4):
                    n, part = indices[r], weights[r] * weight[q] / normal.shape[1]
                    for c in range(3):
                        found[c] += part * color[n, c]
                    found[3] += part * spread[p, n]
            for k in range(factors.shape[1]):
                for c in range(3):
                    light[p, c, k] += factors[q, k] * found[c]
                total[k] += factors[q, k] * found[3]
    return light, total


@njit(**_COMPILED)
def rows_of(first, moment, weight, normal, rotations, node, size):  # type: ignore[no-untyped-def]
    """The operator as compressed sparse rows: first (pixels + 1,), columns, values; columns ascend.

    rotations (T, 3, 3) map the body to the camera's frame; weight (m,) has all factors but the
    interpolation.
    """
    count = len(first) - 1
    total, stamp, touched = np.zeros(size), np.full(size, -1), np.empty(size, np.int32)
    indices, weights = np.empty(4, np.int32), np.empty(4)
    begin = np.zeros(count + 1, np.int64)
    columns, values = np.empty(32 * count, np.int32), np.empty(32 * count)
    for p in range(count):
        found = 0
        for q in range(first[p], first[p + 1]):
            R, share = rotations[moment[q]], weight[q] / normal.shape[1]
            for point in range(normal.shape[1]):
                seen(node, R, normal[q, point], indices, weights)
                for r in range(4):
                    value = share * weights[r]
                    found = add_to_row(p, indices[r], value, total, stamp, touched, found)
        begin[p + 1] = begin[p] + found
        columns, values = with_row(columns, values, begin[p], total, touched[:found])
    return begin, columns[: begin[-1]].copy(), values[: begin[-1]].copy()


@njit(**_COMPILED)
def add_normal(first, columns, values, weights, N):  # type: ignore[no-untyped-def]
    """Add the lower triangle of Aᵀ W A to N (n, n), in the order of N[column, row]."""
    for p in range(len(first) - 1):
        end = first[p + 1]
        for q in range(first[p], end):
            i, scaled = columns[q], weights[p] * values[q]
            for r in range(q, end):
                N[i, columns[r]] += scaled * values[r]

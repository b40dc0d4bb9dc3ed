"""Alpha of a silhouette on its way, and its derivatives, compiled.

In this file the rim of a silhouette is, seen from its center, the curve A q(ψ), where A is a linear
map with det A > 0 and q a star around the unit circle,

    q(ψ) = R(ψ) (cos ψ, sin ψ),    log R(ψ) = Σ aₖ cos kψ + bₖ sin kψ,   k = 3, 4, …

A point x is near the point of the rim that lies in the direction n from it, n the normal of the star
that passes x: A⁻ᵀ (1, −g) in polar coordinates around A⁻¹ x, with g = (log R)′. There the rim's
curvature is κ = det A (1 + g² − (log R)″) / (R |A (g, 1)|³).

Where a rim is and how it is bent is told once for a lattice of points around the shape, and read off it
at every moment: that takes a third of the time, and changes alpha by less than 1e-4.

A pixel takes part in the shape as in the half plane beyond the tangent at that point. On average
over a pixel a rim of curvature κ lies κ/24 inside its tangent; that is taken off the distance, so
that the sum over all pixels is the area. The edge of a half plane that is blurred by σ, `soft`, is
that of a normal distribution of variance σ² + 1/12, the last being the pixel's; κ (σ² + 1/12)/2 is
taken off then.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}

_REACH = 0.7072  # pixels: half the diagonal of one; what is farther from the rim is in or out
_PIXEL = 1 / 12  # variance of a box as wide as a pixel
_TAIL = 3.0  # standard deviations from a soft rim, where all is in or out
_WITHIN = math.erf(_TAIL / math.sqrt(2))
_NODES = 64  # per standard deviation, so that Taylor's polynomials are exact to 1e-7
_SHARPEST = 2.0  # per pixel, the largest curvature that the half plane is corrected for
_LATTICE = 0.125  # pixels between nodes for a radius of 1; with its root, as all errors stay alike
_FAR = 1e3  # pixels: surely in or out
_CELLS = 512  # directions, in each of which it is known what is near the rim


@njit(**_COMPILED)
def covered(s, nx, ny):  # type: ignore[no-untyped-def]
    """Part of a pixel that lies inside a straight edge, and its derivative by the distance s.

    s is how far inside the edge the pixel's center is; (nx, ny) is the unit normal of the edge. The
    edge's profile is a box of width a = max(|nx|, |ny|) blurred by one of width b, the other.
    """
    a, b = abs(nx), abs(ny)
    if a < b:
        a, b = b, a
    d = abs(s)
    if d >= (a + b) / 2:
        return (1.0 if s > 0 else 0.0), 0.0
    if d <= (a - b) / 2:
        return 0.5 + s / a, 1 / a
    rest = (a + b) / 2 - d
    beyond = rest * rest / (2 * a * b)
    return (1 - beyond if s > 0 else beyond), rest / (a * b)


def _tabulated() -> npt.NDArray[np.float64]:
    """Part and density of the normal distribution, within its tails, at the nodes."""
    z = np.arange(-_TAIL * _NODES, _TAIL * _NODES + 1) / _NODES
    part = np.array([0.5 * (1 + math.erf(one / math.sqrt(2)) / _WITHIN) for one in z])
    return np.stack([part, np.exp(-(z**2) / 2) / (np.sqrt(2 * np.pi) * _WITHIN)], axis=1)


_NORMAL = _tabulated()  # the function itself takes four times as long as all the rest of a sweep


@njit(**_COMPILED)
def covered_softly(s, nx, ny, soft, wide, curvature):  # type: ignore[no-untyped-def]
    """Part of a pixel inside an edge that is blurred by `soft`, its derivatives by s and by `soft`.

    s is how far inside the edge the pixel's center is, less κ (σ² + 1/12)/2; soft 0 is a sharp edge.
    wide is 1/√(σ² + 1/12): to divide by that for each pixel took a third of the time.
    """
    if soft == 0:
        part, gain = covered(s, nx, ny)
        return part, gain, 0.0
    z = s * wide
    if abs(z) > _TAIL:
        return (1.0 if z > 0 else 0.0), 0.0, 0.0
    node = int((z + _TAIL) * _NODES + 0.5)
    at = node * (1 / _NODES) - _TAIL
    d, slope, bend = z - at, -at, (at * at - 1) / 2
    part = _NORMAL[node, 0] + d * _NORMAL[node, 1] * (1 + d * (slope / 2 + d * bend * (1 / 3)))
    gain = _NORMAL[node, 1] * (1 + d * (slope + d * bend)) * wide
    return part, gain, -gain * soft * (z * wide + curvature)


@njit(**_COMPILED)
def reach_of(soft):  # type: ignore[no-untyped-def]
    """How far from the rim pixels are partly inside."""
    return _REACH if soft == 0 else _TAIL * np.sqrt(_PIXEL + soft * soft)


@njit(**_COMPILED)
def disc(xy, D, weights, radius, soft, alpha, J):  # type: ignore[no-untyped-def]
    """What `sweep` does for a disc, several times as fast: add to alpha (h, w) and J (h, w, n + 1).

    If J has room for one more, that is for `soft`.
    """
    h, w = alpha.shape
    n = D.shape[2]
    r = radius - (_PIXEL + soft * soft) / (2 * radius)
    wide, curvature = 1 / np.sqrt(_PIXEL + soft * soft), 1 / radius
    outer, inner = r + reach_of(soft), max(r - reach_of(soft), 0.0)
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        first, last = max(int(np.ceil(cy - outer)), 0), min(int(np.floor(cy + outer)), h - 1)
        for j in range(first, last + 1):
            dy = j - cy
            half = np.sqrt(max(outer * outer - dy * dy, 0.0))
            left, right = max(int(np.ceil(cx - half)), 0), min(int(np.floor(cx + half)), w - 1)
            for i in range(left, right + 1):
                dx = i - cx
                square = dx * dx + dy * dy
                if square < inner * inner:
                    alpha[j, i] += weights[k]
                    continue
                d = np.sqrt(square)
                out = 1 / max(d, 1e-9)
                nx, ny = (dx * out, dy * out) if d > 1e-9 else (1.0, 0.0)
                part, gain, by_soft = covered_softly(r - d, nx, ny, soft, wide, curvature)
                alpha[j, i] += weights[k] * part
                g = weights[k] * gain
                if g > 0:
                    for p in range(n):
                        J[j, i, p] += g * (nx * D[k, 0, p] + ny * D[k, 1, p])
                    J[j, i, n] += g
                    if n + 1 < J.shape[2]:
                        J[j, i, n + 1] += weights[k] * by_soft


@njit(**_COMPILED)
def star(c, s, bulges):  # type: ignore[no-untyped-def]
    """R, (log R)′ and (log R)″ at the angle whose cosine and sine are c and s."""
    power, slope, bend = 0.0, 0.0, 0.0
    ck, sk = c * c - s * s, 2 * c * s
    for i in range(len(bulges) // 2):
        ck, sk = ck * c - sk * s, sk * c + ck * s
        a, b, k = bulges[2 * i], bulges[2 * i + 1], i + 3
        along = a * ck + b * sk
        power += along
        slope += k * (b * ck - a * sk)
        bend -= k * k * along
    return np.exp(power), slope, bend


@njit(**_COMPILED)
def around(x, y, A, bulges):  # type: ignore[no-untyped-def]
    """Of the rim in the direction of A⁻¹ (x, y): R, g, (log R)″, cosine, sine, normal."""
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    u, v = (A[1, 1] * x - A[0, 1] * y) / area, (A[0, 0] * y - A[1, 0] * x) / area
    d = np.sqrt(u * u + v * v)
    c, s = (u / d, v / d) if d > 1e-9 else (1.0, 0.0)
    R, g, bend = star(c, s, bulges) if len(bulges) > 0 else (1.0, 0.0, 0.0)
    u, v = c + g * s, s - g * c
    nx, ny = A[1, 1] * u - A[1, 0] * v, A[0, 0] * v - A[0, 1] * u
    norm = np.sqrt(nx * nx + ny * ny)
    return R, g, bend, c, s, nx / norm, ny / norm


@njit(**_COMPILED)
def edge(x, y, A, bulges, soft):  # type: ignore[no-untyped-def]
    """How far inside the rim a point is, normal and curvature there, R, the angle's cosine and sine."""
    R, g, bend, c, s, nx, ny = around(x, y, A, bulges)
    px, py = R * (A[0, 0] * c + A[0, 1] * s), R * (A[1, 0] * c + A[1, 1] * s)
    inside = (px - x) * nx + (py - y) * ny
    R, g, bend, c, s, nx, ny = around(x + inside * nx, y + inside * ny, A, bulges)
    px, py = R * (A[0, 0] * c + A[0, 1] * s), R * (A[1, 0] * c + A[1, 1] * s)
    inside = (px - x) * nx + (py - y) * ny
    u, v = g * c - s, g * s + c
    tx, ty = A[0, 0] * u + A[0, 1] * v, A[1, 0] * u + A[1, 1] * v
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    long = np.sqrt(tx * tx + ty * ty)
    curvature = area * (1 + g * g - bend) / (R * long * long * long)
    curvature = min(max(curvature, -_SHARPEST), _SHARPEST)
    return inside - curvature * (_PIXEL + soft * soft) / 2, nx, ny, curvature, R, c, s


@njit(**_COMPILED)
def direction(x, y):  # type: ignore[no-untyped-def]
    """Which of the cells around the center a point is in; they are of unequal width."""
    u = y / (abs(x) + abs(y) + 1e-300)
    turn = 2 - u if x < 0 else (u if u >= 0 else 4 + u)
    return int(turn * (_CELLS // 4)) % _CELLS


@njit(**_COMPILED)
def near(A, bulges, reach):  # type: ignore[no-untyped-def]
    """(_CELLS,) squared distances from the center below and above which all is in or out."""
    low, high = np.empty(_CELLS + 1), np.empty(_CELLS + 1)
    for i in range(_CELLS + 1):
        turn = 4 * i / _CELLS
        x, y = abs(2 - turn) - 1, 1 - abs((turn + 1) % 4 - 2)
        R, _, _, c, s, nx, ny = around(x, y, A, bulges)
        px, py = R * (A[0, 0] * c + A[0, 1] * s), R * (A[1, 0] * c + A[1, 1] * s)
        rho = np.sqrt(px * px + py * py)
        slanted = rho / (px * nx + py * ny)
        width = reach * slanted + 2 * (slanted - 1)
        low[i], high[i] = max(rho - width, 0.0), rho + width
    least = np.minimum(low[:-1], low[1:]) ** 2
    most = np.maximum(high[:-1], high[1:]) ** 2
    return least, most


@njit(**_COMPILED)
def corners(most):  # type: ignore[no-untyped-def]
    """(_CELLS, 2) of a polygon around all that is not surely out: the ends of the cells."""
    xy = np.empty((_CELLS, 2))
    for i in range(_CELLS):
        turn = 4 * i / _CELLS
        x, y = abs(2 - turn) - 1, 1 - abs((turn + 1) % 4 - 2)
        far = np.sqrt(max(most[i - 1], most[i]) / (x * x + y * y))
        xy[i, 0], xy[i, 1] = far * x, far * y
    return xy


@njit(**_COMPILED)
def spans(polygon, ct, st, cx, cy, left, right):  # type: ignore[no-untyped-def]
    """First and last column of each row (h,) that a polygon reaches, turned and moved; and the rows."""
    h = len(left)
    left[:], right[:] = np.inf, -np.inf
    x, y = polygon[-1, 0], polygon[-1, 1]
    x0, y0 = cx + ct * x - st * y, cy + st * x + ct * y
    top, bottom = y0, y0
    for i in range(len(polygon)):
        x, y = polygon[i, 0], polygon[i, 1]
        x1, y1 = cx + ct * x - st * y, cy + st * x + ct * y
        low, high = min(x0, x1), max(x0, x1)
        for j in range(max(math.floor(min(y0, y1)), 0), min(math.ceil(max(y0, y1)), h - 1) + 1):
            left[j], right[j] = min(left[j], low), max(right[j], high)
        x0, y0, top, bottom = x1, y1, min(top, y1), max(bottom, y1)
    return max(math.ceil(top), 0), min(math.floor(bottom), h - 1)


@njit(**_COMPILED)
def rim(A, bulges, soft):  # type: ignore[no-untyped-def]
    """What `edge` says at nodes h apart (rows, columns, 8); of its first node the x and y, and h.

    Inside, normal, curvature, the rim's point R (cos ψ, sin ψ) and the angle's cosine and sine; beyond
    all that is partly inside only whether it is in or out. Linear between nodes, the distance inside
    lies κ h²/12 below the true one in the mean; that is put back.
    """
    # Powers of two, and nodes that stay where they are when a shape changes a little, so that alpha
    # changes smoothly.
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    h = 2.0 ** math.floor(math.log2(_LATTICE * area**0.25))
    reach = reach_of(soft)
    least, most = near(A, bulges, reach + 2 * h)
    polygon = corners(most)
    x0 = (math.floor(polygon[:, 0].min() / h) - 1) * h
    y0 = (math.floor(polygon[:, 1].min() / h) - 1) * h
    columns = int((polygon[:, 0].max() - x0) / h) + 3
    rows = int((polygon[:, 1].max() - y0) / h) + 3
    lattice = np.zeros((rows, columns, 8))
    for j in range(rows):
        for i in range(columns):
            x, y = x0 + i * h, y0 + j * h
            square, cell = x * x + y * y, direction(x, y)
            if square > most[cell] or square < least[cell]:
                lattice[j, i, 0] = -_FAR if square > most[cell] else _FAR
                continue
            inside, nx, ny, curvature, R, c, s = edge(x, y, A, bulges, soft)
            inside += curvature * h * h / 12
            lattice[j, i] = (inside, nx, ny, curvature, R * c, R * s, c, s)
    return lattice, x0, y0, h, polygon


@njit(**_COMPILED)
def between(lattice, i, j, u, v, k):  # type: ignore[no-untyped-def]
    """The value k a part u of the way from node i to the next, and v from j, linear on the way."""
    above = (1 - u) * lattice[j, i, k] + u * lattice[j, i + 1, k]
    below = (1 - u) * lattice[j + 1, i, k] + u * lattice[j + 1, i + 1, k]
    return (1 - v) * above + v * below


@njit(**_COMPILED)
def sweep(xy, D, weights, spins, turns, by_turning, A, by_A, bulges, soft, alpha, J):  # type: ignore[no-untyped-def]
    """Add to alpha (h, w) and J (h, w, n + j + k), zeros, what a shape covers on its way.

    xy (T, 2) are the centers in pixels of the maps, D (T, 2, n) their derivatives, weights (T,) parts
    of the exposure, turns (T,) angles by which the shape is turned, from +x towards +y; by_A
    (2, 2, j) are the derivatives of A by some parameters, bulges (k,) are a₃, b₃, a₄, b₄, … If it
    `spins`, J has one more, for the parameter by which turns have the derivative by_turning (T,). If
    J has room for yet one more, that is for `soft`.
    """
    height, w = alpha.shape
    n, m = D.shape[2], by_A.shape[2]
    wide = 1 / np.sqrt(_PIXEL + soft * soft)
    lattice, x0, y0, h, polygon = rim(A, bulges, soft)
    reach = reach_of(soft)
    rows, columns, of_edge = lattice.shape
    left, right, at = np.empty(height), np.empty(height), np.empty(of_edge)
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        ct, st = np.cos(turns[k]), np.sin(turns[k])
        top, bottom = spans(polygon, ct, st, cx, cy, left, right)
        for j in range(top, bottom + 1):
            dy = j - cy
            for i in range(math.ceil(max(left[j], 0.0)), math.floor(min(right[j], w - 1)) + 1):
                dx = i - cx
                u = (ct * dx + st * dy - x0) / h
                v = (ct * dy - st * dx - y0) / h
                if not (0 <= u < columns - 1 and 0 <= v < rows - 1):
                    continue
                p, q = int(u), int(v)
                u, v = u - p, v - q
                inside = between(lattice, p, q, u, v, 0)
                if inside < -reach:
                    continue
                if inside > reach:
                    alpha[j, i] += weights[k]
                    continue
                for e in range(1, of_edge):
                    at[e] = between(lattice, p, q, u, v, e)
                _, nx, ny, curvature, px, py, c, s = at
                mx, my = ct * nx - st * ny, ct * ny + st * nx
                part, gain, by_soft = covered_softly(inside, mx, my, soft, wide, curvature)
                alpha[j, i] += weights[k] * part
                g = weights[k] * gain
                if g == 0:
                    continue
                for p in range(n):
                    J[j, i, p] += g * (mx * D[k, 0, p] + my * D[k, 1, p])
                qx, qy = g * px, g * py
                for p in range(m):
                    px = by_A[0, 0, p] * qx + by_A[0, 1, p] * qy
                    py = by_A[1, 0, p] * qx + by_A[1, 1, p] * qy
                    J[j, i, n + p] += nx * px + ny * py
                px, py = A[0, 0] * qx + A[0, 1] * qy, A[1, 0] * qx + A[1, 1] * qy
                along = nx * px + ny * py
                ck, sk = c * c - s * s, 2 * c * s
                for p in range(len(bulges) // 2):
                    ck, sk = ck * c - sk * s, sk * c + ck * s
                    J[j, i, n + m + 2 * p] += along * ck
                    J[j, i, n + m + 2 * p + 1] += along * sk
                last = n + m + len(bulges)
                if spins:
                    J[j, i, last] += (ny * px - nx * py) * by_turning[k]
                    last += 1
                if last < J.shape[2]:
                    J[j, i, last] += weights[k] * by_soft

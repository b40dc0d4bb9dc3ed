"""Alpha of a silhouette on its way, and its derivatives, compiled.

In this file a rim is what `rim_kernel` tells of it: how far inside it a point is, the normal, and the
curvature κ of the nearest point of it. It comes as data: what is compiled here and kept would not
know of a change there.

A pixel takes part in the shape as in the half plane beyond the tangent at that point. On average
over a pixel a rim of curvature κ lies κ/24 inside its tangent; that is taken off the distance, so
that the sum over all pixels is the area. A lens out of focus makes a uniform disc of a point, its
circle of confusion, of the variance σ² = ρ²/4 for the radius ρ; σ is `soft`. With the pixel's
variance, 1/12, the edge of a half plane is taken to be that of a disc of the variance
15/16 (σ² + 1/12) blurred by a normal distribution of the rest, as it is where ρ is √5 pixels. Then
κ (σ² + 1/12)/2 is taken off.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.special import ndtr

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}

_REACH = 0.7072  # pixels: half the diagonal of one; what is farther from the rim is in or out
_PIXEL = 1 / 12  # variance of a box as wide as a pixel
_TAIL = 3.0  # standard deviations from a soft rim, where all is in or out
_NORMAL = 0.25  # of them, what of a soft edge is that of a normal distribution, not of a disc
_NODES = 64  # per standard deviation, so that Taylor's polynomials are exact to 1e-7
_POINTS = 64  # across a disc: what is that smooth they integrate exactly


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
    """Part of an edge of variance 1, its density and the derivatives of that, at the nodes (k, 4).

    A disc's edge has the density of half an ellipse, which Chebyshev's nodes of the second kind
    integrate with anything smooth: it is a mean of normal distributions.
    """
    angles = np.arange(1, _POINTS + 1) * np.pi / (_POINTS + 1)
    weights = 2 / (_POINTS + 1) * np.sin(angles) ** 2
    points = 2 * math.sqrt(1 - _NORMAL**2) * np.cos(angles)
    z = np.arange(-_TAIL * _NODES, _TAIL * _NODES + 1) / _NODES
    u = (z[:, None] - points) / _NORMAL
    density = np.exp(-(u**2) / 2) / (math.sqrt(2 * math.pi) * _NORMAL)
    slope, bend = -u / _NORMAL * density, (u**2 - 1) / _NORMAL**2 * density
    return np.stack([ndtr(u), density, slope, bend], axis=1) @ weights


_EDGE = _tabulated()  # the functions themselves take four times as long as all the rest of a sweep


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
    d, density, slope, bend = z - at, _EDGE[node, 1], _EDGE[node, 2], _EDGE[node, 3]
    part = _EDGE[node, 0] + d * (density + d * (slope / 2 + d * bend / 6))
    gain = (density + d * (slope + d * bend / 2)) * wide
    return part, gain, -gain * soft * (z * wide + curvature)


@njit(**_COMPILED)
def variance_of(soft):  # type: ignore[no-untyped-def]
    """Variance of what the edge of a half plane becomes, pixels²."""
    return _PIXEL + soft * soft


@njit(**_COMPILED)
def reach_of(soft):  # type: ignore[no-untyped-def]
    """How far from the rim pixels are partly inside."""
    return _REACH if soft == 0 else _TAIL * np.sqrt(variance_of(soft))


@njit(**_COMPILED)
def disc(xy, D, weights, radius, soft, alpha, J):  # type: ignore[no-untyped-def]
    """What `sweep` does for a disc, several times as fast: add to alpha (h, w) and J (h, w, n + 1).

    If J has room for one more, that is for `soft`.
    """
    h, w = alpha.shape
    n = D.shape[2]
    r = radius - variance_of(soft) / (2 * radius)
    wide, curvature = 1 / np.sqrt(variance_of(soft)), 1 / radius
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
def between(lattice, i, j, u, v, k):  # type: ignore[no-untyped-def]
    """The value k a part u of the way from node i to the next, and v from j, linear on the way."""
    above = (1 - u) * lattice[j, i, k] + u * lattice[j, i + 1, k]
    below = (1 - u) * lattice[j + 1, i, k] + u * lattice[j + 1, i + 1, k]
    return (1 - v) * above + v * below


@njit(**_COMPILED)
def sweep(xy, D, weights, spins, turns, by_turning, rim, A, by_A, coefficients, soft, alpha, J):  # type: ignore[no-untyped-def]
    """Add to alpha (h, w) and J (h, w, n + j + k), zeros, what a shape covers on its way.

    The rim is told by `rim_kernel.lattice_around`, with the variance and the reach of this softness.
    xy (T, 2) are the centers in pixels of the maps, D (T, 2, n) their derivatives, weights (T,) parts
    of the exposure, turns (T,) angles by which the shape is turned, from +x towards +y; by_A
    (2, 2, j) are the derivatives of A by some parameters, coefficients (k,) are a₃, b₃, a₄, b₄, … If it
    `spins`, J has one more, for the parameter by which turns have the derivative by_turning (T,). If
    J has room for yet one more, that is for `soft`.
    """
    height, w = alpha.shape
    n, m = D.shape[2], by_A.shape[2]
    reach, wide = reach_of(soft), 1 / np.sqrt(variance_of(soft))
    lattice, x0, y0, h, polygon = rim
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
                for p in range(len(coefficients) // 2):
                    ck, sk = ck * c - sk * s, sk * c + ck * s
                    J[j, i, n + m + 2 * p] += along * ck
                    J[j, i, n + m + 2 * p + 1] += along * sk
                last = n + m + len(coefficients)
                if spins:
                    J[j, i, last] += (ny * px - nx * py) * by_turning[k]
                    last += 1
                if last < J.shape[2]:
                    J[j, i, last] += weights[k] * by_soft

"""Alpha of a moving silhouette, and its derivatives, compiled.

In this file a rim is given by `rim_kernel`: the signed distance inside it, the normal, and the
curvature κ of its nearest point.

The coverage of a pixel is that by the half plane beyond the tangent at that point. On average over a
pixel a rim of curvature κ lies κ/24 inside its tangent; this is subtracted from the distance, so that
the sum over all pixels is the area. A lens out of focus images a point as a uniform disc, its circle
of confusion, of the variance σ² = ρ²/4 for the radius ρ; σ is `soft`. With the pixel's variance,
1/12, the edge profile of a half plane is that of a disc of the variance 15/16 (σ² + 1/12) convolved
with a normal distribution of the rest, which is exact where ρ is √5 pixels; κ (σ² + 1/12)/2 is
subtracted.
"""

import math

import numpy as np
from scipy.special import ndtr

from blurmatte.checks import Array
from blurmatte.compiling import FAST_MATH, njit
from blurmatte.sweep.model.rim_kernel import MAX_DISTANCE_STD, reach_of, variance_of

_NODES_PER_STD = 64  # of the tabulated edge: Taylor's polynomials are exact to 1e-7


@njit()
def covered(s, nx, ny):  # type: ignore[no-untyped-def]
    """Fraction of a pixel inside a straight edge, and its derivative by the distance s.

    s is the distance of the pixel's center inside the edge; (nx, ny) is the unit normal of the edge.
    The edge's profile is a box of width a = max(|nx|, |ny|) blurred by one of width b, the other.
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


def _tabulated() -> Array:
    """Profile of an edge of variance 1, its density and two derivatives of that, at nodes (k, 4).

    A disc's edge has the density of half an ellipse. Chebyshev's nodes of the second kind integrate it
    with any smooth function, so that the profile is a mean of normal distributions.
    """
    count, normal_std = 64, 0.25  # quadrature nodes; standard deviation of the normal part
    angles = np.arange(1, count + 1) * np.pi / (count + 1)
    weights = 2 / (count + 1) * np.sin(angles) ** 2
    points = 2 * math.sqrt(1 - normal_std**2) * np.cos(angles)
    last = MAX_DISTANCE_STD * _NODES_PER_STD
    z = np.arange(-last, last + 1) / _NODES_PER_STD
    u = (z[:, None] - points) / normal_std
    density = np.exp(-(u**2) / 2) / (math.sqrt(2 * math.pi) * normal_std)
    slope, bend = -u / normal_std * density, (u**2 - 1) / normal_std**2 * density
    return np.stack([ndtr(u), density, slope, bend], axis=1) @ weights


_EDGE = _tabulated()  # evaluated anew, these functions would dominate the time of a sweep


@njit()
def covered_softly(s, nx, ny, soft, wide, curvature):  # type: ignore[no-untyped-def]
    """Fraction of a pixel inside an edge blurred by `soft`, its derivatives by s and by `soft`.

    s is the distance of the pixel's center inside the edge, less κ (σ² + 1/12)/2; soft 0 is a sharp
    edge. wide is 1/√(σ² + 1/12), computed once.
    """
    if soft == 0:
        part, gain = covered(s, nx, ny)
        return part, gain, 0.0
    z = s * wide
    if abs(z) > MAX_DISTANCE_STD:
        return (1.0 if z > 0 else 0.0), 0.0, 0.0
    node = int((z + MAX_DISTANCE_STD) * _NODES_PER_STD + 0.5)
    at = node * (1 / _NODES_PER_STD) - MAX_DISTANCE_STD
    d, density, slope, bend = z - at, _EDGE[node, 1], _EDGE[node, 2], _EDGE[node, 3]
    part = _EDGE[node, 0] + d * (density + d * (slope / 2 + d * bend / 6))
    gain = (density + d * (slope + d * bend / 2)) * wide
    return part, gain, -gain * soft * (z * wide + curvature)


@njit()
def within(center, reach, count):  # type: ignore[no-untyped-def]
    """First of `count` pixels of a line within a reach of a center, and the one after the last."""
    return max(int(np.ceil(center - reach)), 0), min(int(np.floor(center + reach)), count - 1) + 1


@njit(fastmath=FAST_MATH)
def disc(xy, D, weights, radius, growth, late, grows, soft, alpha, J):  # type: ignore[no-untyped-def]
    """`sweep` for a disc, several times as fast: add to alpha (h, w) and J (h, w, n + 1).

    The logarithm of the radius is larger by growth times late (T,), for whose factor J has one more if
    it `grows`. If J has room for yet one more, that is for `soft`.
    """
    h, w = alpha.shape
    n = D.shape[2]
    of_soft = n + 2 if grows else n + 1
    variance, reach = variance_of(soft), reach_of(soft)
    wide = 1 / np.sqrt(variance)
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        larger = np.exp(growth * late[k]) if grows else 1.0
        by_growth, curvature = late[k] * larger * radius, 1 / (larger * radius)
        r = larger * radius - variance / 2 * curvature
        outer, inner = r + reach, max(r - reach, 0.0)
        for j in range(*within(cy, outer, h)):
            dy = j - cy
            half = np.sqrt(max(outer * outer - dy * dy, 0.0))
            for i in range(*within(cx, half, w)):
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
                    J[j, i, n] += g * larger
                    if grows:
                        J[j, i, n + 1] += g * by_growth
                    if of_soft < J.shape[2]:
                        J[j, i, of_soft] += weights[k] * by_soft


@njit()
def spans(polygon, L, cx, cy, left, right):  # type: ignore[no-untyped-def]
    """First and last column of each row (h,) that a polygon reaches, mapped and moved; and the rows."""
    h = len(left)
    left[:], right[:] = np.inf, -np.inf
    x, y = polygon[-1, 0], polygon[-1, 1]
    x0, y0 = cx + L[0, 0] * x + L[0, 1] * y, cy + L[1, 0] * x + L[1, 1] * y
    top, bottom = y0, y0
    for i in range(len(polygon)):
        x, y = polygon[i, 0], polygon[i, 1]
        x1, y1 = cx + L[0, 0] * x + L[0, 1] * y, cy + L[1, 0] * x + L[1, 1] * y
        low, high = min(x0, x1), max(x0, x1)
        for j in range(max(math.floor(min(y0, y1)), 0), min(math.ceil(max(y0, y1)), h - 1) + 1):
            left[j], right[j] = min(left[j], low), max(right[j], high)
        x0, y0, top, bottom = x1, y1, min(top, y1), max(bottom, y1)
    return max(math.ceil(top), 0), min(math.floor(bottom), h - 1)


@njit()
def between(lattice, i, j, u, v, k):  # type: ignore[no-untyped-def]
    """The value k at the fraction u from node i to the next, and v from node j, bilinear."""
    above = (1 - u) * lattice[j, i, k] + u * lattice[j, i + 1, k]
    below = (1 - u) * lattice[j + 1, i, k] + u * lattice[j + 1, i + 1, k]
    return (1 - v) * above + v * below


@njit()
def largest_stretch(L):  # type: ignore[no-untyped-def]
    """The largest singular value of a linear map (2, 2)."""
    square = L[0, 0] ** 2 + L[0, 1] ** 2 + L[1, 0] ** 2 + L[1, 1] ** 2
    area = L[0, 0] * L[1, 1] - L[0, 1] * L[1, 0]
    return np.sqrt((square + np.sqrt(max(square * square - 4 * area * area, 0.0))) / 2)


@njit()
def stretched(s, curvature, normal, mapped, area, variance):  # type: ignore[no-untyped-def]
    """s, κ, n / N and L⁻ᵀ n / N of a rim mapped by L of determinant `area`.

    With n the normal of the rim at s inside, and N = |L⁻ᵀ n|, the mapped rim has the normal L⁻ᵀ n / N
    and the curvature κ / (det² L N³), and lies s / N away, to first order; s is less
    κ (σ² + 1/12)/2, before and after. Where rims on two sides are equally far, n is 0 and all remains
    as it is.
    """
    nx, ny = normal
    mx, my = mapped
    length2 = nx * nx + ny * ny
    if length2 <= 1e-12:
        return s, curvature, nx, ny, mx, my
    N = np.sqrt((mx * mx + my * my) / length2)
    bent = curvature / (area * area * N * N * N)
    s = (s + curvature * variance / 2) / N - bent * variance / 2
    return s, bent, nx / N, ny / N, mx / N, my / N


@njit(inline="always")  # a call costs 10 % of the time of a sweep
def add_slopes(slopes, g, k, D, by_maps, normal, mapped, at, shape):  # type: ignore[no-untyped-def]
    """Add to a pixel's slopes (n + j + k + l) the derivatives by all parameters; see `sweep`.

    g is the derivative by the distance, D and by_maps are those of center and map at moment k, `normal`
    and `mapped` are n / N and L⁻ᵀ n / N, `at` is the rim's nearest point as `rim_kernel` has it.
    """
    A, by_A, coefficients = shape
    (nx, ny), (mx, my) = normal, mapped
    qx, qy, co, si = g * at[4], g * at[5], at[6], at[7]
    n, m = D.shape[2], by_A.shape[2]
    for p in range(n):
        slopes[p] += g * (mx * D[k, 0, p] + my * D[k, 1, p])
    for p in range(m):
        px = by_A[0, 0, p] * qx + by_A[0, 1, p] * qy
        py = by_A[1, 0, p] * qx + by_A[1, 1, p] * qy
        slopes[n + p] += nx * px + ny * py
    px, py = A[0, 0] * qx + A[0, 1] * qy, A[1, 0] * qx + A[1, 1] * qy
    along = nx * px + ny * py
    ck, sk = co * co - si * si, 2 * co * si
    for p in range(len(coefficients) // 2):
        ck, sk = ck * co - sk * si, sk * co + ck * si
        slopes[n + m + 2 * p] += along * ck
        slopes[n + m + 2 * p + 1] += along * sk
    last = n + m + len(coefficients)
    for p in range(by_maps.shape[3]):
        qx = by_maps[k, 0, 0, p] * px + by_maps[k, 0, 1, p] * py
        qy = by_maps[k, 1, 0, p] * px + by_maps[k, 1, 1, p] * py
        slopes[last + p] += mx * qx + my * qy


@njit(fastmath=FAST_MATH)
def sweep(motion, maps, by_maps, changes, rim, shape, soft, alpha, J):  # type: ignore[no-untyped-def]
    """Add the coverage of a moving shape to alpha (h, w) and J (h, w, n + j + k + l), zeros.

    `motion` are the centers (T, 2) in pixels, their derivatives D (T, 2, n), and the parts of the
    exposure (T,). The rim is from `rim_kernel.lattice_around`, with the variance and the reach of this
    softness, the reach multiplied by the largest factor by which the maps shrink. `shape` are A, its
    derivatives (2, 2, j) by some parameters, and the coefficients (k,), a₃, b₃, a₄, b₄, … At each
    moment the shape is mapped by maps (T, 2, 2), rotations or, if it `changes`, any of positive
    determinant; by_maps (T, 2, 2, l) are their derivatives. If J has room for one more, that is for
    `soft`.
    """
    height, w = alpha.shape
    xy, D, weights = motion
    last = D.shape[2] + shape[1].shape[2] + len(shape[2]) + by_maps.shape[3]
    reach, variance = reach_of(soft), variance_of(soft)
    wide = 1 / np.sqrt(variance)
    lattice, x0, y0, h, polygon = rim
    rows, columns, of_edge = lattice.shape
    left, right, at = np.empty(height), np.empty(height), np.empty(of_edge)
    for k in range(len(xy)):
        cx, cy, L = xy[k, 0], xy[k, 1], maps[k]
        area = L[0, 0] * L[1, 1] - L[0, 1] * L[1, 0]
        a, b, c, d = L[1, 1] / area, -L[0, 1] / area, -L[1, 0] / area, L[0, 0] / area
        far = reach * largest_stretch(L) / area if changes else reach
        top, bottom = spans(polygon, L, cx, cy, left, right)
        for j in range(top, bottom + 1):
            dy = j - cy
            for i in range(math.ceil(max(left[j], 0.0)), math.floor(min(right[j], w - 1)) + 1):
                dx = i - cx
                u = (a * dx + b * dy - x0) / h
                v = (c * dx + d * dy - y0) / h
                if not (0 <= u < columns - 1 and 0 <= v < rows - 1):
                    continue
                p, q = int(u), int(v)
                u, v = u - p, v - q
                inside = between(lattice, p, q, u, v, 0)
                if inside < -far:
                    continue
                if inside > far:
                    alpha[j, i] += weights[k]
                    continue
                a00, a10, a01, a11 = (1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u
                for e in range(8):  # a constant number is vectorized
                    at[e] = (a00 * lattice[q, p, e] + a10 * lattice[q, p + 1, e]) + (
                        a01 * lattice[q + 1, p, e] + a11 * lattice[q + 1, p + 1, e]
                    )
                nx, ny, curvature = at[1], at[2], at[3]
                mx, my = a * nx + c * ny, b * nx + d * ny
                if changes:
                    inside, curvature, nx, ny, mx, my = stretched(
                        inside, curvature, (nx, ny), (mx, my), area, variance
                    )
                part, gain, by_soft = covered_softly(inside, mx, my, soft, wide, curvature)
                alpha[j, i] += weights[k] * part
                g = weights[k] * gain
                if g != 0:
                    add_slopes(J[j, i], g, k, D, by_maps, (nx, ny), (mx, my), at, shape)
                    if last < J.shape[2]:
                        J[j, i, last] += weights[k] * by_soft

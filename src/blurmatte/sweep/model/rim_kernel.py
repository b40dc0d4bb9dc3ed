"""Distance of points from the rim of a silhouette, and its normal and curvature, compiled.

In this file the rim of a silhouette, relative to its center, is the curve A q(ψ), where A is a linear
map with det A > 0 and q a star around the unit circle,

    q(ψ) = R(ψ) (cos ψ, sin ψ),    log R(ψ) = Σ aₖ cos kψ + bₖ sin kψ,   k = 3, 4, …

Its slope by ψ is R A (g, 1) in polar coordinates, with g = (log R)′, and its curvature
κ = det A (1 + g² − (log R)″) / (R |A (g, 1)|³).

These are computed once on a lattice of points around the shape and interpolated at every moment of the
path, which is three times as fast as to compute them in every pixel.
"""

import math

import numpy as np

from blurmatte.compiling import njit
from blurmatte.statistics import UNIFORM_VARIANCE

MAX_DISTANCE_STD = 3.0  # from a soft rim: pixels farther away are in or out
_MAX_CURVATURE = 2.0  # per pixel, that a half plane is corrected for


@njit()
def variance_of(soft):  # type: ignore[no-untyped-def]
    """Variance of the edge profile of a half plane, pixels²."""
    return UNIFORM_VARIANCE + soft * soft  # a pixel is a box


@njit()
def reach_of(soft):  # type: ignore[no-untyped-def]
    """Largest distance from the rim at which pixels are partly inside; half a diagonal if sharp."""
    return 0.7072 if soft == 0 else MAX_DISTANCE_STD * np.sqrt(variance_of(soft))


@njit()
def star(c, s, coefficients):  # type: ignore[no-untyped-def]
    """R, (log R)′ and (log R)″ at the angle whose cosine and sine are c and s."""
    power, slope, bend = 0.0, 0.0, 0.0
    ck, sk = c * c - s * s, 2 * c * s
    for i in range(len(coefficients) // 2):
        ck, sk = ck * c - sk * s, sk * c + ck * s
        a, b, k = coefficients[2 * i], coefficients[2 * i + 1], i + 3
        along = a * ck + b * sk
        power += along
        slope += k * (b * ck - a * sk)
        bend -= k * k * along
    return np.exp(power), slope, bend


@njit()
def rim_at(c, s, A, coefficients):  # type: ignore[no-untyped-def]
    """Of the rim at the angle ψ of cosine c and sine s: R, point, slope by ψ, its length, curvature."""
    R, g, bend = star(c, s, coefficients) if len(coefficients) > 0 else (1.0, 0.0, 0.0)
    px, py = R * (A[0, 0] * c + A[0, 1] * s), R * (A[1, 0] * c + A[1, 1] * s)
    u, v = R * (g * c - s), R * (g * s + c)
    tx, ty = A[0, 0] * u + A[0, 1] * v, A[1, 0] * u + A[1, 1] * v
    long = np.sqrt(tx * tx + ty * ty)
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    curvature = R * R * area * (1 + g * g - bend) / (long * long * long)
    return R, px, py, tx, ty, long, min(max(curvature, -_MAX_CURVATURE), _MAX_CURVATURE)


@njit()
def edge(x, y, c, s, A, coefficients):  # type: ignore[no-untyped-def]
    """Signed distance inside the rim, normal and curvature there, R, the angle's cosine and sine.

    c and s are those of an angle near the one of the rim's nearest point, which is found by Newton-like
    steps along the osculating circle, to the rounding of double precision.
    """
    R, px, py, tx, ty, long, curvature = rim_at(c, s, A, coefficients)
    for _ in range(8):
        away_x, away_y = x - px, y - py
        along = (away_x * tx + away_y * ty) / long
        depth = curvature * (away_y * tx - away_x * ty) / long
        turn = along / (long * max(1 - depth, 0.3))  # near the circle's center steps diverge
        ct, st = np.cos(turn), np.sin(turn)
        c, s = c * ct - s * st, s * ct + c * st
        R, px, py, tx, ty, long, curvature = rim_at(c, s, A, coefficients)
        if abs(turn) < 1e-10:
            break
    nx, ny = ty / long, -tx / long
    return (px - x) * nx + (py - y) * ny, nx, ny, curvature, R, c, s


@njit()
def around(A, coefficients, step):  # type: ignore[no-untyped-def]
    """Points of the rim (k, 6), no two in turn further apart than about `step`.

    Point, normal, the angle's cosine and sine.
    """
    fewest, long = 64, 0.0
    for i in range(fewest):
        turn = 2 * np.pi * i / fewest
        long = max(long, rim_at(np.cos(turn), np.sin(turn), A, coefficients)[5])
    count = max(int(2 * np.pi * long / step), fewest)
    points = np.empty((count, 6))
    for i in range(count):
        turn = 2 * np.pi * i / count
        c, s = np.cos(turn), np.sin(turn)
        _, px, py, tx, ty, long, _ = rim_at(c, s, A, coefficients)
        points[i] = px, py, ty / long, -tx / long, c, s
    return points


@njit()
def lattice_around(A, coefficients, variance, reach):  # type: ignore[no-untyped-def]
    """Results of `edge` at nodes h apart (rows, columns, 8); x and y of the first, h, and a polygon.

    Distance inside, normal, curvature, the rim's point R (cos ψ, sin ψ) and the angle's cosine and
    sine. The distance is reduced by κ/2 times a variance; beyond `reach` it is ±1000 pixels. Linear
    interpolation between nodes lies κ h²/12 below the true distance on average, which is corrected.
    The polygon (k, 2) encloses all points within reach.
    """
    # Powers of two: the nodes stay in place when a shape changes slightly, so that alpha is smooth.
    # The spacing is 1/8 pixel for a sharp rim of radius 1, and grows so that the error of alpha is
    # constant.
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    spacing = 0.125 * (area * variance / UNIFORM_VARIANCE) ** 0.25
    h = 2.0 ** math.floor(math.log2(spacing))
    off = (h * h / 6 - variance) / 2
    reach += abs(off) * _MAX_CURVATURE + 3 * h
    points = around(A, coefficients, h)
    polygon = points[:, :2] + reach * points[:, 2:4]
    x0 = (math.floor(polygon[:, 0].min() / h) - 1) * h
    y0 = (math.floor(polygon[:, 1].min() / h) - 1) * h
    columns = int((polygon[:, 0].max() - x0) / h) + 3
    rows = int((polygon[:, 1].max() - y0) / h) + 3
    nearest = nearest_of(points, x0, y0, h, reach, rows, columns)
    lattice = np.zeros((rows, columns, 8))
    for j in range(rows):
        side = -1e3
        for i in range(columns):
            k = nearest[j, i]
            if k < 0:
                lattice[j, i, 0] = side
                continue
            x, y = x0 + i * h, y0 + j * h
            inside, nx, ny, bent, R, c, s = edge(x, y, points[k, 4], points[k, 5], A, coefficients)
            side = 1e3 if inside > 0 else -1e3
            lattice[j, i] = (inside + bent * off, nx, ny, bent, R * c, R * s, c, s)
    return lattice, x0, y0, h, polygon


@njit()
def nearest_of(points, x0, y0, h, reach, rows, columns):  # type: ignore[no-untyped-def]
    """Index of the point nearest to each node (rows, columns), −1 if none is within reach."""
    nearest = np.full((rows, columns), -1)
    least = np.full((rows, columns), reach * reach)
    for k in range(len(points)):
        u, v = (points[k, 0] - x0) / h, (points[k, 1] - y0) / h
        for j in range(
            max(math.ceil(v - reach / h), 0), min(math.floor(v + reach / h), rows - 1) + 1
        ):
            dy = (j - v) * h
            half = np.sqrt(max(reach * reach - dy * dy, 0.0)) / h
            for i in range(max(math.ceil(u - half), 0), min(math.floor(u + half), columns - 1) + 1):
                dx = (i - u) * h
                if dx * dx + dy * dy < least[j, i]:
                    least[j, i], nearest[j, i] = dx * dx + dy * dy, k
    return nearest

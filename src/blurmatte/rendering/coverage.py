"""Exact area of a shape in each cell of a grid, without sampling, and compiled loops of the bodies.

In this file `x` (w + 1,) and `y` (h + 1,) are increasing cell edges, in pixels from the center of
the shape. Areas are (h, w), in pixels².

Compiled loops are those of areas, of the light of spheres and of samples of sprites. Maps are indexed
[row j, column i], and output arguments come last.
"""

import numpy as np

from blurmatte.checks import Array
from blurmatte.compiling import njit

_ROUNDING = 1e-14  # areas below this part of the whole are floating-point errors of zero


def disc_coverage(x: Array, y: Array, radius: float) -> Array:
    """Area of a disc of `radius` pixels in each cell.

    Let F(x, y) be the area of the unit disc left of x and above y, and S(x) the integral of
    √(1 − u²) from 0 to x. For y <= 0 the disc reaches above y only where |u| < c = √(1 − y²), so

        F(x, y) = ∫ (√(1 − u²) + y) du   from −c to x, x clipped to ±c;

    for y > 0 it is the area of the strip left of x, 2 S(x) + π/2, minus F(x, −y). The area in a cell
    is the mixed difference of F over the cell's corners.
    """
    x, y = np.clip(x / radius, -1, 1), np.clip(y / radius, -1, 1)
    c = np.sqrt(1 - y**2)
    area = np.empty((len(y) - 1, len(x) - 1))
    disc(x, y, _half_area(x), _half_area(c), c, float(radius), area)
    return area


def box_coverage(x: Array, y: Array, width: float, height: float) -> Array:
    """Area of an axis-aligned box of `width` by `height` pixels in each cell."""
    across = np.diff(np.clip(x, -width / 2, width / 2))
    down = np.diff(np.clip(y, -height / 2, height / 2))
    return np.asarray(down[:, None] * across)


def polygon_coverage(x: Array, y: Array, vertices: Array) -> Array:
    """Area of a simple polygon in each cell.

    `vertices` (n, 2) are in order, in either orientation, and may lie outside the grid.
    """
    area = np.zeros((len(y) - 1, len(x) - 1))
    polygon(x, y, np.ascontiguousarray(vertices, dtype=float), area)
    return area


def disc_kernel(radius: float) -> Array:
    """(n, n) fraction of a disc of `radius` pixels that lies in each pixel; the sum is 1."""
    pixels = cell_edges(np.arange(-np.ceil(radius), np.ceil(radius) + 1))
    return np.asarray(disc_coverage(pixels, pixels, radius) / (np.pi * radius**2))


def cell_edges(centers: Array, cells: int = 1) -> Array:
    """Edges of `cells` cells per pixel; `centers` are consecutive pixel centers.

    Cell widths that are powers of two sum to 1 exactly.
    """
    return np.asarray(centers[0] - 0.5 + np.arange(len(centers) * cells + 1) / cells)


def _half_area(x: Array) -> Array:
    """S(x), the integral of √(1 − u²) from 0 to x."""
    area: Array = (x * np.sqrt(1 - x**2) + np.arcsin(x)) / 2
    return area


@njit()
def disc(x, y, S, S_c, c, radius, area):  # type: ignore[no-untyped-def]
    """Area of a disc in each cell, by the formula of `disc_coverage`.

    Here x and y are in radii; S (w + 1,) is S(x), S_c (h + 1,) is S(c) with c (h + 1,) of y.
    """
    for j in range(area.shape[0]):
        before = _left_of(x[0], y[j + 1], S[0], S_c[j + 1], c[j + 1])
        before -= _left_of(x[0], y[j], S[0], S_c[j], c[j])
        for i in range(area.shape[1]):
            after = _left_of(x[i + 1], y[j + 1], S[i + 1], S_c[j + 1], c[j + 1])
            after -= _left_of(x[i + 1], y[j], S[i + 1], S_c[j], c[j])
            part = after - before
            area[j, i] = radius * radius * part if part > _ROUNDING else 0.0
            before = after


@njit()
def _left_of(x, y, S, S_c, c):  # type: ignore[no-untyped-def]
    """F(x, y), the area of the unit disc left of x and above y."""
    upper = min(max(S, -S_c), S_c) + S_c - abs(y) * (min(max(x, -c), c) + c)
    return 2 * S + np.pi / 2 - upper if y > 0 else upper


@njit()
def polygon(x, y, vertices, area):  # type: ignore[no-untyped-def]
    """Add the area of a polygon in each cell to `area`, which is zero on entry.

    For a polygon that is clockwise on screen, an upward edge at x(y) adds everything to its right and
    a downward edge subtracts it: area = −∮ (part of the cell right of x(y)) dy. The opposite
    orientation gives the negative. `full` accumulates the dy that apply to all cells from a column
    to the right.
    """
    full = np.zeros((area.shape[0], area.shape[1] + 1))
    xa, ya = vertices[-1]
    for k in range(len(vertices)):
        xb, yb = vertices[k]
        if yb > ya:
            _add_edge(x, y, xa, ya, xb, yb, -1.0, full, area)
        elif yb < ya:
            _add_edge(x, y, xb, yb, xa, ya, 1.0, full, area)
        xa, ya = xb, yb
    least = _ROUNDING * (np.abs(vertices).max() + 1) ** 2
    for j in range(area.shape[0]):
        height = 0.0
        for i in range(area.shape[1]):
            height += full[j, i]
            covered = abs(area[j, i] + height * (x[i + 1] - x[i]))
            area[j, i] = covered if covered > least else 0.0


@njit()
def _add_edge(x, y, xa, ya, xb, yb, sign, full, area):  # type: ignore[no-untyped-def]
    """Add one edge from (xa, ya) down to (xb, yb), row by row."""
    top, bottom = max(ya, y[0]), min(yb, y[-1])
    slope = (xb - xa) / (yb - ya)
    j = np.searchsorted(y, top, side="right") - 1
    while top < bottom:
        below = min(bottom, y[j + 1])
        left, right = xa + (top - ya) * slope, xa + (below - ya) * slope
        if left > right:
            left, right = right, left
        _add_piece(x, left, right, sign * (below - top), full[j], area[j])
        top, j = below, j + 1


@njit()
def _add_piece(x, left, right, dy, full, area):  # type: ignore[no-untyped-def]
    """Add the part of an edge within one row, cell by cell from left to right; `dy` is the rest."""
    if right <= x[0]:
        full[0] += dy
        return
    slope = dy / (right - left)
    if left < x[0]:
        share = (x[0] - left) * slope
        full[0] += share
        left, dy = x[0], dy - share
    i = np.searchsorted(x, left, side="right") - 1
    while i < len(area) and right > x[i + 1]:
        width = x[i + 1] - left
        share = width * slope
        area[i] += share * width / 2
        full[i + 1] += share
        left, dy, i = x[i + 1], dy - share, i + 1
    if i < len(area):
        area[i] += dy * (x[i + 1] - (left + right) / 2)
        full[i + 1] += dy


@njit()
def shade(sphere, area, x, y, smooth, coverage, light):  # type: ignore[no-untyped-def]
    """Fill `coverage` (h, w) and add the light of a sphere to `light` (h, w, 3).

    `area` (n h, n w) is the covered area of n × n cells per pixel, `x` and `y` are the cell edges.
    Light is sampled once per cell. For a `smooth` sphere, four points per pixel suffice within 0.95
    radii, where the surface is not steep.
    """
    gauss = 0.5 / np.sqrt(3)  # two points at ± this integrate a cubic over a pixel exactly
    n = area.shape[0] // light.shape[0]
    for j in range(light.shape[0]):
        for i in range(light.shape[1]):
            whole = area[n * j : n * j + n, n * i : n * i + n].sum()
            coverage[j, i] = whole
            mx, my = x[n * i] + 0.5, y[n * j] + 0.5
            if smooth and _off_axis(sphere.to_ball, mx, my) < 0.95:
                for px in (mx - gauss, mx + gauss):
                    for py in (my - gauss, my + gauss):
                        _add_light(sphere, px, py, whole / 4, j, i, light)
            elif whole > 0:
                for k in range(n * j, n * j + n):
                    for m in range(n * i, n * i + n):
                        if area[k, m] > 0:
                            px, py = (x[m] + x[m + 1]) / 2, (y[k] + y[k + 1]) / 2
                            _add_light(sphere, px, py, area[k, m], j, i, light)


@njit(inline="always")
def _off_axis(T, px, py):  # type: ignore[no-untyped-def]
    ux, uy = T[0, 0] * px + T[0, 1] * py, T[1, 0] * px + T[1, 1] * py
    return np.sqrt(ux * ux + uy * uy)


@njit(inline="always")
def _add_light(sphere, px, py, weight, j, i, light):  # type: ignore[no-untyped-def]
    """Add `weight` times the light at one image point; a point beyond the rim takes the rim's."""
    beyond = max(_off_axis(sphere.to_ball, px, py), 1.0)
    nx, ny, nz, vx, vy = _normal(sphere, px, py, beyond)
    paint = _paint_at(sphere, nx, ny, nz)
    a, b, c = sphere.ambient[0], sphere.ambient[1], sphere.ambient[2]
    d, e, f = 0.0, 0.0, 0.0
    for k in range(sphere.toward.shape[0]):
        lambert = max(_dot(sphere.toward, k, nx, ny, nz), 0.0)
        a += lambert * sphere.lambert[k, 0]
        b += lambert * sphere.lambert[k, 1]
        c += lambert * sphere.lambert[k, 2]
        if sphere.glossy:
            phong = _facing_halfway(sphere, k, nx, ny, nz, vx, vy) ** sphere.shininess
            d += phong * sphere.phong[k, 0]
            e += phong * sphere.phong[k, 1]
            f += phong * sphere.phong[k, 2]
    light[j, i, 0] += weight * (paint[0] * a + d)
    light[j, i, 1] += weight * (paint[1] * b + e)
    light[j, i, 2] += weight * (paint[2] * c + f)


@njit(inline="always")
def _normal(sphere, px, py, beyond):  # type: ignore[no-untyped-def]
    """Unit normal at an image point, and the slopes of its ray; slopes (0, 0) are the optical axis.

    `beyond` is the distance from the outline's center in units of the rim, at least 1. For a sphere
    of radius R at C (depth 1), a ray d, and e = d - C, the point t d nearest to the camera with
    |t d - C| = R has t - 1 = -(d·e + √(d² R² - |e × C|²)) / d². No large numbers cancel, at any focal
    length.
    """
    if not sphere.pinhole:
        T = sphere.to_ball
        nx, ny = T[0, 0] * px + T[0, 1] * py, T[1, 0] * px + T[1, 1] * py
        nx, ny = nx / beyond, ny / beyond
        return nx, ny, np.sqrt(max(1 - nx * nx - ny * ny, 0.0)), 0.0, 0.0
    ex = (sphere.offset[0] + px / beyond) / sphere.focal
    ey = (sphere.offset[1] + py / beyond) / sphere.focal
    cx, cy, R = sphere.slope[0], sphere.slope[1], sphere.size
    dx, dy = cx + ex, cy + ey
    dd = dx * dx + dy * dy + 1
    cross2 = ex * ex + ey * ey + (ex * cy - ey * cx) ** 2
    farther = -(dx * ex + dy * ey + np.sqrt(max(dd * R * R - cross2, 0.0))) / dd
    return (ex + farther * dx) / R, (ey + farther * dy) / R, -farther / R, dx, dy


@njit(inline="always")
def _facing_halfway(sphere, k, nx, ny, nz, vx, vy):  # type: ignore[no-untyped-def]
    """Cosine between the normal and the half vector of lamp k and camera, clipped at 0."""
    if not sphere.pinhole:
        return max(_dot(sphere.halfway, k, nx, ny, nz), 0.0)
    length = np.sqrt(vx * vx + vy * vy + 1)
    hx, hy = sphere.toward[k, 0] - vx / length, sphere.toward[k, 1] - vy / length
    hz = sphere.toward[k, 2] + 1 / length
    norm = np.sqrt(hx * hx + hy * hy + hz * hz)
    return max(nx * hx + ny * hy + nz * hz, 0.0) / norm if norm > 1e-9 else 0.0


@njit(inline="always")
def _dot(vectors, k, nx, ny, nz):  # type: ignore[no-untyped-def]
    return vectors[k, 0] * nx + vectors[k, 1] * ny + vectors[k, 2] * nz


@njit(inline="always")
def _paint_at(sphere, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Paint at the surface point with normal (nx, ny, nz) in space."""
    if sphere.texture.shape[0] == 0:
        k = 1 if abs(_dot(sphere.axis, 0, nx, ny, nz)) < sphere.band else 0
        return sphere.paints[k, 0], sphere.paints[k, 1], sphere.paints[k, 2]
    bx = _dot(sphere.to_body, 0, nx, ny, nz)
    by = _dot(sphere.to_body, 1, nx, ny, nz)
    bz = _dot(sphere.to_body, 2, nx, ny, nz)
    colatitude = np.arctan2(np.sqrt(bx * bx + bz * bz), -by)
    r, g, b = _texel(sphere.texture, np.arctan2(bx, bz), colatitude)
    return r * sphere.paints[0, 0], g * sphere.paints[0, 1], b * sphere.paints[0, 2]


@njit(inline="always")
def _texel(texture, longitude, colatitude):  # type: ignore[no-untyped-def]
    """Bilinear texture lookup: longitude −π…π wraps around; colatitude 0…π spans the rows."""
    row = colatitude / np.pi * (texture.shape[0] - 2) + 0.5
    column = (longitude / (2 * np.pi) + 0.5) * (texture.shape[1] - 2) + 0.5
    r, g = _bilinear(texture, column, row, 0), _bilinear(texture, column, row, 1)
    return r, g, _bilinear(texture, column, row, 2)


@njit()
def resample(sprite, to_sprite, x, y, across, down, coverage, light):  # type: ignore[no-untyped-def]
    """Fill `coverage` (h, w) and `light` (h, w, 3) with means over across × down points per pixel.

    `sprite` (rows, columns, 4) holds light and alpha with a border of zeros. x (w,) and y (h,) are
    pixel centers relative to the center of the sprite; to_sprite (2, 2) maps them to sprite pixels.
    """
    last_row, last_column = sprite.shape[0] - 1, sprite.shape[1] - 1
    T, n = to_sprite, across * down
    for j in range(coverage.shape[0]):
        for i in range(coverage.shape[1]):
            red, green, blue, alpha = 0.0, 0.0, 0.0, 0.0
            for k in range(n):
                px = x[i] + (k % across + 0.5) / across - 0.5
                py = y[j] + (k // across + 0.5) / down - 0.5
                column = T[0, 0] * px + T[0, 1] * py + last_column / 2
                row = T[1, 0] * px + T[1, 1] * py + last_row / 2
                if 0 <= column < last_column and 0 <= row < last_row:
                    red += _bilinear(sprite, column, row, 0)
                    green += _bilinear(sprite, column, row, 1)
                    blue += _bilinear(sprite, column, row, 2)
                    alpha += _bilinear(sprite, column, row, 3)
            coverage[j, i] = alpha / n
            light[j, i, 0], light[j, i, 1], light[j, i, 2] = red / n, green / n, blue / n


@njit(inline="always")
def _bilinear(sprite, column, row, c):  # type: ignore[no-untyped-def]
    left, top = int(column), int(row)
    u, v = column - left, row - top
    upper = sprite[top, left, c] + u * (sprite[top, left + 1, c] - sprite[top, left, c])
    lower = sprite[top + 1, left, c] + u * (sprite[top + 1, left + 1, c] - sprite[top + 1, left, c])
    return upper + v * (lower - upper)

"""Homographies between image and plate, and interpolation of the plate.

A homography H (3, 3) maps a point of the image to a point of the plate, both in centered coordinates:
0 in the center of the picture and ±1 at the ends of its longer side. Its parameters h are 0 for the
identity:

    H = 1 + (h₀ h₁ h₂ | h₃ h₄ h₅ | h₆ h₇ 0)

h₂ and h₅ are the shift. With a lens term k the points of both pictures are those that a lens without
distortion would show: u becomes u (1 + k |u|²) before H, and its inverse follows H.

A rolling shutter exposes rows one after another. The even part of the camera's motion between them
shears and stretches the picture, as a homography does; the uneven part bends it: u becomes u + c v²,
where v is the coordinate of u across the rows, before all else.

All channels of a pixel share its position and its weights, and positions are not stored.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import AnyArray, Array, Bools, Floats
from blurmatte.compiling import njit

SPLINE_ORDER = 3  # of the interpolation
_LENS_STEPS = 4  # of Newton's method
_PART_PIXELS = 2e4  # that a thread warps at once, at least; fewer take less time than the threads
_BORDER_PX = 12  # beyond which the border has no influence on a spline, relative to 1e-7
IDENTITY_LIGHT = np.eye(7, 1).repeat(3, axis=1)  # (7, 3): gain 1, no offset, no field
IDENTITY_LIGHT.setflags(write=False)


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """Pixels of a picture, in those of the picture to whose center its coordinates refer.

    Parameters
    ----------
    size : (int, int)
        (width, height), pixels.
    origin : (int, int)
        Its first pixel (x, y).
    """

    size: tuple[int, int]
    origin: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Warp:
    """Where the pixels of a picture lie in another, and the pixels of both.

    Parameters
    ----------
    h : (8,) float
        Parameters of the homography.
    size : (int, int)
        (width, height) of the picture in whose centered coordinates it is.
    lens : float
        k.
    target, source : PixelGrid, optional
        Of the result, and of the picture that is interpolated; both as large as `size` if not given.
    bends : (2, 2) float
        c of the picture, and of the other.
    upright : bool
        Whether rows follow one another along y, and not along x.
    """

    h: Array
    size: tuple[int, int]
    lens: float = 0.0
    target: PixelGrid | None = None
    source: PixelGrid | None = None
    bends: Array = field(default_factory=lambda: np.zeros((2, 2)))
    upright: bool = True

    def points(self, xy: Array) -> Array:
        """Positions (n, 2) of points xy (n, 2), pixels."""
        to, u = to_centered(self.size), centered(xy, self.size)
        move(u, self.numbers)
        return np.asarray((u - to[:2, 2]) / to[0, 0])

    @property
    def numbers(self) -> tuple[Any, ...]:
        """What the compiled loops take: H, k and c, the bent axis, and whether there are bends."""
        bends = np.ascontiguousarray(self.bends)
        bent = bool(bends.any())
        return homography(self.h), float(self.lens), bends, int(self.upright), bent

    @property
    def inverse(self) -> "Warp":
        """From the pixels of the other picture to those of this one."""
        h, bends = inverse(self.h), self.bends[::-1]
        return Warp(h, self.size, self.lens, bends=bends, upright=self.upright)


def homography(h: Array) -> Array:
    """(3, 3) H of its parameters h (8,)."""
    return np.asarray(np.eye(3) + np.append(h, 0).reshape(3, 3))


def parameters(H: Array) -> Array:
    """(8,) parameters of a homography (3, 3)."""
    return np.asarray((H / H[2, 2] - np.eye(3)).ravel()[:8])


def inverse(h: Array) -> Array:
    """(8,) parameters of the inverse of a homography."""
    return parameters(np.asarray(np.linalg.inv(homography(h)), float))


def composed(first: Array, then: Array) -> Array:
    """(8,) parameters of one homography after another."""
    return parameters(homography(then) @ homography(first))


def to_centered(size: tuple[int, int]) -> Array:
    """(3, 3) matrix from pixels to centered coordinates of a picture of `size` (width, height)."""
    width, height = size
    half = max(width, height) / 2
    return np.array(
        [[1 / half, 0, (1 - width) / 2 / half], [0, 1 / half, (1 - height) / 2 / half], [0, 0, 1]]
    )


def centered(xy: AnyArray, size: tuple[int, int]) -> Array:
    """(n, 2) centered coordinates of points of a picture, from pixels xy (n, 2)."""
    to = to_centered(size)
    return np.asarray(xy * to[0, 0] + to[:2, 2])


def _projected(h: Array, u: Array) -> tuple[Array, Array]:
    """Centered points (n, 2) under the homography, and their homogeneous coordinates (n, 1)."""
    H = homography(h)
    moved = u @ H[:, :2].T + H[:, 2]
    depth = moved[:, 2:]
    return moved[:, :2] / depth, depth


def derivatives_by_h(h: Array, xy: Array, size: tuple[int, int]) -> Array:
    """(n, 2, 8) derivatives of the positions in the plate of points xy (n, 2), pixels."""
    to, u = to_centered(size), centered(xy, size)
    U, depth = _projected(h, u)
    one = np.concatenate([u, np.ones_like(depth)], axis=1) / depth
    slope = np.zeros((len(xy), 2, 8))
    slope[:, 0, :3] = slope[:, 1, 3:6] = one
    slope[:, :, 6:] = -U[:, :, None] * one[:, None, :2]
    return np.asarray(slope / to[0, 0])


def warped(picture: Floats, how: Warp) -> Floats:
    """A picture (h, w, channels) under a warp, by cubic splines; its border is repeated."""
    around = ((_BORDER_PX, _BORDER_PX),) * 2 + ((0, 0),)
    nodes = spline_coefficients(np.pad(picture.astype(float, copy=False), around, mode="edge"))
    return _between(nodes, _BORDER_PX, SPLINE_ORDER + 1, how, picture.dtype)


def warped_linearly(picture: Floats, how: Warp) -> Floats:
    """A picture (h, w, channels) under a warp, linear between pixels; its border is repeated."""
    return _between(picture, 0, 2, how, picture.dtype)


def warped_mask(mask: Bools, how: Warp) -> Bools:
    """(h, w) True where the support of the spline is True; False beyond the picture."""
    lost = np.pad(~mask, 1, constant_values=True)[..., None].astype(np.float32)
    some = _between(lost, 1, 2, how, np.dtype(np.float32))[..., 0] > 1e-6
    return np.asarray(~scipy.ndimage.binary_dilation(some))


def _between(nodes: Floats, pad: int, taps: int, how: Warp, dtype: np.dtype[Any]) -> Floats:
    """Values between nodes under a warp; see `warp`."""
    target, source = (grid or PixelGrid(how.size) for grid in (how.target, how.source))
    width, height = target.size
    out = np.empty((height, width, nodes.shape[2]), dtype)
    match = how.numbers, to_centered(how.size)
    origins = np.array([*target.origin, *source.origin], float)
    parts = int(np.clip(height * width / _PART_PIXELS, 1, min(height, 64)))
    edges = np.linspace(0, height, parts + 1).astype(int)

    def fill(first: int, end: int) -> None:
        """Fill some rows."""
        warp(nodes, pad, taps, match, origins, first, out[first:end])

    with ThreadPoolExecutor() as threads:  # compiled loops release the interpreter's lock
        list(threads.map(fill, edges[:-1], edges[1:]))
    return out


def spline_coefficients(picture: Floats) -> Array:
    """(h, w, channels) coefficients of the spline that interpolates a picture."""
    channels = np.moveaxis(picture, -1, 0)
    return np.stack(
        [scipy.ndimage.spline_filter(c, SPLINE_ORDER, mode="nearest") for c in channels], axis=-1
    )


def interpolated_variance(xy: Array) -> float:
    """Variance of interpolated white noise of variance 1, mean over the points xy (n, 2)."""
    step = np.linspace(0, 1, 33)
    one = np.eye(1, 31, 15)[0]  # the spline's response beyond 15 pixels is negligible
    energy = [float(np.sum(scipy.ndimage.shift(one, s, order=SPLINE_ORDER) ** 2)) for s in step]
    along = np.interp(xy % 1, step, energy)
    return float(np.mean(along.prod(axis=1)))


@njit()
def cubic(u, weights):  # type: ignore[no-untyped-def]
    """Write the weights (4,) of a cubic B-spline at the fraction u between two nodes."""
    t = 1 - u
    weights[0] = t * t * t / 6
    weights[1] = 2 / 3 - u * u * (2 - u) / 2
    weights[2] = 2 / 3 - t * t * (2 - t) / 2
    weights[3] = u * u * u / 6


@njit(inline="always")
def _within(x, first, last):  # type: ignore[no-untyped-def]
    """x, at least `first` and at most `last`; `first` if it is NaN."""
    if x > last:
        return last
    return x if x > first else first


@njit(inline="always")
def _moved(a, b, numbers):  # type: ignore[no-untyped-def]
    """Where a point lies in the other picture, both in centered coordinates; see `Warp.numbers`."""
    H, lens, bends, across, bent = numbers
    if bent:
        v = b if across == 1 else a
        a, b = a + bends[0, 0] * v * v, b + bends[0, 1] * v * v
    if lens != 0:
        longer = 1 + lens * (a * a + b * b)
        a, b = a * longer, b * longer
    depth = H[2, 0] * a + H[2, 1] * b + H[2, 2]
    U = (H[0, 0] * a + H[0, 1] * b + H[0, 2]) / depth
    V = (H[1, 0] * a + H[1, 1] * b + H[1, 2]) / depth
    if lens != 0:
        R = np.sqrt(U * U + V * V)
        r = R
        for _ in range(_LENS_STEPS):
            r -= (r + lens * r * r * r - R) / (1 + 3 * lens * r * r)
        if R > 0:
            U, V = U * r / R, V * r / R
    if bent:
        v = V if across == 1 else U
        v = 2 * v / (1 + np.sqrt(1 + 4 * bends[1, across] * v))
        U, V = U - bends[1, 0] * v * v, V - bends[1, 1] * v * v
    return U, V


@njit()
def move(points, numbers):  # type: ignore[no-untyped-def]
    """Move points (n, 2) to where they lie in the other picture, in centered coordinates."""
    for n in range(len(points)):
        points[n, 0], points[n, 1] = _moved(points[n, 0], points[n, 1], numbers)


@njit()
def warp(nodes, pad, taps, match, origins, first, out):  # type: ignore[no-untyped-def]
    """Write the rows of a warped picture from row `first` on into `out` (rows, w, channels).

    nodes (h + 2 pad, w + 2 pad, channels): of the picture and `pad` pixels around it. With 4 `taps`
    they are coefficients of a cubic spline, with 2 values between which is interpolated linearly.
    match is (numbers, to): `Warp.numbers`, and the matrix to its centered coordinates, (3, 3). origins
    (4,): x and y of the first pixels of the result and of the picture.
    Positions beyond the nodes are moved to the nearest.
    """
    numbers, to = match
    size, x_off, y_off = to[0, 0], to[0, 2], to[1, 2]
    height, width, channels = nodes.shape
    p, q, before = np.empty(taps), np.empty(taps), taps // 2 - 1
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            a, b = (column + origins[0]) * size + x_off, (first + row + origins[1]) * size + y_off
            U, V = _moved(a, b, numbers)
            x, y = (U - x_off) / size - origins[2], (V - y_off) / size - origins[3]
            x = _within(x + pad, before, width - 1 - before)
            y = _within(y + pad, before, height - 1 - before)
            i, j = min(int(x), width - 2 - before), min(int(y), height - 2 - before)
            if taps == 4:
                cubic(x - i, p)
                cubic(y - j, q)
            else:
                p[0], p[1] = 1 - (x - i), x - i
                q[0], q[1] = 1 - (y - j), y - j
            i, j = i - before, j - before
            for c in range(channels):
                value = 0.0
                for s in range(taps):
                    along = 0.0
                    for r_ in range(taps):
                        along += p[r_] * nodes[j + s, i + r_, c]
                    value += q[s] * along
                out[row, column, c] = value

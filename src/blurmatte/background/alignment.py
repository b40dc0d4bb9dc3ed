"""The fit of a plate to an image: where it lies and how bright it is, in one robust likelihood.

In this file C is the image's light, B the plate's read at h (see `warp`), φ polynomials over the
picture (1, u, v, u², uv, v²), g their factors and o an offset per channel:

    C ≈ B(h) · Σ gᵢφᵢ + o

Both pictures are smoothed alike by one pixel, so that noise is not smoother between the plate's pixels
than on them; otherwise shifts of half a pixel would always look best. What does not follow, such as the
moving object, counts less the further it is off: residuals follow a t distribution.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.background.warp import SHIFT, centered, homography, places, spline_of
from blurmatte.checks import Floats
from blurmatte.radiometry import LinearImage, rounding_noise
from blurmatte.statistics import cell_means

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

GEOMETRIES = ((), SHIFT, tuple(range(8)))  # which of h are free: none, a shift, all
LIGHTS = (0, 1, 2, 7)  # rows of light that are free: none, gain, and offset, and a smooth field
_SMOOTHING = 1.0  # pixels
_MOST_CELLS = 5e5  # larger pictures are looked at in cells of several pixels
_SAMPLES = 8_000  # pixels that are compared: those of the strongest edges, and as many others
_LEAST_SIDE = 48  # cells of the coarsest picture
_FREEDOM = 3.0  # degrees of freedom of the t distribution
_EDGE = 0.1  # pixels, to which an edge is known: the plate may be sharper, splines ring
_LIMIT = 4.0  # standard deviations, beyond which a residual is none of noise
_PRIOR = 0.1  # of h and g: keeps what nothing tells where it is
_STEPS, _LAST = 15, 3  # at most, and of these at last with what is believed alone
_SETTLED = 1e-3  # of a standard deviation squared
_QUARTER = 0.3186  # quantile of the magnitude of a standard normal
_FINEST = 0.1  # of the noise: no fit is better than that
_SMALL = 1e-8  # variance of light that is not rounded
_LEAST_BLOCK = 4  # pixels between those that are compared: smoothed noise is alike over less
SAME_LIGHT = np.zeros((7, 3))
SAME_LIGHT[0] = 1
SAME_LIGHT.setflags(write=False)
_TILES = 12  # by as many
_FLATTER = 0.7034  # E ψ' / E w of ψ = w r for Gaussian noise: the fit's own equations say too much


@dataclass(frozen=True, eq=False)
class Level:
    """Both pictures at one coarseness, and the pixels that are compared.

    C and the slopes of B are (h, w, 3), spline the coefficients of B's, image_slopes (h, w, 3, 2) those
    of C; xy is (n, 2) pixels, sigma (n, 3) the noise of the difference there, basis (n, 6) the
    polynomials.
    """

    C: Array
    slope_x: Array
    slope_y: Array
    spline: Array
    image_slopes: Array
    known: Bools
    xy: npt.NDArray[np.int64]
    sigma: Array
    basis: Array

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        height, width = self.known.shape
        return width, height


@dataclass(frozen=True, eq=False)
class Fit:
    """h (8,); light (7, 3): the gain, the offset, and five more polynomials; how well they fit.

    `residuals` are (n, 3) in units of the noise, NaN where the plate ends; `covariance` is that of what
    is free, h first, then light channel by channel.
    """

    h: Array
    light: Array
    residuals: Array
    covariance: Array
    free: tuple[int, int] = (0, 0)

    @property
    def scale(self) -> float:
        """The residuals' spread, times that of the noise."""
        return spread(self.residuals)


def spread(residuals: Array) -> float:
    """Standard deviation from the lower quarter of the magnitudes: half may be something else."""
    r = np.abs(residuals[np.isfinite(residuals)])
    return float(np.quantile(r, 0.25)) / _QUARTER if r.size else 1.0


def levels(image: LinearImage, plate: LinearImage) -> Iterator[Level]:
    """Both pictures at every coarseness, the finest first."""
    cell = int(np.ceil(np.sqrt(image.valid.size / _MOST_CELLS)))
    C, B = (_cells(picture.rgb, cell) for picture in (image, plate))
    variance = _variance(image, C, cell) + _variance(plate, B, cell)
    known = _cells((image.valid & plate.valid)[..., None].astype(np.float32), cell)
    parts = [C, B, variance, known]
    while True:
        level = _level(*parts)
        yield level
        if min(level.size) < 2 * _LEAST_SIDE:
            return
        parts = [_cells(part, 2) for part in parts]


def _level(C: Array, B: Array, variance: Array, known: Array) -> Level:
    from scipy.ndimage import binary_erosion, gaussian_filter

    C, B = (gaussian_filter(p, (_SMOOTHING, _SMOOTHING, 0)) for p in (C, B))
    clear = np.asarray(binary_erosion(known[..., 0] == 1, iterations=3, border_value=0))
    slope_y, slope_x = (np.asarray(np.gradient(B, axis=axis)) for axis in (0, 1))
    size = known.shape[1], known.shape[0]
    xy = _telling(np.sum(slope_x**2 + slope_y**2, axis=-1), clear)
    to = centered(size)
    u, v = (xy * to[0, 0] + to[:2, 2]).T
    basis = np.stack([np.ones(len(xy)), u, v, u * u, u * v, v * v], axis=1)
    variance = np.maximum(variance, 1e-14) + _EDGE**2 * (slope_x**2 + slope_y**2)
    sigma = np.sqrt(variance[xy[:, 1], xy[:, 0]])
    image_slopes = np.stack([np.gradient(C, axis=axis) for axis in (1, 0)], axis=-1)
    return Level(C, slope_x, slope_y, spline_of(B), image_slopes, clear, xy, sigma, basis)


def _telling(energy: Array, clear: Bools) -> npt.NDArray[np.int64]:
    """(n, 2) the pixel of the strongest edge of every block, and its middle."""
    height, width = energy.shape
    side = max(_LEAST_BLOCK, int(np.ceil(np.sqrt(2 * energy.size / _SAMPLES))))
    rows, columns = height // side, width // side
    blocks = np.where(clear, energy, -1)[: rows * side, : columns * side]
    blocks = blocks.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    place = np.stack([np.argmax(blocks, axis=-1), np.full((rows, columns), side // 2 * (side + 1))])
    y = np.arange(rows)[:, None] * side + place // side
    x = np.arange(columns) * side + place % side
    # By rows, as pictures lie in memory: read column by column they took twice as long.
    yx = np.stack([y.ravel(), x.ravel()], axis=1)
    return np.ascontiguousarray(np.unique(yx[clear[yx[:, 0], yx[:, 1]]], axis=0)[:, ::-1])


def descend(level: Level, start: Fit, geometry: int, light: int) -> Fit:
    """The best fit with what is free of h (an index of GEOMETRIES) and of light (of LIGHTS).

    Last, what is far off no longer counts at all: the object would draw the light towards its own.
    """
    free, rows = list(GEOMETRIES[geometry]), LIGHTS[light]
    h, parts = start.h.copy(), start.light.copy()
    prior = np.eye(len(free) + 3 * rows) / _PRIOR**2
    believed = np.ones((len(level.xy), 3), bool)
    for left in range(_STEPS, -1, -1):
        residuals, slopes = _compare(level, h, parts, free, rows)
        normal, pull = _equations(residuals, slopes, believed)
        now = np.concatenate([h[free], (parts[:rows] - SAME_LIGHT[:rows]).T.ravel()])
        step = np.linalg.solve(normal + prior, -pull - prior @ now)
        if left == 0 or not len(step) or step @ normal @ step < _SETTLED * len(now):
            if not believed.all() or left <= _LAST:
                break
            believed = np.abs(residuals) < _LIMIT * spread(residuals)
        h[free] += step[: len(free)]
        parts[:rows] += step[len(free) :].reshape(3, rows).T
    covariance = _covariance(level, h, residuals, slopes, free)
    return Fit(h, parts, residuals, covariance, (geometry, light))


def first_step(level: Level) -> tuple[Array, Array, float]:
    """Where a fit of everything would go first from a plate as it is: h and light, and how much
    likelier that seems.
    """
    rows = LIGHTS[-1]
    residuals, slopes = _compare(level, np.zeros(8), SAME_LIGHT, list(range(8)), rows)
    normal, pull = _equations(residuals, slopes, np.True_)
    step = -np.linalg.solve(normal + np.eye(len(normal)) / _PRIOR**2, pull)
    h, light = np.asarray(step[:8]), np.asarray(step[8:].reshape(3, rows).T)
    return h, light, float(-pull @ step / 2)


def _equations(residuals: Array, slopes: Array, believed: Bools | np.bool_) -> tuple[Array, Array]:
    """The normal matrix and the gradient of the weighted squares of the residuals."""
    scale = max(spread(residuals), _FINEST)
    weighted = slopes * (believed * _weights(residuals, scale) / scale**2)[..., None]
    weighted = weighted.reshape(3 * len(slopes), -1).T
    pull = weighted @ np.nan_to_num(residuals).ravel()
    normal = weighted @ slopes.reshape(3 * len(slopes), -1)
    return np.asarray(normal, dtype=float), np.asarray(pull, dtype=float)


def _covariance(level: Level, h: Array, residuals: Array, slopes: Array, free: list[int]) -> Array:
    """Of all that is free: how much tiles of the picture disagree about it.

    Residuals of compressed or rounded pictures hang together, so tiles are counted, not pixels [White
    1980, clustered]. The plate's noise has slopes too, and would feign that a plain wall tells where it
    is; so slopes of both pictures are multiplied, whose noise is not the same.
    """
    scale = max(spread(residuals), _FINEST)
    weight = _weights(residuals, scale) / scale**2
    weight *= np.abs(np.nan_to_num(residuals)) < _LIMIT * scale
    pulls = np.einsum("ncp,nc->np", slopes, weight * np.nan_to_num(residuals))
    width, height = level.size
    column, row = (level.xy * _TILES // (width, height)).T
    tiles = np.zeros((_TILES**2, pulls.shape[1]))
    np.add.at(tiles, row * _TILES + column, pulls)
    _, moves = places(h, level.xy.astype(float), level.size)
    own = slopes.copy()
    x, y = level.xy.T
    across = level.image_slopes[y, x] / level.sigma[..., None]
    own[..., : len(free)] = np.einsum("nck,nkp->ncp", across, moves[..., free])
    both = np.einsum("ncp,nc,ncq->pq", slopes, weight, own) * _FLATTER
    values, vectors = np.linalg.eigh((both + both.T) / 2)
    prior = np.eye(len(both)) / _PRIOR**2
    known = np.linalg.inv((vectors * np.maximum(values, 0)) @ vectors.T + prior)
    return np.asarray(known @ (tiles.T @ tiles + prior) @ known)


def _weights(residuals: Array, scale: float) -> Array:
    """(n, 3) weights of a t distribution; 0 where there is no plate."""
    known = np.isfinite(residuals)
    r = np.where(known, residuals, 0) / scale
    return np.asarray(known * (_FREEDOM + 1) / (_FREEDOM + r**2))


def _compare(
    level: Level, h: Array, light: Array, free: list[int], rows: int
) -> tuple[Array, Array]:
    """Residuals (n, 3) in units of noise, and their slopes (n, 3, free) by h and light."""
    from blurmatte.background.alignment_kernel import compare  # numba takes half a second

    x, y = level.xy.T
    residuals, slopes = np.empty((len(x), 3)), np.empty((len(x), 3, len(free) + 3 * rows))
    compare(
        level.spline, level.slope_x, level.slope_y, level.known, level.C[y, x], level.sigma,
        level.basis, level.xy, homography(h), centered(level.size), light,
        np.array(free, np.int64), rows, residuals, slopes,
    )  # fmt: skip
    return residuals, slopes


def gain_in_likelihood(poor: Fit, rich: Fit) -> float:
    """By how much the richer fit is likelier, of the pixels that both have.

    A fit that spreads more, for instance a field of light that follows a large object, is none.
    """
    if rich.scale > poor.scale:
        return -np.inf
    scale = max(rich.scale, _FINEST)
    both = np.isfinite(poor.residuals) & np.isfinite(rich.residuals)
    before, after = (
        np.log1p((fit.residuals[both] / scale) ** 2 / _FREEDOM).sum() for fit in (poor, rich)
    )
    return float((_FREEDOM + 1) / 2 * (before - after))


def _variance(picture: LinearImage, light: Array, cell: int) -> Array:
    """(h, w, 3) noise of cells, at least as it changes with light: its scale is found in the fit."""
    if isinstance(picture.noise, np.ndarray):
        return _cells(picture.noise, cell)
    noise = picture.noise or rounding_noise(picture)
    return np.asarray(noise.variance(light) + _SMALL)


def disagreement(level: Level, fit: Fit) -> tuple[float, float]:
    """The spread of what a fit leaves, and that of the image's light about its median; light."""
    C = level.C[level.xy[:, 1], level.xy[:, 0]]
    return spread(fit.residuals * level.sigma), spread(C - np.median(C, axis=0))


def _cells(values: Floats, side: int) -> Array:
    """Means over blocks; what is left over at the far sides is cut."""
    return np.asarray(cell_means(values, side), dtype=float)

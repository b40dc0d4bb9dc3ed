"""Robust regression of an image on its plate: homography and light, in one likelihood.

In this file C is the light of the image, B(h) the plate under the homography h (see `warp`), φᵢ the
polynomials 1, u, v, u², uv, v² in centered coordinates and, if there are bands, their cosines and sines
(see `match`), gᵢ their coefficients and o an offset, both per channel:

    C ≈ B(h) · Σ gᵢφᵢ + o

Residuals follow a t distribution, so that a moving object has little weight. Both pictures are smoothed
by one pixel: interpolation smooths noise, which otherwise favors shifts of half a pixel.

Shadows and bounced light change a wall smoothly, and so does a displacement of its shading.
Fine structure, the difference of a picture from its local mean, shows displacements alone.

The compiled loop interpolates all channels of a point in one pass, which is four times as fast as one
by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.background.warp import (
    IDENTITY_LIGHT,
    Warp,
    centered,
    cubic,
    derivatives_by_h,
    spline_coefficients,
)
from blurmatte.checks import Array, Bools, Floats, Ints64
from blurmatte.compiling import njit
from blurmatte.radiometry import LinearImage, rounding_noise
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import MAX_RESIDUAL_STD, cell_means, student_loss, student_weight

GEOMETRIES = ((), (2, 5), tuple(range(8)))  # free parameters of h: none, the shift, all
# Free rows of light: none, gain, and offset, and a quadratic field of gain
LIGHTS = ((), (0,), (0, 1), tuple(range(7)))
# Models of each geometry, and a gain per channel
STILL, SHIFT, HOMOGRAPHY = ((geometry, 1) for geometry in range(len(GEOMETRIES)))


# Pyramid of the pictures, and the t regression on its levels.
MAX_PIXELS = 5e5  # of the finest level; larger pictures are averaged over cells
_MIN_SIDE_PX = 48  # of the coarsest level
_MAX_POINTS = 8_000  # compared: half of them on edges
_MIN_SPACING_PX = 4  # of points: smoothing correlates the noise of nearer ones
# Standard deviation of the window of local means: shadows and bounced light are smoother
_LOCAL_MEAN_PX = 4.0
_STRUCTURE_SMOOTHING_PX = 2.0  # where little structure competes with noise that is interpolated
_EDGE_POSITION_STD_PX = 0.1  # the plate may be sharper than the image; splines ring
# Of the t distribution; few, since an object may cover much of the picture.
_DEGREES_OF_FREEDOM = 3.0
_CURVATURE_RATIO = 0.7034  # E ψ' / E w of its ψ = w r, for Gaussian residuals
_SCALE_ERROR = 1.79  # relative standard error of that scale times √n, for Gaussian residuals
_MIN_SCALE = 0.1  # of the residuals, over the predicted noise
_PARAMETER_STD = 0.1  # of the prior of h and light; regularizes what data do not determine
_TOLERANCE = 1e-3  # of a step: mean square over the variance of a parameter
_COVARIANCE_TILES = 12  # per side; residuals of different tiles are independent


@dataclass(frozen=True, eq=False)
class ComparedPair:
    """Both pictures at one resolution, and the n points at which they are compared.

    C, slope_x and slope_y (h, w, 3) are the image and the gradient of the plate, spline its spline
    coefficients, image_slopes (h, w, 3, 2) the gradient of the image; valid (h, w) excludes three
    pixels around invalid ones and the border. At the points xy (n, 2), sigma (n, 3) is the standard
    deviation of the difference, basis (n, 6) are the polynomials φ; those of bands follow. It is no
    `PixelBox`, for the plate is interpolated elsewhere at each step, and has no variance of its own.
    """

    C: Array
    slope_x: Array
    slope_y: Array
    spline: Array
    image_slopes: Array
    valid: Bools
    xy: Ints64
    sigma: Array
    basis: Array

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        height, width = self.valid.shape
        return width, height

    @property
    def identity(self) -> "Alignment":
        """Neither motion nor change of light, without residuals."""
        bands = np.zeros((self.basis.shape[1] - len(IDENTITY_LIGHT) + 1, 3))
        light = np.concatenate([IDENTITY_LIGHT, bands])
        return Alignment(self, np.zeros(8), light, np.zeros((0, 3)))

    def free_rows(self, light: int) -> list[int]:
        """The free rows of light: those of a member of LIGHTS, and all bands."""
        return [*LIGHTS[light], *range(len(IDENTITY_LIGHT), self.basis.shape[1] + 1)]


@dataclass(frozen=True, eq=False)
class Alignment:
    """Parameters h (8,) of the homography and light (7 + bands, 3): gain, offset, the other five
    coefficients, and those of bands.

    residuals (n, 3) are in standard deviations, NaN outside the plate; model are the indices of
    GEOMETRIES and LIGHTS, rows are the free rows of light.
    """

    level: ComparedPair
    h: Array
    light: Array
    residuals: Array
    model: tuple[int, int] = (0, 0)
    rows: tuple[int, ...] = ()

    @property
    def scale(self) -> float:
        """Standard deviation of the residuals over the predicted one."""
        return quartile_scale(self.residuals)

    def covariance(self) -> Array:
        """(k, k) of the free parameters: h first, then the free rows of light, channel by channel.

        The sandwich covariance, clustered by tiles [White 1980]: compression and rounding correlate
        residuals within a tile. The curvature is the product of the gradients of plate and image: the
        noise of one picture alone would add to it, and make a plain wall seem to determine the shift.
        """
        level, free = self.level, list(GEOMETRIES[self.model[0]])
        residuals, own = residuals_and_slopes(level, self.h, self.light, free, list(self.rows))
        k, m = len(free), len(self.rows)
        slopes = np.zeros((*residuals.shape, k + 3 * m))
        slopes[..., :k] = own[..., :k]
        for c in range(3):
            slopes[:, c, k + c * m : k + (c + 1) * m] = own[:, c, k:]
        weight, scale = _weights(residuals)
        weight *= np.abs(np.nan_to_num(residuals)) < MAX_RESIDUAL_STD * scale
        scores = np.einsum("ncp,nc->np", slopes, weight * np.nan_to_num(residuals))
        width, height = level.size
        column, row = (level.xy * _COVARIANCE_TILES // (width, height)).T
        tiles = np.zeros((_COVARIANCE_TILES**2, scores.shape[1]))
        np.add.at(tiles, row * _COVARIANCE_TILES + column, scores)
        moves = derivatives_by_h(self.h, level.xy.astype(float), level.size)
        image_slopes = slopes.copy()
        x, y = level.xy.T
        across = level.image_slopes[y, x] / level.sigma[..., None]
        image_slopes[..., :k] = np.einsum("nck,nkp->ncp", across, moves[..., free])
        curvature = np.einsum("ncp,nc,ncq->pq", slopes, weight, image_slopes) * _CURVATURE_RATIO
        values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
        prior = np.eye(len(curvature)) / _PARAMETER_STD**2
        inverse = np.linalg.inv((vectors * np.maximum(values, 0)) @ vectors.T + prior)
        return np.asarray(inverse @ (tiles.T @ tiles + prior) @ inverse)


def quartile_scale(residuals: Array) -> float:
    """Standard deviation from the lower quartile of |r|: up to half of them may be outliers."""
    r = np.abs(residuals[np.isfinite(residuals)])
    return float(np.quantile(r, 0.25)) / 0.3186 if r.size else 1.0  # 1 for a standard normal


def levels(
    image: LinearImage, plate: LinearImage, structure: bool = False
) -> Iterator[ComparedPair]:
    """Yield the levels of the pyramid, the finest first.

    structure: compare the fine structure of each level, which shows displacements and contrast alone.
    """
    cell = int(np.ceil(np.sqrt(image.valid.size / MAX_PIXELS)))
    C, B = (_cells(picture.rgb, cell) for picture in (image, plate))
    variance = _variance(image, C, cell) + _variance(plate, B, cell)
    valid = _cells((image.valid & plate.valid)[..., None].astype(np.float32), cell)
    while True:
        level = _level(C, B, variance, valid, structure)
        yield level
        if min(level.size) < 2 * _MIN_SIDE_PX:
            return
        C, B, variance, valid = (_cells(part, 2) for part in (C, B, variance, valid))


def _cells(values: Floats, side: int) -> Array:
    return np.asarray(cell_means(values, side), dtype=float)


def _variance(picture: LinearImage, light: Array, cell: int) -> Array:
    """(h, w, 3) variance of cells up to a factor, which is estimated in the fit."""
    if isinstance(picture.noise, np.ndarray):
        return _cells(picture.noise, cell)
    noise = picture.noise or rounding_noise(picture)
    return np.asarray(noise.variance(light) + 1e-8)  # a floor for images without rounding


def _level(C: Array, B: Array, variance: Array, valid: Array, structure: bool) -> ComparedPair:
    if structure:
        C, B = (_fine_structure(p, valid) for p in (C, B))
    side = _STRUCTURE_SMOOTHING_PX if structure else 1
    C, B = (scipy.ndimage.gaussian_filter(p, sigma=(side, side, 0)) for p in (C, B))
    inside = np.asarray(
        scipy.ndimage.binary_erosion(valid[..., 0] == 1, iterations=3, border_value=0)
    )
    slope_y, slope_x = (np.asarray(np.gradient(B, axis=axis)) for axis in (0, 1))
    xy = _points(np.sum(slope_x**2 + slope_y**2, axis=-1), inside)
    u, v = centered(xy, (valid.shape[1], valid.shape[0])).T
    basis = np.stack([np.ones(len(xy)), u, v, u * u, u * v, v * v], axis=1)
    edges = _EDGE_POSITION_STD_PX**2 * (slope_x**2 + slope_y**2)
    sigma = np.sqrt((np.maximum(variance, VARIANCE_FLOOR) + edges)[xy[:, 1], xy[:, 0]])
    image_slopes = np.stack([np.gradient(C, axis=axis) for axis in (1, 0)], axis=-1)
    spline = spline_coefficients(B)
    return ComparedPair(C, slope_x, slope_y, spline, image_slopes, inside, xy, sigma, basis)


def _fine_structure(light: Array, valid: Array) -> Array:
    """A picture without its local means over what is valid; 0 elsewhere."""
    known = 1.0 * (valid == 1)
    total, weight = (
        scipy.ndimage.gaussian_filter(x, sigma=(_LOCAL_MEAN_PX, _LOCAL_MEAN_PX, 0))
        for x in (known * light, known)
    )
    return np.asarray(known * (light - total / np.maximum(weight, np.finfo(float).tiny)))


def _points(energy: Array, inside: Bools) -> Ints64:
    """(n, 2) for every block the pixel of the largest gradient and its center, if inside."""
    height, width = energy.shape
    side = int(np.ceil(np.sqrt(2 * energy.size / _MAX_POINTS)))
    side = max(_MIN_SPACING_PX, side)
    rows, columns = height // side, width // side
    blocks = np.where(inside, energy, -1)[: rows * side, : columns * side]
    blocks = blocks.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    place = np.stack([np.argmax(blocks, axis=-1), np.full((rows, columns), side // 2 * (side + 1))])
    y = np.arange(rows)[:, None] * side + place // side
    x = np.arange(columns) * side + place % side
    # Sorted by rows, the order in memory: twice as fast to read as by columns.
    yx = np.stack([y.ravel(), x.ravel()], axis=1)
    return np.ascontiguousarray(np.unique(yx[inside[yx[:, 0], yx[:, 1]]], axis=0)[:, ::-1])


def fit_level(level: ComparedPair, start: Alignment, model: tuple[int, int]) -> Alignment:
    """Fit what is free in a model (indices of GEOMETRIES and LIGHTS), by reweighted least squares.

    After convergence, outliers get no weight and the fit continues: a large object otherwise biases the
    light. Every step estimates the scale of the residuals, so that there is no one cost to descend.
    Residuals are linear in the light, so that the plate is interpolated anew only if it moves.
    """
    free, rows = list(GEOMETRIES[model[0]]), level.free_rows(model[1])
    h, light, identity = start.h.copy(), start.light.copy(), level.identity.light[rows]
    prior = np.eye(len(free) + 3 * len(rows)) / _PARAMETER_STD**2
    inliers = np.ones((len(level.xy), 3), bool)
    residuals, slopes = residuals_and_slopes(level, h, light, free, rows)
    for left in range(15, -1, -1):  # steps
        normal, gradient = _equations(residuals, slopes, len(rows), inliers)
        now = np.concatenate([h[free], (light[rows] - identity).T.ravel()])
        step = np.linalg.solve(normal + prior, -gradient - prior @ now)
        if left == 0 or not len(step) or step @ normal @ step < _TOLERANCE * len(now):
            if not inliers.all() or left <= 3:  # too few steps are left to continue
                break
            inliers = np.abs(residuals) < MAX_RESIDUAL_STD * quartile_scale(residuals)
        h[free] += step[: len(free)]
        by_light = step[len(free) :].reshape(3, len(rows))
        light[rows] += by_light.T
        if free:
            residuals, slopes = residuals_and_slopes(level, h, light, free, rows)
        else:
            residuals = residuals + np.einsum("ncr,cr->nc", slopes, by_light)
    return Alignment(level, h, light, residuals, model, tuple(rows))


def first_step(level: ComparedPair, model: tuple[int, int]) -> tuple[Alignment, float]:
    """First step of a model from the identity, without residuals, and the log likelihood gained."""
    free, rows, start = list(GEOMETRIES[model[0]]), level.free_rows(model[1]), level.identity
    residuals, slopes = residuals_and_slopes(level, start.h, start.light, free, rows)
    normal, gradient = _equations(residuals, slopes, len(rows), np.True_)
    step = -np.linalg.solve(normal + np.eye(len(normal)) / _PARAMETER_STD**2, gradient)
    h, light = start.h.copy(), start.light.copy()
    h[free] += step[: len(free)]
    light[rows] += step[len(free) :].reshape(3, len(rows)).T
    return replace(start, h=h, light=light, model=model), float(-gradient @ step / 2)


def _equations(
    residuals: Array, slopes: Array, rows: int, inliers: Bools | np.bool_
) -> tuple[Array, Array]:
    """Normal matrix and gradient of the weighted sum of squares; so many rows of light are free."""
    weights = inliers * _weights(residuals)[0]
    known, k = np.nan_to_num(residuals), slopes.shape[2] - rows
    normal, gradient = np.zeros((k + 3 * rows, k + 3 * rows)), np.zeros(k + 3 * rows)
    for c in range(3):
        at = np.r_[:k, k + c * rows : k + (c + 1) * rows]
        weighted = (slopes[:, c] * weights[:, c, None]).T
        normal[np.ix_(at, at)] += weighted @ slopes[:, c]
        gradient[at] += weighted @ known[:, c]
    return normal, gradient


def _weights(residuals: Array) -> tuple[Array, float]:
    """(n, 3) weights of the t distribution over its scale², 0 outside the plate; and that scale."""
    scale, inside = max(quartile_scale(residuals), _MIN_SCALE), np.isfinite(residuals)
    r = np.where(inside, residuals, 0) / scale
    return inside * student_weight(r**2, _DEGREES_OF_FREEDOM, 1) / scale**2, scale


def residuals_and_slopes(
    level: ComparedPair, h: Array, light: Array, free: list[int], rows: list[int]
) -> tuple[Array, Array]:
    """Residuals (n, 3) in standard deviations, and their derivatives (n, 3, k) by what is free.

    Of light these are the derivatives by the rows of their own channel.
    """
    (x, y), xy = level.xy.T, level.xy.astype(float)
    residuals, slopes = np.empty((len(x), 3)), np.empty((len(x), 3, len(free) + len(rows)))
    plate = level.spline, level.slope_x, level.slope_y, level.valid
    points = level.C[y, x], level.sigma, level.basis
    at = Warp(h, level.size).points(xy)
    moves = derivatives_by_h(h, xy, level.size).take(np.array(free, int), axis=-1)
    compare(plate, points, at, moves, light, np.array(rows, np.int64), residuals, slopes)
    return residuals, slopes


def log_likelihood_gain(small: Alignment, large: Alignment) -> float:
    """Log likelihood of a larger model over that of a smaller one, on the points of both.

    −∞ if its residuals have a significantly larger scale, as those of a light field that fits a large
    object.
    """
    by_chance = 3 * _SCALE_ERROR / np.sqrt(len(small.residuals))
    if large.scale > (1 + by_chance) * small.scale:
        return -np.inf
    return float(log_likelihood_gains(small, large).sum())


def log_likelihood_gains(small: Alignment, large: Alignment) -> Array:
    """(n,) log likelihood of a larger model over that of a smaller one, of each point.

    0 for points that one of them puts outside the plate.
    """
    scale = max(large.scale, _MIN_SCALE)
    both = np.isfinite(small.residuals) & np.isfinite(large.residuals)
    before, after = (
        student_loss((np.where(both, fit.residuals, 0) / scale) ** 2, _DEGREES_OF_FREEDOM, 1)
        for fit in (small, large)
    )
    return np.asarray((before - after).sum(axis=1))


def gain_score(fit: Alignment) -> tuple[Array, Array]:
    """(n, 3) derivative of the log likelihood by the gain of each point, and its information."""
    residuals, slopes = residuals_and_slopes(fit.level, fit.h, fit.light, [], [0])
    weight, _ = _weights(residuals)
    B = slopes[..., 0]
    return -weight * B * np.nan_to_num(residuals), weight * B**2


def residual_and_image_std(fit: Alignment) -> tuple[float, float]:
    """Robust standard deviations, linear light: of the residuals, and of the image about its median."""
    level = fit.level
    C = level.C[level.xy[:, 1], level.xy[:, 0]]
    return quartile_scale(fit.residuals * level.sigma), quartile_scale(C - np.median(C, axis=0))


@njit()
def _bilinear(values, j, i, v, u, c):  # type: ignore[no-untyped-def]
    above = (1 - u) * values[j, i, c] + u * values[j, i + 1, c]
    below = (1 - u) * values[j + 1, i, c] + u * values[j + 1, i + 1, c]
    return (1 - v) * above + v * below


@njit()
def compare(plate, points, at, moves, light, rows, residuals, slopes):  # type: ignore[no-untyped-def]
    """Write residuals (n, 3) in standard deviations, NaN outside the plate, and derivatives `slopes`.

    slopes is (n, 3, k + m), rows (m,) the indices of the free rows of the light (b + 1, 3).
    plate is (spline, slope_x, slope_y, valid): its spline coefficients and its gradient, (h, w, 3),
    and (h, w) its pixels at least three from its border. points is (C, sigma, basis): the image's
    light and the standard deviation of the difference, (n, 3), and the functions of the gain (n, b).
    They lie at (n, 2) in the plate, which moves (n, 2, k) by the free parameters of the homography.
    """
    spline, slope_x, slope_y, valid = plate
    C, sigma, basis = points
    height, width = valid.shape
    p, q, k = np.empty(4), np.empty(4), moves.shape[2]
    for n in range(len(at)):
        x, y = at[n, 0], at[n, 1]
        nearest_x, nearest_y = np.rint(x), np.rint(y)
        inside = 0 <= nearest_x < width and 0 <= nearest_y < height
        if not inside or not valid[int(nearest_y), int(nearest_x)]:
            residuals[n], slopes[n] = np.nan, 0
            continue
        i, j = int(np.floor(x)), int(np.floor(y))
        u, v = x - i, y - j
        cubic(u, p)
        cubic(v, q)
        for c in range(3):
            B = 0.0
            for s in range(4):
                row = 0.0
                for r in range(4):
                    row += p[r] * spline[j - 1 + s, i - 1 + r, c]
                B += q[s] * row
            X, Y = _bilinear(slope_x, j, i, v, u, c), _bilinear(slope_y, j, i, v, u, c)
            gain = basis[n, 0] * light[0, c]
            for r in range(1, basis.shape[1]):
                gain += basis[n, r] * light[1 + r, c]
            s = sigma[n, c]
            residuals[n, c] = (B * gain + light[1, c] - C[n, c]) / s
            for r in range(k):
                slopes[n, c, r] = gain / s * (X * moves[n, 0, r] + Y * moves[n, 1, r])
            for r in range(len(rows)):
                row = rows[r]
                by_light = 1 / s if row == 1 else basis[n, max(row - 1, 0)] * B / s
                slopes[n, c, k + r] = by_light

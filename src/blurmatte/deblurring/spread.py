"""Time of a point in each pixel, of a known silhouette without a path, and along a known path.

Alpha is the silhouette χ convolved with the point spread function h,

    α = χ ⊛ h,   h ≥ 0,   Σ h = 1,

with h = 0 where the silhouette would not lie within the streak. The weighted squared error is decreased
by accelerated projected gradient steps [Beck & Teboulle 2009] until it is that of the noise, χ² =
count: early iterations hold the resolved details. Errors are those of estimates from alphas drawn anew.

Dwell time is how long an object was at each part of a known path. With the coverage G(p, k) of a
pixel, averaged while the center passes part k of the path's length, alpha is linear in the times τ
that it takes there,

    α(p) = Σₖ G(p, k) τₖ.

The times are smooth: the prior is exp(−λ |D τ|² / 2) with second differences D, its strength by
evidence as in `priors`. They are the nonnegative least squares solution; the standard deviations
are those of the solution without that constraint.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats, check_kind, check_map, rows_columns
from blurmatte.deblurring.operator import Poses, Sparse, seen_moments, sparse
from blurmatte.deblurring.spin import Spin
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import PointSpread, rows_of

_MAX_ITERATIONS = 500  # of projected gradients
_DRAWS = 12  # alphas drawn for the error
_MIN_WITHIN = 0.8  # of the silhouette that is within the streak
_SIGNIFICANT = 3.0  # alpha of the streak, standard deviations
_STEP_PX = 0.25  # of the center between two moments
_MIN_ALPHA_STD = 1e-3  # of the model of alpha


@dataclass(frozen=True, eq=False)
class _Deconvolution:
    """χ (k, k), and the weights (h, w) of alpha, 0 outside the data; where h may be."""

    chi: Array
    weight: Array
    support: Bools

    def blurred(self, h: Array) -> Array:
        """χ convolved with h."""
        return np.asarray(scipy.signal.fftconvolve(h, self.chi, mode="same"))

    def gradient(self, residual: Array) -> Array:
        """χᵀ of the weighted residual: half the gradient by h of the sum of squares."""
        return np.asarray(
            scipy.signal.fftconvolve(self.weight * residual, self.chi[::-1, ::-1], mode="same")
        )


def fit_psf(alpha: Floats, alpha_std: Floats, silhouette: Floats) -> PointSpread:
    """The point spread function that blurs a silhouette to an alpha.

    Parameters
    ----------
    alpha, alpha_std : (H, W) float
        Exposure fraction and its error.
    silhouette : (k, k) float
        Coverage of the sharp object, 0…1, k odd, its center in the middle: `Sweep.coverage`, or the
        alpha of a sharp picture. It must not change or turn.

    Returns
    -------
    PointSpread
        In the whole picture.

    Raises
    ------
    TypeError, ValueError
        If an argument is no such array, or alpha shows nothing.

    Examples
    --------
    >>> y, x = np.mgrid[-3:4, -3:4]
    >>> disc = (np.hypot(x, y) < 3).astype(float)
    >>> alpha = np.zeros((16, 24))
    >>> for column in (8, 10, 12, 14):
    ...     alpha[5:12, column - 3 : column + 4] += disc / 4
    >>> psf = bm.deblurring.fit_psf(alpha, np.full(alpha.shape, 0.01), disc)
    >>> np.argwhere(psf.weight > 0.1)
    array([[ 8,  8],
           [ 8, 10],
           [ 8, 12],
           [ 8, 14]])
    """
    silhouette, alpha = check_map("silhouette", silhouette), check_map("alpha", alpha)
    alpha_std = check_map("alpha_std", alpha_std, alpha.shape)
    if silhouette.ndim != 2 or not all(side % 2 for side in silhouette.shape):
        raise ValueError(f"silhouette must have odd sides, got {silhouette.shape}")
    known = np.isfinite(alpha) & np.isfinite(alpha_std) & (alpha_std > 0)
    data, std = np.where(known, alpha, 0).astype(float), np.where(known, alpha_std, np.inf)
    chi = np.asarray(silhouette, float)
    support = _support(data > _SIGNIFICANT * std, chi)
    if not support.any():
        raise ValueError(
            "alpha is nowhere large enough, compared with its error, for the silhouette"
        )
    near = scipy.ndimage.binary_dilation(support, chi > 0) & known
    problem = _Deconvolution(chi, np.where(near, 1 / std.astype(float) ** 2, 0), support)
    h = _solved(problem, data)
    rng = np.random.default_rng(0)
    model, scatter = problem.blurred(h), np.where(near, std, 0)
    draws = [_solved(problem, model + scatter * rng.normal(size=h.shape)) for _ in range(_DRAWS)]
    spread = np.sqrt(np.mean((np.array(draws) - h) ** 2, axis=0))
    return PointSpread(h, spread, (0, 0))


def _support(streak: Bools, chi: Array) -> Bools:
    """(H, W) where the center may be: most of the silhouette lies within the streak."""
    within = scipy.signal.fftconvolve(
        streak.astype(float), (chi / chi.sum())[::-1, ::-1], mode="same"
    )
    return np.asarray(within > _MIN_WITHIN)


def _solved(problem: _Deconvolution, data: Array) -> Array:
    """H (H, W) of the projected gradient steps for one alpha [Beck & Teboulle 2009].

    They end where the residuals have the size of the noise, before they fit it. SciPy has no least
    squares of non-negative unknowns with a given sum.
    """
    count = int((problem.weight > 0).sum())
    # The largest eigenvalue of the curvature is at most max weight times (Σ χ)².
    step = 1 / (problem.weight.max() * problem.chi.sum() ** 2)
    h: Array = problem.support / float(problem.support.sum())
    ahead, momentum = h, 1.0
    for _ in range(_MAX_ITERATIONS):
        residual = problem.blurred(ahead) - data
        if float((problem.weight * residual**2).sum()) <= count:
            return ahead
        new = _on_simplex(ahead - step * problem.gradient(residual), problem.support)
        next_momentum = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = _on_simplex(new + (momentum - 1) / next_momentum * (new - h), problem.support)
        h, momentum = new, float(next_momentum)
    return h


def _on_simplex(values: Array, support: Bools) -> Array:
    """The nearest h ≥ 0 of sum 1 on the support [Duchi et al. 2008]."""
    inside = values[support]
    ordered = np.sort(inside)[::-1]
    excess = (np.cumsum(ordered) - 1) / np.arange(1, len(ordered) + 1)
    level = excess[np.flatnonzero(ordered > excess)[-1]]
    projected = np.zeros_like(values)
    projected[support] = np.maximum(inside - level, 0)
    return projected


@dataclass(frozen=True, eq=False)
class Dwell:
    """Times along a path.

    Parameters
    ----------
    xy : (k, 2) float
        Middles of k parts of equal length, pixels.
    position : (k,) float
        Distances of these from the start of the path, pixels.
    time, std : (k,) float
        Fraction of the exposure spent in each part, and its standard deviation; their sum is near 1 if
        path and silhouette are right.
    misfit : float
        Reduced χ² of alpha.

    Examples
    --------
    >>> dwell = bm.deblurring.fit_dwell(solution.alpha, solution.alpha_std, sweep)
    >>> print(f"{dwell.time.sum():.2f} of the exposure on {len(dwell.rows)} parts of the path")
    1.00 of the exposure on 60 parts of the path
    """

    xy: Array
    position: Array
    time: Array
    std: Array
    misfit: float

    def __repr__(self) -> str:
        return f"Dwell({len(self.time)} parts, sum {self.time.sum():.3f}, misfit {self.misfit:.2f})"

    @property
    def rows(self) -> list[Mapping[str, float]]:
        """A row (x, y, position, time, std) for each part, as for a table."""
        x, y = self.xy.T
        return rows_of(x=x, y=y, position=self.position, time=self.time, std=self.std)


def fit_dwell(alpha: Floats, alpha_std: Floats, sweep: Sweep, parts: int = 60) -> Dwell:
    """How long an object was at each part of its path.

    Parameters
    ----------
    alpha, alpha_std : (H, W) float
        Exposure fraction and its error without a model of the path: of `Pixelwise` or `Smooth`.
    sweep : Sweep
        Path and silhouette; its own times are not used.
    parts : int
        Number of parts of the path, 4 or more.

    Returns
    -------
    Dwell

    Raises
    ------
    TypeError, ValueError
        If an argument is something else, sizes differ, or there are fewer than 4 parts.

    Examples
    --------
    >>> dwell = bm.deblurring.fit_dwell(solution.alpha, solution.alpha_std, sweep)
    >>> first_half = dwell.position < sweep.length / 2
    >>> print(f"{dwell.time[first_half].sum():.2f}")
    0.50
    """
    check_kind("sweep", sweep, Sweep, "use blurmatte.sweep.fit_sweep(image, plate)")
    alpha = check_map("alpha", alpha, sweep.size[::-1])
    alpha_std = check_map("alpha_std", alpha_std, sweep.size[::-1])
    if parts < 4:
        raise ValueError(f"parts must be 4 or more, got {parts}")
    (G, xy, position), place = _coverage(sweep, parts), rows_columns(sweep.box)
    data = np.asarray(alpha[place], float).ravel()
    std = np.maximum(np.asarray(alpha_std[place], float).ravel(), _MIN_ALPHA_STD)
    seen = np.isfinite(data) & np.isfinite(std) & (np.asarray(G.sum(axis=1)).ravel() > 0)
    rows = G[seen].toarray() / std[seen, None]
    time, time_std, misfit = _smooth_times(rows, data[seen] / std[seen])
    return Dwell(xy, position, time, time_std, misfit)


def _coverage(sweep: Sweep, parts: int) -> tuple[Sparse, Array, Array]:
    """G (pixels, parts), middles of the parts (parts, 2), and their distances from the start."""
    path, pixels = sweep.trajectory, Pixels.of_box(sweep.box)
    steps = np.linalg.norm(np.diff(path.xy, axis=0), axis=1)
    length = np.concatenate([[0], np.cumsum(steps)]) + 1e-9 * path.t  # increases also at rest
    each = max(1, int(np.ceil(sweep.length / parts / _STEP_PX)))
    position = sweep.length * (np.arange(parts * each) + 0.5) / (parts * each)
    t = np.interp(position, length, path.t)
    xy, maps = path.at(t), sweep.silhouette.map_at(sweep.shape, t)
    poses = Poses(t, np.full(len(t), 1 / len(t)), xy, maps, Spin(np.zeros(3)))
    first, moment, part = seen_moments(sweep, pixels, poses).covered
    G = sparse((first, moment // each, part / each), parts)
    return G, xy.reshape(parts, each, 2).mean(axis=1), position.reshape(parts, each).mean(axis=1)


def _smooth_times(rows: Array, data: Array) -> tuple[Array, Array, float]:
    """Times, their standard deviations, and reduced χ² of rows of unit noise."""
    parts, count = rows.shape[1], len(data)
    D = np.diff(np.eye(parts), n=2, axis=0)
    N, b, Q = rows.T @ rows, rows.T @ data, D.T @ D

    def fit(log_strength: float) -> tuple[float, float, Array]:
        """Log evidence, residual sum of squares, and covariance at a strength of the prior."""
        factor = scipy.linalg.cho_factor(N + np.exp(log_strength) * Q)
        misfit = float(data @ data - b @ scipy.linalg.cho_solve(factor, b))
        log_det = 2 * np.log(np.diag(factor[0])).sum()
        log_evidence = (parts - 2) * log_strength - (count - 2) * np.log(misfit) - log_det
        return float(log_evidence), misfit, scipy.linalg.cho_solve(factor, np.eye(parts))

    largest = float(np.log(np.trace(N)))
    best = scipy.optimize.minimize_scalar(
        lambda x: -fit(x)[0], bounds=(-5, largest + 10), method="bounded"
    )
    _, misfit, covariance = fit(float(best.x))
    scale = misfit / (count - 2)
    smooth = np.exp(best.x / 2) * D
    time, _ = scipy.optimize.nnls(
        np.vstack([rows, smooth]), np.concatenate([data, np.zeros(len(D))])
    )
    return np.asarray(time), np.sqrt(scale * np.diag(covariance)), scale

"""The point spread function of a known silhouette, without a model of the path.

Alpha is the silhouette χ convolved with the point spread function h,

    α = χ ⊛ h,   h ≥ 0,   Σ h = 1,

with h = 0 where the silhouette would not lie within the streak. The weighted squared error is decreased
by accelerated projected gradient steps [Beck & Teboulle 2009] until it is that of the noise, χ² =
count: early iterations hold the resolved details. Errors are those of estimates from alphas drawn anew.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Bools, Floats, check_map
from blurmatte.point_spread import PointSpread

_MAX_ITERATIONS = 500
_DRAWS = 12  # alphas drawn for the error
_MIN_WITHIN = 0.8  # of the silhouette that is within the streak
_SIGNIFICANT = 3.0  # alpha of the streak, standard deviations


@dataclass(frozen=True, eq=False)
class _Problem:
    """χ (k, k), and the weights (h, w) of alpha, 0 outside the data; where h may be."""

    chi: Array
    weight: Array
    support: Bools

    def blurred(self, h: Array) -> Array:
        """χ convolved with h."""
        from scipy.signal import fftconvolve

        return np.asarray(fftconvolve(h, self.chi, mode="same"))

    def gradient(self, residual: Array) -> Array:
        """χᵀ of the weighted residual: half the gradient by h of the sum of squares."""
        from scipy.signal import fftconvolve

        return np.asarray(fftconvolve(self.weight * residual, self.chi[::-1, ::-1], mode="same"))


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
    """
    from scipy.ndimage import binary_dilation

    check_map("silhouette", silhouette, np.shape(silhouette))
    check_map("alpha", alpha, np.shape(alpha))
    check_map("alpha_std", alpha_std, alpha.shape)
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
    near = binary_dilation(support, chi > 0) & known
    problem = _Problem(chi, np.where(near, 1 / std.astype(float) ** 2, 0), support)
    h = _solved(problem, data)
    rng = np.random.default_rng(0)
    model, scatter = problem.blurred(h), np.where(near, std, 0)
    draws = [_solved(problem, model + scatter * rng.normal(size=h.shape)) for _ in range(_DRAWS)]
    spread = np.sqrt(np.mean((np.array(draws) - h) ** 2, axis=0))
    return PointSpread(h, spread, (0, 0))


def _support(streak: Bools, chi: Array) -> Bools:
    """(H, W) where the center may be: most of the silhouette lies within the streak."""
    from scipy.signal import fftconvolve

    within = fftconvolve(streak.astype(float), (chi / chi.sum())[::-1, ::-1], mode="same")
    return np.asarray(within > _MIN_WITHIN)


def _solved(problem: _Problem, data: Array) -> Array:
    """H (H, W) of the projected gradient steps for one alpha."""
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

"""Alpha of several weighted hypotheses: Bayesian model averaging [Hoeting et al. 1999].

With weights w_k, alphas α_k and their variances V_k, alpha of a pixel is the interquartile mean of the
α_k: the mean of the half of the weight that is in the middle. Unlike a mean of all it does not follow
hypotheses of small weight that are far from the others, and unlike a median it averages those that
agree. Its error is the root mean square about it,

    Var α = Σ w_k (V_k' + (α_k − α)²),    V_k' = min_j (V_j + (α_j − α_k)²),

and the same for the sum of alpha over all pixels. A weight is the probability that α_k is the nearest
to the truth; then it is off by no more than any other is. The minimum is over hypotheses of at least
the weight of k.

Alpha is a fraction. One of which nothing is known has the mean 1/2 and the variance 1/12, so its
estimate a is off by √(1/12 + (a − 1/2)²), root mean square. `as_fraction` gives estimates, and
`with_bounded_errors` errors, that do not say less than that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.statistics import UNIFORM_VARIANCE

MIN_WEIGHT = 0.01  # of a hypothesis that may be right
_MIN_SUM = 1e-9  # of alpha, to which errors are relative
QUARTILE = 0.25  # of the weight at both ends, which the mean leaves out

_UNKNOWN_STD = float(np.sqrt(UNIFORM_VARIANCE))  # of a fraction of which nothing is known
_NODES = 24  # of the integrals over a fraction; normal densities there are wider than 0.14


@dataclass(frozen=True, eq=False)
class AlphaEstimate:
    """Alpha in a box by one hypothesis."""

    # (h, w) float: of each pixel; not finite where alpha is unknown
    alpha: Floats
    alpha_std: Floats
    sum_std: float  # standard deviation of the sum of alpha
    # Relative standard deviation of a factor common to all pixels, not included in `alpha_std`
    scale_std: float = 0.0


def averaged(estimates: Sequence[AlphaEstimate], weights: Array) -> AlphaEstimate:
    """The interquartile mean of hypotheses and its error.

    At each pixel only those that know its alpha count. Weights below `MIN_WEIGHT` count as 0.
    The boxes are the same, and the weights sum to 1.
    """
    w, alphas, stds = _known(estimates, weights)
    weights = _counted(weights)
    alpha = np.asarray((_middle(alphas, w) * alphas).sum(axis=0))
    variance = (w * (_least_variance(alphas, stds**2, w) + (alphas - alpha) ** 2)).sum(axis=0)
    sums, total = alphas.sum(axis=(1, 2)), alpha.sum()
    own = np.square([one.sum_std for one in estimates])
    of_sum = weights @ (_least_variance(sums, own, weights) + (sums - total) ** 2)
    factors, scales = sums / max(total, _MIN_SUM), np.square([one.scale_std for one in estimates])
    return AlphaEstimate(
        alpha,
        np.where(w.any(axis=0), np.sqrt(variance), np.inf),
        float(np.sqrt(of_sum)),
        float(np.sqrt(weights @ _least_variance(factors, scales, weights))),
    )


def _least_variance(values: Array, variance: Array, weights: Array) -> Array:
    """(n, ...) variance of values if each is the nearest to the truth, and theirs is `variance`.

    The nearest is off by no more than any other, so that its variance is no more than that of another,
    of at least the same weight, about it.
    """
    least = variance.copy()
    for value, known, weight in zip(values, variance, weights, strict=True):
        about = known + (value - values) ** 2
        least = np.where((weight >= weights) & (weight > 0), np.minimum(least, about), least)
    return least


def middle_weights(estimates: Sequence[AlphaEstimate], weights: Array) -> Array:
    """(n, h, w) weights of each hypothesis in the interquartile mean of each pixel."""
    w, alphas, _ = _known(estimates, weights)
    return _middle(alphas, w)


def _counted(weights: Array) -> Array:
    """(n,) the weights that count; they sum to 1."""
    weights = np.where(weights < MIN_WEIGHT, 0, weights)
    return np.asarray(weights / weights.sum())


def _known(estimates: Sequence[AlphaEstimate], weights: Array) -> tuple[Array, Array, Array]:
    """(n, h, w) weights, which sum to 1 where any hypothesis knows alpha, alphas and their errors."""
    alphas = np.stack([np.asarray(one.alpha, float) for one in estimates])
    stds = np.stack([np.asarray(one.alpha_std, float) for one in estimates])
    known = np.isfinite(alphas) & np.isfinite(stds)
    w = _counted(weights)[:, None, None] * known
    total = w.sum(axis=0)
    w = w / np.where(total > 0, total, 1)
    return w, np.where(known, alphas, 0), np.where(known, stds, 0)


def _middle(values: Array, weights: Array) -> Array:
    """(n, h, w) weights of the interquartile mean of (n, h, w); 0 where all weights are."""
    order = np.argsort(values, axis=0, kind="stable")
    upper = np.cumsum(np.take_along_axis(weights, order, axis=0), axis=0)
    lower = np.concatenate([np.zeros_like(upper[:1]), upper[:-1]])
    inside = np.maximum(np.minimum(upper, 1 - QUARTILE) - np.maximum(lower, QUARTILE), 0)
    middle = np.empty_like(inside)
    np.put_along_axis(middle, order, inside / (1 - 2 * QUARTILE), axis=0)
    return np.asarray(middle)


def as_fraction(alpha: Floats, alpha_std: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation of alpha, which is a fraction.

    With s from half of u = 1/√12 to u, an estimate a ± s is replaced in part, and beyond u wholly, by
    the mean m and the variance v of a normal distribution about a that is restricted to 0…1:

        α = (1 − w) a + w m,    Var α = (1 − w) s² + w v + w (1 − w) (a − m)²,    w = 2s/u − 1 in 0…1.

    Smaller errors leave a as it is, also below 0 and above 1: where alpha is 0, noise of variance s²
    raises m by 0.9 s on average, and with it every sum, while the mean of a is right. There the
    restriction would not help either: 0…1 is then wider than ±√12 s. Where s is larger, the data say
    little more than that alpha is a fraction, and a mostly shows noise.

    alpha, alpha_std (h, w): any numbers; an error that is not finite says that nothing is known.
    """
    silent = ~((alpha_std <= _UNKNOWN_STD / 2) & np.isfinite(alpha))
    if not silent.any():
        return alpha, alpha_std
    a, s = (np.asarray(values[silent], float) for values in (alpha, alpha_std))
    s = np.where(np.isfinite(a) & np.isfinite(s), s, np.inf)
    a = np.where(np.isfinite(s), a, 0.5)
    w = np.clip(2 * s / _UNKNOWN_STD - 1, 0, 1)
    m, v = _restricted(a, s)
    own = np.where(w < 1, s, 0)
    mean = (1 - w) * a + w * m
    variance = (1 - w) * own**2 + w * v + w * (1 - w) * (a - m) ** 2
    alpha, alpha_std = alpha.copy(), alpha_std.copy()
    alpha[silent], alpha_std[silent] = mean, np.sqrt(variance)
    return alpha, alpha_std


def _restricted(a: Array, s: Array) -> tuple[Array, Array]:
    """Mean and variance (n,) of normal distributions about a ± s restricted to 0…1."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    x = (nodes + 1) / 2
    chi2 = ((x - a[:, None]) / s[:, None]) ** 2
    density = weights * np.exp(-0.5 * (chi2 - chi2.min(axis=1, keepdims=True)))
    density /= density.sum(axis=1, keepdims=True)
    mean = density @ x
    return mean, np.maximum(density @ x**2 - mean**2, 0)


def with_bounded_errors(estimate: AlphaEstimate) -> AlphaEstimate:
    """An estimate whose errors are not larger than those of fractions of which nothing is known.

    Alpha stays. The error of a common factor is bounded at the pixel of the largest alpha, and that of
    the sum by the sum of the errors, which it has if all pixels err alike.
    """
    known = np.isfinite(estimate.alpha) & np.isfinite(estimate.alpha_std)
    alpha = np.where(known, estimate.alpha, 0)
    limit = np.sqrt(_UNKNOWN_STD**2 + (alpha - 0.5) ** 2)
    std = np.where(known, np.minimum(estimate.alpha_std, limit), estimate.alpha_std)
    at = int(np.argmax(alpha))
    peak, of_peak = float(alpha.flat[at]), float(limit.flat[at])
    return replace(
        estimate,
        alpha_std=std,
        sum_std=min(estimate.sum_std, float(std[known].sum())),
        scale_std=min(estimate.scale_std, of_peak / peak) if peak > 0 else estimate.scale_std,
    )

"""Average alpha of several hypotheses: Bayesian model averaging [Hoeting et al. 1999].

With weights w_k, alphas α_k and their variances V_k,

    α = Σ w_k α_k,    Var α = Σ w_k (V_k + (α_k − α)²),

and the same for the sum of alpha over all pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Floats

MIN_WEIGHT = 1e-3  # of an averaged hypothesis


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
    """The average of hypotheses.

    At each pixel only those that know its alpha are averaged. Weights below `MIN_WEIGHT` count as 0.
    The boxes are the same, and the weights sum to 1.
    """
    alphas = np.stack([np.asarray(one.alpha, float) for one in estimates])
    stds = np.stack([np.asarray(one.alpha_std, float) for one in estimates])
    known = np.isfinite(alphas) & np.isfinite(stds)
    weights = np.where(weights < MIN_WEIGHT, 0, weights)
    weights = weights / weights.sum()
    w = weights[:, None, None] * known
    total = w.sum(axis=0)
    w = w / np.where(total > 0, total, 1)
    alphas, stds = np.where(known, alphas, 0), np.where(known, stds, 0)
    alpha = (w * alphas).sum(axis=0)
    variance = (w * (stds**2 + (alphas - alpha) ** 2)).sum(axis=0)
    sums = alphas.sum(axis=(1, 2))
    scales = np.array([one.scale_std for one in estimates])
    own = np.array([one.sum_std for one in estimates])
    of_sum = weights @ (own**2 + (sums - weights @ sums) ** 2)
    return AlphaEstimate(
        alpha,
        np.where(total > 0, np.sqrt(variance), np.inf),
        float(np.sqrt(of_sum)),
        float(np.sqrt(weights @ scales**2)),
    )

"""Error of a smooth field at each place, by simulation: the fit is repeated with a known truth.

A field has errors from noise, from smoothing, and from edges and priors that noise changes. The inverse
of the equations contains the first, the mean of the second under the prior, and not the third. So
evidence is drawn from fields similar to the truth, and fitted from the coarsest level on, as that of
the picture was. The truth is rougher than the fitted field. The field plus its smoothed residuals
[twicing; Tukey 1977] is rougher than the truth, by noise. Half of the simulations start from
each. Where the residuals of the picture exceed those of the simulations, the truth is rougher than
both, and the variance is multiplied by the ratio of their squares.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.matting.pyramid import CellEvidence
from blurmatte.matting.smooth_field import (
    LOCAL_DOF,
    LOCAL_PRIOR_DOF,
    TOLERANCE,
    Field,
    Prior,
    field_changes,
    local_mean,
    pooled_variance,
)


def simulated_variance(
    evidence: CellEvidence,
    prior: Prior,
    field: Field,
    refit: Callable[[CellEvidence], Floats],
    cells: int = 1,
    trials: int = 4,
) -> tuple[Floats, float]:
    """Variance of each cell of a field, (h, w), and the square of the bias of its sum.

    field: fitted with this prior.
    refit: the field of other evidence, including the choice of the prior.
    cells: pixels per cell.
    trials: number of simulations, with a fixed seed.
    """
    A, x, mask = evidence.information, field.x, evidence.mask
    tolerance, residuals = TOLERANCE, [_residuals(evidence, x)]
    (more,) = field_changes(evidence, prior, field, residuals, cells, tolerance)
    rougher = np.where(mask, np.clip(x + more, evidence.lower, 1), 0)
    normal, squares, sums = np.random.default_rng(1), np.zeros(x.shape), np.zeros(trials)
    for trial in range(trials):
        true = rougher if trial % 2 else x
        pull = A * true + np.sqrt(A) * normal.standard_normal(A.shape)
        drawn = replace(evidence, pull=pull.astype(A.dtype))
        found = refit(drawn)
        squares += (found - true) ** 2 / trials
        sums[trial] = np.sum(found - true, dtype=float)
        residuals.append(_residuals(drawn, found))
    others = field_changes(evidence, prior, field, residuals[1:], cells, tolerance)
    parameters = A * field.variance
    near, usual = (
        local_mean(m, parameters, mask) for m in (more**2, np.mean(np.square(others), axis=0))
    )
    before = LOCAL_PRIOR_DOF / LOCAL_DOF * usual
    factor = np.maximum((near + before) / np.maximum(usual + before, 1e-30), 1)
    bias_square = max(sums.mean() ** 2 - sums.var(ddof=1) / trials, 0.0)
    return (pooled_variance(squares, mask) * factor).astype(x.dtype), float(bias_square)


def _residuals(evidence: CellEvidence, x: Floats) -> Array:
    """Residuals of the pull, where x is not at a bound."""
    free = (x > evidence.lower) & (x < 1)
    return np.where(free, evidence.pull - evidence.information * x, 0).astype(float)

"""How far a smooth field may be off, place by place: all of it is done again, with a known truth.

A field is off by noise, by what smoothing takes, and by how differently noise lets edges and the prior
turn out. The inverse of the equations tells the first, of the second what the prior expects in the
mean, and nothing of the third. So evidence is drawn of fields like the truth, and solved from the
largest cells on, as that of the picture was. The truth is rougher than the field found. What that
leaves of the evidence, smoothed again and added [twicing; Tukey 1977], makes one that is too rough by
noise. Half of the trials begin at each. Where more is left of the picture's evidence than of what was
drawn, the truth is rougher than both, and the variance larger by that factor.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.matting.smooth_local import BEFORE, TELLING, around
from blurmatte.matting.smooth_prior import TOLERANCE, Evidence, Field, Prior, changes, pooled

Array = npt.NDArray[np.float64]

_TRIALS = 4
_SEED = 1  # the same answer every time
_TINY = 1e-30


def simulated_variance(
    evidence: Evidence,
    prior: Prior,
    field: Field,
    solved: Callable[[Evidence], Floats],
    cells: int = 1,
) -> tuple[Floats, float]:
    """Variance of each cell of a field, (h, w), and the square of what its sum is off in the mean.

    Parameters
    ----------
    evidence : Evidence
    prior : Prior
    field : Field
        Found with this prior.
    solved : callable
        The field that comes of other evidence, from the choice of the prior on.
    cells : int
        How many pixels there are to a cell.
    """
    A, x, mask = evidence.information, field.x, evidence.mask
    left = [_left(evidence, x)]
    (more,) = changes(evidence, prior, field, left, cells, TOLERANCE)
    rougher = np.where(mask, np.clip(x + more, evidence.least, 1), 0)
    normal, squares, sums = np.random.default_rng(_SEED), np.zeros(x.shape), np.zeros(_TRIALS)
    for trial in range(_TRIALS):
        true = rougher if trial % 2 else x
        pull = A * true + np.sqrt(A) * normal.standard_normal(A.shape)
        drawn = replace(evidence, pull=pull.astype(A.dtype))
        found = solved(drawn)
        squares += (found - true) ** 2 / _TRIALS
        sums[trial] = np.sum(found - true, dtype=float)
        left.append(_left(drawn, found))
    others = changes(evidence, prior, field, left[1:], cells, TOLERANCE)
    told = A * field.variance
    near, usual = (around(m, told, mask) for m in (more**2, np.mean(np.square(others), axis=0)))
    before = BEFORE / TELLING * usual
    factor = np.maximum((near + before) / np.maximum(usual + before, _TINY), 1)
    off = max(sums.mean() ** 2 - sums.var(ddof=1) / _TRIALS, 0.0)  # beyond noise
    return (pooled(squares, mask) * factor).astype(x.dtype), float(off)


def _left(evidence: Evidence, x: Floats) -> Array:
    """What a field leaves of the evidence, where it is not held."""
    free = (x > evidence.least) & (x < 1)
    return np.where(free, evidence.pull - evidence.information * x, 0).astype(float)

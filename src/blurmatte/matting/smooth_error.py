"""How far a smooth field may be off, place by place.

The mean x = H⁻¹ p of evidence and prior is off by noise, H⁻¹ √A ξ, and by what smoothing leaves out,
H⁻¹ DᵀΓD of the true field. If that is as the prior says it has the covariance H⁻¹ DᵀΓD H⁻¹, and both
together H⁻¹. But a prior that is right in the mean says too much of what is smoother than others, and
too little of what is not. What was left out shows in what the field leaves of the evidence: smoothed
again, H⁻¹ (p − A x) is H⁻¹ A times it, and noise [twicing; Tukey 1977]. By how much that is more or
less than the prior expects, around a place, is the factor of its part.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.matting.smooth_local import BEFORE, TELLING, around
from blurmatte.matting.smooth_prior import Evidence, Field, Prior, Sampler, pooled

Array = npt.NDArray[np.float64]

_SAMPLES = 4
_SEED = 1  # of samples: the same answer every time
_TINY = 1e-30


def honest_variance(evidence: Evidence, prior: Prior, field: Field) -> Floats:
    """Variance of each pixel of a field that was found with this prior, (h, w).

    Parameters
    ----------
    evidence : Evidence
    prior : Prior
    field : Field
        With variances of samples.
    """
    sampler, mask = Sampler(evidence, prior, field), evidence.mask
    rng = np.random.default_rng(_SEED)
    drawn = [sampler.disturbed(rng) for _ in range(_SAMPLES)]
    once = sampler.solved([b for pair in drawn for b in pair] + [sampler.left])
    again = sampler.solved([sampler.information * one for one in once[:-1]])
    noise, left_out = (_mean_square(once[i:-1:2]) for i in (0, 1))
    of_noise = _mean_square([a - b for a, b in zip(once[:-1:2], again[::2], strict=True)])
    expected = _mean_square(again[1::2])
    told = evidence.information * field.variance
    near = (around(m, told, mask) for m in (once[-1] ** 2, of_noise, expected))
    found, of_noise, expected = near
    usual = BEFORE / TELLING * (expected + of_noise)
    factor = (np.maximum(found - of_noise, 0) + usual) / np.maximum(expected + usual, _TINY)
    variance = pooled(noise, mask) + factor * pooled(left_out, mask)
    return np.asarray(variance, field.x.dtype)


def _mean_square(samples: list[Floats]) -> Floats:
    return np.asarray(np.mean(np.square(samples), axis=0))

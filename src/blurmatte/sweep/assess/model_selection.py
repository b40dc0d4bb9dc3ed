"""Weights of hypotheses about alpha, from their marginal likelihoods in one observation.

Every hypothesis, a fitted sweep or an alpha without a shape, is compared in the same light with one
model of color (`model.color_field`), whose colors are marginalized. The error of alpha adds to the
noise, as the light by which alpha changes a pixel,

    V = V_C + (1 − α)² V_B + σ_α² (k̄ − B)²,

so that a hypothesis with an error larger than claimed is unlikely, and a large claim gains little.
Costs are divided by the variance inflation of the likeliest, for residuals are correlated, and every
fitted parameter costs half a log of the number of pixels.

These weights say which hypothesis predicts the observation best. No hypothesis is complete: shading,
bounced light and the file leave misfits that say nothing about alpha, and that many pixels share. So
the probability that a hypothesis has the alpha nearest to the truth is a power of its weight, as in the
posteriors of wrong models [Grünwald & van Ommen 2017].
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import block_squares
from blurmatte.streaks import Streak
from blurmatte.sweep.model.color_field import fit_field
from blurmatte.sweep.model.observation import BlockStatistics, Observation
from blurmatte.sweep.model.pixel_box import means
from blurmatte.sweep.model.student_t import loss, student_weight
from blurmatte.sweep.sweep import Sweep

# Units of log likelihood for each pixel by which an alpha without a shape seems likelier, for it was
# fitted to the noise of the same pixels; calibrated on rendered scenes.
OPTIMISM = 0.3

# Power of the weights that makes them probabilities: with it the mean probability of the likeliest is
# the fraction of pictures of two renderers in which its alpha is the nearest to the truth.
_POWER = 0.02


@dataclass(frozen=True)
class Evidence:
    """How well a hypothesis predicts an observation."""

    cost: float  # negative log marginal likelihood
    inflation: float  # of the variance of block sums of its residuals, 1 or more
    parameters: int  # that were fitted, colors apart
    pixels: float  # of the observation


def evidence_of(
    observation: Observation, alpha: Array, alpha_std: Array, parameters: int = 0
) -> Evidence:
    """The evidence for an alpha.

    observation: with the plate as the hypothesis has it.
    alpha, alpha_std (h, w): in the observation's pixels; a standard deviation of 0 where alpha has
        a shape, whose error is in its parameters.
    parameters: number of those that were fitted, colors apart.
    """
    weight = observation.weight
    if observation.light_alone:
        alpha = alpha / max(float(alpha.max()), 1e-12)
    alpha = np.where(alpha > 0.002, np.clip(alpha, 0, 1), 0)  # less is noise of alpha
    observation = observation.along_colors(alpha)
    C, B, V_C, V_B = observation.light
    field, _ = fit_field((C, B, V_C, V_B), alpha, weight, observation.pitch, observation.color)
    by_alpha = (field.mean - B) ** 2
    V_C = np.ascontiguousarray(V_C + (alpha_std**2)[..., None] * by_alpha)
    light = C, B, V_C, V_B
    field, e = fit_field(light, alpha, weight, observation.pitch, observation.color)
    chi2 = (e**2).sum(axis=0)
    noise = np.maximum(observation.light[2] + (1 - alpha)[..., None] ** 2 * V_B, VARIANCE_FLOOR)
    added = (alpha_std**2)[..., None] * by_alpha / noise
    normalization = 0.5 * np.log1p(added).sum(axis=-1)
    cost = float((weight * (loss(chi2, observation.channels) + normalization)).sum()) + field.cost
    limited = np.moveaxis(e * np.sqrt(student_weight(chi2, observation.channels)), 0, -1)
    inside = (alpha > 0) & observation.valid
    correlated = (block_squares(limited, inside, size) for size in BlockStatistics.sizes_px)
    channels = observation.channels
    squares = (float(s.sum(axis=1).mean()) / channels for s in correlated if len(s))
    inflation = max(1.0, *squares, 1.0)
    cost += OPTIMISM * float(np.count_nonzero(alpha_std))
    return Evidence(cost, inflation, parameters, float(weight.sum()))


def hypothesis_weights(evidence: list[Evidence]) -> Array:
    """(n,) weights that sum to 1: exp(−cost / inflation − ½ p log n) [Schwarz 1978].

    All evidence is of the same observation.
    """
    weights = np.exp(-hypothesis_scores(evidence))
    return np.asarray(weights / weights.sum())


def hypothesis_probabilities(evidence: list[Evidence]) -> Array:
    """(n,) probabilities that the alpha of a hypothesis is the nearest to the truth; they sum to 1."""
    weights = np.exp(-_POWER * hypothesis_scores(evidence))
    return np.asarray(weights / weights.sum())


def hypothesis_scores(evidence: list[Evidence]) -> Array:
    """(n,) negative log of the weights over the largest, 0 or more, finite where weights underflow."""
    likeliest = min(evidence, key=lambda one: one.cost)
    scores = np.array(
        [
            (one.cost - likeliest.cost) / likeliest.inflation
            + 0.5 * one.parameters * np.log(max(one.pixels / likeliest.inflation, 2.0))
            for one in evidence
        ]
    )
    return np.asarray(scores - scores.min())


def in_observation(values: Array, observation: Observation) -> Array:
    """(h, w) means of a map (H, W) of the picture over the pixels of an observation."""
    scale = round(observation.scale)
    x0, y0 = (round(at - (scale - 1) / 2) for at in observation.origin)
    h, w = observation.weight.shape
    return means(values[y0 : y0 + h * scale, x0 : x0 + w * scale], scale)


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Sweeps that may explain a streak, and the evidence for each."""

    observation: Observation  # the data of all comparisons
    sweeps: tuple[Sweep, ...]  # the likeliest first
    evidence: tuple[Evidence, ...]  # of each sweep
    plate: LinearImage  # in the light that the object left on it, with its error
    streak: Streak  # the part of the picture that moved before that plate
    untried: tuple[str, ...] = ()  # what was not fitted, because the time was over
    # A disc with a pattern, and the evidence for it, if hue does not show the rim
    patterned: tuple[Sweep, Evidence] | None = None

    @property
    def best(self) -> Sweep:
        """The likeliest."""
        return self.sweeps[0]

    @property
    def weights(self) -> Array:
        """(n,) of the sweeps; they sum to 1."""
        return hypothesis_weights(list(self.evidence))

    def best_evidence(self, observation: Observation) -> Evidence:
        """The evidence for the likeliest in another observation."""
        sweep, alpha = self.best, self._best_alpha(observation)
        pixels, radius = observation.pixels, float(sweep.shape[0])
        if sweep.cast is not None:
            S = sweep.cast.missing(sweep.family, sweep.path, radius, pixels)
            observation = replace(observation, B=sweep.cast.on(observation.B, S, alpha))
        return evidence_of(observation, alpha, np.zeros_like(alpha), self.evidence[0].parameters)

    def outside_of_best(self, observation: Observation) -> Observation:
        """An observation with no weight where the likeliest has the object."""
        outside = self._best_alpha(observation) == 0
        return replace(observation, weight=np.where(outside, observation.weight, 0))

    def _best_alpha(self, observation: Observation) -> Array:
        """Alpha of the likeliest in an observation."""
        sweep, pixels = self.best, observation.pixels
        return sweep.silhouette.sweep(sweep.family, sweep.path, sweep.shape, pixels).alpha

    def evidence_of(self, alpha: Array, alpha_std: Array) -> Evidence:
        """The evidence for an alpha (H, W) of the whole picture that has no shape."""
        observation = self.observation
        alpha, alpha_std = (in_observation(x, observation) for x in (alpha, alpha_std))
        return evidence_of(observation, alpha, alpha_std)

"""Weights of hypotheses about alpha, from their marginal likelihoods in one observation.

Every hypothesis, a fitted sweep or an alpha without a shape, is compared in the same light with one
model of color (`model.color_field`), whose colors are marginalized. The error of alpha adds to the
noise, as the light by which alpha changes a pixel,

    V = V_C + (1 − α)² V_B + σ_α² (k̄ − B)²,

so that a hypothesis with an error larger than claimed is unlikely, and a large claim gains little.
Costs are divided by the variance inflation of the likeliest, for residuals are correlated, and every
fitted parameter costs half a log of the number of pixels.

These weights say which hypothesis explains the observation best. No hypothesis is complete: shading,
bounced light and the file leave misfits that say nothing about alpha, and that many pixels share. So
evidence counts by a power η, as in the posteriors of wrong models [Grünwald & van Ommen 2017]. The
power is 1 where the likeliest hypothesis leaves no misfit, for then only noise makes it differ from the
truth. Else it is not known; if it has a gamma distribution, odds fall with the difference s of two
scores as

    ∫ exp(−η s) p(η) dη = (1 + s / s₀)^−c.

The scale s₀ is in proportion to the misfit that the likeliest hypothesis leaves, its variance inflation
above 1. In the same way odds fall with the loss of blocks of pixels to which the colors were not
fitted: a shape that explains noise or shadows by colors of its own predicts them badly. The exponents
c, and the odds of kinds of hypotheses before any comparison, are calibrated (`calibration`): the
probability of a hypothesis is how often its alpha was the nearest to the truth of rendered pictures.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import CORRELATED_PX, DECISIVE_LOG_BAYES_FACTOR, mean_of_blocks
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.calibration import OddsTerms, fitted_calibration
from blurmatte.sweep.model.color_field import AT_REST, ColorField, Light, fit_colors
from blurmatte.sweep.model.observation import Observation, means
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.student_t import loss, student_weight
from blurmatte.sweep.sweep import Sweep

# Units of log likelihood for each pixel by which an alpha without a shape seems likelier, for it was
# fitted to the noise of the same pixels; calibrated on rendered scenes.
OPTIMISM = 0.3

_ODDS_SCALE = 30.0  # s₀, nats, where the variance inflation is 2
_MIN_MISFIT = 0.02  # of the variance inflation above 1: a fit to noise alone leaves as much
_BLOCK_PX = 8  # width of a block of unseen pixels: the node of a color is at most half of it away
# Blocks of four kinds alternate in rows and columns. Colors that are fitted to three kinds predict the
# fourth.
_KINDS_OF_BLOCKS = 4
_NO_TERMS = OddsTerms()


@dataclass(frozen=True)
class Evidence:
    """How well a hypothesis predicts an observation."""

    cost: float  # negative log marginal likelihood
    inflation: float  # of the variance of block sums of its residuals, 1 or more
    parameters: int  # that were fitted, colors apart
    pixels: float  # of the observation
    # Loss of blocks of pixels to which the colors were not fitted; None if that is not known
    unseen: float | None = None
    kind: OddsTerms = _NO_TERMS


def evidence_of(
    observation: Observation,
    alpha: Array,
    alpha_std: Array,
    parameters: int = 0,
    motion: Array = AT_REST,
) -> Evidence:
    """The evidence for an alpha.

    observation: with the plate as the hypothesis has it.
    alpha, alpha_std (h, w): in the observation's pixels; a standard deviation of 0 where alpha has
        a shape, whose error is in its parameters.
    parameters: number of those that were fitted, colors apart.
    motion (2, 2): mean of v vᵀ, v the velocity in the observation's pixels per exposure.
    """
    compared = _Compared.of(observation, alpha, alpha_std, motion)
    observation = compared.observation
    field, e = compared.fitted(observation.weight)
    cost = float((observation.weight * compared.loss(e)).sum()) + field.cost
    chi2, channels = (e**2).sum(axis=0), observation.channels
    limited = np.moveaxis(e * np.sqrt(student_weight(chi2, channels)), 0, -1)
    inside = (compared.alpha > 0) & observation.valid
    inflation = max(
        1.0, *(mean_of_blocks(limited, inside, size, channels) for size in CORRELATED_PX)
    )
    cost += OPTIMISM * float(np.count_nonzero(alpha_std))
    return Evidence(cost, inflation, parameters, float(observation.weight.sum()))


def unseen_loss(
    observation: Observation, alpha: Array, alpha_std: Array, motion: Array = AT_REST
) -> float:
    """The loss of blocks of pixels, with colors that were fitted to other blocks.

    The parameters are those of `evidence_of`.
    """
    compared = _Compared.of(observation, alpha, alpha_std, motion)
    weight = observation.weight
    row, column = (np.arange(n) // _BLOCK_PX % 2 for n in weight.shape)
    kind, total = 2 * row[:, None] + column, 0.0
    for k in range(_KINDS_OF_BLOCKS):
        seen = np.where(kind == k, 0, weight)
        if not (seen * compared.alpha).any():
            seen = weight  # no other block shows the object
        e = compared.fitted(seen)[1]
        total += float((weight * compared.loss(e))[kind == k].sum())
    return total


@dataclass(frozen=True, eq=False)
class _Compared:
    """An alpha, and the light of an observation, a `PixelBox`, in which it is compared with others."""

    observation: Observation  # along the axes of the object's colors
    alpha: Array  # (h, w)
    light: Light  # image, plate, and the variances of both; the first with that by alpha's error
    motion: Array  # (2, 2)
    normalization: Array  # (h, w) nats: of the loss, for a variance that alpha's error increases

    @classmethod
    def of(
        cls, observation: Observation, alpha: Array, alpha_std: Array, motion: Array
    ) -> "_Compared":
        """The parameters are those of `evidence_of`."""
        if observation.light_alone:
            alpha = alpha / max(float(alpha.max()), 1e-12)
        alpha = np.where(alpha > 0.002, np.clip(alpha, 0, 1), 0)  # less is noise of alpha
        observation = observation.along_colors(alpha)
        C, B, V_C, V_B = observation.light
        first = cls(observation, alpha, (C, B, V_C, V_B), motion, np.zeros(alpha.shape))
        if not alpha_std.any():
            return first
        by_alpha = (first.fitted(observation.weight)[0].mean - B) ** 2
        noise = np.maximum(V_C + (1 - alpha)[..., None] ** 2 * V_B, VARIANCE_FLOOR)
        added = (alpha_std**2)[..., None] * by_alpha
        light = C, B, np.ascontiguousarray(V_C + added), V_B
        return cls(observation, alpha, light, motion, 0.5 * np.log1p(added / noise).sum(axis=-1))

    def fitted(self, weight: Array) -> tuple[ColorField, Array]:
        """Colors that are fitted to pixels of this weight (h, w), and residuals (3, h, w) of all."""
        pitch, color = self.observation.pitch, self.observation.color
        return fit_colors(self.light, self.alpha, weight, pitch, color, motion=self.motion)

    def loss(self, e: Array) -> Array:
        """(h, w) nats of residuals (3, h, w)."""
        return loss((e**2).sum(axis=0), self.observation.channels) + self.normalization


def hypothesis_weights(evidence: list[Evidence]) -> Array:
    """(n,) weights that sum to 1: exp(−cost / inflation − ½ p log n) [Schwarz 1978].

    All evidence is of the same observation.
    """
    weights = np.exp(-hypothesis_scores(evidence))
    return np.asarray(weights / weights.sum())


def hypothesis_probabilities(evidence: list[Evidence]) -> Array:
    """(n,) probabilities that the alpha of a hypothesis is the nearest to the truth; they sum to 1.

    They are the weights if the likeliest hypothesis leaves no misfit.
    """
    if leaves_only_noise(evidence):
        return hypothesis_weights(evidence)
    against = fitted_calibration().log_odds_against
    log_odds = -np.array([against(terms) for terms in odds_terms(evidence)])
    weights = np.exp(log_odds - log_odds.max())
    return np.asarray(weights / weights.sum())


def odds_terms(evidence: list[Evidence]) -> list[OddsTerms]:
    """What counts against each hypothesis, of which the likeliest leaves a misfit."""
    scores, losses = hypothesis_scores(evidence), [one.unseen for one in evidence]
    known = [loss for loss in losses if loss is not None]
    unseen = np.zeros(len(losses))
    if len(known) == len(losses):
        unseen = np.array(known) - min(known)
    scale = _ODDS_SCALE * _misfit(evidence)
    logs = np.log1p(np.stack([scores, unseen], axis=1) / scale).tolist()
    return [
        replace(one.kind, seen=seen, unseen=unseen)
        for one, (seen, unseen) in zip(evidence, logs, strict=True)
    ]


def leaves_only_noise(evidence: list[Evidence]) -> bool:
    """Whether the likeliest hypothesis leaves no misfit: then no calibrated odds are needed."""
    return _misfit(evidence) <= _MIN_MISFIT


def is_decisively_likelier(one: Evidence, other: Evidence) -> bool:
    """Whether misfits that both may have do not explain why one is likelier than another.

    The scores must differ by more than the scale s₀ on which odds fall, and decisively without misfit.
    """
    pair = [one, other]
    least = max(DECISIVE_LOG_BAYES_FACTOR, _ODDS_SCALE * _misfit(pair))
    return bool(np.diff(hypothesis_scores(pair)).item() > least)


def _misfit(evidence: list[Evidence]) -> float:
    """Variance inflation above 1 of the likeliest."""
    scores = hypothesis_scores(evidence)
    return evidence[int(np.argmin(scores))].inflation - 1


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


def with_odds(
    evidence: Evidence, observation: Observation, sweep: Sweep, has_pattern: bool
) -> Evidence:
    """Evidence for a sweep with its kind, and how its colors predict unseen pixels.

    That is not known of a pattern.
    """
    shape = sweep.silhouette
    kind = OddsTerms(
        varied=float(sweep.model.rank > 1),
        curved=float(len(sweep.path) - LINE.size),
        growing=float(shape.is_disc and shape.has("rates")),
        outline=float(not shape.is_disc),
    )
    unseen = None
    if not has_pattern:
        observation, alpha = _seen_with(observation, sweep)
        unseen = unseen_loss(observation, alpha, np.zeros_like(alpha), _motion(sweep, observation))
    return replace(evidence, unseen=unseen, kind=kind)


def _seen_with(observation: Observation, sweep: Sweep) -> tuple[Observation, Array]:
    """An observation with the plate in the shadow of a sweep, and the alpha of that in it."""
    alpha = sweep.silhouette.sweep(sweep.family, sweep.path, sweep.shape, observation.pixels).alpha
    if sweep.cast is None:
        return observation, alpha
    radius = sweep.silhouette.value("radius", sweep.shape)
    S = sweep.cast.missing(sweep.family, sweep.path, radius, observation.pixels)
    return replace(observation, B=sweep.cast.on(observation.B, S, alpha)), alpha


def _motion(sweep: Sweep, observation: Observation) -> Array:
    """(2, 2) mean of v vᵀ, v the velocity in an observation's pixels per exposure."""
    return sweep.family.motion(sweep.path, observation.scale)


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
    sweeps: tuple[Sweep, ...]  # the one first that is expected to be the nearest to the truth
    evidence: tuple[Evidence, ...]  # of each sweep
    plate: LinearImage  # in the light that the object left on it, with its error
    streak: Streak  # the part of the picture that moved before that plate
    untried: tuple[str, ...] = ()  # what was not fitted, because the time was over

    @property
    def best(self) -> Sweep:
        """The first."""
        return self.sweeps[0]

    def best_evidence(self, observation: Observation) -> Evidence:
        """The evidence for the best in another observation."""
        observation, alpha = _seen_with(observation, self.best)
        motion, fitted = _motion(self.best, observation), self.evidence[0].parameters
        return evidence_of(observation, alpha, np.zeros_like(alpha), fitted, motion)

    def outside_of_best(self, observation: Observation) -> Observation:
        """An observation with no weight where the best has the object."""
        outside = _seen_with(observation, self.best)[1] == 0
        return replace(observation, weight=np.where(outside, observation.weight, 0))

    def evidence_of(self, alpha: Array, alpha_std: Array) -> Evidence:
        """The evidence for an alpha (H, W) of the whole picture that has no shape.

        It moved as the best shape did.
        """
        alpha, alpha_std = (in_observation(x, self.observation) for x in (alpha, alpha_std))
        motion = _motion(self.best, self.observation)
        return evidence_of(self.observation, alpha, alpha_std, motion=motion)

    def unseen_loss(self, alpha: Array, alpha_std: Array) -> float:
        """As the function of that name, of an alpha (H, W) of the whole picture."""
        alpha, alpha_std = (in_observation(x, self.observation) for x in (alpha, alpha_std))
        motion = _motion(self.best, self.observation)
        return unseen_loss(self.observation, alpha, alpha_std, motion)

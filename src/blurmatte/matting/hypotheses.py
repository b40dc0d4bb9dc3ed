"""Average of hypotheses: sweeps, and alpha without a shape, weighted by their evidence.

An object may hide nothing, and only add light. In this file C is the image's light, B the plate's, and
χ the part of the exposure during which the object was at a pixel. An opacity of 0 ± s gives alpha the
error s χ, and with it the light C − B the error s χ B.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import ClassVar

import numpy as np

from blurmatte.checks import Array, Box, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import MARGIN_PX
from blurmatte.matting.averaging import (
    MIN_WEIGHT,
    QUARTILE,
    AlphaEstimate,
    averaged,
    middle_weights,
    with_bounded_errors,
)
from blurmatte.matting.calibration import (
    GRADE_LIMITS,
    MIN_ALPHA,
    HypothesisSummary,
    calibrated,
    claimed_error,
    error_terms,
    grade_of,
    graded,
    on_streak,
    reasons,
)
from blurmatte.matting.case import Answer, Case, Solver
from blurmatte.matting.fitted_hypothesis import FittedHypothesis, OnPath, Shapeless
from blurmatte.matting.maps import Grade, PixelMaps, Quality, has_flag
from blurmatte.matting.mixtures import Mixtures
from blurmatte.matting.object_light import inpaint_light
from blurmatte.matting.pixelwise import closed_form
from blurmatte.matting.smooth import Smooth, posterior_variance
from blurmatte.matting.stats import SolutionStats, SweepSummary
from blurmatte.matting.summary import Alternative, ordered, streak_sums
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import dilated
from blurmatte.sweep.assess.calibration import OddsTerms
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    Hypotheses,
    hypothesis_probabilities,
    hypothesis_scores,
    hypothesis_weights,
)
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.hypotheses import HYPOTHESES, Hypothesis, is_explained
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.priors import OpacityPrior

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage

ROUNDING_OF_ALPHA = 1e-9  # where alphas cancel; less than any alpha that is known
# The error of an alpha without a shape, over that of its posterior, by which its evidence is bounded
_ERROR_FACTORS = 0.5, 1.0, 2.0, 4.0
_MARGIN_PX = 4  # around the streak: light that is too faint for its mask


@dataclass(frozen=True, eq=False)
class WeightedHypotheses:
    """Weighted hypotheses: shapes in the order of `Hypotheses`, then those without a shape."""

    shapes: list[OnPath]
    shapeless: list[Shapeless]
    possible: list[bool]  #: of all, whether the mixtures of the streak permit it
    weights: Array  #: (n,) probabilities, which sum to 1 and are 0 of what is impossible
    box: Box
    estimates: list[AlphaEstimate]  #: of all, in the box

    @classmethod
    def of(cls, case: Case, without_shape: bool) -> "WeightedHypotheses":
        """Sweeps of a case, and perhaps hypotheses without a shape."""
        assert case.hypotheses is not None
        known, mixtures = case.hypotheses, Mixtures.of(case)
        box = case.box_with(known.sweeps)
        shapes = [OnPath.of(*one) for one in zip(known.sweeps, known.evidence, strict=True)]
        estimates = [one.within(box) for one in shapes]
        possible = [mixtures.permit(one.alpha, box) for one in estimates]
        shapeless: list[Shapeless] = []
        if without_shape:
            _LOG.info("solving alpha without a shape")
            shapeless = _without_shape(case, mixtures, possible)
        estimates += [one.within(box) for one in shapeless]
        possible += [mixtures.permit(one.alpha, box) for one in estimates[len(shapes) :]]
        if case.is_exact or not any(possible):
            possible = [True] * len(estimates)
        # A color on the wrong side of the plate makes every alpha negative, at a good fit.
        shown = [bool(on_streak(one.alpha, one.alpha_std).any()) for one in estimates]
        possible = [a and b for a, b in zip(possible, shown, strict=True)]
        if not any(possible):
            possible = [True] * len(estimates)
        can = iter(possible)
        shapes = [one if next(can) else one.made_impossible for one in shapes]
        shapeless = [one if next(can) else one.made_impossible for one in shapeless]
        weights = np.zeros(len(possible))
        evidence = [one.evidence for one in (*shapes, *shapeless)]
        weights[possible] = hypothesis_probabilities(list(compress(evidence, possible)))
        return cls(shapes, shapeless, possible, weights, box, estimates)

    @property
    def all(self) -> list[FittedHypothesis]:
        """In the order of the weights."""
        return [*self.shapes, *self.shapeless]

    @property
    def best(self) -> FittedHypothesis:
        """What the answer is named after: the first possible shape, or the likeliest without one."""
        return self.all[self._index_of_best]

    @property
    def _index_of_best(self) -> int:
        shapes = len(self.shapes)
        if self.has_shape:
            return int(np.argmax(self.possible))
        return shapes + int(np.argmax(self.weights[shapes:]))

    @property
    def has_shape(self) -> bool:
        """Whether the shapes together are likelier than what has none."""
        return float(self.weights[: len(self.shapes)].sum()) > 0.5

    @property
    def scores(self) -> Array:
        """(n,) differences of evidence from the likeliest, nats, which the weights are made from."""
        return hypothesis_scores([one.evidence for one in self.all])

    def shape_log_odds(self) -> tuple[float, float]:
        """Log odds of the likeliest disc against an outline, and of a shape against none.

        Outlines are not fitted where a disc leaves nothing to explain: then an ellipse would be less
        likely by the price of its two parameters.
        """
        scores = self.scores
        is_disc = np.array([one.sweep.silhouette.is_disc for one in self.shapes])
        shapes, others = scores[: len(is_disc)], scores[len(is_disc) :]
        no_shape = float(others.min() - shapes.min()) if len(others) else 0.0
        if not np.any(is_disc):
            return -np.inf, no_shape
        disc = self.all[int(np.argmax(is_disc))].evidence
        price = float(np.log(max(disc.pixels / disc.inflation, 2.0)))
        if not np.all(is_disc):
            price = float(shapes[~is_disc].min() - shapes[is_disc].min())
        return price, no_shape

    @property
    def of_likeliest_shapes(self) -> Array:
        """(n,) weights of the shapes, for errors that are known of those that fit best."""
        return hypothesis_weights([one.evidence for one in self.shapes])

    def between_shapes(self, observation: Observation) -> Array:
        """Covariance (n, n) of the parameters of the first shape between the shapes that count.

        It is 0 if the first leaves no residuals: others then differ from it by their noise.
        """
        first = self.shapes[0].sweep
        known = first.diagnostics
        between = np.zeros_like(first.covariance)
        if not is_explained(observation, known.variance_inflation, known.residual_excess):
            weights = self.weights[: len(self.shapes)]
            weights = np.where(weights < MIN_WEIGHT, 0, weights)
            changes = np.stack([first.change_to(one.sweep) for one in self.shapes])
            between = np.asarray((changes.T * weights) @ changes / max(weights.sum(), MIN_WEIGHT))
        return between

    @property
    def opacity_error(self) -> float:
        """Relative standard deviation of the opacity of the shapes, which calibrations do not know."""
        return self._over_shapes([one.opacity_error for one in self.shapes])

    @property
    def even_opacity_error(self) -> float:
        """The same if letting light through is as usual as being solid."""
        return self._over_shapes([one.even_opacity_error for one in self.shapes])

    def _over_shapes(self, errors: Sequence[float]) -> float:
        """The root mean square of errors of the shapes."""
        return float(np.sqrt(self.of_likeliest_shapes @ np.square(errors)))

    @property
    def assumed_error(self) -> tuple[Array, float]:
        """Standard deviations of alpha and of its sum by what was assumed, not in calibrations."""
        pairs = [one.sweep.assumed_error(self.box) for one in self.shapes]
        weights = self.of_likeliest_shapes * float(self.weights[: len(pairs)].sum())
        alpha, total = (np.array(values) for values in zip(*pairs, strict=True))
        return np.sqrt(np.tensordot(weights, alpha**2, 1)), float(np.sqrt(weights @ total**2))

    def with_open_errors(self, average: AlphaEstimate) -> AlphaEstimate:
        """A calibrated average with errors that it does not know; none beyond that of a fraction."""
        assumed, sum_assumed = self.assumed_error
        return with_bounded_errors(
            replace(
                average,
                alpha_std=np.hypot(average.alpha_std, assumed),
                sum_std=float(np.hypot(average.sum_std, sum_assumed)),
                scale_std=float(np.hypot(average.scale_std, self.opacity_error)),
            )
        )

    @property
    def summaries(self) -> list[HypothesisSummary]:
        """Of all, for the calibration."""
        return [
            HypothesisSummary(float(w), one.colors.rank, one.has_shape, one.evidence.inflation)
            for w, one in zip(self.weights, self.all, strict=True)
        ]

    def alternatives(
        self, average: AlphaEstimate, pictures: tuple[LinearImage, LinearImage]
    ) -> list[Alternative]:
        """The listed hypotheses; of gray pictures shapes alone, for others know no alpha."""
        gray = pictures[0].meta.one_channel
        found = [
            one.alternative(weight, estimate, average, pictures, self.box)
            for one, weight, estimate in zip(self.all, self.weights, self.estimates, strict=True)
            if one.has_shape or not gray
        ]
        return ordered(found, self.weights[: len(found)], 0 if gray else self._index_of_best)


@dataclass(frozen=True)
class Swept(Solver):
    """Alpha from path and silhouette of the whole streak, fitted together with its color.

    Parameters
    ----------
    hypotheses : tuple of Hypothesis
        The shapes on paths that compete.
    seconds : float
        CPU time after which no further shape is fitted; `SolutionStats.untried` names those that were
        not. What is fitted then depends on the machine.
    opacity : OpacityPrior
        What is known of the part of the light behind the object that it hides.

    Examples
    --------
    >>> answer = bm.solve(image, plate, solution.model, bm.Swept())
    >>> print(answer.sweep)
    Sweep(disc on a line, 59.6 px long, radius 10.01 ± 0.01 px, #ffc046, rank 1)
    """

    hypotheses: tuple[Hypothesis, ...] = field(default=HYPOTHESES, repr=False)
    seconds: float = field(default=math.inf, repr=False)
    opacity: OpacityPrior = field(default=OpacityPrior.USUAL, repr=False)

    needs_sweep = True
    takes_gray = True
    with_shapeless: ClassVar[bool] = False  #: whether alpha without a shape competes

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Average the hypotheses about a case; of an object that hides nothing, its light."""
        found = case.hypotheses
        if found is not None and found.best.silhouette.opacity == 0:
            return _answer_of_light(case, found, out)
        return _averaged(case, out, self.with_shapeless)

    def without_plate_changes(self) -> "Swept":
        """The same without hypotheses of shadows."""
        kept = tuple(one for one in self.hypotheses if not one.changes_plate)
        return replace(self, hypotheses=kept)


@dataclass(frozen=True)
class Averaged(Swept):
    """As `Swept`, averaged with `Smooth` by their evidence; the parameters are the same.

    Examples
    --------
    >>> solver = bm.matting.Averaged(seconds=10)
    >>> answer = bm.solve(image, plate, solution.model, solver)
    >>> answer.grade
    <Grade.CONFIRMED: 'confirmed'>
    """

    with_shapeless = True


def _averaged(case: Case, out: PixelMaps | None, without_shape: bool) -> Answer:
    """The average of hypotheses, with the solver and the colors of the likeliest one."""
    fitted = case.fitted or case
    found = WeightedHypotheses.of(fitted, without_shape)
    average = averaged(found.estimates, found.weights)
    sweep = found.shapes[0].sweep
    exact = case.is_exact
    # What is impossible says nothing about the error of the rest.
    estimates = list(compress(found.estimates, found.possible))
    summaries = list(compress(found.summaries, found.possible))
    terms = error_terms(average, estimates, summaries, sweep.diagnostics, exact)
    claim, compressed = claimed_error(average), case.is_compressed
    of_shape = claimed_error(found.estimates[0])
    gray = fitted.image.meta.one_channel
    average = calibrated(average, estimates, terms, compressed, exact)
    error = claimed_error(average)
    solid, average = graded(average)[0], found.with_open_errors(average)
    grade, alpha_error = graded(average)
    untried = () if fitted.hypotheses is None else fitted.hypotheses.untried
    is_open = found.even_opacity_error > GRADE_LIMITS[Grade.CONFIRMED][1] or grade is not solid
    limits = {
        "time": bool(untried),
        "convergence": found.has_shape and not sweep.diagnostics.converged,
        "opacity": is_open,
        "gray": gray,
    }
    because = [name for name, holds in limits.items() if holds]
    # Errors are calibrated on pictures in color, with all hypotheses, each at its largest likelihood;
    # that the object is solid is assumed.
    if because and grade is Grade.CONFIRMED:
        grade = Grade.PLAUSIBLE
    # The maps have no other place for an error that may be larger than all others.
    alpha_std = np.hypot(average.alpha_std, found.opacity_error * average.alpha)
    average = with_bounded_errors(replace(average, alpha_std=alpha_std))
    pictures = fitted.image.crop(found.box), fitted.plate.crop(found.box)
    alternatives = found.alternatives(average, pictures)
    if fitted.cells is not None:
        alternatives = [_in_pixels(one, fitted.cells) for one in alternatives]
        found, average = _enlarged(found, average, case, fitted.cells)
    model, maps = _written(found, average, case, out)
    stats = SolutionStats(
        sum_alpha_std=average.sum_std,
        alpha_scale_std=average.scale_std,
        sweep=SweepSummary.of(found.shapes[0].sweep),
        weights=tuple(found.weights.tolist()),
        shape_log_odds=found.shape_log_odds(),
        alternatives=tuple(alternatives),
        claimed_error=claim,
        error_terms=terms,
        grade_reasons=(*because, *reasons(terms, claim, found.weights, compressed, gray)),
        grade=grade,
        alpha_error=alpha_error,
        untried=untried,
    )
    solver = Swept() if found.best.has_shape else Smooth()
    factor = max(error / of_shape, 1.0)
    assert fitted.hypotheses is not None
    between = found.between_shapes(fitted.hypotheses.observation)
    shown = maps, model, maps.solved, stats
    return Answer(*shown, solver, factor, between, locates=found.has_shape, assumes="")


def _written(
    found: WeightedHypotheses, average: AlphaEstimate, case: Case, out: PixelMaps | None
) -> tuple[ColorModel, PixelMaps]:
    """Colors of the likeliest hypothesis, and maps with the average and its light."""
    box, best = found.box, found.best
    maps = closed_form(case, box, out)
    pictures = case.within(box)
    best.write(maps, average, pictures, box)
    inpaint_light(maps.within(box), *pictures[:2])
    return case.model if case.is_exact else best.colors, maps


def _enlarged(
    found: WeightedHypotheses, average: AlphaEstimate, case: Case, size: FittingSize
) -> tuple[WeightedHypotheses, AlphaEstimate]:
    """Hypotheses and their average at full size.

    To alpha of the average, interpolated, every shape adds the difference of its alpha at full size
    from its own interpolated alpha. Alpha without a shape has no detail finer than a cell: the
    difference of interpolated and constant cells is an error.
    """
    small, shapes = found.box, found.shapes
    box = size.enlarged_box(small)
    known = np.isfinite(average.alpha_std)
    weights = middle_weights(found.estimates, found.weights)
    rest = np.where(known, average.alpha, 0)
    for weight, estimate in zip(weights[: len(shapes)], found.estimates, strict=False):
        rest = rest - weight * np.where(known, estimate.alpha, 0)
    alpha = size.interpolated(rest, small)
    std = size.interpolated(np.where(known, average.alpha_std, 0), small)
    if weights[len(shapes) :].any():
        std = np.hypot(std, alpha - size.repeated(rest, small))
    shapes = [one.enlarged(size) for one in shapes]
    shapeless = [one.enlarged(size) for one in found.shapeless]
    sweeps = [one.sweep for one in shapes]
    for weight, sweep in zip(weights[: len(shapes)], sweeps, strict=True):
        if weight.any():
            alpha += size.interpolated(weight, small) * sweep.alpha_within(box)
    alpha[np.abs(alpha) < ROUNDING_OF_ALPHA] = 0
    std[~size.repeated(known, small)] = np.inf
    around, box = box, case.box_with(sweeps)
    place = rows_columns(box, around)
    sum_std = size.cell**2 * average.sum_std
    total = AlphaEstimate(alpha[place], std[place], sum_std, average.scale_std)
    found = replace(found, shapes=shapes, shapeless=shapeless, box=box)
    return found, total


def _in_pixels(one: Alternative, size: FittingSize) -> Alternative:
    """An alternative whose radius was in cells."""
    return one if one.radius is None else replace(one, radius=size.cell * one.radius)


def _without_shape(case: Case, mixtures: Mixtures, possible: list[bool]) -> list[Shapeless]:
    """Hypotheses with the likeliest line of colors, and the likeliest plane if that is likelier.

    The likeliest colors are those of the sweep with the most evidence, whose alpha need not be the
    nearest to the truth. Where mixtures lie beyond the line, or disprove the sweep that it is from, the
    line through the farthest mixture takes its place. possible: for each sweep.
    """
    assert case.hypotheses is not None
    evidence = case.hypotheses.evidence
    if case.is_exact:
        return [_shapeless(case, evidence)]
    rivals = list(compress(evidence, possible))
    models: dict[int, ColorModel] = {}
    for i in np.argsort(hypothesis_scores(list(evidence)), kind="stable"):
        model, permitted = case.hypotheses.sweeps[i].model, possible[i]
        if model.rank < 3 and model.rank not in models:
            if model.rank == 1 and not (permitted and mixtures.reach(model.pole)):
                model = mixtures.farthest(model.to_srgb) or model
            models[model.rank] = model
        if model.rank == 1:
            break
    return [_shapeless(replace(case, model=model), rivals) for model in models.values()]


def _shapeless(case: Case, rivals: Sequence[Evidence]) -> Shapeless:
    """Alpha by `Smooth` with the colors of the case.

    rivals: evidence of the shapes that are possible. The error of alpha is simulated only if alpha can
    enter the mean against them, with any of `_ERROR_FACTORS`: else it is that of the posterior, for
    simulations take most of the time of `Smooth`. The posterior of alpha from texture alone, of a
    model of rank 3, does not have the error by the object's own texture.
    """
    solver = Smooth()
    fit = solver.fitted(case)
    if rivals and case.model.rank < 3:
        quick = solver.answer_with(case, fit, posterior_variance(fit), np.inf)
        if not _may_enter_mean(case, quick, rivals):
            return _shapeless_of(case, quick)
    return _shapeless_of(case, solver.answer_with(case, fit, *solver.simulated_error(fit)))


def _may_enter_mean(case: Case, answer: Answer, rivals: Sequence[Evidence]) -> bool:
    """Whether alpha without a shape could enter the mean, if its error had another size."""
    assert case.hypotheses is not None
    alpha, std = _known_alpha(case, answer.maps)[:2]
    trials = [case.hypotheses.evidence_of(alpha, factor * std) for factor in _ERROR_FACTORS]
    losses = [one.unseen for one in rivals if one.unseen is not None]
    best = min(losses, default=None)  # of its own loss nothing is known
    trials = [replace(one, unseen=best, kind=_kind(case.model)) for one in trials]
    return any(hypothesis_probabilities([*rivals, one])[-1] >= QUARTILE for one in trials)


def _shapeless_of(case: Case, answer: Answer) -> Shapeless:
    """An answer of `Smooth` with its evidence."""
    assert case.hypotheses is not None
    alpha, std, scale_std = _known_alpha(case, answer.maps)
    known, box = case.hypotheses, case.grown_streak.around(MARGIN_PX)
    unseen = known.unseen_loss(alpha, std)
    evidence = replace(known.evidence_of(alpha, std), unseen=unseen, kind=_kind(case.model))
    near, sum_std = answer.maps.within(box).copied, answer.stats.sum_alpha_std or 0.0
    return Shapeless(evidence, case.model, near, box, sum_std, scale_std)


def _kind(colors: ColorModel) -> OddsTerms:
    """Of alpha without a shape."""
    return OddsTerms(varied=float(colors.rank > 1), shapeless=1.0)


def _known_alpha(case: Case, maps: PixelMaps) -> tuple[Array, Array, float]:
    """Alpha and its error (H, W), 0 where unknown; the relative error of all by the color."""
    sums = streak_sums(maps, case.model, case.image, case.plate, case.streak)
    std = np.hypot(maps.alpha_std, sums.alpha_scale_std * maps.alpha)
    known = np.isfinite(std) & ~has_flag(maps.quality, Quality.OUTSIDE)
    return np.where(known, maps.alpha, 0), np.where(known, std, 0), sums.alpha_scale_std


def _answer_of_light(case: Case, found: Hypotheses, out: PixelMaps | None) -> Answer:
    """Light and errors of an object that hides nothing.

    The light of a clipped pixel is the least that it may be, and its error as large.

    out: arrays to write to.
    """
    sweep, size = found.best, case.image.size
    maps = PixelMaps.zeros(*size[::-1], case.image.rgb.dtype) if out is None else out
    for values in maps[:4]:
        values[...] = 0
    maps.quality[...] = case.flags | np.uint8(Quality.OUTSIDE)
    box = case.box_with([sweep])
    place, near = rows_columns(box), maps.within(box)
    image, plate = case.image.crop(box), case.plate.crop(box)
    chi = sweep.covered_within(box)
    inside = dilated(case.streak.mask, _MARGIN_PX)[place] | (chi > MIN_ALPHA)
    error = sweep.opacity_std * chi
    light = image.rgb - plate.rgb
    std = np.sqrt(image.variance + plate.variance + (plate.rgb * error[..., None]) ** 2)
    known = (image.valid & plate.valid)[..., None]
    std = np.where(known, std, np.maximum(std, np.abs(light)))
    near.quality[inside] &= ~np.uint8(Quality.OUTSIDE)
    for target, values in zip(near[1:4], (error, light, std), strict=True):
        target[inside] = values[inside]
    of_streak = error[inside & (chi > MIN_ALPHA)]
    alpha_error = float(np.sqrt(np.mean(of_streak**2))) if of_streak.size else 0.0
    grade, untried = grade_of(alpha_error, 0.0), found.untried
    because = () if grade is Grade.CONFIRMED else ("opacity",)
    if untried:
        because = ("time", *because)
        grade = Grade.PLAUSIBLE if grade is Grade.CONFIRMED else grade
    stats = SolutionStats(
        sum_alpha_std=float(error.sum()),
        alpha_scale_std=0.0,
        sweep=SweepSummary.of(sweep),
        claimed_error=alpha_error,
        grade_reasons=because,
        grade=grade,
        alpha_error=alpha_error,
        untried=untried,
    )
    shown = maps, sweep.model, maps.solved, stats
    return Answer(*shown, Swept(), locates=True, assumes="", separates_shadow=True)

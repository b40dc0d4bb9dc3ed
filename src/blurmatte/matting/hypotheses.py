"""Average of hypotheses: sweeps, and alpha without a shape, weighted by their evidence."""

import logging
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from blurmatte.checks import Array, Box, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.matting.alternatives import Alternative, alternative, listed
from blurmatte.matting.averaging import MIN_WEIGHT, AlphaEstimate, averaged, with_bounded_errors
from blurmatte.matting.calibration import (
    GRADE_LIMITS,
    HypothesisSummary,
    calibrated,
    claimed_error,
    error_terms,
    graded,
    reasons,
)
from blurmatte.matting.case import MARGIN_PX, Answer, Case, Solver
from blurmatte.matting.inpainting import inpaint_light
from blurmatte.matting.maps import Grade, PixelMaps, Quality, has_flag
from blurmatte.matting.mixtures import Mixtures
from blurmatte.matting.object_light import light_given
from blurmatte.matting.pixelwise import closed_form
from blurmatte.matting.smooth import Smooth
from blurmatte.matting.stats import SolutionStats, SweepSummary
from blurmatte.matting.summary import streak_sums
from blurmatte.matting.swept import write_swept
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    hypothesis_scores,
    hypothesis_weights,
)
from blurmatte.sweep.assess.opacity import MOVED_ODDS
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.sweep import Sweep

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage

_IMPOSSIBLE_COST = 1e9  # nats, more than evidence ever differs by
ROUNDING_OF_ALPHA = 1e-9  # where alphas cancel; less than any alpha that is known


@dataclass(frozen=True, eq=False)
class _Shapeless:
    """Alpha by `Smooth` with some colors, the maps of its box, and its evidence."""

    model: ColorModel
    maps: PixelMaps
    box: Box
    sum_std: float
    scale_std: float
    evidence: Evidence

    def within(self, box: Box) -> AlphaEstimate:
        """Its alpha in a box."""
        inside = ~has_flag(self.maps.quality, Quality.OUTSIDE)
        both = [max(a, b) for a, b in zip(self.box[:2], box[:2], strict=True)]
        both += [min(a, b) for a, b in zip(self.box[2:], box[2:], strict=True)]
        alpha, std = np.zeros((2, box[3] - box[1], box[2] - box[0]))
        for values, source in ((alpha, self.maps.alpha), (std, self.maps.alpha_std)):
            own = np.where(inside, source, 0)[rows_columns(both, self.box)]
            values[rows_columns(both, box)] = own
        return AlphaEstimate(alpha, std, self.sum_std, self.scale_std)


@dataclass(frozen=True, eq=False)
class _WeightedHypotheses:
    """Weighted hypotheses: sweeps, the likeliest first, then those without a shape."""

    sweeps: list[Sweep]
    shapeless: list[_Shapeless]
    evidence: list[Evidence]
    possible: list[bool]  #: whether the mixtures of the streak permit it
    weights: Array  #: (n,); they sum to 1, and are 0 of what is impossible
    box: Box
    estimates: list[AlphaEstimate]  #: of all, in the box

    @classmethod
    def of(cls, case: Case, without_shape: bool) -> "_WeightedHypotheses":
        """Sweeps of a case, and perhaps hypotheses without a shape."""
        assert case.hypotheses is not None
        sweeps, mixtures = list(case.hypotheses.sweeps), Mixtures.of(case)
        box = case.box_with(sweeps)
        estimates = [_estimate(replace(sweep, opacity_std=0.0), box) for sweep in sweeps]
        possible = [mixtures.permit(one.alpha, box) for one in estimates]
        shapeless: list[_Shapeless] = []
        if without_shape:
            _LOG.info("solving alpha without a shape")
            shapeless = _without_shape(case, mixtures, possible)
        evidence = [*case.hypotheses.evidence, *(one.evidence for one in shapeless)]
        estimates += [one.within(box) for one in shapeless]
        possible += [mixtures.permit(one.alpha, box) for one in estimates[len(sweeps) :]]
        if case.is_exact or not any(possible):
            possible = [True] * len(estimates)
        evidence = [
            one if permitted else replace(one, cost=one.cost + _IMPOSSIBLE_COST)
            for one, permitted in zip(evidence, possible, strict=True)
        ]
        weights = hypothesis_weights(evidence)
        return cls(sweeps, shapeless, evidence, possible, weights, box, estimates)

    @property
    def all(self) -> list[Sweep | _Shapeless]:
        """In the order of the weights."""
        return [*self.sweeps, *self.shapeless]

    @property
    def best(self) -> Sweep | _Shapeless:
        """The one of the largest weight."""
        return self.all[int(np.argmax(self.weights))]

    def shape_log_odds(self) -> tuple[float, float]:
        """Log odds of the likeliest disc against an outline, and of a shape against none.

        Outlines are not fitted where a disc leaves nothing to explain: then an ellipse would be less
        likely by the price of its two parameters.
        """
        scores = hypothesis_scores(self.evidence)
        orders = np.array([sweep.silhouette.order for sweep in self.sweeps])
        shapes, others = scores[: len(orders)], scores[len(orders) :]
        no_shape = float(others.min() - shapes.min()) if len(others) else 0.0
        if not np.any(orders == 1):
            return -np.inf, no_shape
        disc = self.evidence[int(np.argmax(orders == 1))]
        price = float(np.log(max(disc.pixels / disc.inflation, 2.0)))
        if np.any(orders > 1):
            price = float(shapes[orders > 1].min() - shapes[orders == 1].min())
        return price, no_shape

    @property
    def opacity_error(self) -> float:
        """Relative standard deviation of the opacity of the sweeps, which calibrations do not know."""
        relative = [sweep.opacity_std / sweep.silhouette.opacity for sweep in self.sweeps]
        weights = self.weights[: len(relative)]
        return float(np.sqrt(weights @ np.square(relative) / max(float(weights.sum()), 1e-12)))

    @property
    def curve_error(self) -> tuple[Array, float]:
        """Standard deviations of alpha and of its sum by an assumed curve, not in calibrations."""
        pairs = [sweep.curve_error(self.box) for sweep in self.sweeps]
        weights = self.weights[: len(pairs)]
        alpha, total = (np.array(values) for values in zip(*pairs, strict=True))
        return np.sqrt(np.tensordot(weights, alpha**2, 1)), float(np.sqrt(weights @ total**2))

    def with_open_errors(self, average: AlphaEstimate) -> AlphaEstimate:
        """A calibrated average with the errors of curve and opacity; none beyond that of a fraction."""
        by_curve, sum_by_curve = self.curve_error
        return with_bounded_errors(
            replace(
                average,
                alpha_std=np.hypot(average.alpha_std, by_curve),
                sum_std=float(np.hypot(average.sum_std, sum_by_curve)),
                scale_std=float(np.hypot(average.scale_std, self.opacity_error)),
            )
        )

    @property
    def duration_is_open(self) -> bool:
        """Whether the opacity is too uncertain for a confirmed alpha.

        Of an object that moved, as if a part of the exposure were as probable as all of it before the
        picture: the prior alone confirms nothing.
        """
        prior = 1.0 if self.sweeps[0].silhouette.opacity < 1 else MOVED_ODDS
        return bool(self.opacity_error > GRADE_LIMITS[Grade.CONFIRMED][1] * np.sqrt(prior))

    @property
    def summaries(self) -> list[HypothesisSummary]:
        """Of all, for the calibration."""
        return [
            HypothesisSummary(float(w), one.model.rank, isinstance(one, Sweep), known.inflation)
            for w, one, known in zip(self.weights, self.all, self.evidence, strict=True)
        ]


def shape_log_odds(case: Case) -> tuple[float, float]:
    """As `_WeightedHypotheses.shape_log_odds`, of a case that was fitted at full size."""
    return _WeightedHypotheses.of(case, without_shape=True).shape_log_odds()


@dataclass(frozen=True)
class Swept(Solver):
    """Alpha from path and silhouette of the whole streak, fitted together with its color."""

    needs_sweep = True

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Average the sweeps of a case."""
        return _averaged(case, out, without_shape=False)


@dataclass(frozen=True)
class Averaged(Solver):
    """Sweeps and `Smooth`, averaged by their evidence."""

    needs_sweep = True

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Average the sweeps of a case, and alpha without a shape."""
        return _averaged(case, out, without_shape=True)


def _averaged(case: Case, out: PixelMaps | None, without_shape: bool) -> Answer:
    """The average of hypotheses, with the solver and the colors of the likeliest one."""
    fitted = case if case.fitted is None else case.fitted.case
    found = _WeightedHypotheses.of(fitted, without_shape)
    average = averaged(found.estimates, found.weights)
    diagnostics = found.sweeps[0].diagnostics
    exact = case.is_exact
    # What is impossible says nothing about the error of the rest.
    estimates = list(compress(found.estimates, found.possible))
    summaries = list(compress(found.summaries, found.possible))
    terms = error_terms(average, estimates, summaries, diagnostics, exact)
    claim, compressed = claimed_error(average), case.is_compressed
    average = calibrated(average, estimates, terms, compressed, exact)
    error = claimed_error(average)
    average = found.with_open_errors(average)
    grade, alpha_error = graded(average)
    because = reasons(terms, claim, found.weights, compressed)
    if found.duration_is_open:
        because = ["duration", *because]
        grade = Grade.PLAUSIBLE if grade is Grade.CONFIRMED else grade
    # The maps have no other place for an error that may be larger than all others.
    alpha_std = np.hypot(average.alpha_std, found.opacity_error * average.alpha)
    average = with_bounded_errors(replace(average, alpha_std=alpha_std))
    pictures = fitted.image.crop(found.box), fitted.plate.crop(found.box)
    alternatives = _alternatives(found, average, pictures)
    if case.fitted is not None:
        size = case.fitted.size
        alternatives = [_in_pixels(one, size) for one in alternatives]
        found, average = _enlarged(found, average, case, size)
    model, maps = _written(found, average, case, out)
    stats = SolutionStats(
        sum_alpha_std=average.sum_std,
        alpha_scale_std=average.scale_std,
        sweep=SweepSummary.of(found.sweeps[0]),
        weights=tuple(found.weights.tolist()),
        shape_log_odds=found.shape_log_odds(),
        alternatives=tuple(alternatives),
        claimed_error=claim,
        error_terms=terms,
        grade_reasons=tuple(because),
        grade=grade,
        alpha_error=alpha_error,
    )
    locates = isinstance(found.best, Sweep)
    solver, factor = Swept() if locates else Smooth(), max(error / claim, 1.0)
    return Answer(maps, model, maps.solved, stats, solver, factor, locates=locates, assumes="")


def _written(
    found: _WeightedHypotheses, average: AlphaEstimate, case: Case, out: PixelMaps | None
) -> tuple[ColorModel, PixelMaps]:
    """Colors of the likeliest hypothesis, and maps with the average and its light."""
    box, best = found.box, found.best
    maps = closed_form(case, box, out)
    C, B, mixed = case.within(box)
    model = best.model
    if isinstance(best, Sweep):
        model = case.model if case.is_exact else model
        write_swept(maps, best, average, C, mixed.with_edge_variance(B), box)
    else:
        _write(maps, best, average, C, B, box)
    inpaint_light(maps.within(box), C, B)
    return model, maps


def _enlarged(
    found: _WeightedHypotheses, average: AlphaEstimate, case: Case, size: FittingSize
) -> tuple[_WeightedHypotheses, AlphaEstimate]:
    """Hypotheses and their average at full size.

    To alpha of the average, interpolated, every shape adds the difference of its alpha at full size
    from its own interpolated alpha. Alpha without a shape has no detail finer than a cell: the
    difference of interpolated and constant cells is an error.
    """
    assert case.hypotheses is not None
    sweeps, small = list(case.hypotheses.sweeps), found.box
    box = size.enlarged_box(small)
    weights = np.where(found.weights < MIN_WEIGHT, 0, found.weights)
    of_shapes = (weights / weights.sum())[: len(sweeps)]
    known = np.isfinite(average.alpha_std)
    rest = np.where(known, average.alpha, 0)
    for weight, estimate in zip(of_shapes, found.estimates, strict=False):
        rest = rest - weight * np.where(known, estimate.alpha, 0)
    alpha = size.interpolated(rest, small)
    std = size.interpolated(np.where(known, average.alpha_std, 0), small)
    if weights[len(sweeps) :].any():
        std = np.hypot(std, alpha - size.repeated(rest, small))
    for weight, sweep in zip(of_shapes, sweeps, strict=True):
        if weight > 0:
            alpha += weight * sweep.alpha_within(box)
    alpha[np.abs(alpha) < ROUNDING_OF_ALPHA] = 0
    std[~size.repeated(known, small)] = np.inf
    around, box = box, case.box_with(sweeps)
    place = rows_columns(box, around)
    sum_std = size.cell**2 * average.sum_std
    total = AlphaEstimate(alpha[place], std[place], sum_std, average.scale_std)
    shapeless = [_in_picture(one, size) for one in found.shapeless]
    return replace(found, sweeps=sweeps, shapeless=shapeless, box=box), total


def _in_picture(one: _Shapeless, size: FittingSize) -> _Shapeless:
    """A hypothesis about cells with the maps of their pixels, constant over each."""
    alpha, std, P, P_std, quality = one.maps
    alpha, std, P, P_std = (size.repeated(m, one.box) for m in (alpha, std, P, P_std))
    maps = PixelMaps(alpha, std, P, P_std, size.repeated(quality, one.box))
    return replace(one, box=size.enlarged_box(one.box), maps=maps)


def _in_pixels(one: Alternative, size: FittingSize) -> Alternative:
    """An alternative whose radius was in cells."""
    return one if one.radius is None else replace(one, radius=size.cell * one.radius)


def _estimate(sweep: Sweep, box: Box) -> AlphaEstimate:
    """Alpha of a sweep in a box."""
    return AlphaEstimate(*sweep.within(box), sweep.area_std())


def _alternatives(
    found: _WeightedHypotheses, average: AlphaEstimate, pictures: tuple[LinearImage, LinearImage]
) -> list[Alternative]:
    """The listed hypotheses."""
    kinds = [one if isinstance(one, Sweep) else one.model for one in found.all]
    alternatives = [
        alternative(kind, weight, estimate, average, pictures, found.box)
        for kind, weight, estimate in zip(kinds, found.weights, found.estimates, strict=True)
    ]
    return listed(alternatives, hypothesis_scores(found.evidence))


def _without_shape(case: Case, mixtures: Mixtures, possible: list[bool]) -> list[_Shapeless]:
    """Hypotheses with the likeliest line of colors, and the likeliest plane if that is likelier.

    Where mixtures lie beyond the line, or disprove the sweep that it is from, the line through the
    farthest mixture takes its place. possible: for each sweep.
    """
    assert case.hypotheses is not None
    if case.is_exact:
        return [_shapeless(case)]
    models: dict[int, ColorModel] = {}
    for sweep, permitted in zip(case.hypotheses.sweeps, possible, strict=True):
        model = sweep.model
        if model.rank < 3 and model.rank not in models:
            if model.rank == 1 and not (permitted and mixtures.reach(model.pole)):
                model = mixtures.farthest(model.to_srgb) or model
            models[model.rank] = model
        if model.rank == 1:
            break
    return [_shapeless(replace(case, model=model)) for model in models.values()]


def _shapeless(case: Case) -> _Shapeless:
    """Alpha by `Smooth` with the colors of the case."""
    assert case.hypotheses is not None
    box, answer = case.grown_streak.around(MARGIN_PX), Smooth().answer(case, None)
    maps, sum_std = answer.maps, answer.stats.sum_alpha_std or 0.0
    sums = streak_sums(maps, case.model, case.image, case.plate, case.streak)
    scale_std = sums.alpha_scale_std
    near = maps.within(box)
    std = np.hypot(near.alpha_std, scale_std * near.alpha)
    known = np.isfinite(std) & ~has_flag(near.quality, Quality.OUTSIDE)
    alpha, alpha_std = (np.zeros(maps.alpha.shape) for _ in range(2))
    place = rows_columns(box, (0, 0, *case.image.size))
    alpha[place], alpha_std[place] = np.where(known, near.alpha, 0), np.where(known, std, 0)
    evidence = case.hypotheses.evidence_of(alpha, alpha_std)
    return _Shapeless(case.model, near.copied, box, sum_std, scale_std, evidence)


def _write(
    maps: PixelMaps,
    likeliest: _Shapeless,
    average: AlphaEstimate,
    image: LinearImage,
    plate: LinearImage,
    box: Box,
) -> None:
    """Write an average whose likeliest hypothesis has no shape, and its light."""
    maps.write(likeliest.box, likeliest.maps)
    near = maps.within(box)
    alpha, std = average.alpha, average.alpha_std
    P, P_std, _ = light_given(alpha, std, likeliest.model, image, plate)
    for target, values in zip(near, (alpha, std, P, P_std), strict=False):
        target[...] = values
    near.quality[alpha > 0] &= ~np.uint8(Quality.OUTSIDE)

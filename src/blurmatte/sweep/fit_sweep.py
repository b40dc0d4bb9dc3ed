"""fit_sweep: image, plate and streak → Sweep.

The fits of all `HYPOTHESES` are compared in one observation; `Hypotheses` holds them with their
weights, `fit_sweep` returns the likeliest.
"""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from threadpoolctl import threadpool_limits

from blurmatte.calibration import with_noise
from blurmatte.checks import Array, check_kind
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import check_no_shadow, may_be_shadow
from blurmatte.descent import distinct
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.streaks import (
    Streak,
    check_streak,
    find_streaks,
    require_streaks,
    without_faint,
)
from blurmatte.sweep.assess.diagnostics import sweep_of, unknown_opacity_std
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    Hypotheses,
    evidence_of,
    hypothesis_probabilities,
    hypothesis_scores,
    hypothesis_weights,
    is_decisively_likelier,
    with_odds,
)
from blurmatte.sweep.assess.opacity import Opacity, fit_opacity, may_be_there_in_part
from blurmatte.sweep.fit.codec_loss import before_loss, candidate_before_file
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.multistart import (
    MAX_STEPS,
    Multistart,
    fitted_to_hue,
    half_width_of,
    thin_with_moments,
    with_principal_axes,
    with_varied_colors,
)
from blurmatte.sweep.fit.pattern import fit_pattern, fit_patterns, has_pattern, may_have_pattern
from blurmatte.sweep.fit.ranking import (
    NEGATIVE_LIGHT,
    UNSEEN_END,
    Candidate,
    best_of,
    explained_fraction,
    hue_inflation,
    is_source,
    noise_inflation,
)
from blurmatte.sweep.fit.shadow import in_shadow
from blurmatte.sweep.hypotheses import (
    HYPOTHESES,
    Disc,
    Fits,
    Hypothesis,
    TimeLimit,
    is_explained,
    is_explained_by,
    quick_search,
)
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.lighting import Lighting, fit_lighting
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.sweep.model.priors import MotionPrior, OpacityPrior
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.silhouette import OPAQUE, as_silhouette
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.transfer_fit import curve_covariance, with_unstated_curves

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each hypothesis

Search = Callable[[Streak, LinearImage, LinearImage], Multistart]


# Which streaks are fitted, and which hypotheses are refined and kept.
_MAX_STREAKS = 5  # that are compared
# Of the plate's light that it loses: less hardly changes alpha, and costs a search
_MIN_LOSS = 0.02
# Of a streak in that light: a smaller one justifies a search
_MAX_REMAINING_FRACTION = 0.9
_MIN_REFINED_WEIGHT = 1e-2  # probability of a hypothesis that is refined
# Relative root mean square difference of alpha of two hypotheses
_MIN_ALPHA_DIFFERENCE = 0.01
_MIN_OPACITY = 0.02  # of a shape that is fitted by its alpha
# Of the opacity of an object that lets light through; it is 0.29 if that is open, 0…1
_MAX_OPEN_STD = 0.2
_MIN_HIDING_STDS = 3.0  # opacity over its error from which an object is no source of light
_MAX_KNOWN_STD = 0.03  # of the opacity of a solid object that is known to be solid
_MIN_SOURCE_PX = 0.5  # radius of a source of light: a point that a lens blurs
_MAX_ROUNDS = 8  # of opacity and shape
_MIN_OPACITY_STEP = 0.2  # standard deviations between two rounds
_MAX_SOLID_BLUR = 0.1  # blur of the rim over the radius; shadows are softer


@dataclass(frozen=True, eq=False)
class DiscColors:
    """A disc in a frame of a clip, and what the frame says of its colors."""

    sweep: Sweep
    mean: ColorModel  # the line of the mean color
    axes: Array  # (3, 3) float: columns along the mean color, the largest spread, and the smallest
    # Log Bayes factors of two paints against one, and of any colors against two
    log_odds: tuple[float, float]

    @property
    def normals(self) -> Array:
        """(3, n) perpendicular to the line or plane of colors that this frame decides for alone."""
        two, more = (odds > DECISIVE_LOG_BAYES_FACTOR for odds in self.log_odds)
        return self.axes[:, 3 if more else 2 :] if two else self.mean.normals

    @property
    def plane(self) -> ColorModel:
        """Of two paints: the information on its turn about the mean is twice the log Bayes factor."""
        first, second, _ = self.axes.T
        about_mean = 1 / (2 * max(self.log_odds[0], 0.5))  # radians²; a line has any angle
        covariance = about_mean * np.outer(second, second)
        covariance += np.radians(self.mean.angle_std) ** 2 * np.outer(first, first)
        mean = self.mean
        return ColorModel(self.axes[:, :2], covariance, to_srgb=mean.to_srgb, mean=mean.mean)


def fit_sweep(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    model: ColorModel | None = None,
    *,
    start: Sweep | None = None,
) -> Sweep:
    """Find path, silhouette and color of an object from its streak.

    The likeliest of a disc, an outline, and a disc with the shadow that it casts, on the likeliest
    path. `Sweep.diagnostics` and `Sweep.rejection` assess the fit.

    Parameters
    ----------
    image, plate : LinearImage
        With the object, and without; same size.
    streak : Streak, optional
        Where it moved. If not given, the likeliest streak.
    model : ColorModel, optional
        Prior of the color with its covariance.
    start : Sweep, optional
        Of another frame of a clip, with about the same path elsewhere; a faster start of the fit.

    Returns
    -------
    Sweep

    Raises
    ------
    ColorModelError
        If no model was given and the streak only took light: it may be a shadow.
    MotionError
        If nothing moved.
    ValueError
        If the sizes differ.

    Examples
    --------
    >>> sweep = bm.sweep.fit_sweep(image, plate, streak)
    >>> print(sweep)
    Sweep(disc on a line, 59.6 px long, radius 10.01 ± 0.01 px, #ffc046, rank 1)
    """
    check_streak("streak", streak)
    check_kind("model", model, ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")')
    check_kind("start", start, Sweep | None, "use blurmatte.sweep.fit_sweep(image, plate)")
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = likeliest_streak(image, plate, require_streaks(image, plate), model)
    return fit_hypotheses(image, plate, streak, model, start).best.with_assumed_error


def likeliest_streak(
    image: LinearImage,
    plate: LinearImage,
    streaks: Sequence[Streak],
    model: ColorModel | None = None,
) -> Streak:
    """The streak with the most evidence that a disc explains, less that which it does not explain.

    A moving person may change more pixels than a ball, but no disc explains them. So may a shadow,
    which moves with its object: streaks that add light are preferred.

    image, plate: noise known.
    streaks: the strongest first, which is returned if a disc explains none by more than half.
    model: prior of the color.
    """
    strong = without_faint(streaks[:_MAX_STREAKS])
    if len(strong) < 2:
        return streaks[0]
    is_rough = plate.meta.guess_error is not None  # a loss of light may be texture
    lit = [] if is_rough else [one for one in strong if not may_be_shadow(image, plate, one)]
    scored: list[tuple[float, Streak]] = []
    for streak in lit or strong:
        search = quick_search(streak, image, plate, ColorPrior.of(model).of_one_paint)
        explained = explained_fraction(search.quick())
        scored.append((streak.evidence * (2 * explained - 1), streak))
    score, likeliest = max(scored, key=lambda one: one[0])
    return likeliest if score > 0 else (lit or strong)[0]


def fit_hypotheses(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel | None = None,
    start: Sweep | None = None,
    prior: MotionPrior | None = None,
    hypotheses: Sequence[Hypothesis] = HYPOTHESES,
    seconds: float = math.inf,
    opacity: OpacityPrior = OpacityPrior.USUAL,
) -> Hypotheses:
    """Hypotheses about pictures whose noise is known; parameters as for `fit_sweep` and `solve`.

    Before the plate as it is or, if a hypothesis changes the plate, in the light that the object left
    on it if that is decisively likelier. After `seconds` of CPU time the first is fitted only.
    """

    def search(streak: Streak, image: LinearImage, plate: LinearImage) -> Multistart:
        """Fits before a plate."""
        search = Multistart.of(streak, image, plate, ColorPrior.of(model)).with_prior(prior)
        return search.with_observations(lambda one: replace(one, opacity=opacity))

    request = _FitRequest(image, search, start, hypotheses, TimeLimit(seconds))
    with threadpool_limits(1):  # the matrices are small: threads wait longer than they work
        candidates = request.candidates(request.begun(plate, streak))
        # Without hues a dark object looks like a loss of light.
        if any(one.changes_plate for one in hypotheses) and not image.meta.one_channel:
            candidates = _in_likelier_light(candidates, request)
        found = candidates.refined(request.limit if len(hypotheses) > 1 else None)
    # Nobody can give the color of a black thing in a gray picture.
    may_be_texture = plate.meta.guess_error is not None
    if model is None and not (image.meta.one_channel or may_be_texture or _is_solid(found.best)):
        check_no_shadow(image, plate, streak)
    return found


@dataclass(frozen=True, eq=False)
class _FitRequest:
    """What is fitted to an image, before any plate."""

    image: LinearImage
    search_in: Search
    start: Sweep | None
    hypotheses: Sequence[Hypothesis]
    limit: TimeLimit

    def begun(self, plate: LinearImage, streak: Streak) -> Fits:
        """The discs before a plate, from which all hypotheses start."""
        search, one_paint, varied = _discs(self.search_in(streak, self.image, plate), self.start)
        return Fits(search, self.image, plate, streak, tuple(one_paint), tuple(varied))

    def candidates(self, fits: Fits) -> "_Candidates":
        """All hypotheses, begun from discs; of light alone, if the object hides nothing.

        The object is solid unless the likeliest of these shapes is likelier if it lets light through.
        """
        search, discs = fits.search, (fits.one_paint, fits.varied)
        if _is_known_solid(search.observation):
            return self._fitted(fits)
        state = best_of([kind[0] for kind in discs if kind])
        through = cache(partial(_seen_through, bounds=search.bounds))
        seen_through = through(state)
        if _is_alone_explaining(seen_through, state):
            state = seen_through
        elif not (may_be_there_in_part(state) or _is_plain_source(state)):
            solid = self._fitted(fits)
            opacity = _opacity_of(solid.likeliest.state)
            thin = _likelier_thin(solid, state, seen_through, opacity)
            if thin is None:
                return solid.with_opacity_errors(opacity.solid_std, opacity.even_std)
            state = thin
        hides = _opacity_of(through(state))
        if hides.value > 0:
            one_paint, varied = (tuple(map(through, kind)) for kind in discs)
            return self._fitted(replace(fits, one_paint=one_paint, varied=varied), _with_opacity)
        added = self._of_light(fits, hides.std)
        if added.as_fitted.best.rejection != NEGATIVE_LIGHT:
            return added
        # A source of light takes none: the color is wrong, and says nothing about the opacity.
        return self._fitted(fits)

    def _fitted(
        self, fits: Fits, completed: Callable[[Candidate], Candidate] | None = None
    ) -> "_Candidates":
        return _Candidates.of(fits, self.hypotheses, self.limit, completed)

    def _of_light(self, fits: Fits, std: float) -> "_Candidates":
        """Candidates for the light that was added by an object of the opacity 0 ± std."""
        streak, plate = fits.streak, fits.plate
        light, dark = _light_alone(self.image, plate)
        search = self.search_in(streak, light, dark)
        search = search.with_observations(lambda one: replace(one, light_alone=True))
        search = replace(search, bounds=(min(_MIN_SOURCE_PX, search.bounds[0]), search.bounds[1]))
        search, one_paint, varied = _discs(search, None)
        fits = Fits(search, light, dark, streak, tuple(one_paint), tuple(varied))
        return replace(self._fitted(fits), added_before=(plate, std))


def _in_likelier_light(candidates: "_Candidates", request: _FitRequest) -> "_Candidates":
    """Candidates before the plate in the light that the object left on it, if they are likelier.

    Both are compared with the measured noise: changed light would inflate its estimate. Where other
    frames say where the object is, its own light does not count as light on the plate, and a disc that
    they know is fitted again only in a light in which it is likelier as it is.
    """
    found = candidates.as_fitted
    known = found.best.diagnostics
    if found.observation.light_alone:
        return candidates
    if is_explained(found.observation, known.variance_inflation, known.residual_excess):
        return candidates
    if request.limit.is_over:
        return replace(candidates, untried=(*candidates.untried, "other light on the plate"))
    observation = found.observation.raised(1 / found.observation.noise_inflation)
    outside = observation if observation.prior is None else found.outside_of_best(observation)
    before = found.best_evidence(observation)
    rivals = [(before, candidates)]
    for is_gray in (True, False):
        lit = _lighting_of(request.image, found.plate, found.streak, outside, is_gray)
        if lit is not None:
            rivals += _in_light(found, observation, *lit, request)
    best, others = rivals[int(np.argmax(hypothesis_weights([one for one, _ in rivals])))]
    return others if is_decisively_likelier(best, before) else candidates


def _in_light(
    found: Hypotheses,
    observation: Observation,
    lighting: Lighting,
    rest: Streak,
    request: _FitRequest,
) -> list[tuple[Evidence, "_Candidates"]]:
    """Candidates before the plate in a light, and their evidence with that light; none if impossible.

    found: before the plate as it is, in the observation.
    rest: the streak in that light.
    """
    if found.observation.is_known_disc:
        lit = found.best_evidence(lighting.lit(observation))
        both = [found.best_evidence(observation), replace(lit, cost=lit.cost + lighting.cost)]
        if hypothesis_weights(both)[1] < 0.5:
            return []
    begun = request.begun(lighting.on(found.plate), rest)
    if found.observation.prior is None:  # else its first estimate was around the object
        lighting, begun = _light_around(found, observation, lighting, begun, request)
    # That light holds the shadow of the object.
    shapes = [one for one in request.hypotheses if not one.changes_plate]
    evidence, others = _fitted_in(lighting, begun, observation, request, shapes)
    return [] if math.isinf(evidence.cost) else [(evidence, others)]


def _light_around(
    found: Hypotheses,
    observation: Observation,
    lighting: Lighting,
    begun: Fits,
    request: _FitRequest,
) -> tuple[Lighting, Fits]:
    """The light estimated again without the pixels of a disc, if it is likelier; the discs in it.

    The first estimate knows no object, and may be darker where that is.

    begun: the discs in the first estimate.
    """
    fit = partial(_fitted_in, observation=observation, request=request, shapes=(Disc(),))
    before, disc = fit(lighting, begun)
    outside = disc.as_fitted.outside_of_best(observation)
    grain = observation.grain * half_width_of(begun.streak) / half_width_of(found.streak)
    around = fit_lighting(replace(outside, grain=grain), not lighting.is_colored)
    plate = around.on(found.plate)
    rest = _streak_within(found.streak, request.image, plate)
    if rest is None:
        return lighting, begun
    again = request.begun(plate, rest)
    if math.isfinite(before.cost) and not is_decisively_likelier(fit(around, again)[0], before):
        return lighting, begun
    return around, again


def _fitted_in(
    lighting: Lighting,
    begun: Fits,
    observation: Observation,
    request: _FitRequest,
    shapes: Sequence[Hypothesis],
) -> tuple[Evidence, "_Candidates"]:
    """Shapes in a light, and the evidence for both; its cost is infinite if they are impossible."""
    others = replace(request, hypotheses=shapes).candidates(begun)
    fitted = others.as_fitted
    evidence = fitted.best_evidence(lighting.lit(observation))
    cost = evidence.cost + lighting.cost if lighting.is_possible(fitted.best.alpha) else math.inf
    return replace(evidence, cost=cost), others


def _lighting_of(
    image: LinearImage, plate: LinearImage, streak: Streak, observation: Observation, is_gray: bool
) -> tuple[Lighting, Streak] | None:
    """The light on the plate, estimated without a model of the object, and the streak in that light.

    None if the plate hardly gets darker, the streak hardly smaller, or the light is gray all the same.
    """
    lighting = fit_lighting(observation, is_gray)
    if lighting.change.min() > -_MIN_LOSS or not (is_gray or lighting.is_colored):
        return None
    rest = _streak_within(streak, image, lighting.on(plate))
    if rest is None:
        return None
    width = half_width_of(rest)
    finer = replace(observation, grain=observation.grain * width / half_width_of(streak))
    lighting = fit_lighting(finer, is_gray)
    rest = _streak_within(streak, image, lighting.on(plate))
    if rest is None or rest.mask.sum() > _MAX_REMAINING_FRACTION * streak.mask.sum():
        return None
    return lighting, rest


def _streak_within(streak: Streak, image: LinearImage, plate: LinearImage) -> Streak | None:
    """The strongest streak before this plate that overlaps a streak."""
    parts = [part for part in find_streaks(image, plate) if (part.mask & streak.mask).any()]
    return parts[0] if parts else None


def _likelier_thin(
    solid: "_Candidates", disc: State, thin_disc: State, opacity: Opacity
) -> State | None:
    """A shape that lets light through and is likelier than the solid ones, if there is one.

    Of a disc that is too bright for a surface it is that disc, unless texture shows that the likeliest
    shape hides it: the disc of a stick that moved across itself is too small.

    disc, thin_disc: where another search starts, and `_seen_through` of it.
    opacity: that of the likeliest solid shape.
    """
    state = solid.likeliest.state
    if is_source(disc):
        hides = opacity.thin > _MIN_HIDING_STDS * opacity.thin_std
        return None if hides and not is_source(state) else disc
    if solid.likeliest.cast is not None:  # its cost is that before another plate
        is_likelier = thin_disc is not disc and solid.is_beaten_by(thin_disc)
        return thin_disc if is_likelier else None
    thin = thin_disc
    if state is not disc:
        thin = _seen_through(state, solid.fits.search.bounds, opacity)
    if not (opacity.std <= _MAX_KNOWN_STD and is_explained_by(state)):
        thin = best_of([thin, thin_disc])
    return thin if thin not in (state, disc) and best_of([state, thin]) is thin else None


def _is_plain_source(disc: State) -> bool:
    """Whether a source of one color leaves nothing to explain; of any colors, sticks do so as well."""
    one_paint = disc.observation.color.varied == 1
    return is_source(disc) and one_paint and is_explained_by(disc)


def _is_alone_explaining(thin: State, disc: State) -> bool:
    """Whether a disc leaves nothing to explain if it lets light through, and something if not."""
    if thin is disc or is_explained_by(disc):
        return False
    return best_of([disc, thin]) is thin and is_explained_by(thin)


def _light_alone(image: LinearImage, plate: LinearImage) -> tuple[LinearImage, LinearImage]:
    """The light that was added to a plate, and a black plate."""
    meta = replace(image.meta.of_no_file, transfer=None, transfer_assumed=False)
    noise, valid = image.variance + plate.variance, image.valid & plate.valid
    black = np.zeros_like(plate.rgb)
    return (
        LinearImage(image.rgb - plate.rgb, noise, valid, meta),
        LinearImage(black, black, valid, meta),
    )


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Fits of hypotheses and the evidence for each."""

    fits: Fits
    candidates: list[Candidate]
    evidence: list[Evidence]
    untried: tuple[str, ...]
    # Of the light that an object added: the plate behind it, and the error of its opacity 0
    added_before: tuple[LinearImage, float] | None = None

    @classmethod
    def of(
        cls,
        fits: Fits,
        hypotheses: Sequence[Hypothesis],
        limit: TimeLimit,
        completed: Callable[[Candidate], Candidate] | None = None,
    ) -> "_Candidates":
        """All fits from discs, each completed."""
        untried: tuple[str, ...] = ()
        for hypothesis in hypotheses:
            if not hypothesis.is_worth_fitting(fits):
                continue
            if fits.candidates and limit.is_over:
                untried += (hypothesis.in_words,)
                continue
            _LOG.info("fitting %s", hypothesis.in_words)
            fits = fits.with_fits_of(hypothesis)
        if not fits.candidates:  # none is likelier than the discs that all start from
            fits = fits.with_fits_of(Disc())
        candidates = list(fits.candidates)
        if completed is not None:
            candidates = [completed(one) for one in candidates]
        evidence = [_evidence(fits.search.observation, one) for one in candidates]
        return cls(fits, candidates, evidence, untried)

    @property
    def likeliest(self) -> Candidate:
        """The one of the largest weight."""
        return self.candidates[int(np.argmax(hypothesis_weights(self.evidence)))]

    @property
    def as_fitted(self) -> Hypotheses:
        """Their sweeps, not corrected for the file, in the order of `_sorted`."""
        fits = self.fits
        compared = [
            (sweep_of(one, fits.image), known)
            for one, known in zip(self.candidates, self.evidence, strict=True)
        ]
        sweeps, evidences, _ = self._sorted(compared)
        return Hypotheses(fits.search.observation, sweeps, evidences, fits.plate, fits.streak)

    def is_beaten_by(self, state: State) -> bool:
        """Whether another fit is likelier than all of these."""
        other = _evidence(self.fits.search.observation, Candidate(state))
        return bool(hypothesis_scores([*self.evidence, other])[-1] == 0)

    def with_opacity_errors(self, std: float, even_std: float) -> "_Candidates":
        """The same with errors of the opacity."""
        errors = partial(replace, opacity_std=std, even_opacity_std=even_std)
        return replace(self, candidates=list(map(errors, self.candidates)))

    def refined(self, limit: TimeLimit | None) -> Hypotheses:
        """Their sweeps, the probable ones corrected for their file, in the order of `_sorted`.

        If a disc is the likeliest, and brightness alone shows its rim, a disc with a pattern is one of
        them: shading of another disc may explain it as well.
        limit: of the time; None if there is no such disc.
        """
        search, image = self.fits.search, self.fits.image
        probable = hypothesis_probabilities(self.evidence) > _MIN_REFINED_WEIGHT
        compared = [
            _refined(candidate, known, image, search)
            if is_probable
            else (sweep_of(candidate, image), known)
            for candidate, known, is_probable in zip(
                self.candidates, self.evidence, probable, strict=True
            )
        ]
        sweeps, evidences, fitted = self._sorted(compared)
        untried = self.untried
        if limit is not None and self._may_be_another_disc(fitted[0]):
            if limit.is_over:
                untried += ("a disc with a pattern",)
            else:
                _LOG.info("fitting a disc with a pattern")
                errors = fitted[0].opacity_std, fitted[0].even_opacity_std  # of all solid shapes
                pattern, evidence = _with_pattern(self.fits.disc, search, image)
                pattern = replace(pattern, opacity_std=errors[0], even_opacity_std=errors[1])
                compared.append((sweep_of(pattern, image), evidence))
                more = replace(self, candidates=[*self.candidates, pattern])
                sweeps, evidences, fitted = more._sorted(compared)
        if image.meta.transfer_assumed:
            sweeps = _with_curve_errors(sweeps, evidences, fitted, image, search)
        plate, streak = self.fits.plate, self.fits.streak
        if self.added_before is not None:
            plate, std = self.added_before
            sweeps = tuple(_source(one, std) for one in sweeps)
        return Hypotheses(search.observation, sweeps, evidences, plate, streak, untried)

    def _may_be_another_disc(self, likeliest: Candidate) -> bool:
        """Whether a disc of which hue does not show the rim is the likeliest, without a pattern."""
        disc = self.fits.disc
        if not likeliest.silhouette.is_disc or likeliest.cast is not None:
            return False
        if has_pattern(disc) or not may_have_pattern(disc):
            return False
        return fitted_to_hue(disc, self.fits.search.bounds) is disc

    def _sorted(
        self, compared: Sequence[tuple[Sweep, Evidence]]
    ) -> tuple[tuple[Sweep, ...], tuple[Evidence, ...], tuple[Candidate, ...]]:
        """Different sweeps, evidence, candidates; that first whose alpha is expected nearest the truth.

        Probabilities of sweeps that are nearly the same add up in this expectation. Those that end
        where nothing changed are left out, if there are others.
        compared: of each candidate.
        """
        observation = self.fits.search.observation
        order = np.argsort(hypothesis_scores([one for _, one in compared]), kind="stable")
        by_score = [(*compared[i], self.candidates[i]) for i in order]
        by_score = [one for one in by_score if one[0].rejection != UNSEEN_END] or by_score
        different = distinct(by_score, lambda fit, better: _are_alike(fit[0], better[0]))
        kept = [
            (sweep, with_odds(known, observation, sweep, one.covariance is not None), one)
            for sweep, known, one in different
        ]
        probable = hypothesis_probabilities([known for _, known, _ in kept])
        apart = [[one.rms_difference(other) for other, *_ in kept] for one, *_ in kept]
        order = np.argsort(apart @ probable, kind="stable")
        sweeps, evidences, fitted = zip(*(kept[i] for i in order), strict=True)
        return sweeps, evidences, fitted


def _is_known_solid(observation: Observation) -> bool:
    """Whether no opacity but 1 is possible: if that is known, or other frames know the object."""
    opacity, prior = observation.opacity, observation.prior
    return opacity is OpacityPrior.SOLID or (opacity is OpacityPrior.USUAL and prior is not None)


def _seen_through(state: State, bounds: tuple[float, float], known: Opacity | None = None) -> State:
    """A fit with its opacity, both as each other need: other shapes need not explain the plate in it.

    The shape of a solid object is wrong for one that lets light through, and hides what it lets
    through. So fits start from the opacity that it has if it is not solid, where the plate's texture
    says something about that. `known` is the opacity of the fit, if it is known.
    """
    found = known or _opacity_of(state)
    is_open = found.value == 1 and found.thin_std > _MAX_OPEN_STD
    is_any = state.observation.opacity is OpacityPrior.ANY
    if is_any and state.silhouette.opacity == 1 and not is_open:
        larger = _larger_thin(state, bounds)
        if larger is not None and best_of([state, larger]) is larger:
            return larger
    is_known = found.std <= _MAX_KNOWN_STD and is_explained_by(state)
    if is_open or (found.value == 1 and is_known):
        return state
    return _with_own_opacity(state, found, bounds) or state


def _with_own_opacity(state: State, found: Opacity, bounds: tuple[float, float]) -> State | None:
    """A fit again and again with the opacity that is found for it, first this one; None if solid."""
    fitted = state
    for _ in range(_MAX_ROUNDS):
        opacity = max(found.value if found.value < 1 else found.thin, _MIN_OPACITY)
        if abs(opacity - fitted.silhouette.opacity) <= _MIN_OPACITY_STEP * found.thin_std:
            break
        assert isinstance(fitted.silhouette, FlatShape)
        thin = fitted.of_kind(fitted.silhouette.with_opacity(opacity))
        fitted = minimize(with_principal_axes(thin), bounds, MAX_STEPS, ROUGH_TOLERANCE)
        worse = (fitted.cost - state.cost) / state.variance_inflation
        if found.value == 1 and worse > DECISIVE_LOG_BAYES_FACTOR:
            return None
        found = _opacity_of(fitted)
    return None if found.value == 1 else fitted


def _larger_thin(state: State, bounds: tuple[float, float]) -> State | None:
    """A fit of a larger disc that lets light through; None if that is solid.

    A small solid disc that moved far has nearly the alpha of a large one that lets light through and
    moved less. Neither becomes the other in small steps.
    """
    starts = thin_with_moments(state, (LINE, PARABOLA))
    if not starts:
        return None
    best = best_of([minimize(one, bounds, MAX_STEPS, ROUGH_TOLERANCE) for one in starts])
    return _with_own_opacity(best, _opacity_of(best), bounds)


def _opacity_of(state: State) -> Opacity:
    """The opacity of a fit and its error; 1 ± 0 if it is known to be solid, or of light alone."""
    observation = state.observation
    if _is_known_solid(observation) or observation.light_alone:
        return Opacity(1.0, 0.0)
    found = fit_opacity(state)
    is_open = found.value + found.std < OPAQUE or found.std > 1 - OPAQUE
    return found if is_open else Opacity(1.0, 0.0, even_std=found.even_std)


def _with_opacity(candidate: Candidate) -> Candidate:
    """The candidate with its opacity and the error of that; path and shape are the same.

    Its alpha has the shape of the object, so that the opacity is above 0.
    """
    state, found = candidate.state, _opacity_of(candidate.state)
    silhouette = candidate.silhouette.with_opacity(max(found.value, _MIN_OPACITY))
    if state.silhouette != silhouette:
        state = replace(state.of_kind(silhouette), converged=state.converged)
    return replace(candidate, state=state, opacity_std=found.std, even_opacity_std=found.even_std)


def fit_stretch(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel,
    start: Sweep | None,
    prior: MotionPrior,
) -> tuple[Array, Array]:
    """The stretch (2,) of the disc that explains a streak if it may be an ellipse, and its covariance.

    The stretch is that of the parameters of `Silhouette`; the noise is known.
    """
    search = Multistart.of(streak, image, plate, ColorPrior.of(model))
    search, one_paint, _ = _discs(search.with_prior(prior), start)
    disc = one_paint[0]
    ellipse = disc.of_kind(replace(as_silhouette(disc.silhouette), order=2))
    ellipse = minimize(ellipse, search.bounds, MAX_STEPS, ROUGH_TOLERANCE)
    covariance = ellipse.variance_inflation * VARIANCE * ellipse.inverse_curvature_of("stretch")
    return ellipse.shape[ellipse.silhouette.at("stretch")], covariance


def fit_disc(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel | None = None
) -> Sweep:
    """A disc on a parabola: the quick part of `fit_sweep`, for the frames of a clip.

    The noise is known. Without a model the object has one paint. The result need not explain the
    streak, see `Sweep.rejection`. It is corrected for what a clip's codec removed of its change
    (`codec_loss`), not for colors that the file blurred.
    """
    return _quick_disc(image, plate, streak, model)[2]


def fit_disc_colors(image: LinearImage, plate: LinearImage, streak: Streak) -> DiscColors:
    """As `fit_disc` without a model, or a disc of varied colors if that is decisively likelier.

    Correlated noise looks like a field of colors. Costs are compared with the noise raised to that
    which varied colors leave in the hue of blocks, so that a field that is no stronger gains nothing.
    """
    disc, search, sweep = _quick_disc(image, plate, streak)
    varied = with_varied_colors(disc)
    for _ in range(2):  # the second time with axes along the colors of the first
        varied = minimize(with_principal_axes(varied), search.bounds, MAX_STEPS)
    noisy = varied.observation.raised(hue_inflation(varied))

    def cost(state: State, paints: int) -> float:
        """Of a shape whose colors vary along so many axes, in that noise."""
        color = replace(noisy.color, varied=paints)
        return with_principal_axes(state.relit(replace(noisy, color=color))).cost

    two, mean = cost(varied, 2), sweep.model
    odds = cost(disc, 1) - two, two - cost(varied, 3)
    if odds[0] > DECISIVE_LOG_BAYES_FACTOR:
        mean = sweep_of(Candidate(varied.relit(varied.observation.of_one_paint)), image).model
        sweep = sweep_of(Candidate(varied), image)
    return DiscColors(sweep, mean, varied.observation.color.axes, odds)


def _quick_disc(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel | None = None
) -> tuple[State, Multistart, Sweep]:
    """The disc of a quick search with the noise that it estimates, the search, and the sweep."""
    color = ColorPrior.of(model) if model is not None else ColorPrior.of(None).of_one_paint
    search = quick_search(streak, image, plate, color)
    disc = search.soft()
    inflation = noise_inflation(disc)
    if inflation > 1:
        disc = search.with_noise_inflated(inflation).soft()
    if has_pattern(disc) or _may_be_painted(disc, model, image):
        patterned = fit_pattern(disc, search.bounds)
        state = patterned.state.relit(disc.observation)
        return disc, search, before_loss(sweep_of(patterned, image), state, image)
    by_hue = fitted_to_hue(disc, search.bounds)
    sweep = before_loss(sweep_of(Candidate(by_hue), image), by_hue, image)
    if image.meta.sharing is not None or by_hue is disc:
        return disc, search, sweep
    # Codecs of clips quantize chroma where something moves: residuals of hue alone correlate then.
    known = sweep_of(Candidate(disc), image).diagnostics
    return disc, search, replace(sweep, diagnostics=known)


def _may_be_painted(disc: State, model: ColorModel | None, image: LinearImage) -> bool:
    """Whether a disc may have a pattern: of colors that vary, in an image whose file shows them all.

    One that the plate is seen through has the pattern of the plate.
    """
    is_varied = model is not None and model.rank > 1 and image.meta.sharing is None
    return is_varied and may_have_pattern(disc) and _opacity_of(disc).value == 1


def _source(light: Sweep, std: float) -> Sweep:
    """A sweep of light alone as a source of the opacity 0 ± std, which is unknown if light remains."""
    std = unknown_opacity_std(0.0) if light.rejection else std
    return replace(light, silhouette=light.silhouette.with_opacity(0.0), opacity_std=std)


def _with_pattern(
    disc: State, search: Multistart, image: LinearImage
) -> tuple[Candidate, Evidence]:
    """A disc with a pattern, and the evidence for it.

    It is fitted to the light without what the file did to that of the disc, which it would imitate.
    Its evidence differs from that of the disc by as much as in this light.
    """
    corrected = candidate_before_file(disc, image.meta.transfer or SRGB)
    pattern = fit_patterns(corrected.state, search.bounds)[-1]
    before, after = (_evidence(corrected.state.observation, one) for one in (corrected, pattern))
    known = _evidence(search.observation, Candidate(disc))
    evidence = replace(after, cost=known.cost + after.cost - before.cost)
    return replace(pattern, chroma_blur=corrected.chroma_blur), evidence


def _refined(
    candidate: Candidate,
    evidence: Evidence,
    image: LinearImage,
    search: Multistart,
) -> tuple[Sweep, Evidence]:
    """The sweep of a candidate corrected for its file, and fitted to hue if of one paint; its evidence.

    If the fit to hue is likelier than the candidate with all of its light, the candidate had not
    reached the maximum of its likelihood: colors and evidence are then those of the fit to hue.
    """
    if candidate.covariance is not None:
        return sweep_of(candidate, image), evidence
    transfer = image.meta.transfer or SRGB
    corrected = candidate_before_file(candidate.state, transfer, candidate.cast)
    errors = candidate.opacity_std, candidate.even_opacity_std
    candidate = replace(corrected, opacity_std=errors[0], even_opacity_std=errors[1])
    sweep = sweep_of(candidate, image)
    if candidate.cast is not None:
        return sweep, evidence
    state = fitted_to_hue(candidate.state, search.bounds)
    if state is candidate.state:
        return sweep, evidence
    by_hue = replace(candidate, state=state)
    again = _evidence(search.observation, by_hue)
    if again.cost < evidence.cost:
        in_all_light = with_principal_axes(state.relit(candidate.state.observation))
        converged = replace(in_all_light, converged=state.converged)
        sweep, evidence = sweep_of(replace(candidate, state=converged), image), again
    refined = replace(sweep_of(by_hue, image), model=sweep.model, diagnostics=sweep.diagnostics)
    return refined, evidence


def _with_curve_errors(
    sweeps: Sequence[Sweep],
    evidence: Sequence[Evidence],
    candidates: Sequence[Candidate],
    image: LinearImage,
    search: Multistart,
) -> tuple[Sweep, ...]:
    """The sweeps of candidates with the error of the image's transfer curve, which was assumed."""
    assert image.meta.transfer is not None
    others = with_unstated_curves(search.observation, image.meta.transfer)
    found = []
    for sweep, weight, candidate in zip(
        sweeps, hypothesis_weights(list(evidence)), candidates, strict=True
    ):
        state, cast = candidate.state, candidate.cast
        if weight > _MIN_REFINED_WEIGHT:
            known = state.observation
            by = known.noise_inflation / search.observation.noise_inflation
            decoded = [replace(one.raised(by), color=known.color) for one in others]
            if cast is not None:
                decoded = [in_shadow(one, state, cast) for one in decoded]
            by_curve = curve_covariance(state, decoded, search.bounds)
            n = len(sweep.covariance)  # without a blur of the rim that is the file's
            by_curve = by_curve[:n, :n]
            if sweep.assumed_covariance is not None:
                by_curve = by_curve + sweep.assumed_covariance
            sweep = replace(sweep, assumed_covariance=by_curve)
        found.append(sweep)
    return tuple(found)


def _are_alike(one: Sweep, other: Sweep) -> bool:
    """Whether paths of one family have nearly the same alpha."""
    return one.family is other.family and one.rms_difference(other) < _MIN_ALPHA_DIFFERENCE


def _is_solid(sweep: Sweep) -> bool:
    """True if its rim is sharper than that of a soft shadow."""
    known = sweep.diagnostics
    return not known.rejection and known.blur_over_radius < _MAX_SOLID_BLUR


def _discs(search: Multistart, start: Sweep | None) -> tuple[Multistart, list[State], list[State]]:
    """The best discs of one paint and of colors that vary, with the noise that they estimate."""

    def best(search: Multistart) -> tuple[list[State], list[State]]:
        """Discs of one paint and of varied colors, from the search or from `start`."""
        if start is None:
            return search.best()
        curve = start.family.curve(start.path)
        disc = search.of_one_paint.near(start.family, curve, start.radius)
        is_one_paint = search.observation.color.rank == 1
        return [disc], [] if is_one_paint else [with_varied_colors(disc)]

    prior, search = search.observation.prior, search.without_prior  # it would hide a misfit
    discs = best(search)
    inflation = noise_inflation(discs[0][0])
    if inflation > 1:
        search = search.with_noise_inflated(inflation)
        discs = best(search)
    if prior is not None:
        weight = discs[0][0].variance_inflation * VARIANCE * prior.scatter**2
        search = search.with_prior(replace(prior, weight=weight))
        discs = best(search)
    return search, *discs


def _evidence(observation: Observation, candidate: Candidate) -> Evidence:
    """Evidence for a candidate in the light of the file."""
    state = candidate.state
    alpha = state.swept.alpha
    if candidate.covariance is not None:
        pixels = float(observation.weight.sum())
        return Evidence(state.cost, state.variance_inflation, candidate.parameters, pixels)
    if candidate.cast is not None:
        observation = in_shadow(observation, state, candidate.cast)
    motion = state.family.motion(state.path, observation.scale)
    evidence = evidence_of(observation, alpha, np.zeros_like(alpha), candidate.parameters, motion)
    added = state.silhouette.price(state.shape)
    if observation.prior is not None:
        added += observation.prior.cost(state.family, state.path, state.shape)
    return replace(evidence, cost=evidence.cost + added - candidate.unresolved)

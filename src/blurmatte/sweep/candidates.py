"""Candidates: fits of the hypotheses about a streak before one plate, and the evidence for each."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import compress

import numpy as np

from blurmatte.descent import distinct
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.diagnostics import sweep_of, unknown_opacity_std
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    Hypotheses,
    evidence_of,
    hypothesis_probabilities,
    hypothesis_scores,
    hypothesis_weights,
    with_odds,
)
from blurmatte.sweep.assess.opacity import Opacity, may_be_there_in_part
from blurmatte.sweep.fit.codec_loss import candidate_before_file
from blurmatte.sweep.fit.multistart import Multistart, fitted_to_hue, with_principal_axes
from blurmatte.sweep.fit.pattern import fit_patterns, has_pattern, may_have_pattern
from blurmatte.sweep.fit.ranking import NEGATIVE_LIGHT, UNSEEN_END, Candidate, best_of, is_source
from blurmatte.sweep.fit.shadow import in_shadow
from blurmatte.sweep.hypotheses import (
    Disc,
    Fits,
    Hypothesis,
    TimeLimit,
    best_discs,
    is_explained_by,
)
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.state import State
from blurmatte.sweep.see_through import (
    MAX_KNOWN_STD,
    is_alone_explaining,
    is_known_solid,
    is_plain_source,
    opacity_of,
    seen_through,
    with_opacity,
)
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.transfer_fit import curve_covariance, with_unstated_curves

Search = Callable[[Streak, LinearImage, LinearImage], Multistart]

_LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each hypothesis

_MIN_REFINED_WEIGHT = 1e-2  # probability of a hypothesis that is refined
# Relative root mean square difference of alpha of two hypotheses
_MIN_ALPHA_DIFFERENCE = 0.01
_MIN_HIDING_STDS = 3.0  # opacity over its error from which an object is no source of light
_MIN_SOURCE_PX = 0.5  # radius of a source of light: a point that a lens blurs


@dataclass(frozen=True, eq=False)
class Candidates:
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
    ) -> "Candidates":
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

    def with_opacity_errors(self, std: float, even_std: float) -> "Candidates":
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
        transfer = image.meta.transfer or SRGB
        probable = hypothesis_probabilities(self.evidence) > _MIN_REFINED_WEIGHT
        before = {
            one.state: candidate_before_file(one, transfer)
            for one in compress(self.candidates, probable)
        }
        compared = [
            _refined(before[one.state], known, image, search)
            if one.state in before
            else (sweep_of(one, image), known)
            for one, known in zip(self.candidates, self.evidence, strict=True)
        ]
        sweeps, evidences, fitted = self._sorted(compared)
        untried = self.untried
        if limit is not None and self._may_be_another_disc(fitted[0]):
            if limit.is_over:
                untried += ("a disc with a pattern",)
            else:
                _LOG.info("fitting a disc with a pattern")
                errors = fitted[0].opacity_std, fitted[0].even_opacity_std  # of all solid shapes
                disc = Candidate(self.fits.disc)
                corrected = before.get(disc.state) or candidate_before_file(disc, transfer)
                pattern, evidence = _with_pattern(disc, corrected, search)
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


@dataclass(frozen=True, eq=False)
class FitRequest:
    """What is fitted to an image, before any plate."""

    image: LinearImage
    search_in: Search
    start: Sweep | None
    hypotheses: Sequence[Hypothesis]
    limit: TimeLimit

    def begun(self, plate: LinearImage, streak: Streak) -> Fits:
        """The discs before a plate, from which all hypotheses start."""
        search, one_paint, varied = best_discs(
            self.search_in(streak, self.image, plate), self.start
        )
        return Fits(search, self.image, plate, streak, tuple(one_paint), tuple(varied))

    def candidates(self, fits: Fits) -> Candidates:
        """All hypotheses, begun from discs; of light alone, if the object hides nothing.

        The object is solid unless the likeliest of these shapes is likelier if it lets light through.
        """
        search, discs = fits.search, (fits.one_paint, fits.varied)
        if is_known_solid(search.observation):
            return self._fitted(fits)
        state = best_of([kind[0] for kind in discs if kind])
        through = cache(partial(seen_through, bounds=search.bounds))
        thin_disc = through(state)
        if is_alone_explaining(thin_disc, state):
            state = thin_disc
        elif not (may_be_there_in_part(state) or is_plain_source(state)):
            solid = self._fitted(fits)
            opacity = opacity_of(solid.likeliest.state)
            thin = _likelier_thin(solid, state, thin_disc, opacity)
            if thin is None:
                return solid.with_opacity_errors(opacity.solid_std, opacity.even_std)
            state = thin
        hides = opacity_of(through(state))
        if hides.value > 0:
            one_paint, varied = (tuple(map(through, kind)) for kind in discs)
            return self._fitted(replace(fits, one_paint=one_paint, varied=varied), with_opacity)
        added = self._of_light(fits, hides.std)
        if added.as_fitted.best.rejection != NEGATIVE_LIGHT:
            return added
        # A source of light takes none: the color is wrong, and says nothing about the opacity.
        return self._fitted(fits)

    def _fitted(
        self, fits: Fits, completed: Callable[[Candidate], Candidate] | None = None
    ) -> Candidates:
        return Candidates.of(fits, self.hypotheses, self.limit, completed)

    def _of_light(self, fits: Fits, std: float) -> Candidates:
        """Candidates for the light that was added by an object of the opacity 0 ± std."""
        streak, plate = fits.streak, fits.plate
        light, dark = _light_alone(self.image, plate)
        search = self.search_in(streak, light, dark)
        search = search.with_observations(lambda one: replace(one, light_alone=True))
        search = replace(search, bounds=(min(_MIN_SOURCE_PX, search.bounds[0]), search.bounds[1]))
        search, one_paint, varied = best_discs(search, None)
        fits = Fits(search, light, dark, streak, tuple(one_paint), tuple(varied))
        return replace(self._fitted(fits), added_before=(plate, std))


def _likelier_thin(
    solid: Candidates, disc: State, thin_disc: State, opacity: Opacity
) -> State | None:
    """A shape that lets light through and is likelier than the solid ones, if there is one.

    Of a disc that is too bright for a surface it is that disc, unless texture shows that the likeliest
    shape hides it: the disc of a stick that moved across itself is too small.

    disc, thin_disc: where another search starts, and `seen_through` of it.
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
        thin = seen_through(state, solid.fits.search.bounds, opacity)
    if not (opacity.std <= MAX_KNOWN_STD and is_explained_by(state)):
        thin = best_of([thin, thin_disc])
    return thin if thin not in (state, disc) and best_of([state, thin]) is thin else None


def _light_alone(image: LinearImage, plate: LinearImage) -> tuple[LinearImage, LinearImage]:
    """The light that was added to a plate, and a black plate."""
    meta = replace(image.meta.of_no_file, transfer=None, transfer_assumed=False)
    noise, valid = image.variance + plate.variance, image.valid & plate.valid
    black = np.zeros_like(plate.rgb)
    return (
        LinearImage(image.rgb - plate.rgb, noise, valid, meta),
        LinearImage(black, black, valid, meta),
    )


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


def _refined(
    candidate: Candidate, evidence: Evidence, image: LinearImage, search: Multistart
) -> tuple[Sweep, Evidence]:
    """The sweep of a candidate before its file, fitted to hue if of one paint; its evidence.

    If the fit to hue is likelier than the candidate with all of its light, the candidate had not
    reached the maximum of its likelihood: colors and evidence are then those of the fit to hue.
    """
    sweep = sweep_of(candidate, image)
    if candidate.covariance is not None or candidate.cast is not None:
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


def _with_pattern(
    disc: Candidate, corrected: Candidate, search: Multistart
) -> tuple[Candidate, Evidence]:
    """A disc with a pattern, and the evidence for it.

    It is fitted to the light without what the file did to that of the disc, which it would imitate.
    Its evidence differs from that of the disc by as much as in this light.
    """
    pattern = fit_patterns(corrected.state, search.bounds)[-1]
    before, after = (_evidence(corrected.state.observation, one) for one in (corrected, pattern))
    known = _evidence(search.observation, disc)
    evidence = replace(after, cost=known.cost + after.cost - before.cost)
    return replace(pattern, chroma_blur=corrected.chroma_blur), evidence


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


def _source(light: Sweep, std: float) -> Sweep:
    """A sweep of light alone as a source of the opacity 0 ± std, which is unknown if light remains."""
    std = unknown_opacity_std(0.0) if light.rejection else std
    return replace(light, silhouette=light.silhouette.with_opacity(0.0), opacity_std=std)


def _are_alike(one: Sweep, other: Sweep) -> bool:
    """Whether paths of one family have nearly the same alpha."""
    return one.family is other.family and one.rms_difference(other) < _MIN_ALPHA_DIFFERENCE

"""Candidates before the plate in the light that the object left on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    Hypotheses,
    hypothesis_scores,
    hypothesis_weights,
    is_decisively_likelier,
)
from blurmatte.sweep.candidates import Candidates, FitRequest
from blurmatte.sweep.fit.multistart import half_width_of
from blurmatte.sweep.hypotheses import Disc, Fits, is_explained
from blurmatte.sweep.model.lighting import Lighting, fit_lighting
from blurmatte.sweep.model.observation import Observation

# Of the plate's light that it loses: less hardly changes alpha, and costs a search
_MIN_LOSS = 0.02
# Of a streak in that light: a smaller one justifies a search
_MAX_REMAINING_FRACTION = 0.9


def in_likelier_light(candidates: Candidates, request: FitRequest) -> Candidates:
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
    observation = _of_measured_noise(found)
    outside = observation if observation.prior is None else found.outside_of_best(observation)
    lights = []
    for is_gray in (True, False):
        lit = _lighting_of(request.image, found.plate, found.streak, outside, is_gray)
        if lit is not None:
            lights += _with_discs(found, *lit, request)
    # That light holds the shadow of the object.
    shapes = [one for one in request.hypotheses if not one.changes_plate]
    for light in _likeliest_first(lights):
        others = replace(request, hypotheses=shapes).candidates(light.begun)
        evidence = _evidence_for(light.lighting, others, observation)
        if math.isfinite(evidence.cost):
            before = found.best_evidence(observation)
            return others if is_decisively_likelier(evidence, before) else candidates
    return candidates


@dataclass(frozen=True, eq=False)
class _Light:
    """A light on the plate, and the solid discs in it."""

    lighting: Lighting
    begun: Fits  # from which all shapes are fitted
    discs: Candidates
    evidence: Evidence  # for the discs and the light; its cost is infinite if they are impossible

    @classmethod
    def of(
        cls, lighting: Lighting, rest: Streak, found: Hypotheses, request: FitRequest
    ) -> "_Light":
        """With the discs of a whole search in the streak in that light."""
        begun = request.begun(lighting.on(found.plate), rest)
        discs = Candidates.of(begun, (Disc(),), request.limit)
        observation = _of_measured_noise(found)
        return cls(lighting, begun, discs, _evidence_for(lighting, discs, observation))


def _evidence_for(lighting: Lighting, candidates: Candidates, observation: Observation) -> Evidence:
    """The evidence for a light and candidates in it; its cost is infinite if they are impossible."""
    fitted = candidates.as_fitted
    evidence = fitted.best_evidence(lighting.lit(observation))
    is_possible = lighting.is_possible(fitted.best.alpha)
    return replace(evidence, cost=evidence.cost + lighting.cost if is_possible else math.inf)


def _of_measured_noise(found: Hypotheses) -> Observation:
    """The observation of hypotheses with the noise that was measured."""
    return found.observation.raised(1 / found.observation.noise_inflation)


def _likeliest_first(lights: Sequence[_Light]) -> Sequence[_Light]:
    """Lights, that of the likeliest possible discs first, so that other shapes need only this one."""
    possible = [one for one in lights if math.isfinite(one.evidence.cost)]
    if not possible:
        return lights
    scores = hypothesis_scores([one.evidence for one in possible])
    first = possible[int(np.argmin(scores))]
    return [first, *(one for one in lights if one is not first)]


def _with_discs(
    found: Hypotheses, lighting: Lighting, rest: Streak, request: FitRequest
) -> list[_Light]:
    """A light, or that around the disc in it, if this is likelier; none if a known disc denies it.

    The first estimate of the light knows no object, and may be darker where that is.

    found: before the plate as it is.
    rest: the streak in that light.
    """
    observation = _of_measured_noise(found)
    if found.observation.is_known_disc:
        lit = found.best_evidence(lighting.lit(observation))
        both = [found.best_evidence(observation), replace(lit, cost=lit.cost + lighting.cost)]
        if hypothesis_weights(both)[1] < 0.5:
            return []
    light = _Light.of(lighting, rest, found, request)
    if found.observation.prior is not None:  # the first estimate was around the object
        return [light]
    outside = light.discs.as_fitted.outside_of_best(observation)
    grain = observation.grain * half_width_of(rest) / half_width_of(found.streak)
    around = fit_lighting(replace(outside, grain=grain), not lighting.is_colored)
    smaller = _streak_within(found.streak, request.image, around.on(found.plate))
    if smaller is None:
        return [light]
    again = _Light.of(around, smaller, found, request)
    possible = math.isfinite(light.evidence.cost)
    is_better = not possible or is_decisively_likelier(again.evidence, light.evidence)
    return [again if is_better else light]


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
    if rest is None or rest.mask.sum() > _MAX_REMAINING_FRACTION * streak.mask.sum():
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

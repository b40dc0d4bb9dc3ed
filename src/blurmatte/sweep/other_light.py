"""Candidates before the plate in the light that the object left on it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.assess.model_selection import (
    Evidence,
    Hypotheses,
    hypothesis_weights,
    is_decisively_likelier,
)
from blurmatte.sweep.candidates import Candidates, FitRequest
from blurmatte.sweep.fit.multistart import half_width_of
from blurmatte.sweep.hypotheses import Disc, Fits, Hypothesis, is_explained
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
    request: FitRequest,
) -> list[tuple[Evidence, Candidates]]:
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
    request: FitRequest,
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
    request: FitRequest,
    shapes: Sequence[Hypothesis],
) -> tuple[Evidence, Candidates]:
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

"""The plate in the light that an object leaves it."""

from dataclasses import replace

from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.fit.multistart import half_width_of
from blurmatte.sweep.model.lighting import Lighting, fit_lighting
from blurmatte.sweep.model.observation import Observation

_MIN_LOSS = 0.02  # of the plate's light: less hardly changes alpha, and costs a search
_MAX_REMAINING_FRACTION = 0.9  # of a streak's pixels; a smaller streak justifies another search


def lighting_of(
    image: LinearImage, plate: LinearImage, streak: Streak, observation: Observation
) -> tuple[Lighting, Streak] | None:
    """The light on the plate, estimated without a model of the object, and the streak in that light.

    None if the plate hardly gets darker, or the streak hardly smaller.
    """
    lighting = fit_lighting(observation)
    if lighting.change.min() > -_MIN_LOSS:
        return None
    rest = _streak_within(streak, image, lighting.on(plate))
    if rest is None:
        return None
    width = half_width_of(rest)
    finer = replace(observation, grain=observation.grain * width / half_width_of(streak))
    lighting = fit_lighting(finer)
    rest = _streak_within(streak, image, lighting.on(plate))
    if rest is None or rest.mask.sum() > _MAX_REMAINING_FRACTION * streak.mask.sum():
        return None
    return lighting, rest


def _streak_within(streak: Streak, image: LinearImage, plate: LinearImage) -> Streak | None:
    """The strongest streak before this plate that overlaps a streak."""
    parts = [part for part in find_streaks(image, plate) if (part.mask & streak.mask).any()]
    return parts[0] if parts else None

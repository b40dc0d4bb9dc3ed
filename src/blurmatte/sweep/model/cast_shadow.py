"""The shadow that a disc casts on a flat background behind it, and that moves with it.

In this file o is where the disc is at a moment, and s, from 0 to 1, how dark its shadow is there: the
disc, moved by an offset and blurred, for lamps are no points. Over the exposure the part t S of the
plate's light is missing, S = ∫ (1 − o) s, with t the part of each channel's light that came from the
lamp: C = P + (1 − α − t S) B. It is as if the plate were darker, B (1 − t S / (1 − α)).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import PathFamily
from blurmatte.sweep.model.state import State

Array = npt.NDArray[np.float64]

PARAMETERS = 6  # offset, softness, and the strength in each channel
# Strength in the channel that loses most, and that of the least over it: lamps are white.
_MIN_STRENGTH, _MAX_STRENGTH, _MIN_STRENGTH_RATIO = 0.04, 0.95, 0.5
_PROFILE_NODES, _BLUR_REACH = 65, 3.5  # of a profile; standard deviations of its blur
_TIMES, _STEP = (33, 257), 1.0  # fewest and most; pixels from one to the next
_TINY = 1e-9


@dataclass(frozen=True, eq=False)
class CastShadow:
    """A shadow that a disc casts.

    Parameters
    ----------
    offset : (2,) float
        From the disc's center to its shadow's, pixels.
    softness : float
        Standard deviation of its blur, pixels.
    strength : (3,) float
        t of each channel, 0…1.
    """

    offset: Array
    softness: float
    strength: Array

    @property
    def is_possible(self) -> bool:
        """Whether a lamp casts it: in all channels, and not as the only light."""
        least, most = float(self.strength.min()), float(self.strength.max())
        return _MIN_STRENGTH <= most <= _MAX_STRENGTH and least >= _MIN_STRENGTH_RATIO * most

    @property
    def numbers(self) -> dict[str, Any]:
        """All fields by name, as plain numbers."""
        return {
            "offset": tuple(float(x) for x in self.offset),
            "softness": self.softness,
            "strength": tuple(float(t) for t in self.strength),
        }

    def missing(
        self, family: PathFamily, path: Array, radius: float, observation: Observation
    ) -> Array:
        """(h, w) S of a disc of a radius that moves along a path, in the pixels of an observation."""
        from blurmatte.sweep.model import (
            cast_shadow_kernel as cast_kernel,
        )  # numba takes half a second to import

        centers = _centers_of(family, path, observation)
        profile, step = _profile(radius / observation.scale, self.softness / observation.scale)
        S = np.zeros(observation.weight.shape)
        offset, radius = self.offset / observation.scale, radius / observation.scale
        cast_kernel.add_shadow(centers, offset, radius, profile, step, S)
        return S

    def of(self, observation: Observation, state: State) -> Array:
        """(h, w) S that a disc casts."""
        return self.missing(state.family, state.path, float(state.shape[0]), observation)

    def on(self, B: Array, S: Array, alpha: Array) -> Array:
        """(h, w, 3) the plate in this shadow, as it is seen around the object."""
        left = 1 - S[..., None] * self.strength / np.maximum(1 - alpha, _TINY)[..., None]
        return np.asarray(B * np.clip(left, 0, 1))


def in_shadow(observation: Observation, state: State, cast: CastShadow) -> Observation:
    """An observation with the plate in the shadow that a disc casts."""
    S = cast.of(observation, state)
    return replace(observation, B=cast.on(observation.B, S, state.swept.alpha))


def _centers_of(family: PathFamily, path: Array, observation: Observation) -> Array:
    """(T, 2) centers of what goes along a path, at even times, in the pixels of an observation."""
    curve = family.at(path, np.linspace(0, 1, 33))[0]
    length = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
    count = int(np.clip(length / (_STEP * observation.scale), *_TIMES))
    times = (np.arange(count) + 0.5) / count
    centers = family.at(path, times)[0] - np.array(observation.origin)
    return np.asarray(centers / observation.scale)


def _profile(radius: float, softness: float) -> tuple[Array, float]:
    """How dark the shadow is every step from its middle, and the step: a noncentral χ² of two."""
    from scipy.special import chndtr

    reach = radius + _BLUR_REACH * softness
    at = np.linspace(0, reach, _PROFILE_NODES)
    dark = chndtr((radius / softness) ** 2, 2, (at / softness) ** 2)
    return np.where(np.isfinite(dark), dark, at < radius), reach / (_PROFILE_NODES - 1)

"""The shadow that a disc casts on a flat background behind it, and that goes with it.

In this file o is where the disc is at a moment, and s, from 0 to 1, how dark its shadow is there: the
disc, moved by an offset and blurred, for lamps are no points. Over the exposure the part t S of the
plate's light is missing, S = ∫ (1 − o) s, with t the part of each channel's light that came from the
lamp: C = P + (1 − α − t S) B. It is as if the plate were darker, B (1 − t S / (1 − α)). P lies along a
color, so that across it, and in all directions where no object was, t S B is what is left.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.carried import DIFFERENCE, RADIUS, centers_of, place_of, placed, slopes_of
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, added_by, seen
from blurmatte.sweep.path import PathFamily

Array = npt.NDArray[np.float64]

PARAMETERS = 6  # offset, softness, and the strength in each channel
_NODES, _REACH = 65, 3.5  # of a profile, and standard deviations of a blur that count
_DISTANCES = 0.7, 1.4, 2.2  # where a shadow is looked for first: radii
_FARTHEST, _SOFTNESS = 6.0, (0.03, 0.3, 1.0)  # radii; least, at first, and most
# Of the plate's light in the channel that loses most, and what others lose of that. What is no shadow
# takes from one or two channels.
_FAINTEST, _DARKEST, _ALIKE = 0.04, 0.95, 0.5
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
        """Whether lamps cast such: they light all channels alike, and are never the only light."""
        least, most = float(self.strength.min()), float(self.strength.max())
        return _FAINTEST <= most <= _DARKEST and least >= _ALIKE * most

    @property
    def numbers(self) -> dict[str, Any]:
        """All fields by name, as plain numbers."""
        return {
            "offset": tuple(float(x) for x in self.offset),
            "softness": self.softness,
            "strength": tuple(float(t) for t in self.strength),
        }

    def missing(self, family: PathFamily, path: Array, radius: float, data: Data) -> Array:
        """(h, w) S in the pixels of data, of a disc of a radius that went along a path."""
        from blurmatte.sweep import cast_kernel  # numba takes half a second to import

        centers = centers_of(family, path, data)
        profile, step = _profile(radius / data.scale, self.softness / data.scale)
        S = np.zeros(data.weight.shape)
        offset, radius = self.offset / data.scale, radius / data.scale
        cast_kernel.add_shadow(centers, offset, radius, profile, step, S)
        return S

    def of(self, data: Data, state: State) -> Array:
        """(h, w) S that a disc casts."""
        return self.missing(state.family, state.path, float(state.shape[0]), data)

    def on(self, B: Array, S: Array, alpha: Array) -> Array:
        """(h, w, 3) a plate where this is missing, as it is seen beside an object."""
        left = 1 - S[..., None] * self.strength / np.maximum(1 - alpha, _TINY)[..., None]
        return np.asarray(B * np.clip(left, 0, 1))


def in_shadow(data: Data, state: State, cast: CastShadow) -> Data:
    """Data with the plate in the shadow that a disc casts."""
    return replace(data, B=cast.on(data.B, cast.of(data, state), state.swept.alpha))


def fit_cast(data: Data, state: State, start: CastShadow | None = None) -> CastShadow:
    """The shadow that explains most of what a disc of one paint leaves; it need not be possible.

    Parameters
    ----------
    data : Data
        With the plate as it is without.
    state : State
    start : CastShadow, optional
        One like it.
    """
    data = data.coarse_enough(float(state.shape[0]), RADIUS)
    state = seen(data, state)
    radius, alpha = float(state.shape[0]), state.swept.alpha
    over_noise = np.sqrt(data.weight[..., None] / (data.C_variance + data.B_variance))
    across = state.frame.across @ state.frame.across.T
    told = np.where((alpha > 0)[..., None, None], across, np.eye(3)) * over_noise[..., None]
    left = np.einsum("yxcd,yxd->yxc", told, (1 - alpha)[..., None] * data.B - data.C).ravel()

    def shadow(x: Array, strength: Array) -> CastShadow:
        return CastShadow(x[:2] * radius, float(np.exp(x[2])) * radius, strength)

    def solved(x: Array) -> tuple[Array, Array]:
        """What is left with the best strength, and that."""
        S = shadow(x, np.ones(3)).of(data, state)
        A = (told * (S[..., None] * data.B)[:, :, None, :]).reshape(-1, 3)
        t = np.clip(np.linalg.solve(A.T @ A + _TINY * np.eye(3), A.T @ left), 0, 1)
        return np.asarray(left - A @ t), t

    def slopes(x: Array) -> Array:
        steps = DIFFERENCE * np.eye(3)
        ahead, behind = (np.stack([solved(x + s * d)[0] for d in steps], axis=-1) for s in (1, -1))
        return np.asarray((ahead - behind) / (2 * DIFFERENCE))

    start_at = place_of(start, radius)
    x = placed(lambda x: solved(x)[0], start_at, _DISTANCES, _FARTHEST, _SOFTNESS, slopes)
    return shadow(x, solved(x)[1])


def covariance_added(data: Data, state: State, cast: CastShadow) -> Array:
    """(size, size) by how much a disc's covariance grows, for its shadow is not known either.

    Parameters
    ----------
    data : Data
        With the plate in the shadow.
    state : State
    cast : CastShadow
    """
    alpha = state.swept.alpha
    S = cast.of(data, state)
    B = data.B / np.maximum(cast.on(np.ones_like(data.B), S, alpha), _TINY)
    by_strength = S[..., None, None] * B[..., None] * np.eye(3)
    by_place = slopes_of(data, state, cast)[..., None, :] * (cast.strength * B)[..., None]
    return added_by(data, state, np.concatenate([by_strength, by_place], axis=-1))


def _profile(radius: float, softness: float) -> tuple[Array, float]:
    """How dark the shadow is every step from its middle, and the step: a noncentral χ² of two."""
    from scipy.special import chndtr

    reach = radius + _REACH * softness
    at = np.linspace(0, reach, _NODES)
    dark = chndtr((radius / softness) ** 2, 2, (at / softness) ** 2)
    return np.where(np.isfinite(dark), dark, at < radius), reach / (_NODES - 1)

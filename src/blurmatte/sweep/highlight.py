"""The highlight of a glossy disc: a spot of other light that stays where it is on the disc.

Over the exposure the spot, a normal distribution, leaves a smear of its own, G = ∫ spot, of the color
of the lamp: C = P + (1 − α) B + G L. A plane of paint and lamp would explain that too, and much more: a
gray wall has the color of a white lamp, and lies within it. The part of L along the paint may as well
be shading of the paint, so that of all that is possible L is the least.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.sweep.carried import RADIUS, centers_of, place_of, placed, slopes_of
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, added_by, seen
from blurmatte.sweep.student import VARIANCE
from blurmatte.sweep.verdict import overstated

Array = npt.NDArray[np.float64]

PARAMETERS = 5  # offset, softness, and the light across the paint
_NODES, _REACH = 65, 3.5  # of a profile, and standard deviations of a spot that count
_EVERYWHERE = 1e9  # pixels: a disc so much smaller than nothing hides none of a spot
_DISTANCES = 0.0, 0.3, 0.6  # where a spot is looked for first: radii
_FARTHEST, _SOFTNESS = 0.9, (0.05, 0.15, 0.5)  # radii; least, at first, and most
_DARK = 0.01  # of a paint's light: of a channel with less nothing can be taken
_TINY = 1e-9


@dataclass(frozen=True, eq=False)
class Highlight:
    """A spot of light on a disc, of another color than its paint.

    Parameters
    ----------
    offset : (2,) float
        From the disc's center, pixels.
    softness : float
        Its standard deviation, pixels.
    light : (3,) float
        In its middle, linear light, across the paint.
    """

    offset: Array
    softness: float
    light: Array

    @property
    def numbers(self) -> dict[str, Any]:
        """All but the light, which is known in part, by name, as plain numbers."""
        return {"offset": [float(x) for x in self.offset], "softness": self.softness}

    def of(self, data: Data, state: State) -> Array:
        """(h, w) G, the smear of the spot on a disc that goes along its path."""
        from blurmatte.sweep import cast_kernel  # numba takes half a second to import

        at = np.linspace(0, _REACH, _NODES)
        G = np.zeros(data.weight.shape)
        cast_kernel.add_shadow(
            centers_of(state.family, state.path, data),
            self.offset / data.scale,
            -_EVERYWHERE,
            np.exp(-(at**2) / 2),
            float(at[1]) * self.softness / data.scale,
            G,
        )
        return G

    def color(self, paint: Array) -> Array | None:
        """(3,) unit direction of the least light that it can be on a paint; None if it is none.

        Lamps are nearer to white than paint is, so that highlights are paler than what is around them.
        """
        taken = self.light < 0
        # White along what of the light lies across the paint.
        paler = float(self.light.sum() - self.light @ paint * paint.sum()) > 0
        if not paler or np.any(paint[taken] < _DARK):
            return None
        more = float(np.max(-self.light[taken] / paint[taken], initial=0))
        light = self.light + more * paint
        return np.asarray(light / max(float(np.linalg.norm(light)), _TINY))


def without_highlight(data: Data, state: State, highlight: Highlight) -> Data:
    """Data without the light of a disc's highlight."""
    return replace(data, C=data.C - highlight.of(data, state)[..., None] * highlight.light)


def fit_highlight(data: Data, state: State, start: Highlight | None = None) -> Highlight:
    """The highlight that explains most of what a disc of one paint leaves.

    Parameters
    ----------
    data : Data
        With the highlight.
    state : State
    start : Highlight, optional
        One like it.
    """
    data = data.coarse_enough(float(state.shape[0]), RADIUS)
    state = seen(data, state)
    radius, alpha, N = float(state.shape[0]), state.swept.alpha, state.frame.across
    inside = alpha > 0
    over_noise = np.sqrt(data.weight / (data.C_variance + data.B_variance).mean(axis=-1))[inside]
    left = ((data.C - (1 - alpha)[..., None] * data.B)[inside] @ N) * over_noise[:, None]

    def highlight(x: Array, light: Array) -> Highlight:
        return Highlight(x[:2] * radius, float(np.exp(x[2])) * radius, light)

    def solved(x: Array) -> tuple[Array, Array]:
        """What is left with the best light, and that."""
        G = highlight(x, np.ones(3)).of(data, state)[inside] * over_noise
        across = G @ left / max(float(G @ G), _TINY)
        return np.asarray(left - G[:, None] * across).ravel(), N @ across

    start_at = place_of(start, radius)
    x = placed(lambda x: solved(x)[0], start_at, _DISTANCES, _FARTHEST, _SOFTNESS)
    return highlight(x, solved(x)[1])


def covariance_added(data: Data, state: State, highlight: Highlight) -> Array:
    """(size, size) by how much a disc's covariance grows, for its highlight is not known either.

    Parameters
    ----------
    data : Data
        Without the highlight.
    state : State
    highlight : Highlight
    """
    G = highlight.of(data, state)
    by_light = G[..., None, None] * np.eye(3)
    by_place = slopes_of(data, state, highlight)[..., None, :] * highlight.light[:, None]
    return added_by(data, state, np.concatenate([by_light, by_place], axis=-1))


def plane_of(data: Data, state: State, highlight: Highlight, turns: Array) -> ColorModel:
    """The plane of a disc's paint and its highlight.

    Parameters
    ----------
    data : Data
        Without the highlight.
    state : State
    highlight : Highlight
    turns : (2, 2) float
        Covariance of turns of the paint towards the directions across it.
    """
    paint, light = state.main, highlight.color(state.main)
    assert light is not None
    pole = np.cross(paint, light)
    pole /= np.linalg.norm(pole)
    G = highlight.of(data, state)
    V = (data.C_variance + data.B_variance) @ pole**2
    known = float(np.sum(state.weights(data) * G**2 / V))
    brightness2 = float(highlight.light @ highlight.light)
    of_paint = pole @ state.frame.across @ turns @ state.frame.across.T @ pole
    of_light = overstated(data, state) * VARIANCE / max(known * brightness2, _TINY)
    to_paint, to_light = np.linalg.pinv(np.stack([paint, light])).T
    covariance = of_paint * np.outer(to_paint, to_paint) + of_light * np.outer(to_light, to_light)
    evidence = {"shape": float(np.degrees(np.sqrt(np.trace(covariance) / 2)))}
    return ColorModel(np.linalg.qr(np.stack([paint, light], axis=1))[0], covariance, evidence)

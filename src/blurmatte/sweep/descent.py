"""One descent: from a start to the nearest best path, shape and color.

Parameters stand in the order of the path's, the shape's, and two turns of the color's direction. The
cost is that of Student's t distribution of the residuals, which a normal one would be if nothing
but noise were left.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.misfit import Misfit, across, light_along, misfit
from blurmatte.sweep.path import PathFamily
from blurmatte.sweep.silhouette import Silhouette, Swept

Array = npt.NDArray[np.float64]

_FREEDOM = 6.0  # degrees of freedom of the t distribution
_STEPS, _TRIES = 40, 8
_ENOUGH = 1e-3  # of a unit of log likelihood: no step gains more
_BEND = 0.3  # of a radius, or radians, the most that a shape is bent or turned in a step
_TURN = 0.3  # radians, the largest turn of a color in a step


@dataclass(frozen=True, eq=False)
class State:
    """Path, shape and color, and how well they explain the data.

    Parameters
    ----------
    family : PathFamily
    path : (n,) float
    silhouette : Silhouette
        Of what kind the shape is.
    shape : (m,) float
    line : (3,) float
        Unit direction of the color.
    across : (3, 2) float
        Directions across it, in which the color turns.
    swept : Swept
    misfit : Misfit
    cost : float
        Minus the log likelihood of what lies across the color.
    converged : bool
        No step gains anything any more.
    """

    family: PathFamily
    path: Array
    silhouette: Silhouette
    shape: Array
    line: Array
    across: Array
    swept: Swept
    misfit: Misfit
    cost: float
    converged: bool = False

    @property
    def size(self) -> int:
        """How many parameters, those of the color included."""
        return len(self.path) + len(self.shape) + 2

    def weights(self, data: Data) -> Array:
        """(h, w) how much each pixel is believed."""
        return data.weight * (_FREEDOM + 2) / (_FREEDOM + self.misfit.chi2)

    def information(self, data: Data) -> tuple[Array, Array]:
        """Curvature (size, size) and gradient (size,) of the cost."""
        from blurmatte.sweep import kernel  # numba takes half a second to import

        left, weights = self.misfit, self.weights(data)
        H, g = kernel.normal_equations(
            self.swept.by_parameters, left.e, left.by_alpha, left.by_color, weights
        )
        unsure = weights * left.kept * left.light_variance
        H[-2:, -2:] += np.einsum("hw,khwi,khwj->ij", unsure, left.by_turning, left.by_turning)
        return H, g


def state_at(
    data: Data,
    family: PathFamily,
    path: Array,
    silhouette: Silhouette,
    shape: Array,
    line: Array,
) -> State:
    """What a path, a shape and a color leave unexplained."""
    swept, T = silhouette.sweep(family, path, shape, data), across(line)
    left = misfit(data, swept.alpha, line, T)
    return State(family, path, silhouette, shape, line, T, swept, left, _across(data, left))


def seen(data: Data, state: State) -> State:
    """The same path, shape and color in other data."""
    return state_at(data, state.family, state.path, state.silhouette, state.shape, state.line)


def descend(data: Data, start: State, bounds: tuple[float, float]) -> State:
    """Follow the cost down from a start, the radius within bounds."""
    state, caution = start, 1e-2
    for _ in range(_STEPS):
        H, g = state.information(data)
        scales = np.diag(H) + 1e-9 * np.trace(H) / len(H)
        for _ in range(_TRIES):
            damping = np.diag(caution * scales + 1e-12 * np.trace(H))
            step = np.linalg.solve(H + damping, -g).astype(float)
            tried = _moved(data, state, step, bounds)
            gain = _gain(data, state, tried)
            if gain > 0:
                break
            caution *= 6
        else:
            return replace(state, converged=True)
        state, caution = tried, max(caution / 5, 1e-7)
        if gain < _ENOUGH:
            return replace(state, converged=True)
    return state


def _gain(data: Data, state: State, tried: State) -> float:
    """How much likelier `tried` is, given how much of the light along the color was no noise.

    Alpha must not follow the light, for shades are free; so both are asked at the alpha of `state`.
    """
    through = (1 - state.swept.alpha)[..., None]
    P, V = data.C - through * data.B, data.C_variance + through**2 * data.B_variance
    left = state.misfit
    light, variance = light_along(P, V, tried.line)
    none = state.weights(data) * (1 - left.kept)
    along = np.sum(none * (left.light**2 / left.light_variance - light**2 / variance)) / 2
    return state.cost - tried.cost + float(along)


def _across(data: Data, left: Misfit) -> float:
    return float(np.sum(data.weight * np.log1p(left.chi2 / _FREEDOM)) * (_FREEDOM + 2) / 2)


def _moved(data: Data, state: State, step: Array, bounds: tuple[float, float]) -> State:
    """The state after a step, which is shortened where it leaves the range of the linear."""
    n, m = len(state.path), len(state.shape)
    far = np.abs(step[: n + 1]).max() / max(0.5 * state.shape[0], 2 * data.scale)
    bend = np.abs(step[n + 1 : n + m]).max(initial=0) / _BEND
    turn = np.linalg.norm(step[n + m :]) / _TURN
    step = step / max(far, bend, turn, 1)
    line = state.line + state.across @ step[n + m :]
    shape = state.shape + step[n : n + m]
    shape[0] = np.clip(shape[0], *bounds)
    line /= np.linalg.norm(line)
    return state_at(data, state.family, state.path + step[:n], state.silhouette, shape, line)


def main_color(data: Data, alpha: Array) -> Array:
    """(3,) direction of the light that an alpha leaves over, robustly."""
    P = (data.C - (1 - alpha)[..., None] * data.B).reshape(-1, 3)
    base = data.weight.ravel() * alpha.ravel() ** 2
    weights = base
    for _ in range(4):
        line = np.linalg.eigh((P * weights[:, None]).T @ P)[1][:, -1]
        off = np.linalg.norm(P - np.outer(P @ line, line), axis=1)
        usual = np.median(off[base > 0]) if np.any(base > 0) else 0
        weights = base / (1 + (off / max(3 * usual, 1e-12)) ** 2)
    return np.asarray(line * np.sign(line.sum()))

"""Levenberg–Marquardt steps from a start to the nearest path and shape of the least cost."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.model.state import State

Array = npt.NDArray[np.float64]

MAX_STEPS = 40
ROUGH_TOLERANCE = 0.1  # units of log likelihood, on large pixels, and where fits are compared
TOLERANCE = 1e-2  # units of log likelihood
_MAX_TRIALS = 8  # of the damping in one step
_FIRST_DAMPING, _MIN_DAMPING = 1e-2, 1e-7  # of the curvature
_DAMPING_AFTER_FAILURE = 0.1  # of the curvature: less hardly changes a step that failed
_MIN_GAIN_RATIO = 0.25  # of the promised gain; a smaller one increases the damping
_MIN_CURVATURE = 1e-10  # of the largest
_MAX_MOVE = 0.5  # of the radius, or two pixels, in a step
_MAX_BEND = 0.3  # of the radius, or radians, in a step
_BOUND_STEP = 1e-9  # pixels; a parameter that cannot take it is held at a bound


def minimize(
    start: State,
    bounds: tuple[float, float],
    max_steps: int = MAX_STEPS,
    tolerance: float = TOLERANCE,
) -> State:
    """Follow the cost down from a start.

    It has converged where no step gains more than the tolerance and the radius is not at a bound.

    Parameters
    ----------
    start : State
    bounds : (float, float)
        Of the radius, pixels.
    max_steps : int
    tolerance : float
        Units of log likelihood.
    """
    state, damping = start, _FIRST_DAMPING
    for _ in range(max_steps):
        H, g = state.information()
        held = _held(state, g, bounds)
        H[held], H[:, held], g[held] = 0, 0, 0
        if not np.diag(H).any():
            return state  # it has left the picture
        scales = np.sqrt(np.maximum(np.diag(H), 0) + _MIN_CURVATURE * np.diag(H).max())
        curvature, slope = H / np.outer(scales, scales), g / scales
        for _ in range(_MAX_TRIALS):
            damped = curvature + (damping + _MIN_CURVATURE) * np.eye(len(H))
            step = -np.linalg.lstsq(damped, slope)[0] / scales
            promised = -float(g @ step) / 2
            if promised < tolerance:
                return _ended(state, bounds)
            tried = _moved(state, np.asarray(step, float), bounds)
            gain = state.cost - tried.cost
            if gain > 0:
                break
            damping = max(6 * damping, _DAMPING_AFTER_FAILURE)
        else:
            return _ended(state, bounds)
        state = tried
        if state.silhouette.extreme(state.shape):
            return state
        if gain < tolerance:
            return _ended(state, bounds)
        if gain < _MIN_GAIN_RATIO * promised:
            damping = max(6 * damping, _DAMPING_AFTER_FAILURE)
        else:
            damping = max(damping / 5, _MIN_DAMPING)
    return state


def _ended(state: State, bounds: tuple[float, float]) -> State:
    return replace(state, converged=bool(bounds[0] < state.shape[0] < bounds[1]))


def _held(state: State, g: Array, bounds: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """(size,) which parameters are at a bound, and would go beyond."""
    n = len(state.path)
    beyond = state.shape - _BOUND_STEP * np.sign(g[n:])
    held = np.zeros(state.size, bool)
    held[n:] = state.silhouette.possible(beyond, bounds) != beyond
    return held


def _moved(state: State, step: Array, bounds: tuple[float, float]) -> State:
    """The state after a step, which is shortened to where the model is about linear."""
    n, soft = len(state.path), int(state.silhouette.soft)
    lengths = [*step[: n + 1], *step[len(step) - soft :]]
    far = np.abs(lengths).max() / max(_MAX_MOVE * state.shape[0], 2 * state.observation.scale)
    bent = np.abs(step[n + 1 : len(step) - soft]).max(initial=0) / _MAX_BEND
    step = step / max(far, bent, 1)
    shape = state.silhouette.possible(state.shape + step[n:], bounds)
    return state.moved(state.path + step[:n], shape)

"""Levenberg–Marquardt steps from a start to the nearest path and shape of the least cost."""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.sweep.model.state import State

ROUGH_TOLERANCE = 0.1  # units of log likelihood, on large pixels, and where fits are compared


# Damping and length of the steps.
# Of the curvature
_FIRST_DAMPING = 1e-2
_MIN_DAMPING = 1e-7
_DAMPING_AFTER_FAILURE = 0.1  # of the curvature; less hardly changes a step that failed
# Factors of the damping after bad and good steps
_INCREASE = 6
_DECREASE = 5
_MAX_TRIALS = 8  # dampings in one step
_MIN_GAIN_RATIO = 0.25  # of the predicted gain; a smaller gain increases the damping
_MIN_CURVATURE = 1e-10  # of the largest curvature
_MAX_MOVE = 0.5  # in a step, of the radius; two pixels if that is more
_MAX_BEND = 0.3  # in a step, of the radius or radians


def minimize(
    start: State,
    bounds: tuple[float, float],
    max_steps: int = 40,
    tolerance: float = 1e-2,
) -> State:
    """Minimize the cost from a start.

    The result has converged if no step gains more than the tolerance and the radius is within bounds.

    Bounds of the radius are in pixels, the tolerance in units of log likelihood.
    """
    state, damping = start, _FIRST_DAMPING
    for _ in range(max_steps):
        H, g = state.information()
        held = _held(state, g, bounds)
        H[held], H[:, held], g[held] = 0, 0, 0
        if not (np.isfinite(H).all() and np.diag(H).max() > 0):
            return state  # the object is outside of the picture, or the fit is far off
        scales = np.sqrt(np.maximum(np.diag(H), 0) + _MIN_CURVATURE * np.diag(H).max())
        curvature, slope = H / np.outer(scales, scales), g / scales
        for _ in range(_MAX_TRIALS):
            damped = curvature + (damping + _MIN_CURVATURE) * np.eye(len(H))
            step = -np.linalg.lstsq(damped, slope)[0] / scales
            predicted = -float(g @ step) / 2
            if predicted < tolerance:
                return _ended(state, bounds)
            tried = _moved(state, np.asarray(step, float), bounds)
            gain = state.cost - tried.cost
            if gain > 0:
                break
            damping = _increased(damping)
        else:
            return _ended(state, bounds)
        state = tried
        if state.silhouette.extreme(state.shape):
            return state
        if gain < tolerance:
            return _ended(state, bounds)
        if gain < _MIN_GAIN_RATIO * predicted:
            damping = _increased(damping)
        else:
            damping = max(damping / _DECREASE, _MIN_DAMPING)
    return state


def _increased(damping: float) -> float:
    return max(_INCREASE * damping, _DAMPING_AFTER_FAILURE)


def _ended(state: State, bounds: tuple[float, float]) -> State:
    return replace(state, converged=bool(bounds[0] < state.radius < bounds[1]))


def _held(state: State, g: Array, bounds: tuple[float, float]) -> Bools:
    """(size,) which parameters are at a bound that a step along −g would cross."""
    n = len(state.path)
    beyond = state.shape - 1e-9 * np.sign(g[n:])
    held = np.zeros(state.size, bool)
    held[n:] = state.silhouette.possible(beyond, bounds) != beyond
    return held


def _moved(state: State, step: Array, bounds: tuple[float, float]) -> State:
    """The state after a step, shortened to where the model is about linear."""
    n = len(state.path)
    is_length = np.array(n * [True] + state.silhouette.is_length())
    max_move = max(_MAX_MOVE * state.radius, 2 * state.observation.scale)
    moved = np.abs(step[is_length]).max() / max_move
    bent = np.abs(step[~is_length]).max(initial=0) / _MAX_BEND
    step = step / max(moved, bent, 1)
    shape = state.silhouette.possible(state.shape + step[n:], bounds)
    return state.moved(state.path + step[:n], shape)

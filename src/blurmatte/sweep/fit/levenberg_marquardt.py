"""Levenberg–Marquardt steps from a start to the nearest path and shape of the least cost."""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.sweep.model.state import State

ROUGH_TOLERANCE = 0.1  # units of log likelihood, on large pixels, and where fits are compared


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings of the damping and of the step length."""

    # Of the curvature
    first_damping: float = 1e-2
    min_damping: float = 1e-7
    damping_after_failure: float = 0.1  # of the curvature; less hardly changes a step that failed
    # Factors of the damping after bad and good steps
    increase: float = 6
    decrease: float = 5
    max_trials: int = 8  # dampings in one step
    min_gain_ratio: float = 0.25  # of the predicted gain; a smaller gain increases the damping
    min_curvature: float = 1e-10  # of the largest curvature
    max_move: float = 0.5  # in a step, of the radius; two pixels if that is more
    max_bend: float = 0.3  # in a step, of the radius or radians


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
    settings = LevenbergMarquardt
    state, damping = start, settings.first_damping
    for _ in range(max_steps):
        H, g = state.information()
        held = _held(state, g, bounds)
        H[held], H[:, held], g[held] = 0, 0, 0
        if not (np.isfinite(H).all() and np.diag(H).max() > 0):
            return state  # the object is outside of the picture, or the fit is far off
        scales = np.sqrt(np.maximum(np.diag(H), 0) + settings.min_curvature * np.diag(H).max())
        curvature, slope = H / np.outer(scales, scales), g / scales
        for _ in range(settings.max_trials):
            damped = curvature + (damping + settings.min_curvature) * np.eye(len(H))
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
        if gain < settings.min_gain_ratio * predicted:
            damping = _increased(damping)
        else:
            damping = max(damping / settings.decrease, settings.min_damping)
    return state


def _increased(damping: float) -> float:
    settings = LevenbergMarquardt
    return max(settings.increase * damping, settings.damping_after_failure)


def _ended(state: State, bounds: tuple[float, float]) -> State:
    return replace(state, converged=bool(bounds[0] < state.shape[0] < bounds[1]))


def _held(state: State, g: Array, bounds: tuple[float, float]) -> Bools:
    """(size,) which parameters are at a bound that a step along −g would cross."""
    n = len(state.path)
    beyond = state.shape - 1e-9 * np.sign(g[n:])
    held = np.zeros(state.size, bool)
    held[n:] = state.silhouette.possible(beyond, bounds) != beyond
    return held


def _moved(state: State, step: Array, bounds: tuple[float, float]) -> State:
    """The state after a step, shortened to where the model is about linear."""
    n, soft = len(state.path), int(state.silhouette.soft)
    lengths = [*step[: n + 1], *step[len(step) - soft :]]
    max_move = max(LevenbergMarquardt.max_move * state.shape[0], 2 * state.observation.scale)
    moved = np.abs(lengths).max() / max_move
    bent = np.abs(step[n + 1 : len(step) - soft]).max(initial=0) / LevenbergMarquardt.max_bend
    step = step / max(moved, bent, 1)
    shape = state.silhouette.possible(state.shape + step[n:], bounds)
    return state.moved(state.path + step[:n], shape)

"""Descent from a start to the nearest path and shape of the least cost."""

import math
from dataclasses import replace

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.descent import descended
from blurmatte.sweep.model.state import State

ROUGH_TOLERANCE = 0.1  # units of log likelihood, on large pixels, and where fits are compared
# Largest moves in a step
_MAX_MOVE = 0.5  # of the radius; two pixels if that is more
_MAX_BEND = 0.3  # of the radius or radians


def minimize(
    start: State,
    bounds: tuple[float, float],
    max_steps: int = 40,
    tolerance: float = 1e-2,
    rival: float = math.inf,
) -> State:
    """Minimize the cost from a start.

    The result has converged if no step gains more than the tolerance and the radius is within bounds.
    It stops early if the last gain, repeated in all steps that remain, would not reach the cost of a
    rival.

    Bounds of the radius are in pixels, tolerance and costs in units of log likelihood.
    """

    def information(state: State) -> tuple[Array, Array]:
        """Of the cost, without the parameters that a bound holds."""
        H, g = state.information()
        held = _held(state, g, bounds)
        H[held], H[:, held], g[held] = 0, 0, 0
        return H, g

    state, converged = descended(
        start,
        information,
        lambda state, step: _moved(state, step, bounds),
        max_steps,
        tolerance,
        lambda state, reachable: reachable > rival or state.silhouette.extreme(state.shape),
    )
    if not converged:
        return state
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

"""Levenberg–Marquardt steps to the nearest points of least cost, and which of these differ."""

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

import numpy as np

from blurmatte.checks import Array

# Damping, of the curvature
_FIRST_DAMPING = 1e-2
_MIN_DAMPING = 1e-7  # less has no effect on a step
_DAMPING_AFTER_FAILURE = 0.1  # less hardly changes a step that failed
# Factors of the damping after bad and good steps
_INCREASE = 6
_DECREASE = 5
_MAX_TRIALS = 8  # dampings in one step
_MIN_GAIN_RATIO = 0.25  # of the predicted gain; a smaller gain increases the damping
_MIN_CURVATURE = 1e-10  # of the largest curvature


class WithCost(Protocol):
    """A point of a search: anything that has a cost."""

    @property
    def cost(self) -> float:
        """Minus the log likelihood, or another cost that is to be least."""
        ...


P = TypeVar("P", bound=WithCost)
E = TypeVar("E")


def descended(
    start: P,
    information: Callable[[P], tuple[Array, Array]],
    moved: Callable[[P, Array], P],
    max_steps: int,
    tolerance: float,
    stops: Callable[[P, float], bool] = lambda _, reachable: False,
) -> tuple[P, bool]:
    """The point of least cost near a start, and whether no step gains more than the tolerance.

    Parameters
    ----------
    start : P
    information : callable
        Curvature (k, k) and gradient (k,) of the cost at a point, both 0 for what is held. They may be
        overwritten.
    moved : callable
        The point after a step (k,), which it may shorten to where the model is about linear.
    max_steps : int
        Largest number of accepted steps.
    tolerance : float
        Of the cost.
    stops : callable
        Whether the search ends at a point without having converged; also given the cost that it reaches
        if every step that remains gains as much as the last one.
    """
    point, damping = start, _FIRST_DAMPING
    for left in range(max_steps - 1, -1, -1):  # steps
        H, g = information(point)
        if not (np.isfinite(H).all() and np.diag(H).max() > 0):
            return point, False  # data say nothing here, or the fit is far off
        scales = np.sqrt(np.maximum(np.diag(H), 0) + _MIN_CURVATURE * np.diag(H).max())
        curvature, slope = H / np.outer(scales, scales), g / scales
        for _ in range(_MAX_TRIALS):
            damped = curvature + (damping + _MIN_CURVATURE) * np.eye(len(H))
            step = -np.linalg.lstsq(damped, slope)[0] / scales
            predicted = -float(g @ step) / 2
            if predicted < tolerance:
                return point, True
            tried = moved(point, np.asarray(step, float))
            gain = point.cost - tried.cost
            if gain > 0:
                break
            damping = _increased(damping)
        else:
            return point, True
        point = tried
        if stops(point, point.cost - left * gain):
            return point, False
        if gain < tolerance:
            return point, True
        if gain < _MIN_GAIN_RATIO * predicted:
            damping = _increased(damping)
        else:
            damping = max(damping / _DECREASE, _MIN_DAMPING)
    return point, False


def distinct(ends: Iterable[E], are_alike: Callable[[E, E], bool]) -> list[E]:
    """Ends of searches, the best first, without those that are like a better one."""
    kept: list[E] = []
    for end in ends:
        if not any(are_alike(end, better) for better in kept):
            kept.append(end)
    return kept


def _increased(damping: float) -> float:
    return max(_INCREASE * damping, _DAMPING_AFTER_FAILURE)

"""Candidates, their physical admissibility, and their ranking by the Bayesian information criterion.

The criterion is that of Schwarz [1978]. Correlated residuals carry less information: costs are divided
by the variance inflation of the state of the least cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.state import State

NEGATIVE_LIGHT = "needs negative light"  # a reason why a sweep is physically impossible

# Limits of a sweep that is physically possible.
MAX_LIGHT = 1.2  # mean light of a surface, where the sensor's white is 1
# Of a channel, of the brightest one; noise may make a dark channel negative
MIN_LIGHT = -0.1
_MIN_VISIBLE_FRACTION = 0.5  # of the total alpha, on valid pixels
_MAX_OUTSIDE_FRACTION = 0.01  # of the path, outside the mask
# Turn of the path within the object's own width: half a circle, and rounding
_MAX_TURN_RAD = 3.5


def ranked(states: Sequence[State]) -> list[tuple[float, State]]:
    """Score above the best, units of log likelihood, and state; sorted, the best first.

    Inadmissible states are dropped if there are others. The time of a kink counts as two parameters,
    for noise favors one of many times [Yao 1988]. A source of light is a rare explanation: it must be
    decisively likelier.
    """
    admissible = [state for state in states if not rejection(state)] or list(states)
    likeliest = min(admissible, key=lambda state: state.cost)
    inflation = likeliest.variance_inflation
    scores = [
        (state.cost - likeliest.cost) / inflation
        + bic_penalty(
            state.observation, state.parameters + (state.family.kink(state.path) is not None)
        )
        + DECISIVE_LOG_BAYES_FACTOR * is_source(state)
        for state in admissible
    ]
    order = sorted(range(len(scores)), key=scores.__getitem__)
    return [(scores[i] - scores[order[0]], admissible[i]) for i in order]


def is_source(state: State) -> bool:
    """Whether it has more light than a surface could reflect."""
    return float(state.mean_color.max()) > MAX_LIGHT and not state.observation.light_alone


def best_of(states: Sequence[State]) -> State:
    """The first of `ranked`."""
    return ranked(states)[0][1]


def bic_penalty(observation: Observation, parameters: int) -> float:
    """Penalty of a number of parameters, units of log likelihood."""
    return 0.5 * parameters * float(np.log(max(observation.weight.sum(), 2)))


def rms_difference(one: State, other: State) -> float:
    """Root mean square difference of the alphas of two states, of the larger alpha's."""
    a, b = one.swept.alpha, other.swept.alpha
    energy = max(float((a**2).sum()), float((b**2).sum()), 1e-9)
    return float(np.sqrt(((a - b) ** 2).sum() / energy))


def rejection(state: State) -> str:
    """Reason why the sweep is physically impossible, to follow "the fit"; empty if it is possible."""
    light = state.mean_color
    if light.min() < MIN_LIGHT * light.max():
        return NEGATIVE_LIGHT
    if not inside_mask(state):
        return "leaves the streak"
    if self_overlaps(state):
        return "doubles back within its own width"
    alpha = state.swept.alpha
    hidden = (alpha * (1 - state.observation.valid_fraction)).sum()
    if hidden >= (1 - _MIN_VISIBLE_FRACTION) * alpha.sum():
        return "lies mostly where the pictures are clipped or hidden"
    return ""


def inside_mask(state: State) -> bool:
    """True if the path stays near the streak where it is within the picture."""
    observation = state.observation
    xy, _ = state.family.at(state.path, np.linspace(0, 1, 129))
    visible = np.all((xy > -0.5) & (xy < np.array(observation.size) - 0.5), axis=1)
    at = (xy[visible] - observation.origin) / observation.scale
    h, w = observation.near.shape
    x, y = np.clip(np.rint(at), 0, (w - 1, h - 1)).astype(int).T
    # Blocks may cover less than the picture: one block beyond counts as within.
    beyond = np.any((at < -1) | (at > (w, h)), axis=1)
    outside = np.count_nonzero(beyond | ~observation.near[y, x])
    return bool(outside <= _MAX_OUTSIDE_FRACTION * len(xy))


def self_overlaps(state: State) -> bool:
    """True if the path reverses twice, or circles, within the object's own width.

    Also if it bounces and both pieces are shorter than the radius: a line gives the same picture.
    """
    steps = np.diff(state.curve, axis=0) @ np.array([1, 1j])
    turned = float(np.abs(np.angle(steps[1:] * steps[:-1].conj())).sum())
    kink = state.family.kink(state.path)
    if kink is not None:
        xy, _ = state.family.at(state.path, np.array([0, kink, 1]))
        if np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < state.radius:
            return True
    return turned > _MAX_TURN_RAD and float(np.abs(steps).sum()) < 2 * state.radius * turned


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted sweep."""

    state: State
    cast: CastShadow | None = None  # the shadow in which the state's plate lies
    # Pixels by which the file blurred colors, a standard deviation; 0 if it did not
    chroma_blur: float = 0.0
    opacity_std: float = 0.0  # standard deviation of the silhouette's opacity

    @property
    def silhouette(self) -> FlatShape:
        """Kind of the shape: candidates are flat."""
        assert isinstance(self.state.silhouette, FlatShape)
        return self.state.silhouette

    @property
    def parameters(self) -> int:
        """Number of parameters of path, shape, opacity and shadow."""
        seen_through = self.silhouette.opacity < 1
        return (
            self.state.parameters + seen_through + (CastShadow.size if self.cast is not None else 0)
        )

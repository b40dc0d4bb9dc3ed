"""Ranking of fitted states by the Bayesian information criterion [Schwarz 1978].

Correlated residuals carry less information: costs are divided by the variance inflation of the state of
the least cost.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.sweep.fit.feasibility import rejection
from blurmatte.sweep.fit.residuals import variance_inflation
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.state import State


def ranked(states: Sequence[State]) -> list[tuple[float, State]]:
    """Score above the best, units of log likelihood, and state; sorted, the best first.

    Inadmissible states are dropped if there are others. The time of a kink counts as two parameters,
    for noise favors one of many times [Yao 1988].
    """
    admissible = [state for state in states if not rejection(state)] or list(states)
    likeliest = min(admissible, key=lambda state: state.cost)
    inflation = variance_inflation(likeliest)
    scores = [
        (state.cost - likeliest.cost) / inflation
        + bic_penalty(state.observation, state.size + (state.family.kink(state.path) is not None))
        for state in admissible
    ]
    order = sorted(range(len(scores)), key=scores.__getitem__)
    return [(scores[i] - scores[order[0]], admissible[i]) for i in order]


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

"""Which of several descents ended best: a penalised likelihood.

Where residuals hang together, as those of JPEG do, they are so much less evidence than they seem,
and all likelihoods count less.
"""

from collections.abc import Sequence

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State
from blurmatte.sweep.verdict import apart_from_plate, coherence


def trust_in(data: Data, states: Sequence[State]) -> float:
    """By how much likelihoods overstate the evidence, 1 or more: as the likeliest state tells."""
    return max(coherence(data, min(states, key=lambda state: state.cost)), 1.0)


def score(data: Data, state: State, trust: float) -> float:
    """Minus the log likelihood, and 2 for every parameter: as if each had to be 2σ from naught."""
    return state.cost / trust + 2.0 * state.size


def best_of(data: Data, states: Sequence[State]) -> State:
    """The state of the best penalised likelihood, of those that mean something if there are any."""
    states = [s for s in states if apart_from_plate(data, s)] or states
    trust = trust_in(data, states)
    return min(states, key=lambda state: score(data, state, trust))

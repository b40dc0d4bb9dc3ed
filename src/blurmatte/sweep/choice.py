"""Which of several descents ended best: a penalised likelihood.

Where residuals hang together, as those of JPEG do, they are so much less evidence than they seem: all
likelihoods count less.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State
from blurmatte.sweep.verdict import can_be, means_something, overstated

Array = npt.NDArray[np.float64]

CLEARLY = 5.0  # units of log likelihood: less is one to a hundred and fifty
_ANOTHER = 0.1  # of alpha, in which two differ that are not the same answer


def ranked(data: Data, states: Sequence[State]) -> list[tuple[float, State]]:
    """States and by how much each is worse than the likeliest, the best first.

    Units of log likelihood, with the `price` of the parameters. When a velocity jumps counts twice: it
    could have been at any time, and one of them suits the noise [Yao 1988]. States that mean nothing
    are left out if there are others.
    """
    states = [s for s in states if means_something(data, s)] or list(states)
    likeliest = min(states, key=lambda state: state.cost)
    trust = overstated(data, likeliest)
    sizes = [s.size + (s.family.kink(s.path) is not None) for s in states]
    scores = [
        price(data, size) + (s.cost - likeliest.cost) / trust
        for size, s in zip(sizes, states, strict=True)
    ]
    return sorted(zip(scores, states, strict=True), key=lambda pair: pair[0])


def price(data: Data, parameters: int) -> float:
    """What the log likelihood must gain for so many more parameters [Schwarz 1978].

    Of usual numbers of pixels each must be three standard deviations from naught. With two, one of
    nine straight paths was taken for another, for there are many that it can be taken for.
    """
    return 0.5 * parameters * float(np.log(max(data.weight.sum(), 2)))


def best_of(data: Data, states: Sequence[State]) -> State:
    """The state of the best penalised likelihood."""
    return ranked(data, states)[0][1]


def contested(data: Data, states: Sequence[tuple[float, State]]) -> State:
    """The first of `ranked` states, contested by later ones that are about as good."""
    (least, best), *others = states
    near = [s for score, s in others if score < least + CLEARLY and can_be(data, s)]
    return replace(best, contested=most_apart(best, near))


def most_apart(one: State, others: Iterable[State]) -> float:
    """By how much of alpha, root mean square, the most different of other answers differs."""
    return max((by for other in others if (by := apart(one, other)) > _ANOTHER), default=0.0)


def differ(one: State, other: State) -> bool:
    """Whether two ends are two answers."""
    return most_apart(one, [other]) > 0


def apart(one: State, other: State) -> float:
    """By how much of alpha two ends differ, root mean square."""
    a, b = one.swept.alpha, other.swept.alpha
    off = ((a - b) ** 2).sum() / max((a**2).sum(), (b**2).sum(), 1e-9)
    return float(np.sqrt(off))

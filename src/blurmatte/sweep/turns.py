"""A disc and what goes with it, its shadow or its highlight, told in turns until they agree."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from blurmatte.sweep.choice import apart
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, descend, relit, seen
from blurmatte.sweep.search import Search

T = TypeVar("T")

RADIUS = 8.0  # pixels: enough for a disc and what goes with it to agree on
TURNS, AGAIN = 16, 6  # on large pixels, and on small ones
_AGREED = 2e-3  # of alpha: what a turn changes when they have


def in_turns(
    data: Data,
    disc: State,
    other: T | None,
    fit: Callable[[Data, State, T | None], T],
    apply: Callable[[Data, State, T], Data],
    bounds: tuple[float, float],
    turns: int,
) -> tuple[State, T]:
    """A disc and what goes with it, until they agree.

    Parameters
    ----------
    data : Data
    disc : State
        To begin with.
    other : T, optional
        One like it.
    fit : function
        What goes with a disc.
    apply : function
        The data in which that is explained already.
    bounds : (float, float)
        Of the radius, pixels.
    turns : int
        At most.
    """
    disc = seen(data, disc)
    for _ in range(turns):
        other = fit(data, disc, other)
        rest = apply(data, disc, other)
        before, disc = disc, descend(rest, relit(rest, disc), bounds)
        if apart(before, disc) < _AGREED:
            break
    assert other is not None
    return disc, other


def beside(
    search: Search, disc: State, other: T, apply: Callable[[Data, State, T], Data]
) -> Search:
    """A search in data in which something is explained already."""
    data = apply(search.data, seen(search.data, disc), other)
    coarse = data.coarser(round(search.coarse.scale / data.scale))
    return replace(search, data=data, coarse=coarse)

"""A disc of one paint with a highlight, told together, in turns."""

from dataclasses import replace

from blurmatte.radiometry import Transfer
from blurmatte.sweep.choice import price
from blurmatte.sweep.descent import State
from blurmatte.sweep.end import End
from blurmatte.sweep.highlight import (
    PARAMETERS,
    Highlight,
    fit_highlight,
    without_highlight,
)
from blurmatte.sweep.path import PathFamily
from blurmatte.sweep.search import FAMILIES, SMOOTH, Search
from blurmatte.sweep.turns import AGAIN, RADIUS, TURNS, beside, in_turns
from blurmatte.sweep.verdict import MAX_MISFIT, overstated


def with_highlight(search: Search, disc: State, transfer: Transfer) -> End | None:
    """A disc and its highlight, if they explain the streak.

    Parameters
    ----------
    search : Search
    disc : State
        Where the search ended.
    transfer : Transfer
        Of the image's file.
    """
    if disc.frame.rank != 1 or search.data.known is not None:
        return None
    data, bounds = search.data, search.bounds
    coarse = data.coarse_enough(float(disc.shape[0]), RADIUS)
    agreed = in_turns(coarse, disc, None, fit_highlight, without_highlight, bounds, TURNS)
    for families in (SMOOTH, FAMILIES):
        end = _refined(search, agreed, families, transfer)
        if end.misfit <= MAX_MISFIT and end.highlight is not None:
            return end
    return None


def _refined(
    search: Search,
    agreed: tuple[State, Highlight],
    families: tuple[PathFamily, ...],
    transfer: Transfer,
) -> End:
    """The same on small pixels, on the best path."""
    rest = replace(beside(search, *agreed, without_highlight), families=families)
    disc, highlight = in_turns(
        search.data,
        rest.best(1),
        agreed[1],
        fit_highlight,
        without_highlight,
        search.bounds,
        AGAIN,
    )
    rest = beside(search, disc, highlight, without_highlight)
    end = End.before_bleeding(rest, disc, transfer)
    possible = highlight.color(end.state.main) is not None
    return replace(end, highlight=highlight if possible else None)


def likelier_with_highlight(shaped: End, glossy: End) -> bool:
    """Whether a disc with a highlight is likelier than an outline, or a disc without."""
    trust = max(overstated(end.search.data, end.state) for end in (shaped, glossy))
    more = glossy.state.size + PARAMETERS - shaped.state.size
    return (shaped.state.cost - glossy.state.cost) / trust > price(glossy.search.data, more)

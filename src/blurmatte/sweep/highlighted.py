"""A disc of one paint with a highlight, told together, in turns."""

from dataclasses import replace

from blurmatte.sweep.attempt import Attempt
from blurmatte.sweep.choice import differ, price
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, descend, seen
from blurmatte.sweep.end import End
from blurmatte.sweep.highlight import PARAMETERS, Highlight, fit_highlight, without_highlight
from blurmatte.sweep.outline import refined
from blurmatte.sweep.search import FAMILIES, SMOOTH
from blurmatte.sweep.turns import AGAIN, RADIUS, TURNS, beside, in_turns
from blurmatte.sweep.verdict import (
    MAX_MISFIT,
    coherence_of_noise,
    doubtful_share,
    left_beyond_noise,
    overstated,
)

# What discs with highlights may leave on large pixels: 51 right ones left up to 1.86 times noise;
# sheets and squares for which one paid mostly 2.1 to 3.6, and none of them was a disc in the end.
_MOST_LEFT = 2.0
_LITTLE = 0.02  # of the pixels: of dull balls up to 0.006 contradicted


def with_highlight(attempt: Attempt) -> Attempt | None:
    """A disc and its highlight, if they explain the streak.

    Parameters
    ----------
    attempt : Attempt
        The disc without.
    """
    search, disc = attempt.search, attempt.disc
    if disc.frame.rank != 1 or search.data.known is not None:
        return None
    coarse = search.data.coarse_enough(float(disc.shape[0]), RADIUS)
    agreed = _in_turns(coarse, disc, None, search.bounds, TURNS)
    light = without_highlight(coarse, *agreed)
    if left_beyond_noise(light, seen(light, agreed[0])) > _MOST_LEFT:
        return None
    if not _pays(coarse, disc, agreed, search.bounds):
        return None
    for families in (SMOOTH, FAMILIES):
        rest = replace(beside(search, *agreed, without_highlight), families=families)
        disc, highlight = _in_turns(search.data, rest.best(1), agreed[1], search.bounds, AGAIN)
        if highlight.color(disc.main) is None:
            continue
        rest = beside(search, disc, highlight, without_highlight)
        found = replace(attempt, search=rest, disc=disc, highlight=highlight)
        if found.end.misfit <= MAX_MISFIT and highlight.color(found.end.state.main) is not None:
            return found if _stands(found.end) else None
        if found.end.beyond_noise <= MAX_MISFIT:
            break  # it is not the path that is wrong
    return None


def _stands(end: End) -> bool:
    """Whether no outline has another alpha than a disc in the light that a highlight leaves.

    What is no disc leaves something there: of 20 glossy balls none was contested, and a sheet of
    32x13 px that went 10 px, told as a disc with a highlight 0.43 off, claiming 0.008, was.
    """
    shaped = refined(end.search.data, end.state)
    return not differ(end.state, shaped) and shaped.contested <= end.state.contested


def or_glossy(attempt: Attempt) -> Attempt:
    """A disc, or that with its highlight if it has one."""
    glossy = with_highlight(attempt) if may_be_glossy(attempt.end) else None
    if glossy is None:
        return attempt
    explained = attempt.end.left <= MAX_MISFIT
    return attempt if explained and not glossy.end.is_clearly_likelier_than(attempt.end) else glossy


def may_be_glossy(end: End) -> bool:
    """Whether one paint on a disc leaves something, or compression may have hidden what it leaves."""
    data, state = end.search.data, end.state
    explained = end.left <= MAX_MISFIT and state.silhouette.bulges == 1
    hidden = coherence_of_noise(data, state, 1) > 1
    return not explained or hidden or doubtful_share(data, state) > _LITTLE


def _pays(
    coarse: Data, disc: State, agreed: tuple[State, Highlight], bounds: tuple[float, float]
) -> bool:
    """Whether on large pixels, where it takes no time, a highlight gains what its parameters cost.

    In 20 JPEG files (90, 4:2:0) dull balls gained up to 17 units of log likelihood, of a price of
    18 to 23, and glossy ones 47 to 223.
    """
    glossy, highlight = agreed
    without = descend(coarse, seen(coarse, disc), bounds)
    ends = (coarse, without), (without_highlight(coarse, glossy, highlight), glossy)
    trust = max(overstated(*end) for end in ends)
    return (without.cost - glossy.cost) / trust > price(coarse, PARAMETERS)


def _in_turns(
    data: Data, disc: State, highlight: Highlight | None, bounds: tuple[float, float], turns: int
) -> tuple[State, Highlight]:
    return in_turns(data, disc, highlight, fit_highlight, without_highlight, bounds, turns)

"""Discs beside shadows: what lies in one is left out, or the shadow of the disc is told with it.

A shadow takes light and brings none, which tells it apart once the object's color is known. Leaving it
out leaves out what of the object it lies on, and of that there may be much: where the shadow is that of
the disc itself on something flat, as it mostly is, both are told together, in turns.
"""

from dataclasses import replace

import numpy as np

from blurmatte.sweep.attempt import Attempt
from blurmatte.sweep.cast import CastShadow, fit_cast, in_shadow
from blurmatte.sweep.descent import State, seen
from blurmatte.sweep.highlighted import or_glossy
from blurmatte.sweep.outline_start import on_path
from blurmatte.sweep.path import LINE, PathFamily
from blurmatte.sweep.search import FAMILIES, SMOOTH
from blurmatte.sweep.shadow import darkness, shadow_beside
from blurmatte.sweep.turns import AGAIN, RADIUS, TURNS, beside, in_turns
from blurmatte.sweep.verdict import MAX_MISFIT, left_beyond_noise, mostly_seen

_SHADOWS = 2  # times that a streak is looked at without what is found of its shadow
# What discs with their shadows may leave on large pixels: 65 right ones left up to 2.1 times noise,
# sheets and sticks 2.7 to 4.
_MOST_LEFT = 2.5
_LARGEST = 2.5  # times as many pixels as the object touched: shadows are as large, and soft


def beside_shadow(first: Attempt) -> Attempt:
    """A disc beside its shadow, or the first if there is none.

    If most of what is found lies in it, or it is much larger than that, it was no shadow, but a darker
    paint of the object.
    """
    if first.disc.frame.rank == 3:
        return first
    without, shaded = first, 0
    for _ in range(_SHADOWS):
        disc = without.disc
        shadow = shadow_beside(
            without.image, first.plate, without.streak, disc.main, disc.brightness
        )
        if not shadow.any():
            break
        without = without.without(shadow)
        shaded += int(np.count_nonzero(shadow))
    if without is first:
        return first
    cast = _with_cast(first, without.disc, first.disc)
    if cast is not None:
        return _or_first(cast, first)
    data, alpha = without.search.data, without.disc.swept.alpha
    large = shaded > _LARGEST * np.count_nonzero(alpha) * data.scale**2
    return without if mostly_seen(data, without.disc) and not large else first


def _or_first(cast: Attempt, first: Attempt) -> Attempt:
    """A disc and the shadow that it casts, unless the first explains all and is about as likely.

    Darkness along the path can be taken for a shadow that hides more of the object's light. Where
    both are about as likely, the first is contested.
    """
    if first.end.misfit > MAX_MISFIT or cast.end.is_clearly_likelier_than(first.end):
        return cast
    return first.contested_by(cast.end) if cast.end.is_about_as_likely_as(first.end) else first


def beside_darkness(first: Attempt) -> Attempt:
    """A disc and its shadow where no disc tells the color that tells shadow from object.

    What is dark is left out only to begin with: it may as well be another paint.
    """
    dark = darkness(first.image, first.plate, first.streak)
    if not dark.any() or not (first.streak.mask & ~dark).any():
        return _with_cast(first, first.disc) or first
    return _with_cast(first, first.without(dark).disc, first.disc) or first


def _with_cast(first: Attempt, *discs: State) -> Attempt | None:
    """A disc and the shadow that it casts, from the first disc from which they explain all.

    No shadow is quite as it is taken to be, and a path that bends or jumps would take up what is left
    of it, or reach into it: such are begun with, and asked for, where no simpler explains all.
    """
    if first.disc.frame.rank != 1:
        return None
    data = first.search.data
    for disc in discs:
        coarse = data.coarse_enough(float(disc.shape[0]), RADIUS)
        disc = seen(coarse, disc)
        straight = on_path(coarse, disc, LINE)
        for start in (disc,) if straight is disc else (straight, disc):
            agreed = in_turns(coarse, start, None, fit_cast, in_shadow, first.search.bounds, TURNS)
            if left_beyond_noise(coarse, agreed[0]) > _MOST_LEFT:
                continue
            found = _explaining(first, agreed, (SMOOTH, FAMILIES) if start is disc else (SMOOTH,))
            if found is not None:
                return found
    return None


def _explaining(
    first: Attempt, agreed: tuple[State, CastShadow], tried: tuple[tuple[PathFamily, ...], ...]
) -> Attempt | None:
    """The same on small pixels, on paths of the first families with which nothing is left."""
    for families in tried:
        found = _refined(first, agreed, families)
        if found is None:
            continue
        found = or_glossy(found)
        if found.end.misfit <= MAX_MISFIT:
            return found
        if found.end.beyond_noise <= MAX_MISFIT:
            break  # it is not the path that is wrong
    return None


def _refined(
    first: Attempt, agreed: tuple[State, CastShadow], families: tuple[PathFamily, ...]
) -> Attempt | None:
    """The same on small pixels, on the best path; None if no lamp casts such a shadow."""
    data, bounds = first.search.data, first.search.bounds
    for _ in range(2):  # with the shadow another path may be the best
        if not agreed[1].is_possible:
            return None
        search = replace(beside(first.search, *agreed, in_shadow), families=families)
        agreed = in_turns(data, search.best(1), agreed[1], fit_cast, in_shadow, bounds, AGAIN)
    if not agreed[1].is_possible:
        return None
    return replace(
        first, search=beside(first.search, *agreed, in_shadow), disc=agreed[0], cast=agreed[1]
    )

"""Growing discs: a ball that comes nearer, or goes away, during the exposure.

Which, nobody can see, but which end of the path is the larger one. Fits start from a disc's path and
from simpler ones, on large pixels, growing towards either end; growth stands for what a change of
speed along the path may have stood for.
"""

from collections.abc import Iterable
from dataclasses import replace

from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.ranking import best_of
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.sweep.model.state import State

_RADIUS, _SOFT_RADIUS = 8.0, 4.0  # pixels of a disc on large pixels
_GROWTHS = -0.5, 0.5  # logarithms that fits start from
_MAX_COARSE_STEPS, _MAX_FINE_STEPS = 15, 15


def fit_growing(disc: State, bounds: tuple[float, float]) -> State:
    """The growing disc of the least Bayesian information criterion; the disc if its own is less.

    Parameters
    ----------
    disc : State
        Where a fit of a disc ended.
    bounds : (float, float)
        Of the radius, pixels.
    """
    radius = _SOFT_RADIUS if disc.silhouette.soft else _RADIUS
    coarse = disc.on(disc.observation.coarse_enough(float(disc.shape[0]), radius))
    fits = [minimize(s, bounds, _MAX_COARSE_STEPS, ROUGH_TOLERANCE) for s in growing(coarse)]
    best = best_of([coarse, *fits])
    if best is coarse:
        return disc
    fine = minimize(best.on(disc.observation), bounds, _MAX_FINE_STEPS, ROUGH_TOLERANCE)
    return best_of([disc, fine])


def growing(disc: State) -> Iterable[State]:
    """Discs on the path and on simpler ones, that grow towards either end."""
    silhouette = replace(disc.silhouette, changes=True)
    for family in dict.fromkeys((disc.family, LINE, PARABOLA)):
        start = disc.along(family).of_kind(silhouette)
        for growth in _GROWTHS:
            shape = start.shape.copy()
            shape[1] = growth
            yield start.moved(start.path, shape)

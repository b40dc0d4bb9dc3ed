"""Fits of shapes that let light through: their opacity, found together with their form."""

from dataclasses import replace

from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.assess.opacity import Opacity, fit_opacity
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.multistart import MAX_STEPS, thin_with_moments, with_principal_axes
from blurmatte.sweep.fit.ranking import Candidate, best_of, is_source
from blurmatte.sweep.hypotheses import is_explained_by
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.model.state import State

_MIN_OPACITY = 0.02  # of a shape that is fitted by its alpha
# Of the opacity of an object that lets light through; it is 0.29 if that is open, 0…1
_MAX_OPEN_STD = 0.2
MAX_KNOWN_STD = 0.03  # of the opacity of a solid object that is known to be solid
_MAX_ROUNDS = 8  # of opacity and shape
_MIN_OPACITY_STEP = 0.2  # standard deviations between two rounds


def is_known_solid(observation: Observation) -> bool:
    """Whether no opacity but 1 is possible: if that is known, or other frames know the object."""
    opacity, prior = observation.opacity, observation.prior
    return opacity is OpacityPrior.SOLID or (opacity is OpacityPrior.USUAL and prior is not None)


def opacity_of(state: State) -> Opacity:
    """The opacity of a fit and its error; 1 ± 0 if it is known to be solid, or of light alone."""
    observation = state.observation
    if is_known_solid(observation) or observation.light_alone:
        return Opacity(1.0, 0.0)
    found = fit_opacity(state)
    is_open = found.value + found.std < OPAQUE or found.std > 1 - OPAQUE
    return found if is_open else Opacity(1.0, 0.0, even_std=found.even_std)


def seen_through(state: State, bounds: tuple[float, float], known: Opacity | None = None) -> State:
    """A fit with its opacity, both as each other need: other shapes need not explain the plate in it.

    The shape of a solid object is wrong for one that lets light through, and hides what it lets
    through. So fits start from the opacity that it has if it is not solid, where the plate's texture
    says something about that. `known` is the opacity of the fit, if it is known.
    """
    found = known or opacity_of(state)
    is_open = found.value == 1 and found.thin_std > _MAX_OPEN_STD
    is_any = state.observation.opacity is OpacityPrior.ANY
    if is_any and state.silhouette.opacity == 1 and not is_open:
        larger = _larger_thin(state, bounds)
        if larger is not None and best_of([state, larger]) is larger:
            return larger
    is_known = found.std <= MAX_KNOWN_STD and is_explained_by(state)
    if is_open or (found.value == 1 and is_known):
        return state
    return _with_own_opacity(state, found, bounds) or state


def _with_own_opacity(state: State, found: Opacity, bounds: tuple[float, float]) -> State | None:
    """A fit again and again with the opacity that is found for it, first this one; None if solid."""
    fitted = state
    for _ in range(_MAX_ROUNDS):
        opacity = max(found.value if found.value < 1 else found.thin, _MIN_OPACITY)
        if abs(opacity - fitted.silhouette.opacity) <= _MIN_OPACITY_STEP * found.thin_std:
            break
        assert isinstance(fitted.silhouette, FlatShape)
        thin = fitted.of_kind(fitted.silhouette.with_opacity(opacity))
        fitted = minimize(with_principal_axes(thin), bounds, MAX_STEPS, ROUGH_TOLERANCE)
        worse = (fitted.cost - state.cost) / state.variance_inflation
        if found.value == 1 and worse > DECISIVE_LOG_BAYES_FACTOR:
            return None
        found = opacity_of(fitted)
    return None if found.value == 1 else fitted


def _larger_thin(state: State, bounds: tuple[float, float]) -> State | None:
    """A fit of a larger disc that lets light through; None if that is solid.

    A small solid disc that moved far has nearly the alpha of a large one that lets light through and
    moved less. Neither becomes the other in small steps.
    """
    starts = thin_with_moments(state)
    if not starts:
        return None
    best = best_of([minimize(one, bounds, MAX_STEPS, ROUGH_TOLERANCE) for one in starts])
    return _with_own_opacity(best, opacity_of(best), bounds)


def with_opacity(candidate: Candidate) -> Candidate:
    """The candidate with its opacity and the error of that; path and shape are the same.

    Its alpha has the shape of the object, so that the opacity is above 0.
    """
    state, found = candidate.state, opacity_of(candidate.state)
    silhouette = candidate.silhouette.with_opacity(max(found.value, _MIN_OPACITY))
    if state.silhouette != silhouette:
        state = replace(state.of_kind(silhouette), converged=state.converged)
    return replace(candidate, state=state, opacity_std=found.std, even_opacity_std=found.even_std)


def is_plain_source(disc: State) -> bool:
    """Whether a source of one color leaves nothing to explain; of any colors, sticks do so as well."""
    one_paint = disc.observation.color.varied == 1
    return is_source(disc) and one_paint and is_explained_by(disc)


def is_alone_explaining(thin: State, disc: State) -> bool:
    """Whether a disc leaves nothing to explain if it lets light through, and something if not."""
    if thin is disc or is_explained_by(disc):
        return False
    return best_of([disc, thin]) is thin and is_explained_by(thin)

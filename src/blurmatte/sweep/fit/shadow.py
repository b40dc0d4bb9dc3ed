"""A disc and the shadow that it casts, fitted by block-coordinate descent."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.ranking import bic_penalty, rms_difference
from blurmatte.sweep.fit.residuals import variance_inflation
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.state import State

Array = npt.NDArray[np.float64]

_RADIUS = 8.0  # pixels of a disc on large pixels, enough for it and its shadow
_COARSE_ROUNDS, _FINE_ROUNDS = 10, 4
_MAX_STEPS = 10  # of the disc in a round
_CONVERGED_DIFFERENCE = 2e-3  # of alpha, in a round
_FIRST_DISTANCES = 0.7, 1.4, 2.2  # radii, of eight directions each
_MAX_DISTANCE = 6.0  # radii
_SOFTNESS = 0.03, 0.3, 1.0  # radii: least, at first, most
_DIRECTIONS = 8
_DIFFERENCE = 0.02  # of a radius, for numerical derivatives
_CAUCHY_SCALE = 2.5  # standard deviations
_MAX_EVALUATIONS = 12
_COST_TOLERANCE, _PLACE_TOLERANCE = 1e-4, 1e-3  # of both themselves: the next round refines them
_TINY = 1e-9


def fit_with_shadow(disc: State, bounds: tuple[float, float]) -> tuple[State, CastShadow] | None:
    """A disc in its own shadow, if that is possible and likelier than the disc alone.

    Parameters
    ----------
    disc : State
    bounds : (float, float)
        Of the radius, pixels.
    """
    coarse = disc.observation.coarse_enough(float(disc.shape[0]), _RADIUS)
    on_coarse = disc.on(coarse)
    straight = on_coarse.along(LINE)
    starts = (on_coarse,) if straight is on_coarse else (straight, on_coarse)
    fits = [_alternated(start, None, bounds, _COARSE_ROUNDS) for start in starts]
    best, cast = min(fits, key=lambda fit: fit[0].cost)
    gain = (on_coarse.cost - best.cost) / variance_inflation(best)
    if not cast.is_possible or gain < bic_penalty(coarse, CastShadow.size):
        return None
    fine = best.on(disc.observation)
    best, cast = _alternated(fine, cast, bounds, _FINE_ROUNDS)
    return (best, cast) if cast.is_possible and best.cost < disc.cost else None


def _alternated(
    disc: State, cast: CastShadow | None, bounds: tuple[float, float], rounds: int
) -> tuple[State, CastShadow]:
    """Shadow and disc in turn until they agree; the disc is in the observation with the shadow."""
    plain = disc.observation
    for _ in range(rounds):
        cast = fit_cast(plain, disc, cast)
        shaded = disc.relit(in_shadow(plain, disc, cast))
        before, disc = disc, minimize(shaded, bounds, _MAX_STEPS, ROUGH_TOLERANCE)
        if rms_difference(before, disc) < _CONVERGED_DIFFERENCE:
            break
    assert cast is not None
    return disc, cast


def in_shadow(observation: Observation, state: State, cast: CastShadow) -> Observation:
    """An observation with the plate in the shadow that a disc casts."""
    S = cast.missing(state.family, state.path, float(state.shape[0]), observation.pixels)
    return replace(observation, B=cast.on(observation.B, S, state.swept.alpha))


def fit_cast(observation: Observation, disc: State, start: CastShadow | None = None) -> CastShadow:
    """The shadow that explains most of what a disc leaves; it need not be possible.

    Where the object was, only light across its mean color counts: along it is shading.

    Parameters
    ----------
    observation : Observation
        With the plate without a shadow.
    disc : State
    start : CastShadow, optional
    """
    observation = observation.coarse_enough(float(disc.shape[0]), _RADIUS)
    color = disc.mean_color
    radius, disc = float(disc.shape[0]), disc.on(observation)
    alpha = disc.swept.alpha
    std = np.sqrt(observation.C_variance + observation.B_variance)
    over_noise = np.sqrt(observation.weight)[..., None] / std
    unit = color / max(float(np.linalg.norm(color)), _TINY)
    across = np.where((alpha > 0)[..., None, None], np.eye(3) - np.outer(unit, unit), np.eye(3))
    known = across * over_noise[..., None]
    light = (1 - alpha)[..., None] * observation.B - observation.C
    missing = np.einsum("yxcd,yxd->yxc", known, light).reshape(-1, 3)
    # S is a factor of each pixel, so all but S of the normal equations is the same in all trials.
    by_strength = (known * observation.B[..., None, :]).reshape(-1, 3, 3)
    products = np.matmul(by_strength.swapaxes(1, 2), by_strength).reshape(-1, 9)
    pulls = np.matmul(missing[:, None, :], by_strength)[:, 0]

    pixels = observation.pixels

    def shadow(x: Array, strength: Array) -> CastShadow:
        return CastShadow(x[:2] * radius, float(np.exp(x[2])) * radius, strength)

    def solved(x: Array) -> tuple[Array, Array]:
        """Residuals with the best strength, and that."""
        S = shadow(x, np.ones(3)).missing(disc.family, disc.path, radius, pixels).ravel()
        normal = ((S * S) @ products).reshape(3, 3) + _TINY * np.eye(3)
        t = np.clip(np.linalg.solve(normal, S @ pulls), 0, 1)
        explained = (by_strength.reshape(-1, 3) @ t).reshape(-1, 3)
        return (missing - S[:, None] * explained).ravel(), t

    place = None
    if start is not None:
        place = np.array([*start.offset / radius, np.log(start.softness / radius)])
    x = _placed(lambda x: solved(x)[0], place)
    return shadow(x, solved(x)[1])


def _placed(residuals: Callable[[Array], Array], start: Array | None) -> Array:
    """(3,) offset (x, y) and log softness, in radii, of the least residuals.

    Parameters
    ----------
    residuals : function
        Of x, in standard deviations.
    start : (3,) float, optional
        If not given, the best of several.
    """
    from scipy.optimize import least_squares

    def cost(x: Array) -> float:
        return float(np.sum(np.log1p((residuals(x) / _CAUCHY_SCALE) ** 2)))

    def slopes(x: Array) -> Array:
        steps = _DIFFERENCE * np.eye(3)
        ahead, behind = (
            np.stack([residuals(x + sign * step) for step in steps], axis=-1) for sign in (1, -1)
        )
        return np.asarray((ahead - behind) / (2 * _DIFFERENCE))

    least, first, most = np.log(_SOFTNESS)
    if start is None:
        angles = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
        starts = (
            np.array([d * np.cos(a), d * np.sin(a), first])
            for d in _FIRST_DISTANCES
            for a in angles
        )
        start = min(starts, key=cost)
    far = _MAX_DISTANCE
    bounds = (-far, -far, least), (far, far, most)
    end = least_squares(
        residuals, np.clip(start, *bounds), slopes, bounds,
        loss="cauchy", f_scale=_CAUCHY_SCALE, max_nfev=_MAX_EVALUATIONS,
        ftol=_COST_TOLERANCE, xtol=_PLACE_TOLERANCE,
    )  # fmt: skip
    return np.asarray(end.x)

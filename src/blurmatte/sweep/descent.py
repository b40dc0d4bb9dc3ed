"""One descent: from a start to the nearest best path, shape and color.

Parameters stand in the order of the path's, the shape's, and two turns of the color's frame. The cost
is that of Student's t distribution of the residuals, which a normal one would be if nothing but noise
were left.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.field import Field, field_of
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.path import PathFamily
from blurmatte.sweep.silhouette import Silhouette, Swept
from blurmatte.sweep.student import belief, bend, loss

Array = npt.NDArray[np.float64]

_STEPS, _TRIES = 40, 8
_TIMES = np.linspace(0, 1, 33)
_CAREFUL = 0.1  # of the curvature: less caution hardly changes a step that failed
_POOR = 0.25  # of the gain that a step promised: alpha bends within a pixel, and less goes too far
_LEAST = 1e-10  # of the largest curvature, what a parameter without any is given
_ENOUGH = 1e-3  # of a unit of log likelihood: no step gains more
ROUGHLY = 0.1  # of it, on large pixels: smaller steps are taken on small ones
_BEND = 0.3  # of a radius, or radians, the most that a shape is bent or turned in a step
_BRIGHTEST = 3.0  # times the root mean square of an object's light, what a spot of it may be
_BIT = 1e-9  # of a pixel
_TURN = 0.3  # radians, the largest turn of a color in a step


@dataclass(frozen=True, eq=False)
class State:
    """Path, shape and color, and how well they explain the data.

    Parameters
    ----------
    family : PathFamily
    path : (n,) float
    silhouette : Silhouette
        Of what kind the shape is.
    shape : (m,) float
    frame : Frame
        The color model.
    moments : (2, 2) or (3, 3) float
        Second moments of the object's colors within the model, 0 beyond its rank.
    swept : Swept
    e : (3, h, w) float
        Residuals of unit variance: across the model, the second 0 if it is a plane, and negative
        light; or of each channel, if the object may have any colors.
    cost : float
        Minus the log likelihood of what lies across the model.
    converged : bool
        No step gains anything any more.
    field : Field, optional
        Its colors, if it may have any.
    contested : float
        By how much of alpha, root mean square, that of another end differs that explains the data
        as well; 0 if there is none.
    """

    family: PathFamily
    path: Array
    silhouette: Silhouette
    shape: Array
    frame: Frame
    moments: Array
    swept: Swept
    e: Array
    cost: float
    converged: bool = False
    field: Field | None = None
    contested: float = 0.0

    @property
    def size(self) -> int:
        """How many parameters, those of the color included."""
        return len(self.path) + len(self.shape) + 2

    @property
    def curve(self) -> Array:
        """(33, 2) points of the path at equally spaced times."""
        return self.family.at(self.path, _TIMES)[0]

    @property
    def main(self) -> Array:
        """(3,) unit direction of most of the object's light."""
        return self.possible[0]

    @property
    def brightness(self) -> float:
        """Root mean square of the light along `main`."""
        return self.possible[1] / _BRIGHTEST

    @cached_property
    def possible(self) -> tuple[Array, float]:
        """(3,) `main`, and the most light along it that is possible where alpha is 1."""
        return _main(self.frame, self.moments)

    @cached_property
    def chi2(self) -> Array:
        """(h, w) sum of squared residuals; of as many degrees of freedom as the frame has across."""
        return np.asarray((self.e**2).sum(axis=0))

    @cached_property
    def belief(self) -> Array:
        """(h, w) how much each pixel's residuals are taken for noise."""
        return belief(self.chi2)

    def weights(self, data: Data) -> Array:
        """(h, w) how much each pixel counts."""
        return data.weight * self.belief

    def information(self, data: Data, bent: bool = False) -> tuple[Array, Array]:
        """Curvature (size, size) and gradient (size,) of the cost.

        The curvature is what noise alone would leave, or `bent` as the loss is by what else there is.
        """
        if self.field is not None:
            J, alpha = self.swept.by_parameters, self.swept.alpha
            H, g = self.field.information(J, light_of(data), alpha, self.weights(data), self.e)
            return np.pad(H, (0, 2)), np.pad(g, (0, 2))  # all colors cannot turn
        from blurmatte.sweep import residuals  # numba takes half a second to import

        H, g = residuals.normal_equations(
            self.swept.by_parameters, *light_of(data), self.swept.alpha, self.weights(data),
            bend(self.chi2) if bent else np.zeros_like(self.chi2),
            self.frame.across, self.frame.within, self.moments, *self.possible,
        )  # fmt: skip
        if data.known is not None:
            H[-2:, -2:] += data.known.information
            g[-2:] += data.known.information @ data.known.turns(self.frame)
        return H, g


def state_at(
    data: Data,
    family: PathFamily,
    path: Array,
    silhouette: Silhouette,
    shape: Array,
    frame: Frame,
) -> State:
    """What a path, a shape and a color leave unexplained."""
    swept = silhouette.sweep(family, path, shape, data)
    moments, e, cost, field = _left(data, frame, swept)
    return State(family, path, silhouette, shape, frame, moments, swept, e, cost, field=field)


def _left(data: Data, frame: Frame, swept: Swept) -> tuple[Array, Array, float, Field | None]:
    """Moments, residuals, cost and field of a `State`."""
    from blurmatte.sweep import residuals  # numba takes half a second to import

    light, alpha = light_of(data), swept.alpha
    if frame.rank == 3:
        field = field_of(light, alpha, data.weight, data.pitch)
        e = field.residuals(light, alpha)
        cost = float(np.sum(data.weight * loss((e**2).sum(axis=0)))) + field.cost
        moments = field.colors.T @ field.colors / max(len(field.colors), 1)
        return moments, e, cost, field
    moments = residuals.second_moments(*light, alpha, data.weight, frame.across, frame.within)
    e = np.empty((3, *alpha.shape))
    residuals.residuals(*light, alpha, frame.across, *_main(frame, moments), e)
    cost = np.sum(data.weight * loss((e**2).sum(axis=0)))
    if data.known is not None:
        cost += data.known.cost(frame)
    return _positive(moments), e, float(cost), None


def seen(data: Data, state: State) -> State:
    """The same path, shape and color in other data."""
    return state_at(data, state.family, state.path, state.silhouette, state.shape, state.frame)


def relit(data: Data, state: State) -> State:
    """The same in other light of the same pixels, in which alpha is what it was."""
    moments, e, cost, field = _left(data, state.frame, state.swept)
    left = replace(state, moments=moments, e=e, cost=cost, field=field)
    return replace(left, converged=False, contested=0.0)


def sharp(data: Data, state: State) -> State:
    """The same with a sharp rim, in other data."""
    silhouette = replace(state.silhouette, soft=False, defocused=False)
    shape = silhouette.like(state.silhouette, state.shape)
    return state_at(data, state.family, state.path, silhouette, shape, state.frame)


def descend(
    data: Data,
    start: State,
    bounds: tuple[float, float],
    steps: int = _STEPS,
    enough: float = _ENOUGH,
) -> State:
    """Follow the cost down from a start in no more steps than that, the radius within bounds.

    It has converged where no step gains more than `enough`, nor promises to, and the radius is not held
    at a bound: what would be larger or smaller is no end. Nor is an extreme shape, which takes up what
    something else left and grows without end.
    """
    state, caution = start, 1e-2
    for _ in range(steps):
        H, g = state.information(data, bent=True)
        held = _held(state, g, bounds)
        H[held], H[:, held], g[held] = 0, 0, 0
        if not np.diag(H).any():
            return state  # it has left the picture, and nothing there tells where to go
        scales = np.sqrt(np.diag(H) + _LEAST * np.diag(H).max())
        alike, slope = H / np.outer(scales, scales), g / scales
        for _ in range(_TRIES):
            damped = alike + (caution + _LEAST) * np.eye(len(H))
            step = -np.linalg.solve(damped, slope).astype(float) / scales
            promised = -float(g @ step) / 2
            if promised < enough:
                return _ended(state, bounds)
            tried = moved(data, state, step, bounds)
            gain = _gained(data, state, tried)
            if gain > 0:
                break
            caution = _more(caution)
        else:
            return _ended(state, bounds)
        state = tried
        if state.silhouette.extreme(state.shape):
            return state
        if gain < enough:
            return _ended(state, bounds)
        caution = _more(caution) if gain < _POOR * promised else max(caution / 5, 1e-7)
    return state


def _ended(state: State, bounds: tuple[float, float]) -> State:
    return replace(state, converged=bool(bounds[0] < state.shape[0] < bounds[1]))


def _more(caution: float) -> float:
    return max(6 * caution, _CAREFUL)


def _gained(data: Data, state: State, tried: State) -> float:
    """How much likelier `tried` is, units of log likelihood.

    A color that suits the noise of a whole picture better only seems to be.
    """
    if state.field is not None:
        return state.cost - tried.cost
    from blurmatte.sweep import residuals  # numba takes half a second to import

    feigned = residuals.feigned_by_noise(
        *light_of(data), state.swept.alpha, state.weights(data),
        state.frame.across, state.frame.within, state.moments,
        *state.possible, tried.frame.across,
    )  # fmt: skip
    return state.cost - tried.cost - float(feigned) / 2


def added_by(data: Data, state: State, by_other: Array) -> Array:
    """(size, size) by how much the covariance of one paint grows, for something else is not known.

    Parameters
    ----------
    data : Data
    state : State
    by_other : (h, w, 3, n) float
        Derivatives of the light by the parameters of that.
    """
    alpha, N, M = state.swept.alpha, state.frame.across, state.frame.within
    V = data.C_variance + (1 - alpha)[..., None] ** 2 * data.B_variance
    Q = N @ np.linalg.inv(np.einsum("ci,yxc,cj->yxij", N, V, N)) @ N.T
    weighted = state.weights(data)[..., None, None] * Q
    by_alpha = state.swept.by_parameters[:, :, None, :] * data.B[..., None]
    turned = [-(m @ state.main) * n for n in N.T for m in M.T]
    by_turns = (state.brightness * alpha)[..., None, None] * np.stack(turned, axis=1)
    by_disc = np.concatenate([by_alpha, by_turns], axis=-1)
    shared = np.einsum("yxci,yxcd,yxdj->ij", by_disc, weighted, by_other, optimize=True)
    of_disc, of_other = (
        np.einsum("yxci,yxcd,yxdj->ij", by, weighted, by, optimize=True)
        for by in (by_disc, by_other)
    )
    lost = shared @ np.linalg.pinv(of_other, hermitian=True) @ shared.T
    alone, both = (np.linalg.pinv(H, hermitian=True) for H in (of_disc, of_disc - lost))
    return np.asarray(both - alone)


def light_of(data: Data) -> tuple[Array, Array, Array, Array]:
    """Image, plate, and the variances of both."""
    return data.C, data.B, data.C_variance, data.B_variance


def _main(frame: Frame, moments: Array) -> tuple[Array, float]:
    """(3,) unit direction of most of the light with these second moments, and the most along it."""
    main, most = frame.within[:, 0], moments[0, 0]
    if frame.rank > 1:
        values, directions = np.linalg.eigh(moments[: frame.rank, : frame.rank])
        main, most = frame.within @ directions[:, -1], values[-1]
    most = _BRIGHTEST * float(np.sqrt(max(most, 0.0)))
    return np.asarray(main if main.sum() >= 0 else -main), most


def _positive(moments: Array) -> Array:
    """The nearest matrix of second moments: what is less than noise is none."""
    if len(moments) == 2 and moments[0, 0] >= 0 and np.linalg.det(moments) >= 0:
        return moments
    values, directions = np.linalg.eigh(moments)
    return np.asarray((directions * np.maximum(values, 0)) @ directions.T)


def _held(state: State, g: Array, bounds: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """(size,) which parameters are at the end of what is possible, and would go beyond."""
    n, m = len(state.path), len(state.shape)
    beyond = state.shape - _BIT * np.sign(g[n : n + m])
    held = np.zeros(state.size, bool)
    held[n : n + m] = state.silhouette.possible(beyond, bounds) != beyond
    return held


def moved(data: Data, state: State, step: Array, bounds: tuple[float, float]) -> State:
    """The state after a step, which is shortened where it leaves the range of the linear."""
    n, m = len(state.path), len(state.shape)
    bends = n + m - state.silhouette.soft
    far = np.abs([*step[: n + 1], *step[bends : n + m]]).max()
    far /= max(0.5 * state.shape[0], 2 * data.scale)
    bent = np.abs(step[n + 1 : bends]).max(initial=0) / _BEND
    turn = np.linalg.norm(step[n + m :]) / _TURN
    step = step / max(far, bent, turn, 1)
    shape = state.silhouette.possible(state.shape + step[n : n + m], bounds)
    frame = state.frame.turned(step[n + m :])
    return state_at(data, state.family, state.path + step[:n], state.silhouette, shape, frame)


def main_colors(data: Data, alpha: Array, rank: int) -> Frame:
    """The model of the light that an alpha leaves over, robustly."""
    base = data.weight * alpha**2
    at = base > 0
    P, base = data.C[at] - (1 - alpha[at])[:, None] * data.B[at], base[at]
    weights = base
    for _ in range(4):
        directions = np.linalg.eigh((P * weights[:, None]).T @ P)[1][:, : -rank - 1 : -1]
        off = P - P @ directions @ directions.T
        off = np.sqrt(np.einsum("nc,nc->n", off, off))
        usual = float(np.median(off)) if len(off) else 0.0
        weights = base / (1 + (off / max(3 * usual, 1e-12)) ** 2)
    return Frame.of(np.asarray(directions))

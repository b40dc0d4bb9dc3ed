"""State: path and shape of a sweep, their most probable colors, and the residuals."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.statistics import CORRELATED_PX, mean_of_blocks
from blurmatte.streaks import dilated
from blurmatte.sweep.model.color_field import ColorField, fit_colors
from blurmatte.sweep.model.observation import BACKGROUND_MARGIN_PX, Observation
from blurmatte.sweep.model.path import PathFamily
from blurmatte.sweep.model.shape import FlatShape, Shape, SweptAlpha
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.model.student_t import student_weight


@dataclass(frozen=True, eq=False)
class State:
    """Path and shape, and their fit to an observation."""

    observation: Observation
    family: PathFamily
    path: Array  # (n,) float
    silhouette: Shape  # kind of the shape
    shape: Array  # (m,) float
    swept: SweptAlpha  # alpha and its derivatives
    field: ColorField  # the colors
    e: Array  # (3, h, w) float: residuals of unit variance, along the observation's axes of color
    cost: float  # negative log marginal likelihood
    converged: bool = False  # no step reduces the cost any more

    @property
    def size(self) -> int:
        """Number of parameters of path and shape."""
        return len(self.path) + len(self.shape)

    @property
    def parameters(self) -> int:
        """Number of all parameters that were fitted, those that the shape holds included."""
        return len(self.path) + self.silhouette.parameters

    @property
    def radius(self) -> float:
        """The parameter of the shape that is its size, pixels."""
        return self.silhouette.value("radius", self.shape)

    @property
    def curve(self) -> Array:
        """(33, 2) points of the path at equally spaced times, pixels."""
        return self.family.curve(self.path)

    @property
    def mean_color(self) -> Array:
        """(3,) mean color of the object, linear RGB."""
        return np.asarray(self.observation.rgb(self.observation.color.axes @ self.field.mean))

    @property
    def own_light(self) -> Array:
        """(h, w, 3) of the object: alpha times its color, linear RGB."""
        light = self.field.light(self.swept.alpha) @ self.observation.color.axes.T
        return np.asarray(self.observation.rgb(light))

    @cached_property
    def chi2(self) -> Array:
        """(h, w) sum of the three squared residuals."""
        return np.asarray((self.e**2).sum(axis=0))

    @cached_property
    def weights(self) -> Array:
        """(h, w) of the pixels: less for outliers."""
        return self.observation.weight * student_weight(self.chi2, self.observation.channels)

    @property
    def weighted_residuals(self) -> Array:
        """(h, w, 3) residuals as the fit weights them."""
        weight = self.weights / np.maximum(self.observation.weight, 1e-12)
        return np.moveaxis(self.e * np.sqrt(weight), 0, -1)

    @property
    def places(self) -> tuple[Bools, Bools]:
        """Masks (h, w) of the sweep without opaque pixels, and of the background."""
        valid, alpha = self.observation.valid, self.swept.alpha
        near = dilated((alpha > 0) | self.observation.streak, BACKGROUND_MARGIN_PX)
        return near & valid & (alpha < OPAQUE), ~near & valid

    @cached_property
    def variance_inflation(self) -> float:
        """Variance of block sums of residuals over that of independent pixels, 1 or more.

        The larger of both block sizes, within the sweep. By it the log likelihood is too large.
        """
        (inside, _), n = self.places, self.observation.channels
        e = self.weighted_residuals
        return max(1.0, *(mean_of_blocks(e, inside, size, n) for size in CORRELATED_PX))

    def information(self) -> tuple[Array, Array]:
        """Curvature (size, size) and gradient (size,) of the cost; colors are marginalized."""
        H, g = self.field.information(
            self.swept.by_parameters,
            self.observation.light,
            self.swept.alpha,
            self.weights,
            self.e,
        )
        prior = self.observation.prior
        if prior is None:
            return H, g
        return prior.added(H, g, self.family, self.path, self.shape)

    def inverse_curvature(self) -> Array:
        """(size, size): the covariance of path and shape if residuals are independent and normal."""
        return np.asarray(np.linalg.pinv(self.information()[0], hermitian=True), float)

    def inverse_curvature_of(self, name: str) -> Array:
        """(k, k): the same of the parameters of the shape of one name."""
        at, n = self.silhouette.at(name), len(self.path)
        return self.inverse_curvature()[n + at.start : n + at.stop, n + at.start : n + at.stop]

    def on(self, observation: Observation) -> "State":
        """The same path and shape in another observation."""
        return state_at(observation, self.family, self.path, self.silhouette, self.shape)

    def moved(self, path: Array, shape: Array) -> "State":
        """Another path and shape of the same kinds."""
        return state_at(self.observation, self.family, path, self.silhouette, shape)

    def with_parameter(self, name: str, value: float) -> "State":
        """Another value of the parameter of the shape that has this name, or of the first of them."""
        shape = self.shape.copy()
        shape[self.silhouette.at(name).start] = value
        return self.moved(self.path, shape)

    def of_kind(self, silhouette: FlatShape) -> "State":
        """The same shape as another kind of silhouette, which may lack some of its parameters."""
        shape = silhouette.like(self.silhouette, self.shape)
        return state_at(self.observation, self.family, self.path, silhouette, shape)

    def along(self, family: PathFamily) -> "State":
        """The same on a path of another family that is about the same curve."""
        if family is self.family:
            return self
        path = family.starts(self.curve)[0]
        return state_at(self.observation, family, path, self.silhouette, self.shape)

    def relit(self, observation: Observation) -> "State":
        """The same path and shape in an observation of the same pixels: alpha is not computed again."""
        field, e, cost = _explained(
            observation, self.swept.alpha, self.family, self.path, self.shape
        )
        return replace(self, observation=observation, field=field, e=e, cost=cost, converged=False)


def state_at(
    observation: Observation,
    family: PathFamily,
    path: Array,
    silhouette: Shape,
    shape: Array,
) -> State:
    """The state of a path and a shape: alpha, colors, residuals and cost."""
    swept = silhouette.sweep(family, path, shape, observation.pixels)
    field, e, cost = _explained(observation, swept.alpha, family, path, shape)
    return State(observation, family, path, silhouette, shape, swept, field, e, cost)


def _explained(
    observation: Observation, alpha: Array, family: PathFamily, path: Array, shape: Array
) -> tuple[ColorField, Array, float]:
    """Field, residuals and cost of a `State`."""
    light, weight, (none, loss) = observation.light, observation.weight, observation.of_none
    motion = family.motion(path, observation.scale)
    field, e = fit_colors(light, alpha, weight, observation.pitch, observation.color, none, motion)
    cost = loss + field.loss + field.cost
    if observation.prior is not None:
        cost += observation.prior.cost(family, path, shape)
    return field, e, cost

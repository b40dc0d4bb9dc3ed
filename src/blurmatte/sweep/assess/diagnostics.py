"""From a candidate to a sweep: covariance, colors and dimensionless diagnostics."""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.fit.ranking import (
    Candidate,
    outlier_fraction,
    rejection,
    residual_excess,
)
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import Diagnostics, Sweep

_OPACITY_STEP = 0.01  # of a numeric derivative
_MIN_LIGHT = 1e-9  # of white, of an object that has a color
_MAX_ONE_COLOR_SPREAD = (
    0.1  # radians across the mean color: noise, gloss and two lamps of one paint
)


def sweep_of(candidate: Candidate, image: LinearImage) -> Sweep:
    """The sweep of a candidate: parameters, colors and their covariance in an image."""
    state = candidate.state
    inflation, prior = state.variance_inflation * VARIANCE, state.observation.prior
    if prior is not None:
        inflation *= prior.scatter**2
    covariance = candidate.covariance
    if covariance is None:
        covariance = inflation * state.inverse_curvature()
    silhouette = candidate.silhouette
    if candidate.chroma_blur > 0 and image.meta.sharing is None:
        silhouette = silhouette.sharp  # the file blurred the rim, not the lens
    n = len(state.path) + silhouette.size
    covariance, shape = covariance[:n, :n], state.shape[: silhouette.size]
    total = state.swept.by_parameters[..., :n].sum(axis=(0, 1))
    area_error = np.sqrt(total @ covariance @ total) / max(float(state.swept.alpha.sum()), 1e-9)
    opacity_std = candidate.opacity_std
    if silhouette.opacity < 1:
        by_opacity = opacity_std * _by_opacity(state)[:n]
        covariance = covariance + np.outer(by_opacity, by_opacity)
        # What is seen through it determines the product of opacity and coverage. The color of an object
        # that may be solid is that of a solid one.
        opacity_std = float(np.hypot(opacity_std, silhouette.opacity * area_error))
        area_error = opacity_std / silhouette.opacity
    model = _color_model(state, inflation, float(area_error))
    model = replace(model, to_srgb=image.meta.to_srgb, mean=np.maximum(state.mean_color, 0))
    sweep = Sweep(
        state.family, state.path, silhouette, shape, model, covariance, image.size,
        cast=candidate.cast, opacity_std=opacity_std,
    )  # fmt: skip
    angle = model.angle_std if model.rank < 3 else 0.0
    diagnostics = diagnosed(candidate, sweep.radius, sweep.radius_std, angle)
    if prior is not None:
        alike = prior.weight / inflation * covariance  # as the fit weights picture and prior
        probability = prior.probability(state.family, state.path, shape, alike)
        diagnostics = replace(diagnostics, prior_probability=probability)
    return replace(sweep, diagnostics=diagnostics)


def _by_opacity(state: State) -> Array:
    """(p,) derivatives of the likeliest path and shape by the opacity: of the minimum of the cost."""
    assert isinstance(state.silhouette, FlatShape)
    lower = state.silhouette.with_opacity(state.silhouette.opacity - _OPACITY_STEP)
    H, g = state.information()
    slope = (g - state.of_kind(lower).information()[1]) / _OPACITY_STEP
    return np.asarray(-np.linalg.pinv(H, hermitian=True) @ slope, float)


def diagnosed(
    candidate: Candidate, radius: float, radius_std: float, color_angle_std: float
) -> Diagnostics:
    """The diagnostics of a candidate."""
    state = candidate.state
    observation, alpha = state.observation, state.swept.alpha
    inside = (alpha > 0) & observation.valid
    inflation = state.variance_inflation
    variance = observation.C_variance + observation.B_variance
    change = ((observation.C - observation.B) ** 2 / variance)[inside]
    length = max(float(np.linalg.norm(state.field.mean)), 1e-9)
    return Diagnostics(
        rejection(state),
        state.converged,
        residual_excess(state),
        outlier_fraction(state),
        inflation,
        observation.noise_inflation,
        radius_std / radius,
        float(np.linalg.norm(state.field.spread[1:])) / length,
        color_angle_std,
        state.silhouette.softness(state.shape) / radius,
        float(np.sqrt(change.mean())) if change.size else 0.0,
        float(np.count_nonzero(inside)) / inflation,
        candidate.chroma_blur,
    )


def _color_model(state: State, inflation: float, area_error: float) -> ColorModel:
    """A line or a plane of colors, or any: as many axes as the colors spread along.

    The covariance is that of the field's mean, and of the plate's light that alpha's scale, if it is
    wrong by `area_error`, adds to the color.
    """
    field, observation = state.field, state.observation
    axes, length = observation.color.axes, float(np.linalg.norm(field.mean))
    if not length > _MIN_LIGHT:
        raise ColorModelError("the fit found no light of the object along its path")
    rank = observation.color.rank
    if rank == 3:
        rank = 1 + int(np.count_nonzero(field.spread[1:] > _MAX_ONE_COLOR_SPREAD * length))
    if rank == 3:
        return ColorModel.any()
    weight = state.weights * state.swept.alpha**2
    behind = np.einsum("yx,yxc->c", weight, observation.light[1]) / max(float(weight.sum()), 1e-9)
    std = np.hypot(np.sqrt(inflation) * field.mean_std, area_error * behind) / length
    if rank == 1:
        pole = axes @ field.mean / length
        pole = pole if pole.sum() >= 0 else -pole
        across = axes[:, 1:] * std[1:]
        basis = pole[:, None]
    else:
        basis, across = axes[:, :2], axes[:, :2] * std[2]
    return ColorModel(
        basis, across @ across.T, {"shape": float(np.degrees(np.linalg.norm(std[1:])))}
    )

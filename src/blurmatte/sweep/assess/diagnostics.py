"""From a candidate to a sweep: covariance, colors and dimensionless diagnostics.

The camera of a sweep need not be known. A ball that is seen at an angle θ from the axis of a camera is
an ellipse in its picture, longer by 1 / cos θ along the direction from the center of the picture. In
this file s = ½ log(1 / cos θ) is the logarithm of this stretch, and tan θ = d / f, with the ball's
distance d from the center of the picture and the focal length f, both in pixels.
"""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import UNIFORM_VARIANCE
from blurmatte.sweep.fit.ranking import Candidate, outlier_fraction, rejection, residual_excess
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import FlatShape
from blurmatte.sweep.model.silhouette import as_silhouette
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import Diagnostics, Sweep

_OPACITY_STEP = 0.01  # of a numeric derivative
_MIN_LIGHT = 1e-9  # of white, of an object that has a color
# Radians across the mean color: noise, gloss and two lamps of one paint
_MAX_ONE_COLOR_SPREAD = 0.1
# Of usual lenses, 24 to 200 mm for a frame of 36 mm: over the longer side of the picture. In this range
# all ratios of two focal lengths are alike.
_FOCAL_LENGTHS = 24 / 36, 200 / 36
_NODES = 16  # of the mean over focal lengths


def sweep_of(candidate: Candidate, image: LinearImage) -> Sweep:
    """The sweep of a candidate: parameters, colors and their covariance in an image."""
    state = candidate.state
    inflation, prior = state.variance_inflation * VARIANCE, state.observation.prior
    if prior is not None:
        inflation *= prior.scatter**2
    covariance = candidate.covariance
    if covariance is None:
        covariance = inflation * state.inverse_curvature()
    silhouette, by_rim = candidate.silhouette, candidate.rim_covariance
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
        opacity_std = _with_error_of_area(opacity_std, silhouette.opacity, float(area_error))
        area_error = opacity_std / silhouette.opacity
    model = _color_model(state, inflation, float(area_error))
    model = replace(model, to_srgb=image.meta.to_srgb, mean=np.maximum(state.mean_color, 0))
    sweep = Sweep(
        state.family, state.path, silhouette, shape, model, covariance, image.size,
        cast=candidate.cast, opacity_std=opacity_std,
        assumed_covariance=None if by_rim is None else by_rim[:n, :n],
    )  # fmt: skip
    angle = model.angle_std if model.rank < 3 else 0.0
    diagnostics = diagnosed(candidate, sweep.radius, sweep.radius_std, angle)
    if prior is not None:
        alike = prior.weight / inflation * covariance  # as the fit weights picture and prior
        probability = prior.probability(state.family, state.path, shape, alike)
        diagnostics = replace(diagnostics, prior_probability=probability)
    return replace(sweep, diagnostics=diagnostics)


def _with_error_of_area(std: float, opacity: float, area_error: float) -> float:
    """Standard deviation of an opacity and of what a relative error of the area adds to it.

    An opacity is a fraction: the area adds nothing beyond the error of one of which nothing is known.
    """
    unknown = unknown_opacity_std(opacity)
    return max(std, min(float(np.hypot(std, opacity * area_error)), unknown))


def unknown_opacity_std(opacity: float) -> float:
    """Root mean square distance of an opacity of which nothing is known, from 0 to 1, from a value."""
    return float(np.sqrt(UNIFORM_VARIANCE + (opacity - 0.5) ** 2))


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
        candidate.even_opacity_std,
    )


def _color_model(state: State, inflation: float, area_error: float) -> ColorModel:
    """A line or a plane of colors, or any: as many axes as the colors spread along.

    The covariance is that of the field's mean, and of the plate's light that alpha's scale, if it is
    wrong by `area_error`, adds to the color.
    """
    field, observation = state.field, state.observation
    mean, axes = state.mean_color, observation.rgb(observation.color.axes.T).T
    length = float(np.linalg.norm(mean))
    if not length > _MIN_LIGHT:
        raise ColorModelError("the fit found no light of the object along its path")
    pole = mean / length
    # Columns: linear RGB of a unit along each axis, across the mean color
    across = axes - np.outer(pole, pole @ axes)
    size = np.linalg.norm(across, axis=0)
    rank = observation.color.rank
    if rank == 3:
        spread = (field.spread * size)[1:]
        rank = 1 + int(np.count_nonzero(spread > _MAX_ONE_COLOR_SPREAD * length))
    if rank == 3:
        return ColorModel.any()
    weight = state.weights * state.swept.alpha**2
    behind = np.einsum("yx,yxc->c", weight, observation.light[1]) / max(float(weight.sum()), 1e-9)
    std = np.hypot(np.sqrt(inflation) * field.mean_std, area_error * behind) / length
    evidence = {"shape": float(np.degrees(np.linalg.norm(std * size)))}
    if rank == 1:
        pole = pole if pole.sum() >= 0 else -pole
        across = across * std
        return ColorModel(pole[:, None], across @ across.T, evidence)
    basis, R = np.linalg.qr(axes[:, :2])
    basis = basis * np.sign(np.diag(R))
    normal_std = abs(float(np.cross(*basis.T) @ axes[:, 2])) * std[2]
    return ColorModel(basis, normal_std**2 * (basis @ basis.T), evidence)


def with_perspective_error(sweep: Sweep) -> Sweep:
    """The sweep with what a stretch by perspective adds to the covariance of a disc's parameters.

    The parameters change as the disc does whose alpha is nearest to that of the ellipse. The stretch is
    that of a ball in the middle of the exposure, its root mean square over focal lengths. It is an
    error, for the disc need not be a ball, nor the center of the picture that of the lens.
    """
    if not sweep.silhouette.is_disc:
        return sweep
    by_parameters, by_stretch = _derivatives(sweep, _stretch(sweep))
    change = np.linalg.lstsq(by_parameters, by_stretch, rcond=None)[0]
    return replace(sweep, covariance=sweep.covariance + np.outer(change, change))


def _stretch(sweep: Sweep) -> Array:
    """(2,) s cos 2φ and s sin 2φ of the direction φ from the center of the picture."""
    center = (np.array(sweep.size) - 1) / 2
    x, y = sweep.family.at(sweep.path, np.array([0.5]))[0][0] - center
    focal = max(sweep.size) * np.geomspace(*_FOCAL_LENGTHS, _NODES)
    size = np.sqrt(np.mean(np.log(np.hypot(1, np.hypot(x, y) / focal)) ** 2)) / 2
    angle = 2 * np.arctan2(y, x)
    return np.asarray(size * np.array([np.cos(angle), np.sin(angle)]))


def _derivatives(sweep: Sweep, stretch: Array) -> tuple[Array, Array]:
    """Alpha of the pixels by the parameters (p, n + m) of a disc, and by a stretch (p,)."""
    disc, path, n = as_silhouette(sweep.silhouette), sweep.path, len(sweep.path)
    ellipse = replace(disc, order=2)
    # The first of each name are those of the disc: an ellipse has two more rates.
    own = [ellipse.names.index(name) for name in disc.names]
    shape = np.zeros(ellipse.size)
    shape[own] = sweep.shape
    J = ellipse.sweep(sweep.family, path, shape, Pixels.of_box(sweep.box)).by_parameters
    J = J.reshape(-1, J.shape[-1])
    of_path, of_shape = J[:, :n], J[:, n:]
    return np.hstack([of_path, of_shape[:, own]]), of_shape[:, ellipse.at("stretch")] @ stretch

"""Diagnostics of a fitted sweep: dimensionless statistics, and their values for a correct model."""

from dataclasses import dataclass

import numpy as np

from blurmatte.sweep.fit.candidate import Candidate
from blurmatte.sweep.fit.feasibility import rejection
from blurmatte.sweep.fit.residuals import (
    outlier_fraction,
    residual_excess,
    variance_inflation,
)


@dataclass(frozen=True)
class Diagnostics:
    """Evidence for and against a fitted sweep; the defaults are those of a correct model.

    Parameters
    ----------
    rejection : str
        Reason why it is physically impossible, to follow "the fit"; empty if it is possible.
    converged : bool
        The fit ended within its bounds.
    residual_excess : float
        Correlation of residuals over 4 and 8 pixels within the sweep, over that outside; 1 if right.
    outlier_fraction : float
        Fraction of pixels beyond the 99.9 % quantile of noise; 0.001 if right.
    variance_inflation : float
        Variance of block sums of residuals over that of independent pixels; 1 if right.
    noise_inflation : float
        Variance of the noise that the fit needs over the one that was measured; 1 if right.
    mode_disagreement : float
        Root mean square difference of alpha from other hypotheses, weighted, of alpha's own.
    radius_error : float
        Standard deviation of the radius, of the radius.
    color_spread : float
        Spread of color across the mean color, radians.
    color_angle_std : float
        Standard deviation of the color's direction, degrees.
    blur_over_radius : float
        Standard deviation of the rim's blur, of the radius.
    signal_to_noise : float
        Change of a pixel in the sweep over its noise, root mean square.
    effective_pixels : float
        Number of pixels in the sweep over the variance inflation.
    chroma_blur : float
        Standard deviation by which the file blurred colors, pixels; 0 if it did not.
    """

    rejection: str = ""
    converged: bool = True
    residual_excess: float = 1.0
    outlier_fraction: float = 0.0
    variance_inflation: float = 1.0
    noise_inflation: float = 1.0
    mode_disagreement: float = 0.0
    radius_error: float = 0.0
    color_spread: float = 0.0
    color_angle_std: float = 0.0
    blur_over_radius: float = 0.0
    signal_to_noise: float = 0.0
    effective_pixels: float = 0.0
    chroma_blur: float = 0.0


def diagnosed(
    candidate: Candidate, radius: float, radius_std: float, color_angle_std: float
) -> Diagnostics:
    """The diagnostics of a candidate; disagreement is known once there are others."""
    state = candidate.state
    observation, alpha = state.observation, state.swept.alpha
    inside = (alpha > 0) & observation.valid
    inflation = variance_inflation(state)
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
        0.0,
        radius_std / radius,
        float(np.linalg.norm(state.field.spread[1:])) / length,
        color_angle_std,
        state.silhouette.softness(state.shape) / radius,
        float(np.sqrt(change.mean())) if change.size else 0.0,
        float(np.count_nonzero(inside)) / inflation,
        candidate.chroma_blur,
    )

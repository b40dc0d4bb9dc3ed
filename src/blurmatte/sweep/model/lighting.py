"""The light on the plate near an object, as a smooth Gaussian random field of its change.

An object shadows the background and reflects light onto it: the plate is B (1 + ρ) near the object, ρ
smooth. Lamps are about white, so that ρ is the same in all channels. In this file
ρ = Σ_j φ_j ρ_j with bilinear hats φ_j around the nodes of a grid over the whole observation,

    C = (1 + ρ) B + noise

wherever the object is not, and the nodes have the prior density of

    Σ (ρ_i − ρ_j)²/(2 τ²) + Σ ρ_j²/(2 κ²),

the first sum over neighbors. κ and τ are estimated as those of colors are (`color_field`); the cost
includes the volume of the posterior, so that it is what ρ adds to a negative log marginal likelihood.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.color_field import Grid
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.student_t import student_weight


@dataclass(frozen=True)
class LightingSettings:
    """Settings of the fit of ρ; all but rounds and pitch are fractions of the plate's light."""

    rounds: int = 6  # of the field, then its amplitude and the pixels' weights
    # κ and τ at the start, as of a shadow near a wall
    first_spread: float = 0.3
    first_step: float = 0.15
    min_spread: float = 1e-4  # of κ and τ
    # Of ρ
    min_change: float = -0.95
    max_change: float = 0.5
    # From node to node, in those of the color field: half the half width of a streak
    pitch: float = 2.0


@dataclass(frozen=True, eq=False)
class Lighting:
    """The change ρ of the plate's light in an observation."""

    # (h, w) float: ρ in the observation's pixels, and its standard deviation given its neighbors
    change: Array
    std: Array
    cost: float  # negative log prior density of its nodes, and the log volume of their posterior
    origin: tuple[float, float]  # where the center of pixel (0, 0) is, in pixels of the picture
    scale: float  # width of a pixel, in pixels of the picture

    def is_possible(self, alpha: Array) -> bool:
        """True if an object of this alpha can cause this change.

        Its shadow moves with it: no pixel is in shadow for longer than some pixel is covered.
        """
        return bool(-self.change.min() <= alpha.max())

    def lit(self, observation: Observation) -> Observation:
        """An observation of the same pixels with the plate in this light."""
        factor = (1 + self.change)[..., None]
        variance = observation.B_variance + (self.std[..., None] * observation.B) ** 2
        return replace(observation, B=factor * observation.B, B_variance=variance)

    def on(self, plate: LinearImage) -> LinearImage:
        """The plate in this light; pixels outside of the observation do not change."""
        change, std = (self._in_picture(x, plate) for x in (self.change, self.std))
        B = plate.rgb * (1 + change)[..., None]
        variance = plate.variance + (std[..., None] * plate.rgb) ** 2
        kind = plate.rgb.dtype
        return replace(plate.with_noise(variance.astype(kind)), rgb=B.astype(kind))

    def _in_picture(self, values: Array, plate: LinearImage) -> Array:
        from scipy.ndimage import map_coordinates

        width, height = plate.size
        h, w = values.shape
        found = np.zeros((height, width))
        (x, y), half = self.origin, (self.scale - 1) / 2
        x0, y0 = round(x - half), round(y - half)
        x1, y1 = round(x0 + w * self.scale), round(y0 + h * self.scale)
        rows, columns = (np.arange(y0, y1) - y) / self.scale, (np.arange(x0, x1) - x) / self.scale
        at = np.meshgrid(rows, columns, indexing="ij")
        found[y0:y1, x0:x1] = map_coordinates(values, at, order=1, mode="nearest")
        return found


def fit_lighting(observation: Observation) -> Lighting:
    """The change of the plate's light, estimated without a model of the object.

    Pixels of another hue than the plate's show the object and have little influence. The
    observation has the plate as it was without the object.
    """
    from blurmatte.sweep.model import (
        color_field_kernel,
        lighting_kernel,
    )  # numba takes half a second

    shape = observation.weight.shape
    settings = LightingSettings
    pitch = settings.pitch * observation.pitch
    grid = Grid.over(np.ones(shape), pitch)
    light = observation.C, observation.B, observation.C_variance, observation.B_variance
    differences, n = grid.differences(), grid.size
    prior, nodes = np.empty((grid.width, n)), np.empty(n)
    spread, step, cost = settings.first_spread, settings.first_step, 0.0
    chi2, change, std = np.empty(shape), np.empty(shape), np.empty(shape)
    lighting_kernel.chi2_of_best(*light, chi2)
    for _ in range(settings.rounds):
        weight = observation.weight * student_weight(chi2)
        band, right = np.zeros((grid.width, n)), np.zeros(n)
        lighting_kernel.equations(*light, weight, pitch, grid.number, band, right)
        cost, _, _ = color_field_kernel.fit_axis(
            band, right, differences, spread, step, False, prior, nodes
        )
        clipped = np.clip(nodes, settings.min_change, settings.max_change)
        lighting_kernel.values(pitch, grid.number, clipped, change)
        lighting_kernel.chi2(*light, change, chi2)
        lighting_kernel.values(pitch, grid.number, 1 / np.sqrt(band[0] + prior[0]), std)
        away, steps = color_field_kernel.scales(band, prior, nodes, 0.0, grid.neighbors)
        spread, step = (max(float(x), settings.min_spread) for x in (away, steps))
    return Lighting(change, std, float(cost), observation.origin, observation.scale)

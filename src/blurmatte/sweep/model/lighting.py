"""The light on the plate near an object, as a smooth Gaussian random field of its change.

An object shadows the background and reflects light onto it: the plate is B (1 + ρ u) near the object,
ρ smooth. The hue u, three factors with the mean 1, is that of the light that is missing over all light:
a lamp is seldom as warm as the light around it. In this file ρ = Σ_j φ_j ρ_j with bilinear hats φ_j
around the nodes of a grid over the whole observation,

    C = (1 + ρ u) B + noise

wherever the object is not, and the nodes have the prior density of

    Σ (ρ_i − ρ_j)²/(2 τ²) + Σ ρ_j²/(2 κ²),

the first sum over neighbors. κ and τ are estimated as those of colors are (`color_field`), and u, which
is about 1, in turn with ρ; the cost includes the volume of the posterior, so that it is what ρ and u
add to a negative log marginal likelihood.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.color_field import EVEN, Grid
from blurmatte.sweep.model.color_field_kernel import fit_axis, scales
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.student_t import student_weight

# Settings of the fit of ρ; all but rounds and pitch are fractions of the plate's light.
_ROUNDS = 6  # of the field, then its amplitude and the pixels' weights
# κ and τ at the start, as of a shadow near a wall
_FIRST_SPREAD = 0.3
_FIRST_STEP = 0.15
_MIN_SPREAD = 1e-4  # of κ and τ
# Hue u of missing light, 1 + its warmth times this: lamps and skies lie on a line from blue to orange
_WARM = np.array([1.0, 0.0, -1.0])
_WARMTH_STD = 0.2  # of a lamp before other light
_MIN_HUE = 0.01  # of u from 1: less changes no light by more than noise
# Of ρ
_MIN_CHANGE = -0.95
_MAX_CHANGE = 0.5
# From node to node, in those of the color field: half the half width of a streak
_PITCH = 2.0


@dataclass(frozen=True, eq=False)
class Lighting:
    """The change ρ u of the plate's light in an observation."""

    # (h, w) float: ρ in the observation's pixels, and its standard deviation given its neighbors
    change: Array
    std: Array
    # Negative log prior density of its nodes and of its hue, and the log volume of their posterior
    cost: float
    hue: Array  # (3,) u
    origin: tuple[float, float]  # where the center of pixel (0, 0) is, in pixels of the picture
    scale: float  # width of a pixel, in pixels of the picture

    @property
    def is_colored(self) -> bool:
        """Whether its hue is not that of all light."""
        return bool(np.abs(self.hue - 1).max() > _MIN_HUE)

    def is_possible(self, alpha: Array) -> bool:
        """True if an object of this alpha can cause this change.

        Its shadow moves with it: no pixel is in shadow for longer than some pixel is covered.
        """
        return bool(-self.change.min() <= alpha.max())

    def lit(self, observation: Observation) -> Observation:
        """An observation of the same pixels with the plate in this light."""
        B, by_change = observation.B, self.hue * observation.B
        variance = observation.B_variance + (self.std[..., None] * by_change) ** 2
        return replace(observation, B=B + self.change[..., None] * by_change, B_variance=variance)

    def on(self, plate: LinearImage) -> LinearImage:
        """The plate in this light; pixels outside of the observation do not change."""
        (rows, columns), at = self._places()
        change, std = (
            scipy.ndimage.map_coordinates(x, at, order=1, mode="nearest")[..., None]
            for x in (self.change, self.std)
        )
        rgb, variance = plate.rgb.copy(), np.array(plate.variance, plate.rgb.dtype)
        by_change = self.hue * rgb[rows, columns]
        rgb[rows, columns] += change * by_change
        variance[rows, columns] += (std * by_change) ** 2
        return replace(plate.with_noise(variance), rgb=rgb)

    def _places(self) -> tuple[tuple[slice, slice], Array]:
        """Rows and columns of the observation in the picture, and where its pixels are: (2, H, W)."""
        (x, y), half = self.origin, (self.scale - 1) / 2
        h, w = self.change.shape
        x0, y0 = round(x - half), round(y - half)
        rows = slice(y0, round(y0 + h * self.scale))
        columns = slice(x0, round(x0 + w * self.scale))
        at = np.mgrid[rows, columns] - np.array([y, x])[:, None, None]
        return (rows, columns), at / self.scale


def fit_lighting(observation: Observation, is_gray: bool = True) -> Lighting:
    """The change of the plate's light, estimated without a model of the object.

    Pixels of another hue than the plate's show the object and have little influence. The
    observation has the plate as it was without the object. If the change is gray, its hue is 1.
    """
    shape = observation.weight.shape
    grid = Grid.over(np.ones(shape), _PITCH * observation.pitch)
    hats, differences, n = _hats(grid, shape), grid.differences(), grid.size
    B, V = observation.B, observation.C_variance + observation.B_variance
    lost = observation.C - B
    prior, nodes = np.empty((grid.width, n)), np.empty(n)
    spread, step, cost, of_hue = _FIRST_SPREAD, _FIRST_STEP, 0.0, 0.0
    hue, G = np.ones(3), B  # G: the change of light by ρ
    # Of the best change of each pixel: the residual is light of other hues.
    known, pull = ((G * x / V).sum(axis=-1) for x in (G, lost))
    chi2 = np.maximum((lost**2 / V).sum(axis=-1) - pull**2 / (known + 1e-30), 0)
    for _ in range(_ROUNDS):
        weight = observation.weight * student_weight(chi2, observation.channels)
        known, pull = ((weight * (G * x / V).sum(axis=-1)).ravel() for x in (G, lost))
        band = _lower_band(hats.T @ hats.multiply(known[:, None]), grid.width)
        cost, _, _ = fit_axis(band, hats.T @ pull, differences, spread, step, False, prior, nodes)
        change = (hats @ np.clip(nodes, _MIN_CHANGE, _MAX_CHANGE)).reshape(shape)
        if not is_gray:
            hue, of_hue = _hue_of(lost, change[..., None] * B, weight[..., None] / V)
            G = hue * B
        chi2 = ((lost - G * change[..., None]) ** 2 / V).sum(axis=-1)
        std = (hats @ (1 / np.sqrt(band[0] + prior[0]))).reshape(shape)
        away, steps = scales(band, prior, nodes, 0.0, grid.neighbors, EVEN)
        spread, step = (max(float(x), _MIN_SPREAD) for x in (away, steps))
    cost = float(cost) + of_hue
    return Lighting(change, std, cost, hue, observation.origin, observation.scale)


def _hats(grid: Grid, shape: tuple[int, ...]) -> "scipy.sparse.csr_array":
    """(h w, n) values of the nodes' hats in the pixels (h, w) of a picture that a grid covers."""

    def along(size: int) -> "scipy.sparse.csr_array":
        """(size, nodes) values of linear hats along a side."""
        at = np.arange(size) / grid.pitch
        apart = np.abs(at[:, None] - np.arange(int(at[-1]) + 2))
        return scipy.sparse.csr_array(np.maximum(1 - apart, 0))

    rows, columns = map(along, shape)
    order = np.argsort(grid.number[grid.number >= 0])
    return scipy.sparse.kron(rows, columns, "csr")[:, order]


def _lower_band(matrix: "scipy.sparse.sparray", width: int) -> Array:
    """(width, n) lower band of a sparse symmetric matrix (n, n)."""
    diagonals, band = matrix.todia(), np.zeros((width, matrix.shape[0]))
    lower = diagonals.offsets <= 0
    known = diagonals.data.shape[1]  # columns of zeros at the end are left out
    band[-diagonals.offsets[lower], :known] = diagonals.data[lower]
    return band


def _hue_of(lost: Array, by_hue: Array, weight: Array) -> tuple[Array, float]:
    """The likeliest hue (3,) of lost = hue by_hue, (h, w, 3) each, and its part of the cost.

    That is its prior density and the log volume of its posterior, over that of its prior.
    """
    by_warmth = by_hue * _WARM
    known = float((weight * by_warmth**2).sum()) + _WARMTH_STD**-2
    warmth = float((weight * by_warmth * (lost - by_hue)).sum()) / known
    warmth = float(np.clip(warmth, -1, 1))
    cost = (warmth / _WARMTH_STD) ** 2 / 2 + np.log(known * _WARMTH_STD**2) / 2
    return 1 + warmth * _WARM, float(cost)

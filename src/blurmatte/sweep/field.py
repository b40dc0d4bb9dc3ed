"""Field: the colors along a sweep of an object that may have any.

No direction of light lies across a model of all colors. But what is painted on a thing is smeared by
its motion, so that its color changes little within a fraction of its radius. In this file α k is the
light of the object, k = Σ_j φ_j k_j with hats φ_j around the nodes j of a grid, and

    e = (C − (1 − α) B − α k) / √V,    V = V_C + (1 − α)² V_B

is left in each channel. The nodes' colors have the prior density of
Σ |k_i − k_j|²/τ² + Σ |k_j − k̄|²/κ², the first sum over neighbors; k̄ is their mean, κ its length and τ
how much neighbors differ. Where alpha is wrong, the plate's texture is left over, and beside the
object the plate itself.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.student import belief

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Light = tuple[Array, Array, Array, Array]

_ROUNDS = 4  # of fitting colors, then what they differ by and which pixels to doubt
_LEAST_CHANGE, _LEAST_COLOR = 0.01, 1e-3  # of a color, by which neighbors differ; light


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes wherever an object was.

    Parameters
    ----------
    pitch : float
        Pixels from node to node.
    number : (rows, columns) int
        Of each node, −1 where there is none.
    neighbors : (2, k) int
        Pairs of nodes side by side, the lower number first.
    width : int
        Of the lower band of a matrix that couples nodes of one cell.
    """

    pitch: float
    number: Indices
    neighbors: Indices
    width: int

    @classmethod
    def over(cls, alpha: Array, pitch: float) -> "Grid":
        """The nodes of all cells where alpha (h, w) is not 0."""
        from blurmatte.sweep import field_kernel  # numba takes half a second to import

        h, w = alpha.shape
        number = np.full((int(h / pitch) + 2, int(w / pitch) + 2), -1, np.int64)
        field_kernel.touched(alpha, pitch, number)
        number[number == 0] = np.arange(np.count_nonzero(number == 0))
        beside = [_pairs(number[:, :-1], number[:, 1:]), _pairs(number[:-1], number[1:])]
        aslant = [
            _pairs(number[:-1, :-1], number[1:, 1:]),
            _pairs(number[:-1, 1:], number[1:, :-1]),
        ]
        apart = [int(np.max(b - a, initial=0)) for a, b in (*beside, *aslant)]
        return cls(pitch, number, np.concatenate(beside, axis=1), 1 + max(apart))

    @property
    def size(self) -> int:
        """How many nodes."""
        return int(self.number.max()) + 1

    def differences(self) -> Array:
        """(width, size) lower band of the matrix of the sum of squared differences of neighbors."""
        band = np.zeros((self.width, self.size))
        i, j = self.neighbors
        np.add.at(band[0], i, 1)
        np.add.at(band[0], j, 1)
        band[j - i, i] = -1
        return band

    def hats(self, alpha: Array) -> Array:
        """(h, w, size) of the nodes, where alpha is not 0."""
        from blurmatte.sweep import field_kernel  # numba takes half a second to import

        hats = np.zeros((*alpha.shape, self.size))
        field_kernel.write_hats(alpha, self.pitch, self.number, hats)
        return hats


@dataclass(frozen=True, eq=False)
class Field:
    """Colors of a grid's nodes.

    Parameters
    ----------
    grid : Grid
    colors : (m, 3) float
        Linear light.
    prior : (width, m) float
        Lower band of the inverse covariance that they were expected to have, in each channel.
    cost : float
        Minus the log likelihood of these colors, and of the volume of those that would do as well.
    """

    grid: Grid
    colors: Array
    prior: Array
    cost: float

    def residuals(self, light: Light, alpha: Array) -> Array:
        """(3, h, w) of unit variance."""
        from blurmatte.sweep import field_kernel  # numba takes half a second to import

        e = np.empty((3, *alpha.shape))
        field_kernel.residuals(*light, alpha, self.grid.pitch, self.grid.number, self.colors, e)
        return e

    def information(
        self, J: Array, light: Light, alpha: Array, weight: Array, e: Array
    ) -> tuple[Array, Array]:
        """Curvature (n, n) and gradient (n,) of the cost by what alpha depends on.

        The colors follow: what they could explain of a change is no evidence against it.
        """
        from blurmatte.sweep import field_kernel  # numba takes half a second to import

        cross = np.zeros((3, self.grid.size, J.shape[2]))
        H, g = field_kernel.by_alpha(
            J, *light, alpha, weight, self.grid.pitch, self.grid.number, self.colors, e, cross
        )
        band, _ = _equations(self.grid, light, alpha, weight)
        for coupled, own in zip(cross, band, strict=True):
            H -= coupled.T @ _solved(_factor(own + self.prior), coupled)
        return H, g


def field_of(light: Light, alpha: Array, weight: Array, pitch: float, alike: bool = True) -> Field:
    """The likeliest colors of an object of known alpha.

    Parameters
    ----------
    light : four of (h, w, 3) float
        Image, plate, and the variances of both.
    alpha, weight : (h, w) float
    pitch : float
        Pixels from node to node.
    alike : bool
        Neighbors are about as much alike as they turn out to be; else they may be of any color.
    """
    grid = Grid.over(alpha, pitch)
    if grid.size == 0:
        return Field(grid, np.zeros((0, 3)), np.zeros((1, 0)), 0.0)
    i, j = grid.neighbors
    differences = grid.differences()
    band, right = _equations(grid, light, alpha, weight)
    mean = right.sum(axis=1) / np.maximum(
        band[:, 0].sum(axis=1) + 2 * band[:, 1:].sum((1, 2)), 1e-9
    )
    length = max(float(np.linalg.norm(mean)), _LEAST_COLOR)
    change = length
    for _ in range(_ROUNDS):
        prior = differences / change**2
        prior[0] += length**-2
        factors = [_factor(own + prior) for own in band]
        colors = np.stack(
            [_solved(f, r + x / length**2) for f, r, x in zip(factors, right, mean, strict=True)], 1
        )
        steps = np.sum((colors[i] - colors[j]) ** 2, axis=1)
        away = np.sum((colors - mean) ** 2)
        cost = (steps.sum() / change**2 + away / length**2) / 2
        cost += sum(np.log(f[0]).sum() for f in factors) - 3 * np.log(_factor(prior)[0]).sum()
        field = Field(grid, colors, prior, float(cost))
        told = band[:, 0].mean(axis=0) / (band[:, 0].mean(axis=0) + prior[0])
        told = np.minimum(told[i], told[j])
        usual = np.sqrt((told * steps).sum() / max(3 * told.sum(), 1e-9))
        change = max(float(usual), _LEAST_CHANGE * length) if alike else length
        doubted = weight * belief((field.residuals(light, alpha) ** 2).sum(axis=0))
        band, right = _equations(grid, light, alpha, doubted)
    return field


def _equations(grid: Grid, light: Light, alpha: Array, weight: Array) -> tuple[Array, Array]:
    """Lower bands (3, width, m) and right sides (3, m) of the nodes' normal equations."""
    from blurmatte.sweep import field_kernel  # numba takes half a second to import

    band, right = np.zeros((3, grid.width, grid.size)), np.zeros((3, grid.size))
    field_kernel.equations(*light, alpha, weight, grid.pitch, grid.number, band, right)
    return band, right


def _factor(band: Array) -> Array:
    from scipy.linalg import cholesky_banded

    return np.asarray(cholesky_banded(band, lower=True))


def _solved(factor: Array, right: Array) -> Array:
    from scipy.linalg import cho_solve_banded

    return np.asarray(cho_solve_banded((factor, True), right))


def _pairs(a: Indices, b: Indices) -> Indices:
    both = (a >= 0) & (b >= 0)
    return np.stack([a[both], b[both]])

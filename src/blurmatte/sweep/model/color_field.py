"""The colors of an object that moves, as a Gaussian random field over the picture.

Motion blurs the texture of an object, so that its color changes little within a fraction of its radius,
and least along the motion: what a pixel shows is a mean over the part of the object that passed it.
In this file α k is the light of the object, k = Σ_j φ_j k_j with bilinear hats φ_j
around the nodes j of a grid, and along each axis c of color space (`ColorPrior`)

    e = (C − (1 − α) B − α k) / √V,    V = V_C + (1 − α)² V_B

is the residual. The nodes' colors have the prior density of

    Σ w |k_i − k_j|²/(2 τ²) + Σ |k_j − m|²/(2 κ²)

along each axis, the first sum over pairs of nodes of one cell. The weights w are those of finite
differences of ∇kᵀ M ∇k. Without motion M is 1 and w is 1 of neighbors. A pixel that the object passed
by a length L shows k (s) = ∫ k₀(s − u) du / L; from node to node of pitch p that changes by
(k₀(s) − k₀(s − L)) p/L, of the variance 2 κ² p²/L². So the stiffness M along the motion is larger by
L² τ²/(2 p² κ²). That holds for the second and third axis, of hue: brightness, along the first, also
changes with the light along the path. The mean m is free; κ, the spread about it, and τ, the change
from node to node, are estimated. An object of one paint has a spread along its own color
alone, for shading varies; one of two paints, or in the light of two lamps, along two axes. The cost
includes the volume of the posterior: it is the negative log marginal likelihood of alpha, and the
same model holds for objects of one color and of many. The inverse covariance is banded, so that a field
is fitted at each step of a search; `background.guess`, with few cells and one fit, has dense ones.

The axes of `ColorPrior` are orthonormal directions of linear RGB along which colors vary
independently. The first axes span the color model; along the others colors deviate from it by no more
than its error.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array, Ints64
from blurmatte.color.model import ColorModel
from blurmatte.sweep.model import color_field_kernel

Light = tuple[Array, Array, Array, Array]
AT_REST = np.zeros((2, 2))  # the `motion` of `fit_colors`
EVEN = np.array([1.0, 1.0, 0.0, 0.0])  # stiffness without motion

# τ/κ of an object's own texture, whose correlation length is a pitch: √(2 − 2/√e)
_USUAL_CHANGE = 0.9


@dataclass(frozen=True, eq=False)
class ColorPrior:
    """Axes of color space, and the spread of colors along them."""

    axes: Array  # (3, 3) float: orthonormal columns, linear RGB
    rank: int = 3  # number of axes along which the mean color is free; 3 if nothing is known
    # Number of axes along which the spread of colors is estimated; it is small along the others
    varied: int = 3
    # Standard deviation of the angle between colors and the first `rank` axes, radians
    angle_std: float = 0.0
    channels: int = 3  # that are independent: 1 of gray pictures, whose noise counts once

    @property
    def of_one_paint(self) -> "ColorPrior":
        """The same for an object of which only the brightness varies."""
        return replace(self, varied=1)

    @property
    def of_gray(self) -> "ColorPrior":
        """The same for gray pictures, in which an object has one paint."""
        return replace(self, varied=1, channels=1)

    @classmethod
    def of(cls, model: ColorModel | None) -> "ColorPrior":
        """The prior of a color model; without one, or with one of rank 3, nothing is known."""
        if model is None or model.rank == 3:
            return cls(np.eye(3))
        axes = np.linalg.svd(model.basis)[0]
        axes[:, 0] *= np.sign(axes[:, 0].sum())
        std = np.radians(model.angle_std) if model.covariance.any() else 0.0
        std = float(np.hypot(std, 1e-3))  # radians, of a model without an error
        return cls(axes, model.rank, model.rank, std)

    def in_light(self, W: Array) -> "ColorPrior":
        """The same of light that is linear RGB times a symmetric matrix (3, 3)."""
        if self.rank == 3:
            return self
        axes = np.linalg.svd(W @ self.axes[:, : self.rank])[0]
        axes[:, 0] *= np.sign(axes[:, 0] @ W @ self.axes[:, 0])
        return replace(self, axes=axes)

    @classmethod
    def along(cls, mean: Array, moments: Array) -> "ColorPrior":
        """No prior knowledge: axes along a mean color (3,) and the second moments (3, 3) about it."""
        unit = mean / max(float(np.linalg.norm(mean)), 1e-12)
        across = np.eye(3) - np.outer(unit, unit)
        _, vectors = np.linalg.eigh(across @ moments @ across + 1e-12 * across)
        return cls(np.column_stack([unit, *vectors.T[:0:-1]]))


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of the cells that an object covered."""

    pitch: float  # pixels from node to node
    number: Ints64  # number of each node, −1 where there is none
    neighbors: Ints64  # (3, m) pairs of nodes of one cell, and the way between them
    width: int  # of the lower band of a matrix that couples nodes of one cell
    size: int  # number of nodes

    @classmethod
    def over(cls, alpha: Array, pitch: float) -> "Grid":
        """The nodes of all cells where alpha (h, w) is not 0."""
        h, w = alpha.shape
        number = np.full((int(h / pitch) + 2, int(w / pitch) + 2), -1, np.int64)
        color_field_kernel.touched(alpha, pitch, number)
        neighbors, apart, size = color_field_kernel.numbered(number)
        return cls(pitch, number, neighbors, 1 + apart, size)

    def differences(self, stiffness: Array = EVEN) -> Array:
        """(width, size) lower band of the matrix of the weighted sum of squared differences.

        stiffness (4,): weights along rows, columns, and both diagonals.
        """
        pairs = self.neighbors, stiffness
        band = color_field_kernel.squared_differences(*pairs, self.width, self.size)
        return np.asarray(band)


@dataclass(frozen=True, eq=False)
class ColorField:
    """Colors of a grid's nodes, along the axes of color space."""

    grid: Grid
    colors: Array  # (n, 3) float: linear light
    # (3, width, n) float: lower bands of the inverse covariance of their prior, along each axis
    prior: Array
    cost: float  # negative log prior density of these colors, and the log volume of their posterior
    loss: float  # by which the loss of all residuals exceeds that without the object
    # (3,) float: m, its standard deviation, κ and τ
    mean: Array
    mean_std: Array
    spread: Array
    change: Array
    rank: int = 3  # number of axes along which the mean is free

    def light(self, alpha: Array) -> Array:
        """(h, w, 3) of the object: alpha times its color."""
        P = np.zeros((*alpha.shape, 3))
        y, x = np.nonzero(alpha > 0)
        (v, j), (u, i) = (np.modf(at / self.grid.pitch) for at in (y, x))
        for down, right in np.ndindex(2, 2):
            node = self.grid.number[j.astype(int) + down, i.astype(int) + right]
            hat = np.abs(1 - down - v) * np.abs(1 - right - u)
            P[y, x] += hat[:, None] * self.colors[node]
        return P * alpha[..., None]

    def information(
        self, J: Array, light: Light, alpha: Array, weight: Array, e: Array
    ) -> tuple[Array, Array]:
        """Curvature (n, n) and gradient (n,) of the cost by the parameters of alpha.

        The colors are marginalized. J (h, w, n): derivatives of alpha; e (3, h, w): residuals.
        """
        pitch, number = self.grid.pitch, self.grid.number
        H, g = color_field_kernel.information(
            J, light, alpha, weight, pitch, number, self.colors, e, self.prior, self.rank
        )
        return H, g


def residuals_of_none(light: Light) -> Array:
    """(3, h, w) residuals of unit variance without an object."""
    C, B, V_C, V_B = light
    return np.ascontiguousarray(np.moveaxis((C - B) / np.sqrt(V_C + V_B), 2, 0))


def fit_colors(
    light: Light,
    alpha: Array,
    weight: Array,
    pitch: float,
    color: ColorPrior,
    of_none: Array | None = None,
    motion: Array = AT_REST,
) -> tuple[ColorField, Array]:
    """The colors of the largest posterior density for an alpha, and residuals (3, h, w).

    `light` are image, plate, and the variances of both, (h, w, 3), along the axes of `color`; the
    pitch is that of the nodes, pixels; `of_none` are the `residuals_of_none` if they are known.
    motion (2, 2): mean of v vᵀ over the exposure, v the velocity in pixels per exposure.
    """
    grid, stiffness = Grid.over(alpha, pitch), np.stack([EVEN, stiffness_of(motion, pitch)])
    e = residuals_of_none(light) if of_none is None else of_none.copy()
    differences = np.stack([grid.differences(one) for one in stiffness])
    pairs = grid.number, differences, grid.neighbors, stiffness
    known = color.rank, color.varied, color.angle_std, color.channels
    colors, prior, mean, mean_std, spread, change, cost, loss = color_field_kernel.fit(
        light, alpha, weight, pitch, pairs, known, e
    )
    costs = float(cost), float(loss)
    return ColorField(grid, colors, prior, *costs, mean, mean_std, spread, change, color.rank), e


def stiffness_of(motion: Array, pitch: float) -> Array:
    """(4,) weights of squared differences of nodes along rows, columns and both diagonals.

    Of a path that turns, the velocities that differ from the main direction count against it: light
    changes in turn along each part of the path. `motion` is that of `fit_colors`.
    """
    (least, most), directions = np.linalg.eigh(motion)
    more = _USUAL_CHANGE**2 / 2 * (most - least) / pitch**2
    M = np.eye(2) + more * np.outer(directions[:, 1], directions[:, 1])
    # With x and y for the derivatives, 2 xy is (x + y)² − x² − y²: so the diagonals have the sign of
    # M_xy. Where a weight would be negative, it is 0, for then the prior is proper.
    both = abs(M[0, 1])
    falling, rising = (both, 0.0) if M[0, 1] > 0 else (0.0, both)
    return np.array([max(M[0, 0] - both, 0.0), max(M[1, 1] - both, 0.0), falling, rising])

"""What is known besides the pictures: radius and path from other frames, and the opacity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.sweep.model.path import PathFamily
from blurmatte.trajectory import derivative

_TIMES = np.array([0.0, 0.5, 1.0])  # of a path's points, exposures
_MIN_LEARNED = 1e-6  # of the prior's variance: of less the picture says nothing


@dataclass(frozen=True, eq=False)
class PathPrior:
    """A Gaussian prior of the path in an exposure.

    Parameters
    ----------
    points : (3, 2) float
        Its beginning, middle in time and end, pixels of the picture.
    covariance : (6, 6) float
        Of x and y of the three.

    Examples
    --------
    >>> points = np.array([path.at(t) for t in (0, 0.5, 1)])
    >>> known = bm.sweep.PathPrior(points, 0.25 * np.eye(6))
    >>> known.shifted((5, 0)).points[0]
    array([35., 44.])
    """

    points: Array
    covariance: Array

    def shifted(self, by: Array) -> PathPrior:
        """The same moved by (x, y)."""
        return replace(self, points=self.points + by)

    def mapped(self, points: Callable[[Array], Array]) -> PathPrior:
        """The same in the pixels of another picture, into which a function maps points (n, 2)."""
        J = np.kron(np.eye(len(_TIMES)), derivative(points, self.points[1]))
        return PathPrior(points(self.points), J @ self.covariance @ J.T)


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """A Gaussian prior of the motion of an object.

    Parameters
    ----------
    radius, radius_std : float
        Pixels of the picture.
    path : PathPrior, optional
    is_disc : bool
        The silhouette is known to be a disc.
    scatter : float
        Factor of the errors of the picture alone, 1 or more: frames of its clip scatter by so much
        more than each states.
    weight : float
        Of its cost. Residuals that correlate weigh too much by their variance inflation; the prior
        has to be multiplied by the same to keep its share.
    camera_stretch : (float, float)
        Of every shape in the picture, by the camera's rolling shutter, as `Silhouette` has it.

    Raises
    ------
    ValueError
        If a number is not above 0.

    Examples
    --------
    >>> prior = bm.sweep.MotionPrior(radius=10.0, radius_std=0.1, is_disc=True)
    >>> answer = bm.solve(image, plate, solution.model, bm.Swept(), prior=prior)
    >>> print(answer.sweep)
    Sweep(disc on a line, 59.6 px long, radius 10.01 ± 0.01 px, #ffc046, rank 1)
    """

    radius: float
    radius_std: float
    path: PathPrior | None = None
    is_disc: bool = False
    scatter: float = 1.0
    weight: float = 1.0
    camera_stretch: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("radius", "radius_std", "scatter", "weight"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, got {getattr(self, name)}")

    def shifted(self, by: Array) -> MotionPrior:
        """The same moved by (x, y)."""
        return self if self.path is None else replace(self, path=self.path.shifted(by))

    def mapped(self, points: Callable[[Array], Array], center: Array) -> MotionPrior:
        """The same of an object at a center (2,), in the pixels of another picture."""
        size = float(np.sqrt(abs(np.linalg.det(derivative(points, center)))))
        path = None if self.path is None else self.path.mapped(points)
        return replace(
            self, radius=size * self.radius, radius_std=size * self.radius_std, path=path
        )

    @property
    def of_silhouette(self) -> MotionPrior:
        """What it says of the silhouette alone: the radius is not known to a factor of two."""
        return replace(self, radius_std=self.radius, path=None, scatter=1.0)

    def cost(self, family: PathFamily, path: Array, shape: Array) -> float:
        """Negative log of the prior density, up to a constant."""
        residual, _, precision = self._linear(family, path, shape)
        return float(residual @ precision @ residual) / 2

    def added(
        self, H: Array, g: Array, family: PathFamily, path: Array, shape: Array
    ) -> tuple[Array, Array]:
        """Curvature and gradient of a cost by path and shape, with the prior's."""
        residual, J, precision = self._linear(family, path, shape)
        return H + J.T @ precision @ J, g + J.T @ precision @ residual

    def probability(
        self, family: PathFamily, path: Array, shape: Array, covariance: Array
    ) -> float:
        """That a frame which agrees with the prior ends as far from it, or farther.

        An estimate m with the covariance V that contains a prior m₀ with the covariance P differs from
        it by m − m₀ with the covariance P − V.

        Parameters
        ----------
        family : PathFamily
        path, shape : (n,), (m,) float
            Estimate with this prior.
        covariance : (n + m, n + m) float
            Of the estimate.
        """
        residual, J, precision = replace(self, weight=1.0)._linear(family, path, shape)
        root = np.linalg.cholesky(precision).T
        learned, axes = np.linalg.eigh(np.eye(len(root)) - root @ J @ covariance @ J.T @ root.T)
        seen = learned > _MIN_LEARNED
        chi2 = np.sum((axes.T @ root @ residual)[seen] ** 2 / learned[seen])
        return float(scipy.special.chdtrc(max(np.count_nonzero(seen), 1), chi2))

    def _linear(self, family: PathFamily, path: Array, shape: Array) -> tuple[Array, Array, Array]:
        """Residual, its derivatives by path and shape, and the precision of the prior."""
        size = len(path) + len(shape)
        radius = shape[0]  # the first parameter of every `Shape`
        residual, J = np.array([radius - self.radius]), np.zeros((1, size))
        J[0, len(path)] = 1
        precision = np.array([[self.radius_std**-2]])
        if self.path is not None:
            xy, D = family.at(path, _TIMES)
            residual = np.concatenate([(xy - self.path.points).ravel(), residual])
            along = np.zeros((6, size))
            along[:, : len(path)] = D.reshape(6, -1)
            J = np.concatenate([along, J])
            precision = scipy.linalg.block_diag(np.linalg.inv(self.path.covariance), precision)
        return residual, J, self.weight * precision


class OpacityPrior(StrEnum):
    """What is known of an object's opacity before the picture is looked at.

    Examples
    --------
    >>> glass = bm.matting.Averaged(opacity=bm.sweep.OpacityPrior.ANY)
    >>> bm.solve(image, plate, solver=glass).grade
    <Grade.CONFIRMED: 'confirmed'>
    """

    USUAL = "usual"  #: most objects are solid: decisive evidence is necessary for another opacity
    SOLID = "solid"  #: it is known to be 1
    ANY = "any"  #: solid or not with even odds; if not, every opacity from 0 to 1 is as likely

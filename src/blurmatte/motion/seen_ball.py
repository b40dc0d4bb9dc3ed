"""SeenBall: a ball that flies through space, as a silhouette that a sweep can have.

The path's parameters are the pixels (x, y) in which its center is seen at equally spaced times; the
shape's are its radius in the picture, pixels, and by how much its logarithm differs at these times.
With the radius in space as the unit of length, that is where the ball was: at the distance
magnification / radius along the pixel's ray. All are of the size of pixels, and no radius in space
is needed to find them. Between the times it flies on a line, or with constant acceleration, in
space.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.intrinsics import Intrinsics
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import PathFamily, Polynomial
from blurmatte.sweep.model.silhouette import Silhouette, Swept, moments

Array = npt.NDArray[np.float64]

_STEP = 0.05  # pixels, for derivatives of where pixels look
_RIM = 16  # points around a rim that tell which pixels may see it
_BEYOND = 1.05  # how much farther than these points, and
_PIXELS = 2.0  # by how many pixels
_GROWTHS = {2: np.array([[-0.5], [0.5]]), 3: np.array([[-0.5, 0], [0, 1], [0.5, 0]])}


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenBall(Silhouette):
    """A ball in the pixels of some data; a disc for all that do not look at it closely.

    Parameters
    ----------
    intrinsics : Intrinsics
    rays : (h, w, 3) float
        Where the pixels of the data look; unit directions.
    slopes : (h, w, 3, 2) float
        Their change from one of these pixels to the next.
    """

    intrinsics: Intrinsics
    rays: Array
    slopes: Array

    @classmethod
    def before(cls, intrinsics: Intrinsics, data: Observation) -> "SeenBall":
        """The silhouettes of a camera in the pixels of data; rays that it does not know are NaN."""
        h, w = data.weight.shape
        y, x = np.mgrid[:h, :w]
        pixels = np.stack([x, y], axis=-1) * data.scale + data.origin
        rays, slopes = intrinsics.rays(pixels), intrinsics.ray_slopes(pixels) * data.scale
        return cls(intrinsics=intrinsics, rays=rays, slopes=np.ascontiguousarray(slopes))

    def sweep(self, family: PathFamily, path: Array, shape: Array, data: Observation) -> Swept:
        """Alpha of a ball on its way, and its derivatives."""
        from blurmatte.motion import ball_kernel  # numba takes half a second to import

        assert isinstance(family, Polynomial)
        alpha = np.zeros(data.weight.shape)
        J = np.zeros((*alpha.shape, len(path) + len(shape)))
        t, weights = moments(family, path, data.scale)
        nodes, by_parameters = at_nodes(self.intrinsics, path, shape)
        basis = family.weights(t)
        X, D = basis @ nodes, np.einsum("tk,kcp->tcp", basis, by_parameters)
        boxes = self._boxes(X, data)
        ball_kernel.flight(X, D, weights, boxes, self.rays, self.slopes, alpha, J)
        return Swept(alpha, J)

    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """The nearest shape with a radius within bounds."""
        return np.concatenate([np.clip(shape[:1], *bounds), shape[1:]])

    def _boxes(self, X: Array, data: Observation) -> npt.NDArray[np.int64]:
        """(T, 4) pixels of the data that may see a ball at X (T, 3), radii."""
        rims = self.intrinsics.project(rim(X, _RIM))
        center = self.intrinsics.project(X)[:, None]
        with np.errstate(invalid="ignore"):
            reach = _BEYOND * np.abs(rims - center).max(axis=1) + _PIXELS * data.scale
            low = (center[:, 0] - reach - data.origin) / data.scale
            high = (center[:, 0] + reach - data.origin) / data.scale
        h, w = data.weight.shape
        seen = np.isfinite(low + high).all(axis=1, keepdims=True)
        low, high = np.where(seen, low, 0), np.where(seen, high, 0)
        low, high = np.clip(np.floor(low), 0, (w, h)), np.clip(np.ceil(high), 0, (w, h))
        return np.hstack([low, high]).astype(np.int64)


def at_nodes(intrinsics: Intrinsics, path: Array, shape: Array) -> tuple[Array, Array]:
    """Where the ball is at the equally spaced times (k, 3), radii, and derivatives (k, 3, n)."""
    pixels = path.reshape(-1, 2)
    k = len(pixels)
    radii = shape[0] * np.exp(_GROWTHS[k] @ shape[1:])
    X = positions(intrinsics, pixels, radii)
    D = np.zeros((k, 3, len(path) + len(shape)))
    for i, step in enumerate(_STEP * np.eye(2)):
        ends = [positions(intrinsics, pixels + d, radii) for d in (step, -step)]
        D[range(k), :, 2 * np.arange(k) + i] = (ends[0] - ends[1]) / (2 * _STEP)
    D[:, :, len(path)] = -X / shape[0]
    D[:, :, len(path) + 1 :] = -X[:, :, None] * _GROWTHS[k][:, None, :]
    return X, D


def positions(intrinsics: Intrinsics, pixels: Array, radii: Array) -> Array:
    """(k, 3) where balls are whose centers are seen in pixels (k, 2), radii (k,) pixels; in radii."""
    distance = intrinsics.magnification(pixels) / radii
    return np.asarray(distance[..., None] * intrinsics.rays(pixels))


def rim(X: Array, count: int) -> Array:
    """(T, count, 3) points around the rims of balls at X (T, 3), radii, as seen from the origin."""
    square = (X**2).sum(axis=1, keepdims=True)
    away = np.eye(3)[np.abs(X).argmin(axis=1)]
    u = np.cross(X, away)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(X, u) / np.sqrt(square)
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    flat = np.sqrt(np.maximum(1 - 1 / square, 0))
    return np.asarray((X * (1 - 1 / square))[:, None] + flat[:, None] * circle)

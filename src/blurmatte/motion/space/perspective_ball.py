"""The perspective image of a ball: its outline in the pixels of a camera, and back to its position.

A sphere of radius R whose center is X touches the rays at the angle ρ from X, sin ρ = R/|X|. A pinhole
camera sees this cone as an ellipse. If X is θ off the axis, and q = cos²θ − sin²ρ, then the center of
the ellipse lies at sin θ cos θ / q on the plane z = 1, farther out than the center of the sphere, and
its half axes are sin ρ cos ρ / q away from the axis and sin ρ / √q across [Hartley & Zisserman,
Multiple View Geometry, 8.3: outlines of quadrics]. Given the ellipse, this is solved for X.

The unit of length in space is the radius of the ball: a picture determines only X/R. The parameters of
the path are the pixels (x, y) of the projected center at equally spaced times; those of the shape are
the radius in the picture, pixels, and the differences of its logarithm at these times. The distance
is magnification / radius, along the ray of the pixel. All parameters are of the size of pixels. Between
these times the ball moves on a line, or with constant acceleration, in space.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Ints64
from blurmatte.intrinsics import Intrinsics
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import PathFamily, Polynomial
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import Shape, SweptAlpha
from blurmatte.sweep.model.silhouette import moments

_STEP = 0.05  # pixels, for derivatives of rays
_OUTLINE_POINTS = 16
_GROWTHS = {2: np.array([[-0.5], [0.5]]), 3: np.array([[-0.5, 0], [0, 1], [0.5, 0]])}


@dataclass(frozen=True, eq=False, kw_only=True)
class PerspectiveBall(Shape):
    """The image of a ball in the pixels of an observation."""

    name = "ball"

    intrinsics: Intrinsics
    rays: Array  # (h, w, 3) float: unit directions of the rays of the pixels
    slopes: Array  # (h, w, 3, 2) float: their change from pixel to pixel, in x and y
    degree: int = 1  # of its path through space

    @property
    def names(self) -> tuple[str, ...]:
        """The radius, and the differences of its logarithm."""
        return "radius", *self.degree * ("growth",)

    @classmethod
    def in_observation(cls, intrinsics: Intrinsics, data: Observation) -> "PerspectiveBall":
        """For the pixels of an observation; rays are NaN where the distortion has no inverse."""
        h, w = data.weight.shape
        y, x = np.mgrid[:h, :w]
        pixels = np.stack([x, y], axis=-1) * data.scale + data.origin
        rays, slopes = intrinsics.rays(pixels), intrinsics.ray_slopes(pixels) * data.scale
        return cls(intrinsics=intrinsics, rays=rays, slopes=np.ascontiguousarray(slopes))

    def sweep(self, family: PathFamily, path: Array, shape: Array, pixels: Pixels) -> SweptAlpha:
        """Alpha of a moving ball, and its derivatives."""
        from blurmatte.motion.space import perspective_ball_kernel  # loads scipy.special

        assert isinstance(family, Polynomial)
        alpha = np.zeros(pixels.shape)
        J = np.zeros((*alpha.shape, len(path) + len(shape)))
        t, weights = moments(family, path, pixels.scale)
        nodes, by_parameters = at_nodes(self.intrinsics, path, shape)
        basis = family.weights(t)
        X, D = basis @ nodes, np.einsum("tk,kcp->tcp", basis, by_parameters)
        boxes = self._boxes(X, pixels)
        perspective_ball_kernel.flight(X, D, weights, boxes, self.rays, self.slopes, alpha, J)
        return SweptAlpha(alpha, J)

    def possible(self, shape: Array, bounds: tuple[float, float]) -> Array:
        """The nearest shape with a radius within bounds."""
        return np.concatenate([np.clip(shape[:1], *bounds), shape[1:]])

    def _boxes(self, X: Array, within: Pixels) -> Ints64:
        """(T, 4) boxes of the pixels that may see a ball at X (T, 3), radii.

        5 % and two pixels larger than the box of the points on its outline.
        """
        points = self.intrinsics.project(outline(X, _OUTLINE_POINTS))
        center = self.intrinsics.project(X)[:, None]
        with np.errstate(invalid="ignore"):
            reach = 1.05 * np.abs(points - center).max(axis=1) + 2.0 * within.scale
            low = (center[:, 0] - reach - within.origin) / within.scale
            high = (center[:, 0] + reach - within.origin) / within.scale
        h, w = within.shape
        seen = np.isfinite(low + high).all(axis=1, keepdims=True)
        low, high = np.where(seen, low, 0), np.where(seen, high, 0)
        low, high = np.clip(np.floor(low), 0, (w, h)), np.clip(np.ceil(high), 0, (w, h))
        return np.hstack([low, high]).astype(np.int64)


def at_nodes(intrinsics: Intrinsics, path: Array, shape: Array) -> tuple[Array, Array]:
    """Positions at the equally spaced times (k, 3), radii, and their derivatives (k, 3, n)."""
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
    """(k, 3) positions, in ball radii, from projected centers (k, 2) and radii (k,), pixels."""
    distance = intrinsics.magnification(pixels) / radii
    return np.asarray(distance[..., None] * intrinsics.rays(pixels))


def outline(X: Array, count: int) -> Array:
    """(T, count, 3) points on the outlines of balls at X (T, 3), radii, seen from the origin."""
    square = (X**2).sum(axis=1, keepdims=True)
    away = np.eye(3)[np.abs(X).argmin(axis=1)]
    u = np.cross(X, away)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(X, u) / np.sqrt(square)
    angle = 2 * np.pi * np.arange(count) / count
    circle = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    flat = np.sqrt(np.maximum(1 - 1 / square, 0))
    return np.asarray((X * (1 - 1 / square))[:, None] + flat[:, None] * circle)


def positions_of_discs(intrinsics: Intrinsics, centers: Array, radius: float) -> Array:
    """(k, 3) positions, in ball radii, from discs of one radius at `centers` (k, 2), pixels.

    The disc replaces the ellipse of the same center and area. With m the distance of that center
    from the axis and b, a its half axes, all on the plane z = 1,

        a² = b² (1 + m²/(1 + b²)),    q = (1 + b²)/(m² + (1 + b²)²),    sin²ρ = b² q,

    and cos²θ = q (1 + b²).
    """
    m = intrinsics.undistort(centers)
    m2 = (m**2).sum(axis=-1)
    # A radian is `magnification` pixels wide, and (1 + m²)^(3/4) wide on the plane z = 1.
    square = (radius / intrinsics.magnification(centers)) ** 2 * (1 + m2) ** 1.5  # a b
    b2 = square
    for _ in range(20):  # fixed point; gains four digits in each step
        b2 = square / np.sqrt(1 + m2 / (1 + b2))
    q = (1 + b2) / (m2 + (1 + b2) ** 2)
    distance = (b2 * q) ** -0.5
    cosine = np.sqrt(np.minimum(q * (1 + b2), 1))
    # The center of the ball projects nearer to the axis than the center of the ellipse.
    tangent = np.sqrt(1 - cosine**2) / cosine
    factor = np.where(m2 > 0, tangent / np.sqrt(np.maximum(m2, 1e-300)), 1)
    ray = np.concatenate([m * factor[..., None], np.ones_like(m[..., :1])], axis=-1)
    return np.asarray(ray * (distance * cosine)[..., None])

"""Poses and views of a body: rotation, deformation, perspective, and their change in an exposure.

Directions in space are (x, y, z) with x right, y down and z towards the camera. A rotation is a
rotation vector in radians; along +z it turns x towards y. The camera is far away and sees x and y,
unless the pose has a view of a pinhole camera.

A pinhole camera of focal length f sees a sphere of radius R at depth 1 and slope (u, v) from the
optical axis as an ellipse. With L² = 1 + u² + v²,

    its center is        f (u, v) / (1 - R²),
    its semi-axes are    f R √(L² - R²) / (1 - R²)  along (u, v)   and   f R / √(1 - R²)  across.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, check_positive
from blurmatte.trajectory import Trajectory


@dataclass(frozen=True)
class CameraView:
    """Direction and focal length with which a pinhole camera sees a body."""

    # Tangents of the angles in x and y between the optical axis and the ray to the body's center
    slope: tuple[float, float]
    focal: float  # pixels


@dataclass(frozen=True, eq=False)
class Pose:
    """Rotation of a body in space, followed by a linear deformation in the picture."""

    rotation: Array  # (3, 3): from a point of the body to space, both relative to the body's center
    # (2, 2) map of the picture plane: size and deformation. With a view, the size in the picture is
    # the focal length times the size in space over the depth
    stretch: Array
    view: CameraView | None = None  # of a pinhole camera; None for a camera far away

    @property
    def plane(self) -> Array:
        """(2, 2) map of the body's x and y to the picture; complete for a flat body."""
        return np.asarray(self.stretch @ self.rotation[:2, :2])

    def magnified(self, factor: float) -> Pose:
        """The same pose in a picture with `factor` times as many pixels in x and in y."""
        view = self.view and replace(self.view, focal=factor * self.view.focal)
        return Pose(self.rotation, factor * self.stretch, view)


AT_REST = Pose(np.eye(3), np.eye(2))


@dataclass(frozen=True)
class Change:
    """Rotation, growth and deformation of a body, each linear in time over the exposure.

    Parameters
    ----------
    turned : (3,) float
        Rotation at the start.
    spin : (3,) float
        Further rotation during the exposure; may be many turns.
    scale : (float, float)
        Relative size at the start and at the end.
    squash : (float, float)
        Deformation at the start and at the end: longer by this factor along `squash_angle`, shorter
        by it across; 1 is none. The area is preserved.
    squash_angle : float
        Radians from +x towards +y.
    depth : (float, float)
        Relative depth along the optical axis at the start and at the end. It is linear in time, and
        the size is divided by it; see `path_in_depth`.

    Raises
    ------
    ValueError
        For numbers that are not finite, or a scale, squash or depth that is not positive.
    """

    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)
    squash: tuple[float, float] = (1.0, 1.0)
    squash_angle: float = 0.0
    depth: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        counts = {"turned": 3, "spin": 3, "scale": 2, "squash": 2, "depth": 2}
        for name, count in counts.items():
            numbers = np.asarray(getattr(self, name), dtype=float)
            if numbers.shape != (count,) or not np.all(np.isfinite(numbers)):
                raise ValueError(f"{name} must be {count} finite numbers, got {numbers.tolist()}")
            if count == 2 and not np.all(numbers > 0):
                raise ValueError(f"{name} must be positive, got {numbers.tolist()}")
            object.__setattr__(self, name, tuple(numbers.tolist()))
        if not np.isfinite(self.squash_angle):
            raise ValueError(f"squash_angle must be finite, got {self.squash_angle}")

    def at(self, t: float) -> Pose:
        """The pose at exposure fraction `t`."""
        rotation = _matrix(_triple(t * np.asarray(self.spin))) @ _matrix(self.turned)
        longer = _between(self.squash, t)
        c, s = np.cos(self.squash_angle), np.sin(self.squash_angle)
        axes = np.array([[c, -s], [s, c]])
        size = _between(self.scale, t) / _between(self.depth, t)
        return Pose(rotation, size * (axes * [longer, 1 / longer]) @ axes.T)

    def part(self, start: float, end: float) -> Change:
        """The change between two exposure fractions, as a change of a shorter exposure."""
        return Change(
            turned=_vector(self.at(start).rotation),
            spin=_triple((end - start) * np.asarray(self.spin)),
            scale=(_between(self.scale, start), _between(self.scale, end)),
            squash=(_between(self.squash, start), _between(self.squash, end)),
            squash_angle=self.squash_angle,
            depth=(_between(self.depth, start), _between(self.depth, end)),
        )

    @property
    def rate(self) -> float:
        """Upper bound of the distance that a point at distance 1 from the center moves."""
        longest = max(max(self.squash), 1 / min(self.squash))
        growth = abs(self.scale[1] - self.scale[0]) * longest
        nearest = min(self.depth)
        approach = abs(self.depth[1] - self.depth[0]) * longest  # d(1/z) = dz / z²
        # d(1/q) = dq / q²: the compressed side moves faster than the one that grows.
        bending = abs(self.squash[1] - self.squash[0]) * max(1, 1 / min(self.squash) ** 2)
        turning = float(np.linalg.norm(self.spin)) * longest
        size_rate = growth + max(self.scale) * (bending + turning + approach / nearest)
        return size_rate / nearest


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera, for scenes with perspective.

    Parameters
    ----------
    focal : float
        Focal length, pixels.
    center : (float, float), optional
        Principal point, pixels; the middle of the picture if not given.

    Raises
    ------
    ValueError
        If the focal length is not positive or the center is not a finite point.
    """

    focal: float
    center: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_positive("focal", self.focal, "pixels")
        if self.center is not None and (
            np.shape(self.center) != (2,) or not np.all(np.isfinite(self.center))
        ):
            raise ValueError(f"center must be two finite numbers of pixels, got {self.center}")

    def view(self, point: Array, size: tuple[int, int]) -> CameraView:
        """View of a body whose center is at `point` (2,) in a picture of `size` (width, height)."""
        middle = (np.array(size) - 1) / 2 if self.center is None else np.array(self.center)
        u, v = ((point - middle) / self.focal).tolist()
        return CameraView((u, v), self.focal)


def sphere_outline(view: CameraView, radius: float) -> tuple[Array, Array]:
    """Ellipse that a sphere projects to, pixels.

    Its center (2,) relative to the image of the sphere's, and the symmetric map (2, 2) of the unit
    circle to it. `radius`: focal length times radius over depth, less than the focal length.
    """
    slope, f, R = np.array(view.slope), view.focal, radius / view.focal
    squared = slope @ slope
    along = f * R * np.sqrt(1 + squared - R**2) / (1 - R**2)
    across = f * R / np.sqrt(1 - R**2)
    radial = np.outer(slope, slope) / squared if squared > 0 else np.zeros((2, 2))
    center = f * slope * R**2 / (1 - R**2)
    return center, across * np.eye(2) + (along - across) * radial


def rim_magnification(view: CameraView, reach: float) -> float:
    """Upper bound of the speed of a point within `reach` pixels of a body's center, relative to it.

    At a slope s from the optical axis the picture plane is stretched radially by 1 + s².
    """
    slope = float(np.linalg.norm(view.slope))
    return (1 + (slope + reach / view.focal) ** 2) / (1 + slope**2)


def path_in_depth(
    start: npt.ArrayLike, end: npt.ArrayLike, depth: tuple[float, float]
) -> Trajectory:
    """Path in the picture of straight motion at constant speed in space, seen by a pinhole camera.

    The path is straight, and faster where the body is nearer; `Change.depth` changes the body's size
    accordingly. The path depends on neither focal length nor principal point.

    Parameters
    ----------
    start, end : (2,) float
        Pixels.
    depth : (float, float)
        Depth at the start and at the end; only their ratio matters.

    Raises
    ------
    ValueError
        If a depth is not positive.
    """
    near = np.asarray(depth, dtype=float)
    if near.shape != (2,) or not np.all(np.isfinite(near) & (near > 0)):
        raise ValueError(f"depth must be two positive numbers, got {depth}")
    ends = np.array([start, end], dtype=float)
    knots = 129  # piecewise linear timing is then exact to 1e-4 of the length
    t = np.arange(knots) / (knots - 1)
    shares = np.stack([(1 - t) * near[0], t * near[1]], axis=1)
    return Trajectory(shares @ ends / shares.sum(axis=1, keepdims=True), t)


def _between(ends: tuple[float, float], t: float) -> float:
    return float(ends[0] + t * (ends[1] - ends[0]))


@lru_cache(maxsize=1024)  # one at all times, for a body that does not spin
def _matrix(vector: tuple[float, float, float]) -> Array:
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix())


def _vector(matrix: Array) -> tuple[float, float, float]:
    return _triple(scipy.spatial.transform.Rotation.from_matrix(matrix).as_rotvec())


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z

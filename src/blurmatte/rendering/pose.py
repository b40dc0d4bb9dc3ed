"""Pose: how a body is turned and stretched at one moment; Change: how that goes on in an exposure.

Directions in space are (x, y, z) with x right, y down and z towards the camera. A rotation is
written as a vector: its axis, as long as its angle in radians; along +z it turns x towards y. The
camera is far away and sees x and y, unless the pose has a view.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """From where a pinhole camera sees a body.

    Parameters
    ----------
    slope : (float, float)
        Tangents of the angles in x and y between the optical axis and the ray to the body's center.
    focal : float
        Focal length, pixels.
    """

    slope: tuple[float, float]
    focal: float


@dataclass(frozen=True, eq=False)
class Pose:
    """How a body is turned in space, and then stretched in the picture.

    Parameters
    ----------
    rotation : (3, 3) float
        Takes a point of the body to where it is in space, from the body's center.
    stretch : (2, 2) float
        Linear map of the picture plane that follows: its size and deformation. With a view, a size
        in the picture is the focal length times the size in space over the depth.
    view : View, optional
        Of a camera that is near; None: the camera is far away.
    """

    rotation: Array
    stretch: Array
    view: View | None = None

    @property
    def plane(self) -> Array:
        """(2, 2) map of the body's own x and y to the picture: all of it, for a flat body."""
        return np.asarray(self.stretch @ self.rotation[:2, :2])

    def magnified(self, factor: float) -> Pose:
        """The same pose in a picture with so many times as many pixels in x and in y."""
        view = self.view and replace(self.view, focal=factor * self.view.focal)
        return Pose(self.rotation, factor * self.stretch, view)


AT_REST = Pose(np.eye(3), np.eye(2))


_COUNTS = {"turned": 3, "spin": 3, "scale": 2, "squash": 2, "depth": 2}


@dataclass(frozen=True)
class Change:
    """How a body turns, grows and is deformed while it moves, evenly over the exposure.

    Parameters
    ----------
    turned : (3,) float
        Rotation at the start.
    spin : (3,) float
        Rotation that comes on top until the end; may be many turns.
    scale : (float, float)
        Size at the start and at the end, 1 as made: larger comes nearer to the camera.
    squash : (float, float)
        Deformation at the start and at the end: longer by this factor along `squash_angle`, shorter
        by it across; 1 is none. The area stays.
    squash_angle : float
        Radians from +x towards +y.
    depth : (float, float)
        Distance from the camera along its axis at the start and at the end, 1 as made. It changes
        evenly, and the size is divided by it; see `path_in_depth`.

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
        for name, count in _COUNTS.items():
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
        rotation = _matrix(t * np.asarray(self.spin)) @ _matrix(np.asarray(self.turned))
        longer = _between(self.squash, t)
        c, s = np.cos(self.squash_angle), np.sin(self.squash_angle)
        axes = np.array([[c, -s], [s, c]])
        size = _between(self.scale, t) / _between(self.depth, t)
        return Pose(rotation, size * (axes * [longer, 1 / longer]) @ axes.T)

    def part(self, start: float, end: float) -> Change:
        """What happens between two exposure fractions, as a change of its own."""
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
        """How far a point at distance 1 from the center moves in an exposure, at most."""
        longest = max(max(self.squash), 1 / min(self.squash))
        growth = abs(self.scale[1] - self.scale[0]) * longest
        nearest = min(self.depth)
        approach = abs(self.depth[1] - self.depth[0]) * longest  # d(1/z) = dz / z²
        # d(1/q) = dq / q²: the side that is squashed moves faster than the one that grows.
        bending = abs(self.squash[1] - self.squash[0]) * max(1, 1 / min(self.squash) ** 2)
        turning = float(np.linalg.norm(self.spin)) * longest
        size_rate = growth + max(self.scale) * (bending + turning + approach / nearest)
        return size_rate / nearest


def _between(ends: tuple[float, float], t: float) -> float:
    return float(ends[0] + t * (ends[1] - ends[0]))


def _matrix(vector: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _vector(matrix: Array) -> tuple[float, float, float]:
    from scipy.spatial.transform import Rotation

    return _triple(Rotation.from_matrix(matrix).as_rotvec())


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z

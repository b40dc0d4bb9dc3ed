"""Depth from blur: the distance of an object of known speed.

An object that moves v T meters during the exposure, parallel to the picture, and L pixels in it, has
the depth Z = f v T/L; with m₀ and m₁ the undistorted ends of its path on the plane z = 1, Z =
v T/|m₁ − m₀|. An object that moves in the unit direction V has the depths Z₀ and Z₁ for which

    Z₁ (m₁, 1) − Z₀ (m₀, 1) = ± v T V ,

three equations in two unknowns; the third checks V. The direction of time is the sign for which both
depths are positive.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, check_not_negative, check_positive
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.picture.error_budget import (
    Source,
    check_with_std,
    covariances,
    path_source,
    relative_errors,
)
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class BlurDepth:
    """Distance of an object along the optical axis.

    Parameters
    ----------
    start, end : float
        Depth at both ends of its path, meters; the same if it moved parallel to the picture.
    covariance : (2, 2) float
        Of both depths.
    off : float
        Angle between the given direction and the plane through the streak and the camera, radians: 0
        if they agree.
    parts : mapping of str to float
        Relative errors of the mean depth that each source alone causes: the "picture", the
        "speed", the "exposure time", the "camera".

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> far = bm.motion.depth_from_blur(sweep, lens, speed=2.0, exposure_time=1 / 60, speed_std=0.1)
    >>> print(f"{far.depth:.3f} ± {far.depth_std:.3f} m")
    0.056 ± 0.003 m
    """

    start: float
    end: float
    covariance: Array
    off: float
    parts: Mapping[str, float]

    def __repr__(self) -> str:
        return f"BlurDepth({self.depth:.4g} ± {self.depth_std:.2g} m)"

    @property
    def depth(self) -> float:
        """Mean of both ends, meters."""
        return (self.start + self.end) / 2

    @property
    def depth_std(self) -> float:
        """Standard deviation of `depth`, meters."""
        return float(np.sqrt(self.covariance.sum())) / 2

    def numbers(self) -> dict[str, float]:
        """All numbers by name, flat, for a row of a table: meters and radians."""
        ends = np.sqrt(np.diag(self.covariance))
        return {
            **{"blur_depth": self.depth, "blur_depth_std": self.depth_std},
            **{"blur_depth_start": self.start, "blur_depth_start_std": float(ends[0])},
            **{"blur_depth_end": self.end, "blur_depth_end_std": float(ends[1])},
            "blur_depth_off": self.off,
        }


def depth_from_blur(
    path: Sweep | Trajectory,
    intrinsics: Intrinsics,
    speed: float,
    exposure_time: float,
    direction: npt.ArrayLike | None = None,
    speed_std: float = 0.0,
    exposure_std: float = 0.0,
    path_std: float = 0.0,
) -> BlurDepth:
    """Distance of an object from the length of its streak and its known speed.

    Parameters
    ----------
    path : Sweep or Trajectory
        Straight and at constant speed.
    intrinsics : Intrinsics
        Of the camera.
    speed, exposure_time : float
        m/s, and seconds.
    direction : (3,) float, optional
        Of the motion, x right, y down, z forward, of any length and sign. If not given, parallel to the
        picture: the depth of a motion at an angle φ to it is then too large by 1/cos φ or more.
    speed_std, exposure_std, path_std : float
        Standard deviations; the last of each coordinate of both ends of a Trajectory, pixels.

    Raises
    ------
    TypeError, ValueError, MotionError
        For another path, a number out of its range, or a direction that cannot be that of this streak.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> bm.motion.depth_from_blur(sweep, lens, speed=2.0, exposure_time=1 / 60, speed_std=0.1)
    BlurDepth(0.05563 ± 0.0028 m)
    """
    check_with_std("speed", speed, speed_std)
    check_positive("exposure_time", exposure_time)
    check_not_negative("exposure_std", exposure_std)
    along = _checked_direction(direction)
    picture, points = path_source(path, path_std)
    sources = {
        "picture": picture,
        "speed": Source.number(speed, speed_std),
        "exposure time": Source.number(exposure_time, exposure_std),
        "camera": Source(intrinsics.values, intrinsics.covariance),
    }

    def depths(parameters: Array, v: Array, T: Array, values: Array) -> Array:
        """Depth at both ends and its mean."""
        ends = intrinsics.with_values(values).undistort(points(parameters, np.array([0.0, 1.0])))
        return _depths(ends, float(v[0] * T[0]), along)

    values, parts, total = covariances(depths, sources)
    if not (np.all(np.isfinite(values)) and values[0] > 0 and values[1] > 0):
        raise MotionError("no motion along direction gives this streak; check it, or expose longer")
    start, end, mean, off = map(float, values)
    return BlurDepth(start, end, total[:2, :2], off, relative_errors(parts, 2, mean))


def _checked_direction(direction: npt.ArrayLike | None) -> Array | None:
    along = None if direction is None else np.asarray(direction, dtype=float)
    if along is not None and (along.shape != (3,) or not np.linalg.norm(along) > 0):
        raise ValueError(f"direction must be (x, y, z), not all 0, got {along}")
    return along


def _depths(ends: Array, shift: float, direction: Array | None) -> Array:
    """(4,) depth at both ends, its mean, and `BlurDepth.off`; depths <= 0 if impossible."""
    if direction is None:
        length = float(np.linalg.norm(ends[1] - ends[0]))
        Z = shift / length if length > 0 else np.nan
        return np.array([Z, Z, Z, 0])
    unit = direction / np.linalg.norm(direction)
    A = np.column_stack([[*-ends[0], -1], [*ends[1], 1]])
    Z, *_ = np.linalg.lstsq(A, shift * unit, rcond=1e-9)
    normal = np.cross(A[:, 0], A[:, 1])
    off = np.arcsin(min(abs(float(unit @ normal)) / max(float(np.linalg.norm(normal)), 1e-300), 1))
    Z = Z if Z.sum() > 0 else -Z
    return np.array([*Z, Z.mean(), off])

"""Motion on a plane in perspective: a car on a road, a puck on ice.

A homography H maps points (X, Y) of the plane, meters, to the undistorted picture: the image point is
m = H (X, Y, 1)ᵀ up to a factor. With known intrinsics m lies on the plane z = 1, and H = (r₁ r₂ t) up
to a factor, with r₁ and r₂ the plane's axes and t its origin in the camera's coordinates [Zhang, A
flexible new technique for camera calibration, TPAMI 2000]; this also gives the planes parallel to it.
Without intrinsics m is the pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, check_kind, check_not_negative, check_points
from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.picture.error_budget import (
    ErrorBudget,
    OverExposure,
    Source,
    by_axis,
    check_exposure,
    covariances,
    path_source,
    relative_errors,
)
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane with a scale, and its position before the camera.

    Parameters
    ----------
    homography : (3, 3) float
        From (X, Y, 1) on the plane, meters, to the pixel (x, y, 1), or with `intrinsics` to the
        point on z = 1 before the camera; up to a factor, such that the visible side is positive.
    intrinsics : Intrinsics, optional
    covariance : (9, 9) float
        Of the homography, row by row.

    Raises
    ------
    ValueError
        If the homography has no inverse, or the camera lies within the plane.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> wall_behind = bm.motion.Plane.from_pose(lens, np.eye(3), (0, 0, 2.0))
    >>> wall_behind.locate(np.array([[100.0, 36.0]])).round(2)
    array([[0.73, 0.01]])
    """

    homography: Array
    intrinsics: Intrinsics | None = None
    covariance: Array = field(default_factory=lambda: np.zeros((9, 9)))

    def __post_init__(self) -> None:
        H = np.array(self.homography, dtype=float)
        if H.shape != (3, 3) or not np.all(np.isfinite(H)) or np.linalg.cond(H) > 1e12:
            raise ValueError(
                "homography must be (3, 3), finite and have an inverse: no three points on a line, and "
                "the camera outside the plane"
            )
        object.__setattr__(self, "homography", H)

    def __repr__(self) -> str:
        return f"Plane({'with' if self.intrinsics else 'without'} intrinsics)"

    @classmethod
    def from_points(
        cls,
        pixels: npt.ArrayLike,
        meters: npt.ArrayLike,
        intrinsics: Intrinsics | None = None,
        pixel_std: float = 0.0,
        meter_std: float = 0.0,
    ) -> Plane:
        """From four or more points with known positions on the plane.

        Parameters
        ----------
        pixels, meters : (n, 2) float
            The points in the picture and on the plane, n >= 4.
        intrinsics : Intrinsics, optional
            Needed if the lens distorts, and for objects above the plane.
        pixel_std, meter_std : float
            Standard deviations of each coordinate.

        Raises
        ------
        ValueError
            For fewer points, three of four on a line, or a negative standard deviation.
        """
        if intrinsics is not None:
            check_intrinsics("intrinsics", intrinsics)
        check_not_negative("pixel_std", pixel_std)
        check_not_negative("meter_std", meter_std)
        seen, true = np.array(pixels, float), np.array(meters, float)
        if seen.ndim != 2 or seen.shape[1:] != (2,) or seen.shape != true.shape or len(seen) < 4:
            raise ValueError(
                f"pixels and meters must be four points (x, y) or more each, got {seen.shape} and "
                f"{true.shape}"
            )

        def homography(pixels: Array, meters: Array) -> Array:
            """(9,) homography from meters to undistorted points."""
            points = pixels.reshape(-1, 2)
            points = points if intrinsics is None else intrinsics.undistort(points)
            return _homography(meters.reshape(-1, 2), points).ravel()

        n = seen.size
        sources = {
            "pixels": Source(seen.ravel(), pixel_std**2 * np.eye(n)),
            "meters": Source(true.ravel(), meter_std**2 * np.eye(n)),
        }
        H, _, total = covariances(homography, sources)
        return cls(H.reshape(3, 3), intrinsics, total)

    @classmethod
    def from_pose(
        cls, intrinsics: Intrinsics, rotation: npt.ArrayLike, translation: npt.ArrayLike
    ) -> Plane:
        """From its pose in the camera's coordinates, as OpenCV's solvePnP returns it.

        Parameters
        ----------
        intrinsics : Intrinsics
        rotation : (3, 3) float
            From the plane's axes to the camera's; or (3,), the rotation vector, radians.
        translation : (3,) float
            The plane's origin in the camera's coordinates, meters.
        """
        check_intrinsics("intrinsics", intrinsics)
        R = np.asarray(rotation, dtype=float)
        if R.size == 3:
            R = scipy.spatial.transform.Rotation.from_rotvec(R.ravel()).as_matrix()
        t = np.asarray(translation, dtype=float).ravel()
        if R.shape != (3, 3) or t.shape != (3,):
            raise ValueError(
                f"rotation must be (3, 3) or (3,) and translation (3,), got {R.shape} and {t.shape}"
            )
        return cls(np.column_stack([R[:, 0], R[:, 1], t]), intrinsics)

    def locate(self, pixels: npt.ArrayLike, height: float = 0.0) -> Array:
        """Points (..., 2) on the plane, meters, that project to pixels (..., 2).

        For a point `height` meters above the plane, on the camera's side, the foot of its
        perpendicular. NaN beyond the horizon.

        Raises
        ------
        ValueError
            For a height without intrinsics, or pixels of another shape.
        """
        return self._locate(self.homography, check_points("pixels", pixels, 2), height)

    def _locate(self, H: Array, pixels: Array, height: float) -> Array:
        m = pixels
        if self.intrinsics is not None:
            m = self.intrinsics.undistort(pixels)
            H = _raised(H, height)
        elif height != 0:
            raise ValueError(f"a height needs intrinsics of the camera, got a height of {height}")
        point = np.concatenate([m, np.ones_like(m[..., :1])], axis=-1) @ np.linalg.inv(H).T
        before = (
            np.sign(np.linalg.det(H)) * np.sign(np.linalg.det(self.homography)) * point[..., 2:]
        )
        return np.where(before > 0, point[..., :2] / point[..., 2:], np.nan)


@dataclass(frozen=True, eq=False)
class PlaneMotion(OverExposure, ErrorBudget):
    """Motion on a plane; the picture does not determine which end came first.

    Parameters
    ----------
    start, end : (2,) float
        On the plane, meters.
    covariance : (4, 4) float
        Of start and end.
    length, length_std : float
        Of the path, meters.
    parts : mapping of str to float
        Relative errors of the length that each source alone causes: the "picture", the "plane", the
        "height"; and for the speed the "exposure time".
    exposure_time, exposure_std : float or None, float
        Seconds.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> wall_behind = bm.motion.Plane.from_pose(lens, np.eye(3), (0, 0, 2.0))
    >>> moved = bm.motion.measure_on_plane(sweep, wall_behind, exposure_time=1 / 60)
    >>> print(f"{moved.speed:.1f} ± {moved.speed_std:.1f} m/s")
    71.9 ± 0.2 m/s
    """

    start: Array
    end: Array
    covariance: Array
    length: float
    length_std: float
    parts: Mapping[str, float]
    exposure_time: float | None = None
    exposure_std: float = 0.0

    def __repr__(self) -> str:
        speed = self._speed_in_words()
        return f"PlaneMotion({self.length:.4g} ± {self.length_std:.2g} m{speed})"

    @property
    def displacement(self) -> Array:
        """(2,) from start to end, meters."""
        return np.asarray(self.end - self.start)

    def numbers(self) -> dict[str, float | str]:
        """All numbers by name, flat, for a row of a table: meters, and m/s if the time is known."""
        std = np.sqrt(np.diag(self.covariance))
        row: dict[str, float | str] = {}
        row |= by_axis("plane_start", self.start, std[:2])
        row |= by_axis("plane_end", self.end, std[2:])
        row |= {"plane_length": self.length, "plane_length_std": self.length_std}
        if self.exposure_time is not None:
            row |= {"plane_speed": self.speed, "plane_speed_std": self.speed_std}
        return row | {"plane_error_from": self.dominant}

    @property
    def _moved(self) -> tuple[float, float]:
        return self.length, self.length_std


def measure_on_plane(
    path: Sweep | Trajectory,
    plane: Plane,
    exposure_time: float | None = None,
    exposure_std: float = 0.0,
    height: float = 0.0,
    height_std: float = 0.0,
    path_std: float = 0.0,
) -> PlaneMotion:
    """Path and speed of an object that moves on a plane.

    Parameters
    ----------
    path : Sweep or Trajectory
        Of one of its points in the picture: of a sweep the center, whose height must be given.
    plane : Plane
    exposure_time, exposure_std : float, optional
        Seconds, and their standard deviation; without them there is no speed.
    height, height_std, path_std : float
        Of the point above the plane, meters; of each coordinate of both ends of a Trajectory, pixels.

    Raises
    ------
    TypeError, ValueError, MotionError
        For another path, a number out of its range, or a path that is a point or beyond the horizon.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> wall_behind = bm.motion.Plane.from_pose(lens, np.eye(3), (0, 0, 2.0))
    >>> bm.motion.measure_on_plane(sweep, wall_behind)
    PlaneMotion(1.197 ± 0.0042 m)
    """
    check_kind("plane", plane, Plane, "use blurmatte.motion.Plane.from_points(pixels, meters)")
    check_exposure(exposure_time, exposure_std)
    picture, points = path_source(path, path_std)
    sources = {
        "picture": picture,
        "plane": Source(plane.homography.ravel(), plane.covariance),
        "height": Source.number(height, height_std),
    }

    def ends_and_length(parameters: Array, homography: Array, above: Array) -> Array:
        """First and last point on the plane, and the path length, meters."""
        xy = points(parameters, np.linspace(0, 1, 17))
        X = plane._locate(homography.reshape(3, 3), xy, float(above[0]))
        length = np.linalg.norm(np.diff(X, axis=0), axis=1).sum()
        return np.concatenate([X[0], X[-1], [length]])

    values, parts, total = covariances(ends_and_length, sources)
    if not np.all(np.isfinite(values)):
        raise MotionError("the streak goes beyond the plane's horizon; check the plane's points")
    if not values[4] > 0:
        raise MotionError("nothing moved: start and end of the path are one point")
    length, length_std = float(values[4]), float(np.sqrt(total[4, 4]))
    relative = relative_errors(parts, 4, length, exposure_time, exposure_std)
    places = values[:2], values[2:4], total[:4, :4]
    return PlaneMotion(*places, length, length_std, relative, exposure_time, exposure_std)


def _raised(H: Array, height: float) -> Array:
    """The homography of the parallel plane at a height, meters, on the camera's side."""
    if height == 0:
        return H
    scale = (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1])) / 2
    normal = np.cross(H[:, 0], H[:, 1])
    normal /= np.linalg.norm(normal)
    normal *= -np.sign(normal @ H[:, 2])
    return np.column_stack([H[:, :2], H[:, 2] + height * scale * normal])


def _homography(a: Array, b: Array) -> Array:
    """H (3, 3) of unit norm that maps a (n, 2) to b (n, 2), positive there, by linear least squares.

    Points are shifted to their mean and scaled first [Hartley, In defense of the eight-point
    algorithm, TPAMI 1997].
    """
    (a, A), (b, B) = _normalized(a), _normalized(b)
    one, zero = np.ones(len(a)), np.zeros((len(a), 3))
    p = np.column_stack([a, one])
    rows = np.concatenate([
        np.hstack([p, zero, -b[:, :1] * p]), np.hstack([zero, p, -b[:, 1:] * p]),
    ])  # fmt: skip
    H = np.linalg.inv(B) @ np.linalg.svd(rows)[2][-1].reshape(3, 3) @ A
    origin = np.linalg.inv(A) @ [0, 0, 1]  # the mean point
    return np.asarray(H * np.sign(H[2] @ origin) / np.linalg.norm(H))


def _normalized(points: Array) -> tuple[Array, Array]:
    """Points (n, 2) shifted to the mean 0 and scaled to size 1, and the map (3, 3) that does it."""
    mean = points.mean(axis=0)
    scale = 1 / max(float(np.abs(points - mean).mean()), 1e-300)
    T = np.array([[scale, 0, -scale * mean[0]], [0, scale, -scale * mean[1]], [0, 0, 1]])
    return (points - mean) * scale, T

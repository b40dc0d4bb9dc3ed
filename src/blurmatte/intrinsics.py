"""Intrinsics: projection of points in space to pixels by a calibrated camera, and its inverse.

Points in space are (x, y, z) in the camera's coordinates, x right, y down, z forward. Pixels are
(x, y) with their centers at whole numbers, (0, 0) the center of the first one, as in OpenCV. In this
file m is a point on the plane z = 1 without distortion, m′ with it, and the pixel is
(fx m′x + cx, fy m′y + cy).

The two distortion models are those of OpenCV [calib3d]: the rational model of Brown with tangential
terms, and for fisheye lenses a polynomial of the angle [Kannala & Brandt, TPAMI 2006].
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, check_kind, check_not_negative, check_points

_MAX_STEPS = 30  # of Newton's method
_CONVERGED = 1e-12  # on the plane z = 1: far below a pixel
_TINY = 1e-30  # complex step, and guards


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A calibrated camera: focal lengths, principal point and distortion, with their errors.

    Parameters
    ----------
    fx, fy : float
        Focal lengths, pixels.
    cx, cy : float
        Principal point, pixels.
    distortion : (n,) float
        OpenCV's k1, k2, p1, p2, k3, k4, k5, k6, of which 0, 4, 5 or 8 are given; of a fisheye
        k1, k2, k3, k4.
    fisheye : bool
        True for the fisheye model; without coefficients it is the equidistant projection.
    covariance : (4 + n, 4 + n) float, optional
        Of fx, fy, cx, cy and the distortion; by default zeros, known exactly.
    size : (int, int), optional
        (width, height) of the pictures of the calibration, the only ones it is valid for.

    Raises
    ------
    ValueError
        For numbers that are not finite, focal lengths that are not positive, or another count.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, (6000, 4000), sensor_width=36)
    >>> print(f"{lens.fx:.0f} pixels")
    4667 pixels
    >>> lens.project(np.array([[0.1, 0.0, 2.0]])).round(1)
    array([[3232.8, 1999.5]])
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Array = field(default_factory=lambda: np.zeros(0))
    fisheye: bool = False
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        distortion = np.array(self.distortion, dtype=float).reshape(-1)
        object.__setattr__(self, "distortion", distortion)
        if not (np.all(np.isfinite(self.values)) and min(self.fx, self.fy) > 0):
            raise ValueError(
                f"fx and fy must be positive and all finite, got {self.values.tolist()}"
            )
        # OpenCV's: k1 k2 p1 p2 [k3 [k4 k5 k6]], and k1 k2 k3 k4 of a fisheye.
        counts = (0, 4) if self.fisheye else (0, 4, 5, 8)
        if len(distortion) not in counts:
            kind = "a fisheye" if self.fisheye else "a lens"
            raise ValueError(
                f"distortion of {kind} must have {', '.join(map(str, counts[:-1]))} or {counts[-1]} "
                f"coefficients, got {len(distortion)}"
            )
        n = len(self.values)
        covariance = np.array(self.covariance, dtype=float)
        covariance = covariance if covariance.size else np.zeros((n, n))
        if covariance.shape != (n, n) or not np.all(np.isfinite(covariance)):
            raise ValueError(f"covariance must be finite, ({n}, {n}), got {covariance.shape}")
        object.__setattr__(self, "covariance", covariance)
        if self.size is not None:
            width, height = map(int, self.size)
            if min(width, height) < 1:
                raise ValueError(f"size must be (width, height) in pixels, got {self.size}")
            object.__setattr__(self, "size", (width, height))

    def __repr__(self) -> str:
        kind = ", fisheye" if self.fisheye else ""
        return (
            f"Intrinsics(focal length {self.fx:.1f} x {self.fy:.1f} px ± {self.std[0]:.2g}, "
            f"center ({self.cx:.1f}, {self.cy:.1f}){kind}, {len(self.distortion)} distortion terms)"
        )

    @classmethod
    def from_focal_length(
        cls,
        focal_length: float,
        size: tuple[int, int],
        sensor_width: float | None = None,
        std: float = 0.0,
    ) -> Intrinsics:
        """A lens without distortion, its principal point in the middle of the picture.

        Parameters
        ----------
        focal_length : float
            Millimeters; the 35 mm equivalent if no sensor width is given.
        size : (int, int)
            (width, height) of the picture, pixels.
        sensor_width : float, optional
            Width of the picture on the sensor, millimeters.
        std : float
            Standard deviation of the focal length, millimeters.

        Raises
        ------
        ValueError
            If a length is not positive, or the standard deviation is negative or not finite.
        """
        width, height = size
        check_not_negative("std", std)
        if sensor_width is not None and not sensor_width > 0:
            raise ValueError(f"sensor_width must be positive millimeters, got {sensor_width}")
        # A 35 mm equivalent is for a diagonal of 36 mm by 24 mm [CIPA DCG-001].
        scale = np.hypot(width, height) / np.hypot(36, 24)
        scale = float(scale if sensor_width is None else width / sensor_width)
        f, covariance = focal_length * scale, np.zeros((4, 4))
        covariance[:2, :2] = (std * scale) ** 2  # one length: fully correlated
        return cls(f, f, (width - 1) / 2, (height - 1) / 2, covariance=covariance, size=size)

    @property
    def values(self) -> Array:
        """(4 + n,) fx, fy, cx, cy and the distortion."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion], dtype=float)

    @property
    def std(self) -> Array:
        """(4 + n,) standard deviations of `values`."""
        return np.sqrt(np.diag(self.covariance))

    def check_size(self, size: tuple[int, int]) -> None:
        """Raise unless pictures of a size (width, height) can be of this camera.

        Raises
        ------
        ValueError
            If it was calibrated with pictures of another size.
        """
        if self.size is not None and self.size != tuple(size):
            raise ValueError(
                "the camera was calibrated with pictures of {}x{} pixels, and this has {}x{}; give the "
                "calibration of pictures of this size".format(*self.size, *size)
            )

    def with_values(self, values: Array) -> Intrinsics:
        """The same kind of camera with other `values`."""
        fx, fy, cx, cy = (float(v) for v in values[:4])
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, distortion=np.asarray(values[4:]))

    def project(self, points: npt.ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) in space; NaN for those behind the camera."""
        X = check_points("points", points, 3)
        z = np.where(X[..., 2:] > 0, X[..., 2:], np.nan)
        m = self._distorted(X[..., :2] / z)
        return np.asarray(m * [self.fx, self.fy] + [self.cx, self.cy])

    def undistort(self, pixels: npt.ArrayLike) -> Array:
        """Points (..., 2) on the plane z = 1 of pixels (..., 2), by Newton's method.

        NaN where the distortion model has no inverse, far from the center.
        """
        xy = check_points("pixels", pixels, 2)
        there = (xy - [self.cx, self.cy]) / [self.fx, self.fy]
        if not self.fisheye and not self.distortion.any():
            return np.asarray(there)
        if self.fisheye:
            return self._undistort_fisheye(there)
        m = there
        with np.errstate(all="ignore"):
            for _ in range(_MAX_STEPS):
                off = self._distorted(m) - there
                if np.nanmax(np.abs(off), initial=0) < _CONVERGED:
                    break
                J = self._slope(m)
                m = m - (_inverse(J) @ off[..., None])[..., 0]
            wrong = ~(np.abs(self._distorted(m) - there).max(axis=-1) < 1e-6)
            slope = self._slope(np.where(wrong[..., None], 0, m))
            # Far from the center the model may reflect or rotate the plane, as no lens does.
            wrong |= ~((np.linalg.det(slope) > 0) & (np.trace(slope, axis1=-2, axis2=-1) > 0))
        return np.where(wrong[..., None], np.nan, m)

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """Unit directions (..., 3) of pixels (..., 2); NaN where `undistort` is."""
        return _ray(self.undistort(pixels))

    def ray_slopes(self, pixels: npt.ArrayLike) -> Array:
        """(..., 3, 2) derivatives of the rays by the pixel's x and y."""
        m = self.undistort(pixels)
        ray = _ray(m)[..., None]
        with np.errstate(all="ignore"):  # NaN stays NaN
            by_pixel = _inverse(self._slope(m)) / [self.fx, self.fy]
        flat = np.concatenate([by_pixel, np.zeros_like(by_pixel[..., :1, :])], axis=-2)
        length = np.sqrt(1 + (m**2).sum(axis=-1))[..., None, None]
        along = np.swapaxes(ray, -1, -2) @ flat
        return np.asarray((flat - ray * along) / length)

    def magnification(self, pixels: npt.ArrayLike) -> Array:
        """(...) pixels per radian, the geometric mean over directions."""
        slopes = self.ray_slopes(pixels)
        area = np.linalg.norm(np.cross(slopes[..., 0], slopes[..., 1]), axis=-1)
        return np.asarray(area**-0.5)

    def _distorted(self, m: Array) -> Array:
        """m′ of m; also of complex m."""
        k = self.distortion
        x, y = m[..., 0], m[..., 1]
        square = x * x + y * y
        if self.fisheye:
            r = np.sqrt(square + _TINY)
            theta = np.arctan(r)
            return np.asarray(m * (_distorted_angle(theta, k) / r)[..., None])
        if not k.any():
            return m
        k = np.concatenate([k, np.zeros(8 - len(k))])
        above = 1 + square * (k[0] + square * (k[1] + square * k[4]))
        below = 1 + square * (k[5] + square * (k[6] + square * k[7]))
        factor = above / below
        xd = x * factor + 2 * k[2] * x * y + k[3] * (square + 2 * x * x)
        yd = y * factor + 2 * k[3] * x * y + k[2] * (square + 2 * y * y)
        return np.stack([xd, yd], axis=-1)

    def _slope(self, m: Array) -> Array:
        """(..., 2, 2) derivative of m′ by m, by complex steps."""
        steps = (1j * _TINY * np.eye(2)).astype(complex)
        return np.stack([self._distorted(m + d).imag / _TINY for d in steps], axis=-1)

    def _undistort_fisheye(self, there: Array) -> Array:
        """M of m′ of a fisheye, by Newton's method for the angle; NaN from 90° off the axis."""
        r = np.linalg.norm(there, axis=-1)
        theta, k = r, self.distortion
        with np.errstate(all="ignore"):
            for _ in range(_MAX_STEPS):
                slope = _distorted_angle(theta + 1j * _TINY, k).imag / _TINY
                theta = theta - (_distorted_angle(theta, k) - r) / slope
            seen = (np.abs(_distorted_angle(theta, k) - r) < 1e-6) & (np.abs(theta) < np.pi / 2)
            seen &= (theta >= 0) & (_distorted_angle(theta + 1j * _TINY, k).imag > 0)
            factor = np.where(r > _CONVERGED, np.tan(theta) / np.maximum(r, _TINY), 1)
        return np.where(seen[..., None], there * factor[..., None], np.nan)


def _ray(m: Array) -> Array:
    """Unit directions (..., 3) of points m (..., 2)."""
    ray = np.concatenate([m, np.ones_like(m[..., :1])], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def _inverse(J: Array) -> Array:
    """Inverses of (..., 2, 2) matrices, infinite or NaN if singular."""
    a, b, c, d = J[..., 0, 0], J[..., 0, 1], J[..., 1, 0], J[..., 1, 1]
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return np.asarray(adjugate / (a * d - b * c)[..., None, None])


def _distorted_angle(theta: Array, k: Array) -> Array:
    """Angle after the distortion of a fisheye, of the angle theta before, radians."""
    if not k.any():
        return theta
    s = theta * theta
    return np.asarray(theta * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))))


def check_intrinsics(name: str, value: object) -> None:
    """Raise TypeError unless it is the Intrinsics of a camera."""
    check_kind(name, value, Intrinsics, "use blurmatte.read_intrinsics(file)")

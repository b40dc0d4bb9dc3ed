"""Intrinsics: how a camera turns points in space into pixels, and back.

Points in space are (x, y, z) in the camera's coordinates, x right, y down, z forward. Pixels are
(x, y) with their centers at whole numbers, (0, 0) the center of the first one, as OpenCV has it. In
this file m is a point on the plane z = 1 as a pinhole sees it, m′ where the lens puts it, and the
pixel is (fx m′x + cx, fy m′y + cy).

The two models of lenses are OpenCV's [calib3d]: the rational one of Brown with tangential terms, and
of fisheyes a polynomial of the angle [Kannala & Brandt, TPAMI 2006].
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind, check_points

Array = npt.NDArray[np.float64]

_COUNTS = (0, 4, 5, 8)  # coefficients that OpenCV knows: k1 k2 p1 p2 [k3 [k4 k5 k6]]
_FISHEYE_COUNTS = (0, 4)
_STEPS = 30
_CLOSE = 1e-12  # on the plane z = 1: far below a pixel
_TINY = 1e-30
_DIAGONAL_35MM = float(np.hypot(36, 24))  # what a 35 mm equivalent is made for [CIPA DCG-001]


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A calibrated camera: focal lengths, principal point and distortion, with their errors.

    Parameters
    ----------
    fx, fy : float
        Focal lengths, pixels.
    cx, cy : float
        Where the optical axis meets the picture, pixels.
    distortion : (n,) float
        OpenCV's k1, k2, p1, p2, k3, k4, k5, k6, of which 0, 4, 5 or 8 are given; of a fisheye
        k1, k2, k3, k4.
    fisheye : bool
        Which of the two models the distortion is of; a fisheye without coefficients is equidistant.
    covariance : (4 + n, 4 + n) float, optional
        Of fx, fy, cx, cy and the distortion; zeros if it is empty or not given: known exactly.
    size : (int, int), optional
        (width, height) of the pictures that it was calibrated with; of others nothing here is true.

    Raises
    ------
    ValueError
        For numbers that are not finite, focal lengths that are not positive, or another count.
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
        counts = _FISHEYE_COUNTS if self.fisheye else _COUNTS
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
        """A lens without distortion whose axis meets the middle of the picture.

        Parameters
        ----------
        focal_length : float
            Millimeters; the 35 mm equivalent if no sensor width is given.
        size : (int, int)
            (width, height) of the picture, pixels.
        sensor_width : float, optional
            Millimeters that the width of the picture has on the sensor.
        std : float
            Standard deviation of the focal length, millimeters.

        Raises
        ------
        ValueError
            If a length is not positive, or the standard deviation is none.
        """
        width, height = size
        if not (np.isfinite(std) and std >= 0):
            raise ValueError(f"std must be finite and not negative, got {std}")
        if sensor_width is not None and not sensor_width > 0:
            raise ValueError(f"sensor_width must be positive millimeters, got {sensor_width}")
        scale = np.hypot(width, height) / _DIAGONAL_35MM
        scale = float(scale if sensor_width is None else width / sensor_width)
        f, covariance = focal_length * scale, np.zeros((4, 4))
        covariance[:2, :2] = (std * scale) ** 2  # one length: both err together
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
        """Whether it may be the camera of pictures of a size (width, height).

        Raises
        ------
        ValueError
            If it is known to have been calibrated with pictures of another size.
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
        """Points (..., 2) on the plane z = 1 that are seen in pixels (..., 2).

        By Newton's method. NaN where the lens puts nothing: so far out that the model of its
        distortion has no inverse there.
        """
        xy = check_points("pixels", pixels, 2)
        there = (xy - [self.cx, self.cy]) / [self.fx, self.fy]
        if not self.fisheye and not self.distortion.any():
            return np.asarray(there)
        if self.fisheye:
            return self._unfished(there)
        m = there
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                off = self._distorted(m) - there
                if np.nanmax(np.abs(off), initial=0) < _CLOSE:
                    break
                J = self._slope(m)
                m = m - (_inverse(J) @ off[..., None])[..., 0]
            wrong = ~(np.abs(self._distorted(m) - there).max(axis=-1) < 1e-6)
            slope = self._slope(np.where(wrong[..., None], 0, m))
            # Far out the model may turn the plane over, or around: both are no lens.
            wrong |= ~((np.linalg.det(slope) > 0) & (np.trace(slope, axis1=-2, axis2=-1) > 0))
        return np.where(wrong[..., None], np.nan, m)

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """Unit directions (..., 3) in which pixels (..., 2) look; NaN where `undistort` is."""
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
        """(...) pixels that a radian takes there, the geometric mean of all directions."""
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
            return np.asarray(m * (_turned(theta, k) / r)[..., None])
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

    def _unfished(self, there: Array) -> Array:
        """What a fisheye puts at m′: its angle by Newton's method; 90° off the axis or more is NaN."""
        r = np.linalg.norm(there, axis=-1)
        theta, k = r, self.distortion
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                slope = _turned(theta + 1j * _TINY, k).imag / _TINY
                theta = theta - (_turned(theta, k) - r) / slope
            seen = (np.abs(_turned(theta, k) - r) < 1e-6) & (np.abs(theta) < np.pi / 2)
            seen &= (theta >= 0) & (_turned(theta + 1j * _TINY, k).imag > 0)
            factor = np.where(r > _CLOSE, np.tan(theta) / np.maximum(r, _TINY), 1)
        return np.where(seen[..., None], there * factor[..., None], np.nan)


def _ray(m: Array) -> Array:
    """Unit directions (..., 3) of points m (..., 2)."""
    ray = np.concatenate([m, np.ones_like(m[..., :1])], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def _inverse(J: Array) -> Array:
    """Of (..., 2, 2) matrices, infinite or NaN if there is none."""
    a, b, c, d = J[..., 0, 0], J[..., 0, 1], J[..., 1, 0], J[..., 1, 1]
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return np.asarray(adjugate / (a * d - b * c)[..., None, None])


def _turned(theta: Array, k: Array) -> Array:
    """The angle at which a fisheye puts what is seen at the angle theta."""
    if not k.any():
        return theta
    s = theta * theta
    return np.asarray(theta * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))))


def check_intrinsics(name: str, value: object) -> None:
    """Raise TypeError unless it is the Intrinsics of a camera."""
    check_kind(name, value, Intrinsics, "use blurmatte.read_intrinsics(file)")

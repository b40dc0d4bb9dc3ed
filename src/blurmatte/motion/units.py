"""From pixels and exposures to meters and seconds, and what a rolling shutter does to both.

A rolling shutter exposes row y later than row 0 by y τ, τ the line time. The exposure fraction s of
the row in which the object's center is seen at p(s) is the moment s T + τ y(s), T the exposure
time. So what looks like one exposure of the object took the time

    D = T + τ (y(1) − y(0)),

longer than T if it moved down and shorter if it moved up, and its mean speed is length / D. The same
follows for the whole silhouette: what is seen is the picture of a global shutter, sheared and
stretched by p → (x − v_x τ y, (1 − v_y τ) y), v in pixels per second. All lengths along the motion
are stretched by 1 / (1 − v_y τ) = D / T, and so is the area of the silhouette. The direction stays.
[Ait-Aider et al., "Simultaneous object pose and velocity computation using a single view from a
rolling shutter camera", ECCV 2006, has the camera model.]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.errors import MotionError
from blurmatte.motion.shutter import check_line_time

if TYPE_CHECKING:
    from blurmatte.motion.motion import Motion

Array = npt.NDArray[np.float64]

READOUT = (
    0.02  # seconds that usual sensors with a rolling shutter take from the first row to the last
)
_PER_METER_PER_SECOND = {"m/s": 1.0, "km/h": 3.6, "mph": 3600 / 1609.344}


@dataclass(frozen=True)
class Scale:
    """How large a pixel is where the object went, in a plane parallel to the sensor.

    Parameters
    ----------
    meters_per_pixel : float
    std : float
        Its standard deviation.
    motion : Motion, optional
        Whose radius told it: the errors of that and of its length hang together.

    Raises
    ------
    ValueError
        Unless it is positive and its error is not negative.
    """

    meters_per_pixel: float
    std: float = 0.0
    motion: Motion | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        _check_positive("meters_per_pixel", self.meters_per_pixel)
        _check_error("std", self.std)

    @classmethod
    def from_radius(cls, motion: Motion, radius: float, std: float = 0.0) -> Scale:
        """From the true radius of a ball, or of the disc of the silhouette's area, in meters.

        Raises
        ------
        ValueError
            For a radius that is not positive.
        MotionError
            If the radius in the picture is not above its own error, or the object reaches the border.
        """
        from blurmatte.motion.motion import Motion as Measured  # which imports this module

        check_kind("motion", motion, Measured, "use blurmatte.measure_motion(solution)")
        _check_positive("radius", radius)
        _check_error("std", std)
        if motion.radius <= 3 * motion.radius_std:
            raise MotionError(
                f"a radius of {motion.radius:.2g} ± {motion.radius_std:.2g} px gives no scale; give "
                "meters per pixel, or two points of known distance"
            )
        if motion.at_border and motion.source == "moments":
            raise MotionError(
                "the object reaches the border, so that its radius in the picture is not known; give "
                "meters per pixel, or two points of known distance"
            )
        scale = radius / motion.radius
        relative = np.hypot(std / radius, motion.radius_std / motion.radius)
        return cls(scale, float(scale * relative), motion)

    @classmethod
    def from_points(
        cls, first: npt.ArrayLike, second: npt.ArrayLike, distance: float, std: float = 0.0
    ) -> Scale:
        """From two points (x, y) of the picture, pixels, and how far they are apart, meters.

        `std` is the error of the distance and of pointing together, in meters. The points must be as
        far from the camera as the object.

        Raises
        ------
        ValueError
            If the points are one, or the distance is not positive.
        """
        a, b = np.asarray(first, float), np.asarray(second, float)
        if a.shape != (2,) or b.shape != (2,):
            raise ValueError(f"a point must be (x, y), got the shapes {a.shape} and {b.shape}")
        _check_positive("distance", distance)
        _check_error("std", std)
        pixels = float(np.linalg.norm(b - a))
        if not (np.isfinite(pixels) and pixels > 0):
            raise ValueError(f"the two points must differ, got {a.tolist()} and {b.tolist()}")
        return cls(distance / pixels, std / pixels)


@dataclass(frozen=True)
class Speed:
    """How fast something was, on average over the exposure and at most.

    Parameters
    ----------
    mean, mean_std, top, top_std : float
        With standard deviations, in `unit`.
    unit : str
        "m/s"; without a scale "px/s"; without an exposure time "m/exposure" or "px/exposure".
    parts : mapping
        What the error of the mean comes from, each alone, as a fraction of the speed.
    unknown : float or None
        By which fraction a usual rolling shutter would change it, if there is one that nobody spoke
        of; 0 if the line time was given, None if the exposure time is not known.
    """

    mean: float
    mean_std: float
    top: float
    top_std: float
    unit: str
    parts: Mapping[str, float]
    unknown: float | None = 0.0

    def __repr__(self) -> str:
        return f"Speed({self.mean:.4g} ± {self.mean_std:.2g} {self.unit})"

    @property
    def dominant(self) -> str:
        """What most of the error comes from: "length", "scale", "exposure time", …"""
        return max(self.parts, key=lambda name: self.parts[name])

    def numbers(self) -> dict[str, float | str | None]:
        """All numbers by name, flat, for a row of a table."""
        return {
            "mean_speed": self.mean,
            "mean_speed_std": self.mean_std,
            "highest_speed": self.top,
            "highest_speed_std": self.top_std,
            "speed_unit": self.unit,
            "speed_error_from": self.dominant,
            "rolling_shutter_may_change": self.unknown,
        }

    def in_unit(self, unit: str) -> Speed:
        """The same in "m/s", "km/h" or "mph".

        Raises
        ------
        ValueError
            For another unit.
        MotionError
            If the speed is not known in meters per second.
        """
        if unit not in _PER_METER_PER_SECOND:
            raise ValueError(f"unit must be {' or '.join(_PER_METER_PER_SECOND)}, got {unit!r}")
        if self.unit not in _PER_METER_PER_SECOND:
            missing = [what for what, lacking in (("a scale", "px"), ("an exposure time", "exposure"))
                       if lacking in self.unit]  # fmt: skip
            raise MotionError(
                f"the speed is known in {self.unit} only; give {' and '.join(missing)}"
            )
        f = _PER_METER_PER_SECOND[unit] / _PER_METER_PER_SECOND[self.unit]
        mean, mean_std, top, top_std = (
            f * v for v in (self.mean, self.mean_std, self.top, self.top_std)
        )
        return Speed(mean, mean_std, top, top_std, unit, self.parts, self.unknown)


def speed_of(
    motion: Motion,
    scale: Scale | None,
    exposure_time: float | None,
    exposure_std: float,
    line_time: float | None,
    downward: bool | None,
) -> Speed:
    """See `Motion.speed`."""
    check_kind("scale", scale, Scale | None, "use blurmatte.Scale(meters_per_pixel)")
    _check_error("exposure_std", exposure_std)
    if exposure_time is not None:
        _check_positive("exposure_time", exposure_time)
    lag = _lag(motion, exposure_time, line_time)
    ways = (1, -1) if downward is None else (1,) if downward else (-1,)
    possible = [way * lag for way in ways if 1 + way * lag > 0]
    if not possible:
        raise ValueError("an object cannot go up that far within the exposure; check line_time")
    both = np.array([_mean_and_top(motion, scale, exposure_time, lag) for lag in possible])
    mean, top = both.mean(axis=0)
    parts = _parts(motion, scale, exposure_time, exposure_std)
    apart = np.ptp(both, axis=0) / 2
    if lag > 0 and len(possible) == 2:
        parts["direction of time"] = float(apart[0] / max(mean, 1e-12))
    others = _squares(parts) - parts["length"] ** 2
    of_mean = _squares(parts) + _shared(motion, scale, "length")
    of_top = (motion.top_speed_std / max(motion.top_speed, 1e-12)) ** 2 + others
    of_top += _shared(motion, scale, "top_speed")
    return Speed(
        float(mean),
        float(mean * np.sqrt(max(of_mean, 0))),
        float(top),
        float(top * np.sqrt(max(of_top, 0))),
        ("px" if scale is None else "m") + ("/exposure" if exposure_time is None else "/s"),
        parts,
        _unspoken(motion, exposure_time) if line_time is None else 0.0,
    )


def _lag(motion: Motion, exposure_time: float | None, line_time: float | None) -> float:
    """τ |y(1) − y(0)| / T, by which moving down takes longer than the exposure."""
    if line_time is None:
        return 0.0
    _check_error("line_time", line_time)
    check_line_time(line_time, motion.size[1])
    if exposure_time is None:
        raise ValueError("line_time needs exposure_time, for its effect is their ratio")
    return line_time * _fall(motion) / exposure_time


def _fall(motion: Motion) -> float:
    """Rows between the first place and the last."""
    y = motion.trajectory.xy[:, 1]
    return abs(float(y[-1] - y[0]))


def _mean_and_top(
    motion: Motion, scale: Scale | None, exposure_time: float | None, lag: float
) -> tuple[float, float]:
    """Both speeds, if the last row it is seen in is exposed later by `lag` times the exposure."""
    size = 1.0 if scale is None else scale.meters_per_pixel
    if scale is not None and scale.motion is not None:
        size *= np.sqrt(1 + lag)  # the area that told it is stretched by that
    T = 1.0 if exposure_time is None else exposure_time
    y, t = motion.trajectory.xy[:, 1], motion.trajectory.t
    down = np.diff(y) / np.diff(t) * np.sign(y[-1] - y[0]) / max(_fall(motion), 1e-12)
    slower = np.maximum(1 + lag * down, 1e-6)
    fastest = motion.top_speed * np.max(motion.speeds / slower) / max(np.max(motion.speeds), 1e-12)
    return size * motion.length / (T * (1 + lag)), float(size * fastest / T)


def _parts(
    motion: Motion, scale: Scale | None, exposure_time: float | None, exposure_std: float
) -> dict[str, float]:
    """Relative errors of the mean speed, each alone."""
    parts = {"length": motion.length_std / max(motion.length, 1e-12)}
    if scale is not None:
        parts["scale"] = scale.std / scale.meters_per_pixel
    if exposure_time is not None:
        parts["exposure time"] = exposure_std / exposure_time
    return parts


def _shared(motion: Motion, scale: Scale | None, name: str) -> float:
    """Relative variance that speed loses or gains because the scale's error hangs together with it."""
    if scale is None or scale.motion is None or scale.motion.covariance is not motion.covariance:
        return 0.0
    both = motion.covariance_of(name, "radius")
    value = motion.length if name == "length" else motion.top_speed
    return -2 * both / (max(value, 1e-12) * motion.radius)


def _unspoken(motion: Motion, exposure_time: float | None) -> float | None:
    """What a usual rolling shutter may do, if nobody said that there is none."""
    if exposure_time is None:
        return None
    return READOUT / motion.size[1] * _fall(motion) / exposure_time


def _squares(parts: Mapping[str, float]) -> float:
    return sum(part**2 for part in parts.values())


def _check_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be finite and above 0, got {value}")


def _check_error(name: str, value: float) -> None:
    if not (np.isfinite(value) and value >= 0):
        raise ValueError(f"{name} must be finite and not negative, got {value}")

"""Propagation of errors, and the part of a result's error that each input causes.

A result f(p) of parameters p with the covariance V has the covariance J V Jᵀ, to first order. The
derivatives J are central differences.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, check_not_negative, check_positive
from blurmatte.errors import MotionError
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory

DIFFERENCE_STEP = 1e-3  # standard deviations: small against curvature, large against rounding


@dataclass(frozen=True, eq=False)
class Source:
    """An input of a measurement."""

    values: Array  # (n,) float
    covariance: Array  # (n, n) float

    @classmethod
    def number(cls, value: float, std: float) -> "Source":
        """One number with its standard deviation."""
        return cls(np.array([value], float), np.array([[std**2]], float))


class ErrorBudget:
    """A result with the part of its error that each source alone causes, relative."""

    parts: Mapping[str, float]

    @property
    def dominant(self) -> str:
        """Source of the largest part of the error: "length", "scale", "exposure time", …"""
        return max(self.parts, key=lambda name: self.parts[name])


class OverExposure:
    """A change over the exposure, whose time may be known: its speed, and its largest error."""

    exposure_time: float | None
    exposure_std: float

    @property
    def speed(self) -> float:
        """Mean over the exposure, m/s, or rad/s of a rotation."""
        return self._moved[0] / self._seconds

    @property
    def speed_std(self) -> float:
        """Standard deviation of the speed."""
        moved, std = self._moved
        of_time = moved * self.exposure_std / self._seconds
        return float(np.hypot(std, of_time) / self._seconds)

    @property
    def _moved(self) -> tuple[float, float]:
        """What changed over the exposure, meters or radians, and its standard deviation."""
        raise NotImplementedError

    @property
    def _seconds(self) -> float:
        if self.exposure_time is None:
            raise MotionError("a velocity needs the exposure_time, in seconds; give it")
        return self.exposure_time

    def _speed_in_words(self, unit: str = "m/s") -> str:
        """The end of a sentence; "" without the time."""
        if self.exposure_time is None:
            return ""
        return f", {self.speed:.4g} ± {self.speed_std:.2g} {unit}"


def propagated(
    function: Callable[[Array], Array],
    parameters: Array,
    covariance: Array,
    angles: slice = slice(0),
) -> tuple[Array, Array]:
    """Values (n,) of a function of parameters (m,), and their covariance (n, n).

    Differences of those values that are `angles`, in radians, are wrapped to ±π.
    """
    values = function(parameters)
    steps = DIFFERENCE_STEP * np.sqrt(np.maximum(np.diag(covariance), 0)) + 1e-9
    J = np.empty((len(values), len(parameters)))
    for i, step in enumerate(steps):
        shift = np.zeros(len(parameters))
        shift[i] = step
        change = function(parameters + shift) - function(parameters - shift)
        change[angles] = np.angle(np.exp(1j * change[angles]))
        J[:, i] = change / (2 * step)
    return values, J @ covariance @ J.T


def covariances(
    f: Callable[..., Array], sources: Mapping[str, Source]
) -> tuple[Array, dict[str, Array], Array]:
    """Value of f, the covariance that each source alone causes, and their sum.

    f maps one array for each source, in their order, to an array (m,). The sources are independent.
    """
    values = [source.values for source in sources.values()]
    value = np.asarray(f(*values), dtype=float)
    parts = {}
    for i, (name, source) in enumerate(sources.items()):
        parts[name] = np.zeros((len(value), len(value)))
        if source.covariance.any():

            def alone(x: Array, i: int = i) -> Array:
                """The function of one argument."""
                return np.asarray(f(*values[:i], x, *values[i + 1 :]), dtype=float)

            parts[name] = propagated(alone, source.values, source.covariance)[1]
    return value, parts, np.sum(list(parts.values()), axis=0)


def relative_errors(
    parts: Mapping[str, Array],
    i: int,
    value: float,
    exposure_time: float | None = None,
    exposure_std: float = 0.0,
) -> dict[str, float]:
    """Relative error of value i that each source causes; of a speed, also the exposure time."""
    errors = {name: float(np.sqrt(part[i, i])) / value for name, part in parts.items()}
    if exposure_time is not None and exposure_std > 0:
        errors["exposure time"] = exposure_std / exposure_time
    return errors


def path_source(
    path: Sweep | Trajectory, path_std: float
) -> tuple[Source, Callable[[Array, Array], Array]]:
    """Parameters of a path in a picture, and the function from them and times (T,) to pixels (T, 2).

    Raises TypeError, ValueError if it is no path, or the standard deviation is negative or not
    finite.
    """
    check_with_std("path", 1.0, path_std)
    if isinstance(path, Sweep):
        n = len(path.path)
        picture = Source(path.path, path.covariance[:n, :n])
        return picture, lambda parameters, t: path.family.at(parameters, t)[0]
    if not isinstance(path, Trajectory):
        raise TypeError(f"path must be a Sweep or a Trajectory, got {type(path).__name__}")

    def moved(off: Array, t: Array) -> Array:
        """Points of the path after a shift of both ends."""
        ends = np.column_stack([1 - t, t]) @ off.reshape(2, 2)
        return np.asarray(path.at(t) + ends)

    return Source(np.zeros(4), path_std**2 * np.eye(4)), moved


def check_with_std(name: str, value: float, std: float) -> None:
    """Raise ValueError unless value > 0 and std >= 0."""
    check_positive(name, value)
    check_not_negative(f"{name}_std", std)


def check_exposure(exposure_time: float | None, exposure_std: float) -> None:
    """Raise ValueError unless the exposure time, if known, is > 0 and its standard deviation >= 0."""
    check_with_std("exposure", 1.0 if exposure_time is None else exposure_time, exposure_std)


def by_axis(name: str, values: Array, stds: Array) -> dict[str, float]:
    """Coordinates and their standard deviations by name: name_x, name_x_std, name_y …"""
    named = {}
    for axis, value, std in zip("xyz", values, stds, strict=False):
        named[f"{name}_{axis}"], named[f"{name}_{axis}_std"] = float(value), float(std)
    return named

"""Sources: what an answer in meters rests on, and the error that each of them leaves in it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.motion.propagation import propagated
from blurmatte.sweep import Sweep
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Source:
    """Numbers that an answer rests on.

    Parameters
    ----------
    values : (n,) float
    covariance : (n, n) float
    """

    values: Array
    covariance: Array

    @classmethod
    def number(cls, value: float, std: float) -> "Source":
        """One number with its standard deviation."""
        return cls(np.array([value], float), np.array([[std**2]], float))


def covariances(
    f: Callable[..., Array], sources: Mapping[str, Source]
) -> tuple[Array, dict[str, Array]]:
    """What f makes of the sources' values, and the covariance that each of them alone gives it.

    Parameters
    ----------
    f : callable
        Of as many arrays as there are sources, in their order; gives an array (m,).
    sources : mapping of str to Source
        Independent of each other.

    Returns
    -------
    value : (m,) float
    parts : dict of str to (m, m) float
    """
    values = [source.values for source in sources.values()]
    value = np.asarray(f(*values), dtype=float)
    parts = {}
    for i, (name, source) in enumerate(sources.items()):
        parts[name] = np.zeros((len(value), len(value)))
        if source.covariance.any():

            def alone(x: Array, i: int = i) -> Array:
                return np.asarray(f(*values[:i], x, *values[i + 1 :]), dtype=float)

            parts[name] = propagated(alone, source.values, source.covariance)[1]
    return value, parts


def relative_errors(
    parts: Mapping[str, Array],
    i: int,
    value: float,
    exposure_time: float | None = None,
    exposure_std: float = 0.0,
) -> dict[str, float]:
    """Of the value i, as each part alone makes it; of a speed, that of the exposure time too."""
    errors = {name: float(np.sqrt(part[i, i])) / value for name, part in parts.items()}
    if exposure_time is not None and exposure_std > 0:
        errors["exposure time"] = exposure_std / exposure_time
    return errors


def seen_path(
    path: Sweep | Trajectory, path_std: float
) -> tuple[Source, Callable[[Array, Array], Array]]:
    """What a picture says of a path, and where that is: (T, 2) pixels of parameters and times (T,).

    Raises
    ------
    TypeError, ValueError
        If it is no path, or the standard deviation is none.
    """
    check_number("path", 1.0, path_std)
    if isinstance(path, Sweep):
        n = len(path.path)
        picture = Source(path.path, path.covariance[:n, :n])
        return picture, lambda parameters, t: path.family.at(parameters, t)[0]
    if not isinstance(path, Trajectory):
        raise TypeError(f"path must be a Sweep or a Trajectory, got {type(path).__name__}")

    def moved(off: Array, t: Array) -> Array:
        ends = np.column_stack([1 - t, t]) @ off.reshape(2, 2)
        return np.asarray(path.at(t) + ends)

    return Source(np.zeros(4), path_std**2 * np.eye(4)), moved


def check_number(name: str, value: float, std: float) -> None:
    """ValueError unless value > 0 and std >= 0."""
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be finite and above 0, got {value}")
    if not (np.isfinite(std) and std >= 0):
        raise ValueError(f"{name}_std must be finite and not negative, got {std}")


def check_exposure(exposure_time: float | None, exposure_std: float) -> None:
    """The same of an exposure time that may not be known."""
    check_number("exposure", 1.0 if exposure_time is None else exposure_time, exposure_std)


def named_axes(name: str, values: Array, stds: Array) -> dict[str, float]:
    """Coordinates and their standard deviations by name: name_x, name_x_std, name_y …"""
    told = {}
    for axis, value, std in zip("xyz", values, stds, strict=False):
        told[f"{name}_{axis}"], told[f"{name}_{axis}_std"] = float(value), float(std)
    return told

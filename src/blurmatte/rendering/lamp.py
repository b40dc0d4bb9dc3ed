"""Lamps: far away, each of a color. What they and the light from everywhere do to paint.

Directions are (x, y, z) with x right, y down and z towards the camera, of any length.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.rendering.paint import check_color

Array = npt.NDArray[np.float64]

_TO_CAMERA = np.array([0.0, 0, 1])


@dataclass(frozen=True)
class Lamp:
    """Parallel light from one side.

    Parameters
    ----------
    direction : (3,) float
        Towards the lamp, from the body.
    color : (3,) float
        Linear light: what a white surface that faces the lamp shows of it.

    Raises
    ------
    ValueError
        If the direction is none, or the color black or negative.
    """

    direction: tuple[float, float, float] = (-0.45, -0.7, 0.55)
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        unit_direction("direction", self.direction)
        check_color("color", self.color)
        for name in ("direction", "color"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))

    @property
    def toward(self) -> Array:
        """(3,) unit vector towards the lamp."""
        return unit_direction("direction", self.direction)

    @property
    def halfway(self) -> Array:
        """(3,) unit vector halfway to the camera; zeros if the lamp is right behind the body."""
        between = self.toward + _TO_CAMERA
        length = np.linalg.norm(between)
        return np.asarray(between / length if length > 1e-9 else np.zeros(3))


def unit_direction(name: str, direction: Sequence[float] | Array) -> Array:
    """`direction` with length 1; ValueError unless it is (x, y, z) and not 0."""
    d = np.asarray(direction, dtype=float)
    if d.shape != (3,) or not np.all(np.isfinite(d)) or not np.linalg.norm(d) > 1e-9:
        raise ValueError(f"{name} must be a direction (x, y, z), got {direction}")
    return np.asarray(d / np.linalg.norm(d))


def check_lighting(lamps: tuple[Lamp, ...], ambient: float) -> None:
    """Raise unless there are one or more lamps, and `ambient` is a part of 1."""
    if not isinstance(lamps, tuple) or not all(isinstance(lamp, Lamp) for lamp in lamps):
        raise TypeError(f"lamps must be a tuple of Lamp, got {lamps!r}")
    if not lamps:
        raise ValueError("lamps must be one or more, got none")
    if not 0 <= ambient <= 1:
        raise ValueError(f"ambient must lie between 0 and 1, got {ambient}")


def lamp_colors(lamps: tuple[Lamp, ...]) -> Array:
    """(n, 3) linear light."""
    return np.array([lamp.color for lamp in lamps])


def shade(normal: Array, lamps: tuple[Lamp, ...], ambient: float) -> Array:
    """(3,) light that white paint with a unit `normal` shows: ambient + Lambert."""
    facing = np.array([max(float(normal @ lamp.toward), 0) for lamp in lamps])
    colors = lamp_colors(lamps)
    return np.asarray(ambient * colors.mean(axis=0) + (1 - ambient) * facing @ colors)


def lit(paints: Array, lamps: tuple[Lamp, ...], ambient: float) -> Array:
    """(m, 3) colors that span all that `paints` (n, 3) can show under these lamps."""
    colors = lamp_colors(lamps)
    lights = colors.mean(axis=0, keepdims=True) if ambient == 1 else colors
    return (paints[:, None] * lights).reshape(-1, 3)

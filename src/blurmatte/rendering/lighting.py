"""Lamps, paints, and the colors that paints show under lamps.

Lamps are far away. Directions are (x, y, z) with x right, y down and z towards the camera, of any
length. Colors are linear light.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Floats
from blurmatte.color.model import ColorModel


@dataclass(frozen=True)
class Lamp:
    """Parallel light from one direction.

    Parameters
    ----------
    direction : (3,) float
        From the body towards the lamp.
    color : (3,) float
        Linear light that a white surface facing the lamp reflects.

    Raises
    ------
    ValueError
        If the direction is zero or not finite, or the color is black or negative.
    """

    direction: tuple[float, float, float] = (-0.45, -0.7, 0.55)
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        unit_direction("direction", self.direction)
        check_color("color", self.color)
        for name in ("direction", "color"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))

    @cached_property
    def toward(self) -> Array:
        """(3,) unit vector towards the lamp."""
        return unit_direction("direction", self.direction)

    @cached_property
    def halfway(self) -> Array:
        """(3,) unit vector halfway between lamp and camera; zeros for a lamp behind the body."""
        between = self.toward + np.array([0.0, 0, 1])
        length = np.linalg.norm(between)
        return np.asarray(between / length if length > 1e-9 else np.zeros(3))


def unit_direction(name: str, direction: Sequence[float] | Array) -> Array:
    """`direction` with length 1; ValueError unless it is (x, y, z) and not 0."""
    d = np.asarray(direction, dtype=float)
    if d.shape != (3,) or not np.all(np.isfinite(d)) or not np.linalg.norm(d) > 1e-9:
        raise ValueError(f"{name} must be a direction (x, y, z), got {direction}")
    return np.asarray(d / np.linalg.norm(d))


def check_lighting(lamps: object, ambient: float) -> None:
    """Raise TypeError or ValueError unless there are lamps and `ambient` is within 0…1."""
    if not isinstance(lamps, tuple) or not all(isinstance(lamp, Lamp) for lamp in lamps):
        raise TypeError(f"lamps must be a tuple of Lamp, got {lamps!r}")
    if not lamps:
        raise ValueError("lamps must be one or more, got none")
    if not 0 <= ambient <= 1:
        raise ValueError(f"ambient must lie between 0 and 1, got {ambient}")


def lamp_colors(lamps: tuple[Lamp, ...]) -> Array:
    """(n, 3) linear light of n lamps."""
    return np.array([lamp.color for lamp in lamps])


def shade(normal: Array, lamps: tuple[Lamp, ...], ambient: float) -> Array:
    """(3,) light reflected by white paint with a unit `normal`: ambient + Lambert."""
    facing = np.array([max(float(normal @ lamp.toward), 0) for lamp in lamps])
    colors = lamp_colors(lamps)
    return np.asarray(ambient * colors.mean(axis=0) + (1 - ambient) * facing @ colors)


def lit(paints: Array, lamps: tuple[Lamp, ...], ambient: float) -> Array:
    """(m, 3) colors that span every color of `paints` (n, 3) under these lamps."""
    colors = lamp_colors(lamps)
    lights = colors.mean(axis=0, keepdims=True) if ambient == 1 else colors
    return (paints[:, None] * lights).reshape(-1, 3)


def check_color(name: str, value: npt.ArrayLike) -> Array:
    """`value` as (3,) linear light; ValueError unless finite, not negative and not black."""
    color = np.array(value, dtype=float)
    if color.shape != (3,) or not np.all(np.isfinite(color) & (color >= 0)) or not color.any():
        raise ValueError(
            f"{name} must be three linear values, not negative and not all 0, got {value!r}"
        )
    return color


def true_model(colors: Array) -> ColorModel | None:
    """The line or plane spanned by colors (n, 3), known exactly; None if they span RGB.

    Distances up to 1e-6 of the brightest value count as rounding errors.
    """
    rank = int(np.linalg.matrix_rank(colors, tol=1e-6 * np.max(np.abs(colors))))
    return None if rank == 3 else ColorModel.from_samples(colors, rank, std=0)


def spanning(colors: Floats) -> Array:
    """At most three rows (k, 3) with the same span as colors (..., 3); they may be negative."""
    return np.asarray(np.linalg.qr(colors.reshape(-1, 3).astype(float), mode="r"))


def hex_codes(model: ColorModel | None) -> str:
    """The sRGB hex codes of a color model for people; "all colors" for None."""
    return "all colors" if model is None else " + ".join(model.hex)

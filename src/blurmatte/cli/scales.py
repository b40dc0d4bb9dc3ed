"""How large things are: meters per pixel, the true radius of a ball, the camera that saw them."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Annotated

import blurmatte as bm
from blurmatte.cli.console import option
from blurmatte.cli.quantities import length, numbers

SIZE = "True size and time"
LENGTH = "LENGTH[±ERROR]"
Quantity = tuple[float, float]  # a value and its error
Readout = Annotated[
    str | None,
    option("down|up|left|right", "Where the sensor's next row lies; else the file's.", SIZE),
]

_FAR_OFF_AXIS = 0.1  # of width and height, from the middle: no lens is mounted so


@dataclass(frozen=True)
class BallSize:
    """The true size of the object."""

    diameter: Annotated[str | None, option(LENGTH, "True diameter: 4cm, 40mm±0.2mm.", SIZE)] = None
    radius: Annotated[str | None, option(LENGTH, "Or its radius.", SIZE)] = None

    def __post_init__(self) -> None:
        if self.radius is not None and self.diameter is not None:
            raise ValueError("give one of --radius and --diameter, not both")
        self.true_radius  # noqa: B018  # refuses what is no length

    @property
    def true_radius(self) -> Quantity | None:
        """Radius and its error, meters; None if no size was given."""
        if self.radius is not None:
            return length("--radius", self.radius)
        if self.diameter is None:
            return None
        value, std = length("--diameter", self.diameter)
        return value / 2, std / 2


@dataclass(frozen=True)
class ScaleOptions(BallSize):
    """How large a pixel is where the object moved."""

    scale: Annotated[
        str | None,
        option("LENGTH|X0,Y0,X1,Y1=LENGTH", "Of a pixel, or between two points.", SIZE),
    ] = None

    def __post_init__(self) -> None:
        if sum(text is not None for text in (self.radius, self.diameter, self.scale)) > 1:
            raise ValueError("give one of --radius, --diameter and --scale")
        super().__post_init__()
        self.constant  # noqa: B018

    @property
    def constant(self) -> bm.Scale | None:
        """The scale that does not depend on what is measured."""
        if self.scale is None:
            return None
        place, equals, distance = self.scale.rpartition("=")
        if not equals:
            return bm.Scale(*length("--scale", self.scale))
        x0, y0, x1, y1 = numbers("--scale", place, "x0,y0,x1,y1=length")
        return bm.Scale.from_points((x0, y0), (x1, y1), *length("--scale", distance))

    def of_motion(self, motion: bm.Motion) -> bm.Scale | None:
        """Meters per pixel of what moved like that."""
        size = self.true_radius
        return self.constant if size is None else bm.Scale.from_radius(motion, *size)

    def of_radius(self, pixels: float, std: float) -> bm.Scale | None:
        """Meters per pixel of an object with this radius and its error in pixels."""
        size = self.true_radius
        if size is None:
            return self.constant
        true, true_std = size
        return bm.Scale(true / pixels, true / pixels * math.hypot(true_std / true, std / pixels))


def check_camera(lens: bm.Intrinsics, size: tuple[int, int]) -> None:
    """Check that it may be the camera of pictures of a size.

    Raises ValueError if it was calibrated with pictures of another size. Warns BlurmatteWarning if
    that is not known, and its axis is far from their middle.
    """
    lens.check_size(size)
    (x, y), axis = ((n - 1) / 2 for n in size), (lens.cx, lens.cy)
    off = abs(axis[0] - x) / size[0], abs(axis[1] - y) / size[1]
    if lens.size is None and max(off) > _FAR_OFF_AXIS:
        warnings.warn(
            "the camera's axis meets the picture at ({:.0f}, {:.0f}), far from its middle, ({:.0f}, "
            "{:.0f}): if it was calibrated with pictures of another size than {}x{}, all of space is "
            'wrong; calibrate with such, and say "size": [{}, {}] in its file'.format(
                *axis, x, y, *size, *size
            ),
            bm.BlurmatteWarning,
            stacklevel=2,
        )

"""Values as people type them: numbers, boxes, frames, and quantities with a unit and an error.

They say how large things are, too: meters per pixel, the true radius of a ball, the camera that saw
them.
"""

from __future__ import annotations

import math
import os
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import blurmatte as bm
from blurmatte.cli.console import option, optional

Direction: TypeAlias = Literal["right", "down", "left", "up"]  # in the picture

_PLAIN = r"\s*[-+]?(\d+\.?\d*|\.\d+)\s*"
_ROUNDING_S = 1e-3  # of times as people type them
_FRAME = r"\d*|\d+(\.\d*)?s"
_UNITS = {
    "length": {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0},  # meters
    "time": {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},  # seconds
    "speed": {"": 1.0, "m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704},  # meters per second
    "acceleration": {"": 1.0, "m/s2": 1.0, "m/s²": 1.0},
}
_LENGTH = "a length with its unit, like 4cm or 4cm±0.1mm"
_TIME = "a time with its unit or a fraction of a second, like 1/60, 4ms or 15us"
_NUMBER = r"([+-]?[\d.]+(?:e[+-]?\d+)?(?:/[\d.]+)?)\s*((?:[a-zµ][a-zµ/2²]*)?)"
SIZE = "True size and time"
LENGTH = "LENGTH[±ERROR]"
Quantity = tuple[float, float]  # a value and its error
Camera = Annotated[Path | None, option("FILE", "JSON of the calibrated camera.", SIZE)]
ExposureTime = Annotated[
    str | None,
    option("TIME[±ERROR]", "Exposure time: 1/60, 4ms; else the file's.", SIZE, "--exposure"),
]
LineTime = Annotated[
    str | None, option("TIME", "From row to row of a rolling shutter: 15us.", SIZE)
]
Readout = Annotated[
    str | None,
    option("down|up|left|right", "Where the sensor's next row lies; else the file's.", SIZE),
]

_FAR_OFF_AXIS = 0.1  # of width and height, from the middle: no lens is mounted so


def numbers(name: str, text: str, *forms: str) -> list[float]:
    """Numbers with commas between them, as many as one of `forms` has, like "x,y,radius"."""
    parts = text.split(",")
    counts = [form.count(",") + 1 for form in forms]
    if len(parts) not in counts or not all(re.fullmatch(_PLAIN, part) for part in parts):
        raise ValueError(f"{name} must be {' or '.join(forms)}, got {text!r}")
    return [float(part) for part in parts]


def check_count(name: str, count: int | None) -> None:
    """Raise ValueError for a number of things below 1."""
    if count is not None and count < 1:
        raise ValueError(f"{name} must be at least 1, got {count}")


def processes(wanted: int | None, count: int, least: int) -> int:
    """How many processes do so many things: one for each core, but one in all for less than `least`."""
    if wanted is None:
        wanted = (os.cpu_count() or 1) if count >= least else 1
    return max(min(wanted, count), 1)


def check_rate(rate: float | None) -> None:
    """Raise ValueError for a --rate that is none."""
    if rate is not None and not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"--rate must be frames per second, above 0, got {rate:g}")


def is_box(text: str) -> bool:
    """Whether this is x0,y0,x1,y1 in whole pixels."""
    return re.fullmatch(r"(\s*-?\d+\s*,){3}\s*-?\d+\s*", text) is not None


def box(name: str, text: str) -> tuple[int, int, int, int]:
    """A box of pixels; its last column and row are excluded."""
    if not is_box(text):
        raise ValueError(f"{name} must be x0,y0,x1,y1 in whole pixels, got {text!r}")
    x0, y0, x1, y1 = (int(part) for part in text.split(","))
    return x0, y0, x1, y1


def frame_range(
    name: str,
    text: str | None,
    times: Sequence[float] | None = (),
    known: Sequence[int] | None = None,
) -> slice:
    """Frames from START to STOP (excluded), every STEP-th: numbers, or seconds like 2.5s.

    text: START:STOP or START:STOP:STEP; parts may be left out.
    times: of all frames, seconds, in order.
    known: numbers of all frames, in order; None for 0, 1, …
    """
    if text is None:
        return slice(None)
    start, *more = text.split(":")
    stop, step = (*more, "", "")[:2]
    if not more or len(more) > 2 or not re.fullmatch(r"\d*", step):
        raise ValueError(
            f"{name} must be START:STOP or START:STOP:STEP, like 40:52 or 2.5s:4s, got {text!r}"
        )
    if step and int(step) < 1:
        raise ValueError(f"{name} must have a step of at least 1, got {text!r}")
    first, last = (_frame(name, part, times, known) for part in (start, stop))
    return slice(first, last, int(step) if step else None)


def _frame(
    name: str, text: str, times: Sequence[float] | None, known: Sequence[int] | None
) -> int | None:
    """Index of the first frame at or after a number or, with an s behind it, a time in seconds."""
    if not re.fullmatch(_FRAME, text):
        raise ValueError(
            f"{name} must have frames as a number like 120, or seconds like 4.5s, got {text!r}"
        )
    if not text.endswith("s"):
        number = int(text) if text else None
        return number if number is None or known is None else bisect_left(known, number)
    if times is None:
        raise ValueError(f"{name} must be frame numbers, for pictures have no times, got {text!r}")
    return bisect_left(times, float(text[:-1]) - _ROUNDING_S)


def number(text: str) -> float:
    """A number or a fraction like 1/60; ValueError if it is none, or not finite."""
    above, _, below = text.partition("/")
    value = float(above) / (float(below or 1) or math.nan)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is no number")
    return value


def meters(name: str, text: str) -> tuple[float, float]:
    """A place along an axis and its error, meters."""
    return _with_error(name, text, "length", "meters like 0.02, 2cm or 2cm±0.1mm", bare=True)


def length(name: str, text: str) -> tuple[float, float]:
    """A length, which is above 0, and its error, meters."""
    return _with_error(name, text, "length", _LENGTH, above_zero=True)


def time_of_exposure(name: str, text: str) -> tuple[float, float]:
    """A time that is above 0, and its error, seconds."""
    return _with_error(name, text, "time", _TIME, above_zero=True)


def time_of_line(name: str, text: str) -> float:
    """A time that may be 0, seconds."""
    value, _ = _with_error(name, text, "time", _TIME)
    if value < 0:
        raise ValueError(
            f"{name} must be 0 or more, got {text!r}; if rows are read from the bottom of the picture "
            "to its top, give --readout up"
        )
    return value


def direction(name: str, text: str | None) -> Direction | None:
    """A direction in the picture, if it is given."""
    match text:
        case None | "down" | "up" | "left" | "right":
            return text
    raise ValueError(f"{name} must be down, up, left or right, got {text!r}")


def meters_per_second(name: str, text: str) -> tuple[float, float]:
    """A speed and its error, m/s."""
    what = "a speed with its unit, like 12m/s, 43km/h or 12m/s±0.2m/s"
    return _with_error(name, text, "speed", what, above_zero=True)


def acceleration(name: str, text: str) -> tuple[list[float], float]:
    """A vector of one to three numbers, m/s², and the error of its size."""
    what = "9.81, x,y or x,y,z in m/s², like 9.81±0.01 or 0,9.7,1.2"
    parts = [_with_error(name, part, "acceleration", what, bare=True) for part in text.split(",")]
    if len(parts) > 3:
        raise ValueError(f"{name} must be {what}, got {text!r}")
    return [value for value, _ in parts], parts[-1][1]


def _with_error(
    name: str, text: str, kind: str, what: str, bare: bool = False, above_zero: bool = False
) -> tuple[float, float]:
    """Value and error, each a number or fraction with a unit.

    Only 0, a fraction of a second and, if `bare`, any number need no unit.
    """
    units, values = _UNITS[kind], []
    for part in text.replace("+-", "±").split("±"):
        found = re.fullmatch(_NUMBER, part.strip())
        if found is None or found[2] not in units:
            raise ValueError(f"{name} must be {what}, got {text!r}")
        try:
            value = number(found[1])
        except ValueError:
            raise ValueError(f"{name} must be {what}, got {text!r}") from None
        fraction = kind == "time" and "/" in found[1]
        if not (found[2] or bare or fraction or value == 0):
            raise ValueError(f"{name} must be {what}; {part.strip()!r} has no unit")
        values.append(units[found[2]] * value)
    if len(values) > 2:
        raise ValueError(f"{name} must be {what}, got {text!r}")
    if len(values) == 2 and values[1] < 0:
        raise ValueError(f"{name} must have an error of 0 or more, got {text!r}")
    if above_zero and not values[0] > 0:
        raise ValueError(f"{name} must be above 0, got {text!r}")
    return values[0], values[1] if len(values) == 2 else 0.0


@dataclass(frozen=True)
class BallSize:
    """The true size of the object."""

    diameter: str | None = optional(LENGTH, "True diameter: 4cm, 40mm±0.2mm.", SIZE)
    radius: str | None = optional(LENGTH, "Or its radius.", SIZE)

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

    scale: str | None = optional(
        "LENGTH|X0,Y0,X1,Y1=LENGTH", "Of a pixel, or between two points.", SIZE
    )

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

    def of_motion(self, motion: bm.motion.Motion) -> bm.Scale | None:
        """Meters per pixel of what moved like that."""
        size = self.true_radius
        return self.constant if size is None else bm.Scale.from_radius(motion, *size)


def check_camera(lens: bm.Intrinsics, size: tuple[int, int]) -> None:
    """Check that it may be the camera of pictures of a size.

    Raises ValueError if it was calibrated with pictures of another size. Warns BlurmatteWarning if
    that is not known, and its axis is far from their middle.
    """
    lens.check_size(size)
    (x, y), axis = ((n - 1) / 2 for n in size), (lens.cx, lens.cy)
    off = abs(axis[0] - x) / size[0], abs(axis[1] - y) / size[1]
    if lens.size is None and max(off) > _FAR_OFF_AXIS:
        bm.errors.warn(
            "the camera's axis meets the picture at ({:.0f}, {:.0f}), far from its middle, ({:.0f}, "
            "{:.0f}): if it was calibrated with pictures of another size than {}x{}, all of space is "
            'wrong; calibrate with such, and say "size": [{}, {}] in its file'.format(
                *axis, x, y, *size, *size
            )
        )

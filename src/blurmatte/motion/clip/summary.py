"""All frames of a clip together: the scale and the fall of each object, and the rows of its table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from blurmatte.errors import MotionError
from blurmatte.intrinsics import Intrinsics
from blurmatte.motion.clip.detections import FrameMotion
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.fall_fit import fit_fall, fit_fall_in_space
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.clip.speed import (
    Uncertain,
    mean_speed,
    median_radius,
    path_length,
    path_length_in_space,
)
from blurmatte.motion.picture.motion import Scale

Places = Sequence[BallPlace | None]


@dataclass(frozen=True)
class KnownQuantities:
    """What is known of a clip besides its pictures.

    Parameters
    ----------
    scale : Scale, optional
        Of a pixel, the same in all frames.
    radius : (float, float), optional
        True radius of the object and its error, meters.
    lens : Intrinsics, optional
        Of the camera: the object is a ball in space.
    gravity : (float or list of float, float), optional
        A number (down; in space its size) or a vector, m/s², and the error of its size.
    exposure : (float, float), optional
        Exposure time and its error, seconds.
    line_time : float
        Of a rolling shutter, seconds.
    place_std : (float, float)
        Error in x and y that all places share, pixels.
    radius_std : float
        Of all radii by a transfer curve that is not stated, relative.
    """

    scale: Scale | None = None
    radius: Uncertain | None = None
    lens: Intrinsics | None = None
    gravity: tuple[float | list[float], float] | None = None
    exposure: Uncertain | None = None
    line_time: float = 0.0
    place_std: Uncertain = (0.0, 0.0)
    radius_std: float = 0.0

    def scale_of(self, rows: Sequence[FrameMotion]) -> Scale | None:
        """Meters per pixel of the object in these rows; None if unknown, or in space.

        Raises
        ------
        MotionError
            If it should follow from the radius, and the object was not found.
        """
        if self.lens is not None or self.radius is None:
            return None if self.lens is not None else self.scale
        (pixels, std), (true, true_std) = median_radius(rows), self.radius
        std = math.hypot(std, self.radius_std * pixels)
        relative = math.hypot(true_std / true, std / pixels)
        return Scale(true / pixels, true / pixels * relative)


@dataclass(frozen=True, eq=False)
class ObjectSummary:
    """What all frames of one object say.

    Parameters
    ----------
    number : int
        Of the object.
    rows : sequence of FrameMotion
    places : sequence of BallPlace or None, optional
        In space, one for each row.
    known : KnownQuantities
    scale : Scale or None
        Of all its frames, if there is one.
    fall : FreeFall or None
    no_scale, no_fall, no_gravity : str
        Why there is no scale or fall, or why gravity was not used; "" otherwise.
    """

    number: int
    rows: Sequence[FrameMotion]
    places: Places | None
    known: KnownQuantities
    scale: Scale | None = None
    fall: FreeFall | None = None
    no_scale: str = ""
    no_fall: str = ""
    no_gravity: str = ""

    @classmethod
    def of(
        cls,
        number: int,
        rows: Sequence[FrameMotion],
        places: Places | None,
        known: KnownQuantities,
    ) -> ObjectSummary:
        """The summary of the rows of one object; MotionError as `scale_of`."""
        scale, reason = known.scale_of(rows), ""
        each = cls(number, rows, places, known, scale)
        if known.gravity is not None:
            try:
                return each.falling(known)
            except MotionError as error:
                reason = str(error)
        try:
            return replace(each.falling(replace(known, gravity=None)), no_gravity=reason)
        except MotionError as error:
            return replace(each, no_fall=str(error), no_gravity=reason)

    def falling(self, known: KnownQuantities) -> ObjectSummary:
        """The same with the fall, and the scale that follows from it."""
        gravity, std = known.gravity or (None, 0.0)
        if self.places is not None:
            return replace(self, fall=fit_fall_in_space(self.places, None, gravity, std))
        fall = fit_fall(self.rows, self.scale, gravity, std, known.line_time)
        return replace(self, fall=fall, scale=fall.scale)


def summaries(
    rows: Sequence[FrameMotion], places: Places | None, several: bool, known: KnownQuantities
) -> list[ObjectSummary]:
    """Of the one object of a clip, or of each; the scale is that of its own place.

    Raises
    ------
    MotionError
        If the scale should follow from the radius of the only object, and it was not found.
    """
    if not several:
        return [ObjectSummary.of(1, rows, places, known)]
    found = []
    for number in sorted({row.object for row in rows if row.object is not None}):
        of = [k for k, row in enumerate(rows) if row.object == number]
        mine, there = [rows[k] for k in of], None if places is None else [places[k] for k in of]
        try:
            found.append(ObjectSummary.of(number, mine, there, known))
        except MotionError as error:
            unscaled = replace(known, scale=None, radius=None, gravity=None)
            one = ObjectSummary.of(number, mine, there, unscaled)
            found.append(replace(one, no_scale=str(error)))
    return found


def clip_table(
    rows: Sequence[FrameMotion],
    places: Places | None,
    found: Sequence[ObjectSummary],
    known: KnownQuantities,
) -> list[dict[str, Any]]:
    """All numbers of each frame, with the speed in the best unit that is known."""
    scales = {one.number: one.scale for one in found}
    lines = []
    for k, row in enumerate(rows):
        numbers = row.numbers()
        for name, std in zip(("x_std", "y_std"), known.place_std, strict=True):
            if numbers[name] is not None:
                numbers[name] = math.hypot(numbers[name], std)
        if places is None or known.lens is None:
            scale = scales.get(row.object or 1)
            unit, moved = "px" if scale is None else "m", path_length(row.sighting, scale)
        else:
            ball = places[k]
            unit, moved = "m", path_length_in_space(ball, row.sighting, known.lens)
            numbers |= dict.fromkeys(BallPlace.names) if ball is None else ball.numbers()
        unit += "/exposure" if known.exposure is None else "/s"
        speed = mean_speed(row, moved, known.exposure, known.line_time) or (None, None)
        names = "speed", "speed_std", "speed_unit"
        lines.append(numbers | dict(zip(names, (*speed, unit), strict=True)))
    return lines

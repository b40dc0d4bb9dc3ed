"""Rows of the tables of a solved clip, FrameRecord, and of a solved row of pictures, PictureRecord."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from operator import attrgetter
from typing import Any

from blurmatte.checks import Box
from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution
from blurmatte.motion.clip.detections import FrameMotion
from blurmatte.motion.columns import Column, TableRow
from blurmatte.motion.picture.measure import measure_motion


@dataclass(frozen=True)
class FrameRecord(TableRow):
    """What was written for an object in one frame, or why nothing was.

    Parameters
    ----------
    frame : int
        Its number: in the name of a picture, in a clip from 0.
    time : float or None
        Presentation time, seconds.
    object : int
        Number of the object, from 1.
    shot : int
        Number of the shot, from 1.
    x, y, radius, radius_std, length : float or None
        Mean place, radius and length of the path of the solution, pixels, as `measure_motion` gives
        them and as the sheet shows them; None if nothing can be measured.
    sum_alpha, sum_alpha_std : float or None
        Pixels.
    color : str
        That names the object, `ColorModel.color`.
    grade : str
        Of the solution; "" if there is none.
    alpha_error : float or None
        Its calibrated error of alpha.
    box : (x0, y0, x1, y1) or None
        Of the layer, pixels.
    layer : str
        Name of its file, in the folder of results.
    reason : str
        Why there is no layer.
    doubts : str
        Why these numbers may be wrong.

    Examples
    --------
    >>> record = bm.clips.FrameRecord.of(rows[0], 1, solution, "layer.000000.exr")
    >>> record.frame, record.grade, round(record.sum_alpha)
    (0, 'confirmed', 314)
    """

    frame: int
    time: float | None
    object: int
    shot: int
    x: float | None = None
    y: float | None = None
    radius: float | None = None
    radius_std: float | None = None
    length: float | None = None
    sum_alpha: float | None = None
    sum_alpha_std: float | None = None
    color: str = ""
    grade: str = ""
    alpha_error: float | None = None
    box: Box | None = None
    layer: str = ""
    reason: str = ""
    doubts: str = ""

    @classmethod
    def of(cls, row: FrameMotion, shot: int, solution: Solution, layer: str) -> FrameRecord:
        """The record of a solution, and of the row that it measures (`as_solved`)."""
        inside, whole, shape = solution.streak & solution.known, solution.layer, dict[str, Any]()
        if (seen := row.sighting) is not None:
            (x, y), motion = seen.motion.center.tolist(), seen.motion
            shape = {"x": x, "y": y, "length": motion.length}
            shape |= {"radius": motion.radius, "radius_std": motion.radius_std}
        return cls(
            row.frame,
            row.time,
            row.object or 1,
            shot,
            **shape,
            sum_alpha=float(solution.alpha[inside].sum(dtype=float)),
            sum_alpha_std=solution.stats.sum_alpha_std,
            color=solution.model.color,
            grade=str(solution.grade),
            alpha_error=solution.stats.alpha_error,
            box=None if whole.empty else whole.box,
            layer=layer,
            doubts=row.reason if seen is None else " ".join(seen.doubts),
        )

    @property
    def columns(self) -> Sequence[Column[FrameRecord]]:
        """The columns of its table."""
        return FRAME_COLUMNS


@dataclass(frozen=True)
class PictureRecord(TableRow):
    """What was found in one picture of a row, or why nothing was.

    Parameters
    ----------
    picture : str
        Its file, as it was given.
    folder : str
        Of its results, in that of the row; "" if it was refused.
    grade : str
        Of the solution; "" if it has none.
    alpha_error : float or None
        Its calibrated error of alpha.
    sum_alpha, sum_alpha_std : float or None
        Pixels.
    radius, radius_std, length, length_std : float or None
        Of the object and of its path, pixels; None if nothing can be measured.
    angle, angle_std : float or None
        Direction of the motion, degrees, as `measure_motion` gives it.
    color : str
        That names the object, `ColorModel.color`.
    reason : str
        Why it was refused.
    """

    picture: str = ""
    folder: str = ""
    grade: str = ""
    alpha_error: float | None = None
    sum_alpha: float | None = None
    sum_alpha_std: float | None = None
    radius: float | None = None
    radius_std: float | None = None
    length: float | None = None
    length_std: float | None = None
    angle: float | None = None
    angle_std: float | None = None
    color: str = ""
    reason: str = ""

    @classmethod
    def of(cls, solution: Solution) -> PictureRecord:
        """The record of a solution, without the names of files."""
        stats = solution.stats
        record = cls(
            grade=str(stats.grade or ""),
            alpha_error=stats.alpha_error,
            sum_alpha=stats.sum_alpha,
            sum_alpha_std=stats.sum_alpha_std,
            color=solution.model.color,
        )
        try:
            motion = measure_motion(solution)
        except MotionError:  # alpha may be nothing, or unknown everywhere
            return record
        names = ("radius", "radius_std", "length", "length_std")
        found: dict[str, Any] = {name: float(getattr(motion, name)) for name in names}
        found |= {name: math.degrees(getattr(motion, name)) for name in ("angle", "angle_std")}
        return replace(record, **{name: x for name, x in found.items() if math.isfinite(x)})

    @property
    def columns(self) -> Sequence[Column[PictureRecord]]:
        """The columns of its table."""
        return PICTURE_COLUMNS


_PIXELS = dict.fromkeys(
    ("x", "y", "radius", "radius_std", "length", "length_std", "sum_alpha", "sum_alpha_std"), "px"
)


def _columns(names: Iterable[str], **units: str) -> Iterator[Column[Any]]:
    """Columns of the fields of a record, in order, with their units."""
    known = _PIXELS | units
    return (Column(name, known.get(name, ""), attrgetter(name)) for name in names)


def _edge(k: int, record: FrameRecord) -> int | None:
    """One of the four edges of the box of a layer, if there is one."""
    return None if record.box is None else record.box[k]


FRAME_COLUMNS: tuple[Column[FrameRecord], ...] = (
    *_columns((one.name for one in fields(FrameRecord) if one.name != "box"), time="s"),
    *(Column(name, "px", partial(_edge, k)) for k, name in enumerate(("x0", "y0", "x1", "y1"))),
)
PICTURE_COLUMNS: tuple[Column[PictureRecord], ...] = (
    *_columns((one.name for one in fields(PictureRecord)), angle="°", angle_std="°"),
)

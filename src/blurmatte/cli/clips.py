"""The object in every frame of a clip, and how an interrupted run is resumed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import blurmatte as bm
from blurmatte.cli.console import about, complain, waiting, with_progress
from blurmatte.cli.quantities import Direction

Places: TypeAlias = "Sequence[bm.motion.BallPlace | None]"
Record: TypeAlias = "Callable[[bm.motion.FrameSightings], None]"

_MIN_FRAMES_TO_PARALLELIZE = 16  # below, starting processes takes longer than they save


@dataclass(frozen=True, eq=False)
class KnownBall:
    """A ball of known radius before a calibrated camera."""

    lens: bm.Intrinsics
    radius: tuple[float, float]  # true radius and its error, meters
    line_time: float  # of a rolling shutter, seconds

    def places(
        self,
        frames: bm.Frames[bm.LinearImage],
        plate: bm.LinearImage,
        rows: Sequence[bm.motion.FrameMotion],
        model: bm.ColorModel,
        workers: bm.Workers,
    ) -> Places:
        """Where it was in space in each row."""
        fits = bm.motion.fit_balls(
            frames, plate, rows, model, self.lens, *self.radius, workers=workers
        )
        balls = list(with_progress(fits, "fitting the ball in space", len(rows)))
        return bm.motion.places_in_space(
            rows, self.lens, *self.radius, balls=balls, line_time=self.line_time
        )

    def moved(
        self, ball: bm.motion.BallPlace | None, seen: bm.motion.Sighting | None
    ) -> tuple[float, float] | None:
        """Path length within the exposure and its error, meters; of a disc parallel to the picture."""
        from blurmatte.motion.clip.speed import path_length_in_space

        return path_length_in_space(ball, seen, self.lens)


@dataclass(frozen=True)
class ClipTask:
    """What is measured in the frames of a clip."""

    source: Path  # the clip, for messages
    color: str | None  # HEX, FILE.json or any; None: found in some of the frames
    several: bool  # whether all objects of the color are followed
    min_frames: int  # of these objects: in how many frames each is seen at least
    rate: float | None  # frames per second, if the clip does not say
    workers: int | None  # number of processes; None: one for each core
    out: Path | None  # the table; finished frames are kept next to it
    inputs: tuple[Path, ...]  # files whose contents must be equal to resume
    settings: dict[str, Any]  # of the reading, which must be equal too
    ball: KnownBall | None = None
    # Where the next row of the sensor lies; None: as the file says
    readout: Direction | None = None
    by_size: bool = False  # whether the scale follows from the radius in pixels

    @property
    def unfinished(self) -> Path | None:
        """Where finished frames are kept until the table is whole."""
        return None if self.out is None else self.out.with_name(f"{self.out.name}.unfinished")

    @contextmanager
    def recorded(self) -> Iterator[tuple[list[bm.motion.FrameSightings], Record]]:
        """What an interrupted run with the same inputs and settings has measured; what records more."""
        from blurmatte.clips.manifest import Finished, Manifest, key_of, opened_manifest

        opened: AbstractContextManager[Manifest[Finished]] = nullcontext(Manifest())
        if self.unfinished is not None:
            same = {"color": self.color, "several": self.several, "rate": self.rate}
            key = key_of(self.inputs, same | self.settings)
            opened = opened_manifest(self.unfinished, key, Finished)
        with opened as manifest:
            seen = [one.seen for one in manifest.finished if one.seen is not None]
            try:
                yield seen, lambda frame: manifest.append(Finished(1, seen=frame))
            except BaseException:
                if manifest.finished and self.unfinished is not None:
                    complain(f"{self.unfinished}: keeps the finished frames; run the same again")
                raise


@dataclass(frozen=True, eq=False)
class ClipMeasurement:
    """What the frames show: the plate, the object's color, where it was, and in space if asked.

    `place_std` is the error in x and y that all places share, pixels; `radius_std` that of all radii by
    a transfer curve that is not known, relative.
    """

    plate: bm.LinearImage
    model: bm.ColorModel
    rows: list[bm.motion.FrameMotion]
    places: Places | None
    place_std: tuple[float, float]
    radius_std: float = 0.0


def measure_frames(
    task: ClipTask, frames: bm.Frames[bm.LinearImage], plate: bm.LinearImage | None
) -> ClipMeasurement:
    """The object in each frame; the plate is made of them if none is given."""
    from blurmatte.motion.clip.color import seen_color
    from blurmatte.motion.clip.steps import ClipInputs, measured
    from blurmatte.motion.clip.transfer_spread import radius_spread
    from blurmatte.motion.clip.workers import return_freed_memory

    model, count = _given_color(task.color), task.workers
    if count is None:
        count = 1 if len(frames) < _MIN_FRAMES_TO_PARALLELIZE else os.cpu_count() or 1
    return_freed_memory()
    # Processes start while the plate is made.
    with (
        task.recorded() as (old, record),
        about(task.source),
        bm.Workers(max(min(count, len(frames)), 1)) as workers,
        waiting("reading the clip"),
    ):
        frames = frames.for_plate(plate)
        clip = ClipInputs(
            *(frames, plate, model, task.several),
            rate=task.rate,
            min_frames=task.min_frames,
            finished=old,
        )
        for event in measured(clip, workers):
            if isinstance(event, bm.motion.FrameSightings):
                record(event)
            else:
                plate, rows, model = event.plate, event.rows, event.model
        assert plate is not None
        assert model is not None
        if task.readout is not None:
            rows = [_read_out(row, task.readout) for row in rows]
        places = None
        if task.ball is not None:
            places = task.ball.places(frames, plate, rows, model, workers)
    spread = 0.0
    if frames.curve_assumed and task.by_size:
        with waiting("comparing transfer curves"):
            spread = radius_spread(frames, plate, rows, frames.frame_numbers)
    if model.rank < 3 or not task.several:  # else objects may have different colors
        model = seen_color(model, rows)
    return ClipMeasurement(plate, model, rows, places, frames.place_std, spread)


def remove_unfinished(task: ClipTask) -> None:
    """Remove the kept frames; the table is written."""
    if task.unfinished is not None:
        task.unfinished.unlink(missing_ok=True)


def _given_color(text: str | None) -> bm.ColorModel | None:
    """The color model of --color; None: it is to be found."""
    if text is None:
        return None
    if text.lower().endswith(".json"):
        return bm.read_color_model(text)
    if text == "any":
        return bm.ColorModel.any()
    return bm.ColorModel.from_hex(text)


def _read_out(row: bm.motion.FrameMotion, readout: Direction) -> bm.motion.FrameMotion:
    """The row of a camera whose next row lies in this direction."""
    if row.sighting is None:
        return row
    return replace(
        row,
        sighting=replace(row.sighting, measured=replace(row.sighting.measured, readout=readout)),
    )

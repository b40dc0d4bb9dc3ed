"""The object in every frame of a clip, and how an interrupted run is resumed."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

import blurmatte as bm
from blurmatte.cli.console import NamedError, about, complain, waiting, with_progress

Places: TypeAlias = "Sequence[bm.BallPlace | None]"

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
        rows: Sequence[bm.FrameMotion],
        model: bm.ColorModel,
        workers: bm.Workers,
    ) -> Places:
        """Where it was in space in each row."""
        fits = bm.fit_balls(frames, plate, rows, model, self.lens, *self.radius, workers=workers)
        balls = list(with_progress(fits, "fitting the ball in space", len(rows)))
        return bm.places_in_space(
            rows, self.lens, *self.radius, balls=balls, line_time=self.line_time
        )

    def moved(
        self, ball: bm.BallPlace | None, seen: bm.Sighting | None
    ) -> tuple[float, float] | None:
        """Path length within the exposure and its error, meters; of a disc parallel to the picture."""
        if ball is None or seen is None:
            return None
        if ball.length is not None and ball.length_std is not None:
            return ball.length, ball.length_std
        pixel = ball.distance / float(self.lens.magnification(seen.place))
        from_distance = seen.length * ball.distance_std / ball.distance
        return pixel * seen.length, pixel * math.hypot(seen.length_std, from_distance)


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
    resume: bool  # whether an interrupted run is continued
    same: dict[str, Any]  # settings that must be equal to resume
    ball: KnownBall | None = None

    @property
    def unfinished(self) -> Path | None:
        """Where finished frames are kept until the table is whole."""
        return None if self.out is None else self.out.with_name(f"{self.out.name}.unfinished")

    @property
    def head(self) -> dict[str, Any]:
        """First line of that file."""
        kept = {"blurmatte": bm.__version__, "clip": str(self.source), "color": self.color}
        return {**kept, "several": self.several, **self.same}


@dataclass(frozen=True, eq=False)
class Measured:
    """What the frames show: the plate, the object's color, where it was, and in space if asked.

    `place_std` is the error in x and y that all places share, pixels.
    """

    plate: bm.LinearImage
    model: bm.ColorModel
    rows: list[bm.FrameMotion]
    places: Places | None
    place_std: tuple[float, float]


def measure_frames(
    task: ClipTask, frames: bm.Frames[bm.LinearImage], plate: bm.LinearImage | None
) -> Measured:
    """The object in each frame; the plate is made of them if none is given."""
    from blurmatte.motion.clip.color import color_in_scene
    from blurmatte.motion.clip.measure import scene_of, sightings_in_scene
    from blurmatte.motion.clip.scene import clip_plate
    from blurmatte.motion.clip.workers import return_freed_memory

    model, journal = _given_color(task.color), _journal(task)
    count = task.workers
    if count is None:
        count = 1 if len(frames) < _MIN_FRAMES_TO_PARALLELIZE else os.cpu_count() or 1
    return_freed_memory()
    # Processes start while the plate is made.
    with about(task.source), bm.Workers(max(min(count, len(frames)), 1)) as workers:
        frames = frames.for_plate(plate)
        if plate is None:
            with waiting("making the plate"):
                plate = clip_plate(frames)
        scene = scene_of(frames, plate, model)
        if model is None:
            with waiting("finding the color"):
                model = color_in_scene(frames, scene, workers)
        seen = sightings_in_scene(
            frames,
            scene,
            model,
            workers,
            several=task.several,
            numbers=frames.frame_numbers,
            rate=task.rate,
            skip=len(journal.frames),
        )
        new = with_progress(seen, "measuring", len(frames) - len(journal.frames))
        kept = _kept(task, journal, new)
        rows = bm.link_objects(kept, task.min_frames) if task.several else bm.link_sightings(kept)
        places = None
        if task.ball is not None:
            places = task.ball.places(frames, plate, rows, model, workers)
    return Measured(plate, model, rows, places, frames.place_std)


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


@dataclass(frozen=True)
class _Journal:
    """What an interrupted run left: finished frames, and how many bytes of its file hold them."""

    frames: Sequence[bm.FrameSightings] = ()
    size: int = 0


def _journal(task: ClipTask) -> _Journal:
    """The frames of an interrupted run, up to the first line that is damaged or was cut off."""
    path = task.unfinished
    if path is None or not path.exists():
        return _Journal()
    try:
        lines = path.read_bytes().splitlines(keepends=True)
    except OSError as error:
        raise NamedError(f"{path}: delete it, for it cannot be read ({error.strerror})") from error
    heads, frames, size = list[Any](), list[bm.FrameSightings](), 0
    with suppress(AttributeError, KeyError, RecursionError, TypeError, ValueError):
        for line in lines:
            if not line.endswith(b"\n"):
                break
            if heads:
                frames.append(_frame(line.decode()))
            else:
                heads.append(json.loads(line))
            size += len(line)
    if not frames:
        return _Journal()  # it holds nothing to continue with
    if not task.resume:
        raise NamedError(f"{path}: add --resume to continue the interrupted run, or delete it")
    if heads != [json.loads(json.dumps(task.head))]:
        raise NamedError(f"{path}: was begun with other options; give the same, or delete it")
    return _Journal(frames, size)


def _frame(line: str) -> bm.FrameSightings:
    """A frame of a journal; ValueError for another content."""
    from blurmatte.files.documents import parse_json

    frame: bm.FrameSightings = parse_json(line, bm.FrameSightings)
    for one in frame.found:
        if not abs(one.xy_covariance) <= 1.001 * one.x_std * one.y_std:
            raise ValueError("a covariance must not exceed the standard deviations")
    return frame


def _kept(
    task: ClipTask, old: _Journal, new: Iterator[bm.FrameSightings]
) -> Iterator[bm.FrameSightings]:
    """All frames; each new one is appended to the file of unfinished runs at once."""
    path = task.unfinished
    yield from old.frames
    if path is None:
        yield from new
        return
    count = 0
    try:
        for count, frame in enumerate(new, 1):
            _append(path, frame, task.head, old.size if count == 1 else None)
            yield frame
    except BaseException:
        if count or old.frames:
            complain(f"{path}: keeps the finished frames; add --resume to continue")
        raise


def _append(path: Path, frame: bm.FrameSightings, head: Any, size: int | None) -> None:
    """Append a line; before the first of a run, the file is cut to `size`, or begun if that is 0."""
    lines = [json.dumps(asdict(frame))]
    if size == 0:
        lines.insert(0, json.dumps(head))
    with path.open("ab", buffering=0) as file:
        if size is not None:
            file.truncate(size)
        file.write("".join(f"{line}\n" for line in lines).encode())

"""What `measure` does with a clip: the object in every frame, and going on after a break."""

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import blurmatte as bm
from blurmatte.cli.flights import KnownBall, Places
from blurmatte.cli.inputs import Files
from blurmatte.cli.plates import frame_number
from blurmatte.cli.printing import complain
from blurmatte.cli.program import NamedError, about, with_progress
from blurmatte.cli.space import check_camera
from blurmatte.cli.targets import check_file
from blurmatte.motion.picture.motion import MAX_READOUT as LASTS

_TABLES = ".csv", ".json", ".parquet"
_LEAST = 3  # frames of an object, if not told
_FEW = 16  # frames for which more processes do not pay


@dataclass(frozen=True)
class ClipTask:
    """What the options of `measure` say about a clip."""

    source: Path
    files: Files
    plate: Path | None
    color: str | None
    several: bool
    least: int | None
    start: str | None
    stop: str | None
    step: int
    rate: float | None
    workers: int | None
    out: Path | None
    resume: bool
    ball: KnownBall | None = None
    exposure: float | None = None  # seconds
    line_time: float = 0.0  # seconds

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"--step must be at least 1, got {self.step}")
        if self.least is not None and not self.several:
            raise ValueError("--least is for --several objects")
        if self.least is not None and self.least < 1:
            raise ValueError(f"--least must be at least 1, got {self.least}")
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0):
            raise ValueError(f"--rate must be frames per second, above 0, got {self.rate:g}")
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")
        check_file(self.out, "a table", *_TABLES)
        if self.resume and self.out is None:
            raise ValueError("--resume goes on with the table that --out names")

    @property
    def begun(self) -> Path | None:
        """Where the frames that are done are kept until the table is whole."""
        return None if self.out is None else self.out.with_name(f"{self.out.name}.unfinished")

    @property
    def asked(self) -> dict[str, Any]:
        """What must be the same to go on."""
        return {
            "blurmatte": bm.__version__,
            "clip": str(self.source),
            "plate": None if self.plate is None else str(self.plate),
            "color": self.color,
            "several": self.several,
            "frames": [self.start, self.stop, self.step, self.rate],
            "transfer": self.files.transfer,
        }


@dataclass(frozen=True, eq=False)
class Measured:
    """What the frames show: the plate, the object's color, where it was, and in space if asked."""

    plate: bm.LinearImage
    model: bm.ColorModel
    rows: list[bm.FrameMotion]
    places: Places | None


def measure_frames(task: ClipTask) -> Measured:
    """The object in each frame."""
    given, done = _given_color(task.color), _done(task)
    with about(task.source):
        frames = bm.read_frames(str(task.source), task.files.curve, task.files.max_pixels)
        first, last = (frame_number(text, frames.rate) for text in (task.start, task.stop))
        frames = frames[first : last : task.step]
        if len(frames) == 0:
            raise ValueError("there are no such frames; look at --start and --stop")
        _check_times(task, frames.rate, frames.size[1])
        if task.ball is not None:
            check_camera(task.ball.lens, frames.size)
    plate = _plate(task, frames)
    count = task.workers
    if count is None:
        count = 1 if len(frames) < _FEW else os.cpu_count() or 1
    with about(task.source), bm.Workers(min(count, len(frames))) as workers:
        model = given or bm.clip_color(frames, plate, workers)
        rows = _rows(task, frames, plate, model, done, workers)
        if task.ball is None:
            return Measured(plate, model, rows, None)
        return Measured(plate, model, rows, task.ball.places(frames, plate, rows, model, workers))


def _check_times(task: ClipTask, rate: float | None, rows: int) -> None:
    """ValueError if exposing a frame, or reading its rows, would take longer than it lasts."""
    rate = task.rate or rate
    if rate is None:
        return
    if task.line_time * rows * rate > LASTS:
        raise ValueError(
            f"a line time of {task.line_time:g} s is {task.line_time * rows:.3g} s for {rows} rows, "
            f"and a frame lasts {1 / rate:.3g} s: give --line-time with its unit, like 15us, or the "
            "true --rate of the frames"
        )
    if task.exposure is not None and task.exposure * rate > LASTS:
        raise ValueError(
            f"an exposure of {task.exposure:g} s is longer than a frame lasts, {1 / rate:.3g} s: give "
            "--exposure with its unit, like 4ms, or the true --rate of the frames"
        )


def _rows(
    task: ClipTask,
    frames: bm.Frames[bm.LinearImage],
    plate: bm.LinearImage,
    model: bm.ColorModel,
    done: Sequence[bm.FrameSightings],
    workers: bm.Workers,
) -> list[bm.FrameMotion]:
    """Each frame by itself, as far as that is not done, then all of them joined."""
    seen = bm.sightings(
        frames,
        plate,
        model,
        several=task.several,
        numbers=frames.numbers,
        rate=task.rate,
        skip=len(done),
        workers=workers,
    )
    kept = _kept(task, done, with_progress(seen, "measuring", len(frames) - len(done)))
    if task.several:
        return bm.link_objects(kept, task.least or _LEAST)
    return bm.link_sightings(kept)


def finish(task: ClipTask) -> None:
    """The table is written; what it was made of is not needed any more."""
    if task.begun is not None:
        task.begun.unlink(missing_ok=True)


def _plate(task: ClipTask, frames: bm.Frames[bm.LinearImage]) -> bm.LinearImage:
    if task.plate is not None:
        return task.files.read(task.plate)[0]
    with about(task.source):
        return bm.make_plate(frames).plate


def _given_color(text: str | None) -> bm.ColorModel | None:
    """What --color says; None: the frames must tell."""
    if text is None:
        return None
    if text.lower().endswith(".json"):
        return bm.read_color_model(text)
    if text == "any":
        return bm.ColorModel.any()
    return bm.ColorModel.from_hex(text)


def _done(task: ClipTask) -> list[bm.FrameSightings]:
    """The frames that an interrupted run has left."""
    path = task.begun
    if path is None or not path.exists():
        return []
    if not task.resume:
        raise NamedError(f"{path}: an interrupted run left it; go on with --resume, or delete it")
    try:
        # The last line may have been cut off.
        lines = path.read_text(encoding="utf-8").rpartition("\n")[0].splitlines()
        head, *frames = map(json.loads, lines)
    except (OSError, ValueError) as error:
        raise NamedError(f"{path}: cannot be gone on with ({error}); delete it") from error
    if head != task.asked:
        raise NamedError(f"{path}: was begun with other options; give the same, or delete it")
    return [_frame(frame) for frame in frames]


def _frame(told: dict[str, Any]) -> bm.FrameSightings:
    found = tuple(bm.Sighting(**one) for one in told.pop("found"))
    return bm.FrameSightings(found=found, **told)


def _kept(
    task: ClipTask, done: Sequence[bm.FrameSightings], new: Iterator[bm.FrameSightings]
) -> Iterator[bm.FrameSightings]:
    """All frames, each written down as soon as it is done."""
    if task.begun is None:
        yield from new
        return
    with task.begun.open("w", encoding="utf-8", newline="\n") as file:
        file.write(json.dumps(task.asked) + "\n")
        file.writelines(json.dumps(asdict(frame)) + "\n" for frame in done)
        yield from done
        try:
            for frame in new:
                file.write(json.dumps(asdict(frame)) + "\n")
                file.flush()
                yield frame
        except KeyboardInterrupt:
            complain(f"{task.begun}: keeps the frames that are done; go on with --resume")
            raise

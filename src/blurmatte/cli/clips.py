"""What `measure` does with a clip: the object in every frame, as a table."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import blurmatte as bm
from blurmatte.cli.inputs import Files
from blurmatte.cli.plates import frame_number
from blurmatte.cli.printing import in_degrees
from blurmatte.cli.program import NamedError, about, with_progress

Rows = Sequence[bm.FrameMotion]
Scaling = Callable[[Rows], bm.Scale]
Gravity = tuple[float | list[float], float]

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

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"--step must be at least 1, got {self.step}")
        if self.least is not None and not self.several:
            raise ValueError("--least is for --several objects")
        if self.least is not None and self.least < 1:
            raise ValueError(f"--least must be at least 1, got {self.least}")
        if self.out is not None and self.out.suffix.lower() not in _TABLES:
            raise ValueError(f"--out must end with {', '.join(_TABLES)}, got {self.out}")
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


def measure_frames(task: ClipTask) -> tuple[bm.LinearImage, bm.ColorModel, list[bm.FrameMotion]]:
    """The plate, the object's color, and where it was in each frame."""
    done = _done(task)
    with about(task.source):
        frames = bm.read_frames(str(task.source), task.files.curve, task.files.max_pixels)
        first, last = (frame_number(text, frames.rate) for text in (task.start, task.stop))
        frames = frames[first : last : task.step]
        if len(frames) == 0:
            raise ValueError("there are no such frames; look at --start and --stop")
    plate = _plate(task, frames)
    count = task.workers
    if count is None:
        count = 1 if len(frames) < _FEW else os.cpu_count() or 1
    with about(task.source), bm.Workers(count) as workers:
        model = _color(task, frames, plate, workers)
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
        if not task.several:
            return plate, model, bm.link_sightings(kept)
        return plate, model, bm.link_objects(kept, task.least or _LEAST)


def finish(task: ClipTask) -> None:
    """The table is written; what it was made of is not needed any more."""
    if task.begun is not None:
        task.begun.unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class Told:
    """What the frames of one object say of it, together."""

    number: int
    words: list[str]
    fall: bm.FreeFall | None
    scale: bm.Scale | None


def told_of(
    task: ClipTask, rows: Rows, scaled: Scaling | None, gravity: Gravity | None
) -> list[Told]:
    """Of the one object of a clip, or of each that was found; the scale is that of its own place.

    Raises
    ------
    MotionError
        If there is one object alone, and its size, that is to give the scale, does not.
    """
    if not task.several:
        return [_told(1, rows, scaled, gravity)]
    told = []
    for number in sorted({row.object for row in rows if row.object is not None}):
        mine = [row for row in rows if row.object == number]
        try:
            one = _told(number, mine, scaled, gravity)
        except bm.MotionError as error:
            one = replace(_told(number, mine, None, None), words=[f"No scale: {error}."])
        frames = f"Object {number}: in {len(mine)} frames, {mine[0].frame} to {mine[-1].frame}."
        told.append(replace(one, words=[frames, *one.words]))
    return told


def _told(number: int, rows: Rows, scaled: Scaling | None, gravity: Gravity | None) -> Told:
    scale = None if scaled is None else scaled(rows)
    found = _sound(rows)
    words = [_radius(found)] if found else []
    scatter = bm.frame_scatter(rows)
    words += [] if scatter is None else bm.explain(scatter)
    try:
        fall = bm.fit_fall(rows, scale, *(gravity or ()))
    except bm.MotionError as error:
        if gravity is None:
            return Told(number, [*words, f"No fall to check: {error}."], None, scale)
        without = _told(number, rows, scaled, None)
        return replace(without, words=[*without.words, f"Gravity was not used: {error}."])
    return Told(number, [*words, *bm.explain(fall)], fall, fall.scale)


def table(
    rows: Rows, told: Sequence[Told], time: tuple[float, float] | None
) -> list[dict[str, Any]]:
    """All numbers of each frame, with the speed as well as it is known."""
    scales = {one.number: one.scale for one in told}
    return [
        {**row.numbers(), **_speed(row.sighting, scales.get(row.object or 1), time)} for row in rows
    ]


def words(rows: Rows, model: bm.ColorModel, several: bool) -> list[str]:
    """What was found, in sentences."""
    found = [row.sighting for row in rows if row.sighting is not None]
    frames, of = len({row.frame for row in rows if row.sighting}), len({row.frame for row in rows})
    told = [f"Color: {in_degrees(model)}.", f"Found in {frames} of {of} frames"]
    if not found:
        return [told[0], f"{told[1]}."]
    swept = sum(one.source == "sweep" for one in found)
    directed = sum(row.directed for row in rows)
    count = len({row.track for row in rows if row.track is not None})
    tracks = f"{count} {'object' if several else 'track'}{'' if count == 1 else 's'}"
    doubted = sum(bool(one.doubts) for one in found)
    how = (
        f"{swept} measured from a shape on a path, {len(found) - swept} from the moments of alpha; of "
        f"{directed} the direction of time is known, and {doubted} "
        f"{'is' if doubted == 1 else 'are'} doubtful."
    )
    return [told[0], f"{told[1]}, {tracks if several else f'in {tracks}'}: {how}"]


def usual_radius(rows: Rows) -> tuple[float, float]:
    """Median of the radii, pixels, and its error, from how they scatter."""
    found = _sound(rows)
    if not found:
        raise bm.MotionError("the object was found in no frame, so that its size gives no scale")
    middle, scatter = _middle(found)
    # Of normal numbers a median scatters by √(π/2) times as much as a mean.
    return middle, max(1.2533 * scatter / len(found) ** 0.5, min(one.radius_std for one in found))


def _sound(rows: Rows) -> list[bm.Sighting]:
    """What was found without doubts, or all if there is nothing else."""
    found = [row.sighting for row in rows if row.sighting is not None]
    return [one for one in found if not one.doubts] or found


def _radius(found: Sequence[bm.Sighting]) -> str:
    middle, scatter = _middle(found)
    return (
        f"Radius {middle:.2f} px in the middle of all; they vary by {scatter / middle:.1%} "
        "(1.48 times the median of the differences)."
    )


def _middle(found: Sequence[bm.Sighting]) -> tuple[float, float]:
    """Median of the radii, and how they scatter about it: the standard deviation of normal numbers."""
    radii = sorted(one.radius for one in found)
    middle = radii[len(radii) // 2]
    return middle, 1.4826 * sorted(abs(radius - middle) for radius in radii)[len(radii) // 2]


def _speed(
    one: bm.Sighting | None, scale: bm.Scale | None, time: tuple[float, float] | None
) -> dict[str, Any]:
    """Mean speed within the exposure, and its error."""
    unit = ("px" if scale is None else "m") + ("/exposure" if time is None else "/s")
    if one is None:
        return {"speed": None, "speed_std": None, "speed_unit": unit}
    speed, relative2 = one.length, (one.length_std / max(one.length, 1e-12)) ** 2
    if scale is not None:
        speed *= scale.meters_per_pixel
        relative2 += (scale.std / scale.meters_per_pixel) ** 2
    if time is not None:
        speed /= time[0]
        relative2 += (time[1] / time[0]) ** 2
    return {"speed": speed, "speed_std": speed * relative2**0.5, "speed_unit": unit}


def _plate(task: ClipTask, frames: bm.Frames[bm.LinearImage]) -> bm.LinearImage:
    if task.plate is not None:
        return task.files.read(task.plate)[0]
    with about(task.source):
        return bm.make_plate(frames).plate


def _color(
    task: ClipTask,
    frames: bm.Frames[bm.LinearImage],
    plate: bm.LinearImage,
    workers: bm.Workers,
) -> bm.ColorModel:
    if task.color is None:
        return bm.clip_color(frames, plate, workers)
    if task.color.lower().endswith(".json"):
        return bm.read_color_model(task.color)
    if task.color == "any":
        return bm.ColorModel.any()
    return bm.ColorModel.from_hex(task.color)


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
        for frame in new:
            file.write(json.dumps(asdict(frame)) + "\n")
            file.flush()
            yield frame

"""The command that measures the motion in each frame of a clip: track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.clip_table import Gravity, KnownQuantities, drawn, summaries, table, words
from blurmatte.cli.clips import (
    ClipMeasurement,
    ClipTask,
    KnownBall,
    measure_frames,
    remove_unfinished,
)
from blurmatte.cli.console import about, answer, flag, in_degrees, option, output, waiting
from blurmatte.cli.output_checks import SHEET, check_file, check_outputs
from blurmatte.cli.quantities import (
    SIZE,
    Readout,
    ScaleOptions,
    acceleration,
    check_camera,
    direction,
    time_of_exposure,
    time_of_line,
)
from blurmatte.cli.rows import given_files
from blurmatte.cli.selection import OBJECT, Clip, FrameSelection, Reading

RUN = "The run"

_TABLES = ".csv", ".json", ".parquet"


@dataclass(frozen=True)
class ObjectOptions:
    """Which objects of a clip are followed."""

    color: Annotated[
        str | None, option("HEX|FILE.json|any", "Its color; else found in some frames.", OBJECT)
    ] = None
    several: Annotated[bool, flag("--several", "Follow all of that color.", OBJECT)] = False
    least: Annotated[int | None, option("N", "Of these: seen in N frames or more; 3.", OBJECT)] = (
        None
    )

    def __post_init__(self) -> None:
        if self.least is not None and not self.several:
            raise ValueError("--least needs --several: it is for several objects")
        if self.least is not None and self.least < 1:
            raise ValueError(f"--least must be at least 1, got {self.least}")


@dataclass(frozen=True)
class ProcessOptions:
    """How the frames are processed."""

    workers: Annotated[int | None, option("N", "Processes; one for each core.", RUN)] = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"--workers must be at least 1, got {self.workers}")


@dataclass(frozen=True)
class Physics(ScaleOptions):
    """Known quantities: sizes, times, the camera, gravity."""

    camera: Annotated[Path | None, option("FILE", "JSON of the calibrated camera.", SIZE)] = None
    exposure: Annotated[str | None, option("TIME[±ERROR]", "Exposure time.", SIZE)] = None
    line_time: Annotated[
        str | None, option("TIME", "From row to row of a rolling shutter.", SIZE)
    ] = None
    readout: Readout = None
    gravity: Annotated[
        str | None,
        option("G|X,Y|X,Y,Z[±ERROR]", "Of a fall, m/s²: gives the scale.", SIZE),
    ] = None

    def __post_init__(self) -> None:
        if self.camera is not None and self.scale is not None:
            raise ValueError(
                "give --radius or --diameter with --camera, not --scale: the size of a pixel follows "
                "from the distance in each frame"
            )
        super().__post_init__()
        if self.camera is not None and self.true_radius is None:
            raise ValueError(
                "--camera needs --radius or --diameter, the ball's true size; if it is unknown, give "
                "a guess and --gravity: the fall determines the factor of all lengths"
            )
        direction("--readout", self.readout)
        self.gravity_vector, self.line_seconds, self.exposure_seconds  # noqa: B018

    @property
    def exposure_seconds(self) -> tuple[float, float] | None:
        """Exposure time and its error."""
        return None if self.exposure is None else time_of_exposure("--exposure", self.exposure)

    @property
    def line_seconds(self) -> float:
        """Time from row to row; 0 for none."""
        return 0.0 if self.line_time is None else time_of_line("--line-time", self.line_time)

    @property
    def gravity_vector(self) -> Gravity | None:
        """A number (down; in space its size) or a vector, m/s², and the error of its size."""
        if self.gravity is None:
            return None
        vector, std = acceleration("--gravity", self.gravity)
        if self.camera is not None and len(vector) == 2:
            raise ValueError(
                "--gravity with --camera must be a magnitude, like 9.81, or x,y,z to the right, down "
                f"and away from the camera, like 0,9.81,0; got two numbers, {self.gravity!r}"
            )
        if not any(vector) or (len(vector) == 1 and vector[0] < 0):
            raise ValueError(
                "--gravity must be above 0, or a vector like 0,9.81,0 (right, down, away from the "
                f"camera), got {self.gravity!r}"
            )
        return (vector if len(vector) > 1 else vector[0]), std

    @property
    def ball(self) -> KnownBall | None:
        """The ball in space, if the camera is known."""
        if self.camera is None or self.true_radius is None:
            return None
        return KnownBall(bm.read_intrinsics(self.camera), self.true_radius, self.line_seconds)


@command(
    "track rally.mp4 -o rally.csv",
    'track rally.mp4 --plate plate.exr --color "#d8ff3c" --diameter 67mm --overlay rally.png',
    "track throw.mp4 --frames 40:52 --camera lens.json --radius 20mm --gravity 9.81",
)
def track(
    clip: Clip,
    chosen: FrameSelection,
    followed: ObjectOptions,
    physics: Physics,
    run: ProcessOptions,
    reading: Reading,
    plate: Annotated[
        Path | None, option("FILE", "The scene without it; else made of the clip.")
    ] = None,
    out: Annotated[Path | None, output("The table: .csv, .json or .parquet.")] = None,
    overlay: Annotated[Path | None, option("FILE", "Draw the paths: .png or .jpg.")] = None,
    as_json: AsJson = False,
) -> None:
    """Track the object through CLIP: place, speed and size per frame."""
    check_file(out, "a table", *_TABLES)
    check_file(overlay, "a sheet", *SHEET)
    source, ball = Path(clip[0]), physics.ball
    task = ClipTask(
        source,
        followed.color,
        followed.several,
        3 if followed.least is None else followed.least,
        chosen.rate,
        run.workers,
        out,
        given_files(clip, plate, followed.color, reading.transfer),
        {"frames": chosen.frames, "transfer": reading.transfer},
        ball,
        direction("--readout", physics.readout),
        physics.true_radius is not None,
    )
    check_outputs(out, overlay, task.unfinished)
    frames = _frames(clip, chosen, reading, physics)
    given = None if plate is None else reading.read(plate)
    measured = measure_frames(task, frames, given)
    _answer(task, measured, physics, overlay, as_json)


def _frames(
    clip: list[str], chosen: FrameSelection, reading: Reading, physics: Physics
) -> bm.Frames[bm.LinearImage]:
    """The frames to measure, after a check of their times and the camera."""
    with about(Path(clip[0])):
        frames = reading.frames(clip, chosen.frames)
        # A sensor has no fewer rows than the shorter side of its picture has pixels.
        _check_times(physics, chosen.rate or frames.rate, min(frames.size))
        if physics.ball is not None:
            check_camera(physics.ball.lens, frames.size)
    return frames


def _check_times(physics: Physics, rate: float | None, rows: int) -> None:
    """Raise ValueError if exposure or readout takes longer than a frame."""
    from blurmatte.motion.picture.motion import MAX_READOUT  # imports all of the library

    if rate is None:
        return
    line_time, exposure = physics.line_seconds, physics.exposure_seconds
    if line_time * rows * rate > MAX_READOUT:
        raise ValueError(
            "give --line-time with its unit, like 15us, or the true --rate: "
            f"{line_time:g} s are {line_time * rows:.3g} s for {rows} rows, longer than a frame, "
            f"{1 / rate:.3g} s"
        )
    if exposure is not None and exposure[0] * rate > MAX_READOUT:
        raise ValueError(
            "give --exposure with its unit, like 4ms, or the true --rate: "
            f"{exposure[0]:g} s is longer than a frame, {1 / rate:.3g} s"
        )


def _answer(
    task: ClipTask, measured: ClipMeasurement, physics: Physics, overlay: Path | None, as_json: bool
) -> None:
    """Write the table and the sheet, and print their contents."""
    from blurmatte.motion.clip.cadence import Cadence

    rows, places = measured.rows, measured.places
    known = KnownQuantities(
        physics.of_radius,
        physics.true_radius is not None,
        None if task.ball is None else task.ball.moved,
        physics.gravity_vector,
        physics.exposure_seconds,
        physics.line_seconds,
        measured.place_std,
        measured.radius_std,
    )
    with about(task.source):
        found = summaries(rows, places, task.several, known)
    said = words(rows, in_degrees(measured.model), task.several)
    said += Cadence.stated(rows).words
    said += [word for one in found for word in one.words]
    lines = table(rows, places, found, known)
    if task.out is not None:
        bm.write(task.out, lines)
    if overlay is not None:
        with waiting("drawing the paths"):
            physical, name = drawn(lines, found, places), task.source.name
            bm.write(overlay, bm.figures.draw_clip(measured.plate, rows, said, physical, name))
    remove_unfinished(task)
    falls = [None if one.fall is None else one.fall.numbers() for one in found]
    of_falls: dict[str, Any] = {"falls": falls} if task.several else {"fall": falls[0]}
    answer(as_json, {"rows": lines, **of_falls, "in_words": said}, said)

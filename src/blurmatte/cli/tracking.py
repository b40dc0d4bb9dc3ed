"""The command that measures the motion in each frame of a clip: track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, optional, output, switch
from blurmatte.cli.paths import SHEET, check_file, check_outputs, given_files
from blurmatte.cli.quantities import (
    SIZE,
    Camera,
    ExposureTime,
    LineTime,
    Readout,
    ScaleOptions,
    acceleration,
    check_camera,
    check_count,
    direction,
    time_of_exposure,
    time_of_line,
)
from blurmatte.cli.selection import OBJECT, Clip, FrameSelection, Reading, stated_model
from blurmatte.formats import TABLES, TRACKER, TRACKMATE

if TYPE_CHECKING:
    from blurmatte.motion.clip.summary import KnownQuantities

RUN = "The run"


@dataclass(frozen=True)
class ObjectOptions:
    """Which objects of a clip are followed."""

    color: str | None = optional(
        "HEX|FILE.json|any", "Its color; else found in some frames.", OBJECT
    )
    several: bool = switch("--several", "Follow all of that color.", OBJECT)
    least: int | None = optional("N", "Of these: seen in N frames or more; 3.", OBJECT)

    def __post_init__(self) -> None:
        if self.least is not None and not self.several:
            raise ValueError("--least needs --several: it is for several objects")
        check_count("--least", self.least)


@dataclass(frozen=True)
class ProcessOptions:
    """How the frames are processed."""

    workers: int | None = optional("N", "Processes; one for each core.", RUN)

    def __post_init__(self) -> None:
        check_count("--workers", self.workers)


@dataclass(frozen=True)
class Physics(ScaleOptions):
    """Known quantities: sizes, times, the camera, gravity."""

    camera: Camera = None
    exposure: ExposureTime = None
    line_time: LineTime = None
    readout: Readout = None
    gravity: str | None = optional("G|X,Y|X,Y,Z[±ERROR]", "Of a fall, m/s²: gives the scale.", SIZE)

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
    def gravity_vector(self) -> tuple[float | list[float], float] | None:
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
    def known(self) -> KnownQuantities:
        """All of it but errors that the frames share."""
        from blurmatte.motion.clip.summary import KnownQuantities  # imports all of the library

        return KnownQuantities(
            self.constant,
            self.true_radius,
            None if self.camera is None else bm.read_intrinsics(self.camera),
            self.gravity_vector,
            self.exposure_seconds,
            self.line_seconds,
        )


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
    plate: Path | None = optional("FILE", "The scene without it; else made of the clip."),
    out: Annotated[Path | None, output("The table: .csv, .json, .parquet or others.")] = None,
    overlay: Path | None = optional("FILE", "Draw the paths: .png or .jpg."),
    as_json: AsJson = False,
) -> None:
    """Track the object through CLIP: place, speed and size per frame."""
    check_file(out, "a table", *TABLES)
    if followed.several and out is not None and out.name.lower().endswith(TRACKER):
        raise ValueError(f"{out}: holds one object; write {TRACKMATE}, or follow without --several")
    check_file(overlay, "a sheet", *SHEET)
    from blurmatte.cli.clips import Tracking, check_times  # imports all of the library
    from blurmatte.motion.clip.steps import ClipInputs

    source, known = Path(clip[0]), physics.known
    readout = direction("--readout", physics.readout)
    files = given_files(clip, plate, followed.color, reading.transfer)
    settings = {"color": followed.color, "several": followed.several, "rate": chosen.rate}
    settings |= {"frames": chosen.frames, "transfer": reading.transfer}
    unfinished = None if out is None else out.with_name(f"{out.name}.unfinished")
    check_outputs(out, overlay, unfinished)
    with about(source):
        frames = reading.frames(clip, chosen.frames)
        # A sensor has no fewer rows than the shorter side of its picture has pixels.
        check_times(known, chosen.rate or frames.rate, min(frames.size))
        if known.lens is not None:
            check_camera(known.lens, frames.size)
    inputs = ClipInputs(
        frames,
        None if plate is None else reading.read(plate),
        _color(followed.color),
        followed.several,
        rate=chosen.rate,
        min_frames=followed.least or 3,
    )
    task = Tracking(source, frames, inputs, known, readout, out, unfinished)
    task.answer(task.measured(run.workers, files, settings), overlay, as_json)


def _color(text: str | None) -> bm.ColorModel | None:
    """The color model of --color; None: it is to be found."""
    if text is None:
        return None
    return bm.ColorModel.any() if text == "any" else stated_model([text])

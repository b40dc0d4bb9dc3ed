"""save_clip: a clip → a layer for each frame with an object, a table, a report and a sheet."""

import re
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np

from blurmatte.background import ClipShot, ParallaxRegion
from blurmatte.checks import AnyArray, Bools, check_kind, check_map
from blurmatte.clips.manifest import NAME, Finished, Manifest, key_of, opened_manifest
from blurmatte.clips.table import FrameRecord
from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError, MotionError
from blurmatte.explain.calibration import camera_in_words
from blurmatte.explain.clip import saved_in_words, without_layer_in_words
from blurmatte.figures import draw_clip
from blurmatte.figures.clip import Matte
from blurmatte.files.atomic import replacing
from blurmatte.files.clip_decoding import video_library
from blurmatte.files.frames import Frames, write_frames
from blurmatte.files.reading import read_layer
from blurmatte.files.writing import require_parquet, write
from blurmatte.formats import Writes, written
from blurmatte.layer import Layer, empty_layer
from blurmatte.matting.case import Solver
from blurmatte.matting.maps import Grade
from blurmatte.motion import FrameMotion, FrameSightings, Workers
from blurmatte.motion.clip.cadence import Cadence
from blurmatte.motion.clip.detections import Sighting
from blurmatte.motion.clip.solving import FrameSolver, as_solved, check_clip_solver
from blurmatte.motion.clip.steps import ClipInputs, ClipMeasured, measured, shots_of, solved
from blurmatte.motion.clip.workers import Failure
from blurmatte.motion.columns import html_table
from blurmatte.radiometry import LinearImage
from blurmatte.results import save_parallax

MOVIES, LAYER_EXTENSIONS = written(Writes.LAYERS), written(Writes.LAYER, Writes.LAYERS)
TABLE_EXTENSIONS = ".csv", ".parquet"
SHEET_FRAMES = 3  # that the sheet shows with their alpha


@dataclass(frozen=True, eq=False)
class ClipRun:
    """What is solved in a clip, and how it is written.

    Parameters
    ----------
    inputs : tuple of Path
        The files of the clip, and of plate and color if they were given; their contents are part of
        the hash by which a run is resumed.
    frames : Frames
        From `read_frames`.
    plate : LinearImage, optional
        The scene without the object; if not given, one is made for each shot.
    model : ColorModel, optional
        Of the object; found for each shot if not given.
    several : bool
        Every object of that color, each in a folder of its own.
    extension : str
        Of the layers: .exr, .png, .tif, or .mov for one ProRes 4444 of all of them.
    occluder : (H, W) bool, optional
        Where something is in front of the scene in all frames, as in `solve_clip`.
    table : str
        Of the frames: .csv or .parquet (the `tables` extra).
    command : str
        How it was called, for the report.
    complete : bool
        Write all numbers of each solution into its EXR, which `read_solution` reads; it has more
        channels than RGBA.
    rate : float, optional
        Frames per second; replaces the times of the frames: each is its number over the rate.
    solver : Solver, optional
        As in `solve_clip`.

    Raises
    ------
    ValueError
        If an extension is another, complete layers are no EXRs, or the solver has a plate in shadow.
    FileError
        If pyarrow is missing and the table is .parquet, or PyAV and layers are .mov.

    Examples
    --------
    >>> from pathlib import Path
    >>> clip = bm.read_frames("clip", bm.SRGB)
    >>> run = bm.clips.ClipRun((Path("throw.png"),), clip, plate, extension=".png")
    >>> run.name
    'throw.png …'
    """

    inputs: tuple[Path, ...]
    frames: Frames[LinearImage]
    plate: LinearImage | None = None
    model: ColorModel | None = None
    several: bool = False
    extension: str = ".exr"
    occluder: Bools | None = None
    table: str = ".csv"
    command: str = ""
    complete: bool = False
    rate: float | None = None
    solver: Solver | None = None

    def __post_init__(self) -> None:
        check_kind("frames", self.frames, Frames, "use blurmatte.read_frames(path)")
        check_clip_solver(self.solver)
        if self.occluder is not None:
            hidden = check_map("occluder", self.occluder, self.frames.size[::-1], kinds="b")
            object.__setattr__(self, "occluder", hidden)
        if self.extension not in LAYER_EXTENSIONS:
            raise ValueError(
                f"layers are written as {', '.join(LAYER_EXTENSIONS)}, got {self.extension!r}"
            )
        if self.complete and self.extension != ".exr":
            raise ValueError(f"complete layers are .exr files, got {self.extension!r}")
        if self.table not in TABLE_EXTENSIONS:
            raise ValueError(f"table must be .csv or .parquet, got {self.table!r}")
        if self.table == ".parquet":
            require_parquet()  # the table is written at the end
        if self.extension in MOVIES:
            video_library(Path("layers.mov"))  # and so is the clip

    @property
    def key(self) -> str:
        """Hash of inputs and settings."""
        model = self.model
        color = None if model is None else [model.basis.tolist(), model.covariance.tolist()]
        settings = {
            # One frame shows with which curve all are read.
            "light": [_digest(frame.rgb) for frame in self.frames[:1]],
            "frames": str(self.frames.frame_numbers),
            "rate": self.rate or self.frames.rate,
            "color": color,
            "several": self.several,
            "layers": self.file_extension,
            "complete": self.complete,
            "occluder": None if self.occluder is None else _digest(self.occluder),
            "solver": repr(self.solver),
            "opacity": None if self.solver is None else self.solver.opacity,
            "seconds": None if self.solver is None else self.solver.seconds,
        }
        return key_of(self.inputs, settings)

    @property
    def name(self) -> str:
        """Of the clip, or of the first of its pictures, for people."""
        if self.frames.clip is not None:
            return self.frames.clip.path.name
        return f"{self.inputs[0].name} …" if self.inputs else "clip"

    @property
    def file_extension(self) -> str:
        """Of the file of one frame; a movie is made of EXRs."""
        return ".exr" if self.extension in MOVIES else self.extension

    def layers_in(self, folder: Path) -> "_LayerFiles":
        """The files of its layers in a folder of results."""
        return _LayerFiles(folder, self.file_extension, self.several)


@dataclass(frozen=True)
class _LayerFiles:
    """Layers of frames in a folder of results; if there are several objects, each has a folder."""

    folder: Path
    extension: str
    several: bool

    def name(self, frame: int, number: int) -> str:
        """Name of the layer of an object in a frame."""
        name = f"layer.{frame:06d}{self.extension}"
        return f"object{number}/{name}" if self.several else name

    def write_empty(
        self, records: Sequence[FrameRecord], frames: Sequence[int], size: tuple[int, int]
    ) -> list[list[str]]:
        """Write a transparent layer for each frame without one, so that no number is missing.

        For each object that has a layer in some frame. Returns the names of the files of each object.
        """
        empty = list[list[str]]()
        for number in sorted({record.object for record in records if record.layer}):
            named = {record.frame for record in records if record.layer and record.object == number}
            empty.append([self.name(frame, number) for frame in frames if frame not in named])
            paths = [self.folder / name for name in empty[-1]]
            for path in paths[:1]:
                write(path, empty_layer(size))
            for path in paths[1:]:  # a copy takes much less time than to compress it again
                with replacing(path, self.extension) as temporary:
                    copyfile(paths[0], temporary)
        return empty

    def remove(self, names: Iterable[str], frames: Collection[int]) -> None:
        """Remove those of the files that a layer of these frames would have as its name."""
        of_object = "object[0-9]+/" if self.several else ""
        form = re.compile(rf"{of_object}layer\.([0-9]+){re.escape(self.extension)}")
        for name in names:
            found = form.fullmatch(name)
            if found is not None and int(found[1]) in frames:
                (self.folder / name).unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class _LayerWriter:
    """Solves a frame and writes its layer; runs in any process.

    Of complete layers all numbers of the solution are written, the sweep included.
    """

    solver: FrameSolver
    files: _LayerFiles
    shot: int
    complete: bool

    def __call__(self, frames: Sequence[LinearImage], row: FrameMotion) -> Finished:
        """Solve a frame, given alone, write its layer, and return its record and what it shows."""
        frame, number = row.place
        solution = self.solver(frames, row)
        if isinstance(solution, str):
            record = FrameRecord(frame, row.time, number, self.shot, reason=solution)
            return Finished(self.shot, layer=record)
        name = self.files.name(frame, number)
        path = self.files.folder / name
        if self.files.several:
            path.parent.mkdir(exist_ok=True)
        write(path, solution if self.complete else solution.layer)
        row = as_solved(row, solution)
        seen = FrameSightings(frame, row.time, () if row.sighting is None else (row.sighting,))
        return Finished(self.shot, seen, FrameRecord.of(row, self.shot, solution, name))


@dataclass(frozen=True, eq=False)
class ClipReport:
    """What came of a clip.

    Parameters
    ----------
    records : tuple of FrameRecord
        Of all frames in which something moved, in order; those without a layer have a reason.
    shots : tuple of ClipShot
        In numbers of frames, as in the records.
    problems : tuple of str
        Shots without a result, and frames that failed, each with its reason; how many frames have no
        layer.
    files : tuple of Path
        Written besides the layers.
    seconds : float
        Of this run.
    new : int
        Frames that were solved in this run.
    empty : int
        Frames without the object, or without a solution, whose layer file is transparent; of several
        objects those of the first. 0 if layers are written with all numbers of a solution.

    Examples
    --------
    >>> with bm.motion.Workers(1) as workers:
    ...     *_, report = bm.save_clip(run, "layers", workers)
    >>> report.grades
    {'confirmed': 2, 'plausible': 0, 'assumed': 0}
    """

    records: tuple[FrameRecord, ...]
    shots: tuple[ClipShot, ...]
    problems: tuple[str, ...]
    files: tuple[Path, ...]
    seconds: float
    new: int
    empty: int = 0

    def _repr_html_(self) -> str:
        return html_table(self.records)

    @property
    def grades(self) -> dict[str, int]:
        """Number of frames of each grade, the best first."""
        found = Counter(record.grade for record in self.records)
        return {str(grade): found[str(grade)] for grade in Grade}


@dataclass
class _RunProgress:
    """Progress of one run."""

    manifest: Manifest[Finished]
    rows: list[FrameMotion] = field(default_factory=list)
    solved: dict[tuple[int, int], Sighting] = field(default_factory=dict)
    records: list[FrameRecord] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    plates: list[LinearImage] = field(default_factory=list)
    parallax: list[ParallaxRegion] = field(default_factory=list)  # of the first shot
    new: int = 0

    def shown(self) -> list[FrameMotion]:
        """The rows with what was measured in their solutions; detections without one are in doubt."""
        return [
            row
            if row.sighting is None
            else replace(
                row, sighting=self.solved.get(row.place) or row.sighting.with_doubts("No layer.")
            )
            for row in self.rows
        ]


def _digest(values: AnyArray) -> str:
    """Hash of the values of an array."""
    return sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def save_clip(
    run: ClipRun, folder: str | Path, workers: Workers
) -> Iterator[FrameSightings | FrameRecord | ClipReport]:
    """Separate the object from its background in all frames of a clip, and write layers and a table.

    Layers are written one by one, each completely or not at all, and recorded in a manifest; a run with
    the same inputs and settings skips what is done, and ends with the same files. The folder then has

    =================  ===============================================================
    layer.000123.exr   the object in frame 123, in the whole window; transparent without it
    frames.csv         a row for each of them: time, place, radius, grade, box; or frames.parquet
    overview.png       the paths over the plate; its charts need matplotlib
    report.json        shots, grades, problems, speed
    plate.exr          if it was made; plate2.exr of the second shot, and so on
    manifest.jsonl     what is done
    =================  ===============================================================

    Parameters
    ----------
    run : ClipRun
    folder : str or Path
        Made if needed; on a disk that all workers reach.
    workers : Workers

    Yields
    ------
    FrameSightings
        Of each frame, when it is measured.
    FrameRecord
        Of each frame with the object, when its layer is written.
    ClipReport
        At the end.

    Raises
    ------
    MotionError
        If no shot has a result.
    FileError
        If the folder cannot be written to.

    Examples
    --------
    >>> with bm.motion.Workers(1) as workers:
    ...     *_, report = bm.save_clip(run, "layers", workers)
    >>> sorted(file.name for file in report.files)
    ['frames.csv', 'overview.png']
    """
    folder, begun = Path(folder), time.monotonic()
    run = replace(run, frames=run.frames.for_plate(run.plate))
    with opened_manifest(folder / NAME, run.key, Finished) as manifest:
        work = _RunProgress(manifest)
        _note(manifest, [name for one in manifest.replaced for name in one.layers])
        found, numbers = shots_of(run.frames, workers), run.frames.frame_numbers
        shots = [shot.numbered(numbers) for shot in found]
        for number, shot in enumerate(found, 1):
            try:
                yield from _shot(run, folder, number, shot, work, workers)
            except BlurmatteError as error:
                work.problems.append(f"{shots[number - 1]}: {error}")
        yield _finished(run, folder, work, shots, begun)


def _shot(
    run: ClipRun, folder: Path, number: int, shot: ClipShot, work: _RunProgress, workers: Workers
) -> Iterator[FrameSightings | FrameRecord]:
    """Measure and solve the frames of a shot that are not done."""
    finished = [one for one in work.manifest.finished if one.shot == number]
    seen = [one.seen for one in finished if one.seen is not None and one.layer is None]
    done = {
        (one.layer.frame, one.layer.object): one
        for one in finished
        if one.layer is not None and (not one.layer.layer or (folder / one.layer.layer).exists())
    }
    clip = ClipInputs(
        *(run.frames[shot.start : shot.stop], run.plate, run.model),
        *(run.several, run.occluder, run.rate),
        any_color=True,
        finished=seen,
        written=done,
    )
    for event in measured(clip, workers):
        if isinstance(event, ClipMeasured):
            found = event
        else:
            work.manifest.append(Finished(number, seen=event))
            yield event
    before = max((row.track or 0 for row in work.rows), default=0)
    work.rows += [replace(row, track=row.track and row.track + before) for row in found.rows]
    work.plates.append(found.plate)
    work.problems += camera_in_words(found.camera, clip.numbers)
    if found.camera is not None and len(work.plates) == 1:
        work.parallax += found.camera.parallax
    how = run.layers_in(folder.absolute()), number, run.complete
    outcomes = solved(found, workers, run.solver, lambda solver: _LayerWriter(solver, *how))
    for row, outcome in outcomes:
        if isinstance(outcome, Failure):
            work.problems.append(f"frame {row.frame}: {outcome.error}")
            continue
        work.manifest.append(outcome)
        done[row.place] = outcome
        work.new += 1
        if outcome.layer is not None:
            yield outcome.layer
    for place, one in done.items():
        for solved_one in () if one.seen is None else one.seen.found:
            work.solved[place] = found.on_canvas(place[0], solved_one)
    empty = [
        FrameRecord(row.frame, row.time, 1, number, reason=row.reason)
        for row in found.rows
        if row.sighting is None and row.something_moved and row.place not in done
    ]
    records = [one.layer for one in done.values() if one.layer is not None]
    work.records += sorted([*records, *empty], key=lambda one: (one.frame, one.object))


def _finished(
    run: ClipRun, folder: Path, work: _RunProgress, shots: Sequence[ClipShot], begun: float
) -> ClipReport:
    """Write what follows from all frames; the report."""
    if not work.rows:
        raise MotionError("; ".join(work.problems) or "the clip has no frames")
    work.problems += [*Cadence.stated(work.rows).words, *_without_layer(work)]
    files, empty = _written(run, folder, work, shots), _fill(run, folder, work)
    done = tuple(work.records), tuple(shots), tuple(work.problems)
    report = ClipReport(*done, files, time.monotonic() - begun, work.new, empty)
    write(folder / "report.json", _numbers(run, report))
    return report


def _written(
    run: ClipRun, folder: Path, work: _RunProgress, shots: Sequence[ClipShot]
) -> tuple[Path, ...]:
    """Write table, plates, sheet and movie; their paths. Without a record there is no table."""
    table, files = folder / f"frames{run.table}", list[Path]()
    if work.records:
        files.append(table)
        write(table, [record.numbers() for record in work.records])
    else:
        table.unlink(missing_ok=True)  # of an older run
    if run.plate is None:
        for number, plate in enumerate(work.plates, 1):
            files.append(folder / f"plate{number if number > 1 else ''}.exr")
            write(files[-1], plate)
    files += save_parallax(folder, work.plates[0], work.parallax)
    files.append(folder / "overview.png")
    grades = Counter(record.grade for record in work.records if record.layer)
    words = saved_in_words(grades, shots, len(work.plates)) + work.problems[:3]
    mattes = _mattes(run, folder, work.records)
    write(files[-1], draw_clip(work.plates[0], work.shown(), words, name=run.name, mattes=mattes))
    if run.extension in MOVIES:
        numbers = sorted({record.object for record in work.records if record.layer})
        for number in numbers:
            name = f"layers{number}.mov" if run.several else "layers.mov"
            files.append(folder / name)
            layers = _movie(run, folder, [one for one in work.records if one.object == number])
            write_frames(files[-1], layers, rate=run.rate or run.frames.rate)
    return tuple(files)


def _movie(run: ClipRun, folder: Path, records: Sequence[FrameRecord]) -> Iterator[Layer]:
    """The layer of one object in each frame, for a ProRes 4444 with alpha as long as the clip."""
    named = {record.frame: record.layer for record in records if record.layer}
    empty = empty_layer(read_layer(folder / next(iter(named.values()))).size)
    for number in run.frames.frame_numbers:
        yield read_layer(folder / named[number]) if number in named else empty


def _mattes(run: ClipRun, folder: Path, records: Sequence[FrameRecord]) -> list[Matte]:
    """Frames with layers for the sheet, early, in the middle and late in the clip."""
    layers = [record for record in records if record.layer]
    count = min(len(layers), SHEET_FRAMES)
    chosen = [layers[(2 * k + 1) * len(layers) // (2 * count)] for k in range(count)]
    places = {number: k for k, number in enumerate(run.frames.frame_numbers)}
    return [
        Matte(one.frame, run.frames[places[one.frame]], read_layer(folder / one.layer))
        for one in chosen
    ]


def _fill(run: ClipRun, folder: Path, work: _RunProgress) -> int:
    """Write empty layers of the other frames, or none if layers are complete; how many.

    Layers of these frames that are left of an earlier run are removed.
    """
    numbers, size, files = run.frames.frame_numbers, run.frames.size, run.layers_in(folder)
    empty = [] if run.complete else files.write_empty(work.records, numbers, size)
    kept = {record.layer for record in work.records}.union(*empty)
    earlier = {name for one in work.manifest.finished for name in one.layers}
    files.remove(earlier - kept, set(numbers))
    _note(work.manifest, [name for names in empty for name in names])
    return len(empty[0]) if empty else 0


def _note(manifest: Manifest[Finished], names: Sequence[str]) -> None:
    """Add names of layers to the manifest that it does not have."""
    noted = {name for one in manifest.finished for name in one.layers}
    if new := tuple(name for name in names if name not in noted):
        manifest.append(Finished(0, files=new))


def _without_layer(work: _RunProgress) -> list[str]:
    """How many frames have no layer though something moved, and the reason of most of them.

    Without any layer, all frames count.
    """
    done = {record.frame for record in work.records if record.layer}
    frames = {row.frame for row in work.rows}
    reasons = {row.frame: row.reason for row in work.rows if not row.sighting}
    reasons |= {record.frame: record.reason for record in work.records if record.reason}
    counted = {row.frame for row in work.rows if row.color_moved} if done else frames
    without = [reasons.get(frame, "") for frame in sorted(counted - done)]
    return without_layer_in_words(without, len(frames))


def _numbers(run: ClipRun, report: ClipReport) -> dict[str, Any]:
    layers = [record for record in report.records if record.layer]
    return {
        "command": run.command,
        "inputs": [str(path) for path in run.inputs],
        "frames": len(run.frames),
        "rate": run.rate or run.frames.rate,
        "size": run.frames.size,
        "layers": len(layers),
        "empty_layers": report.empty,
        "grades": report.grades,
        "shots": report.shots,
        "problems": list(report.problems),
    }

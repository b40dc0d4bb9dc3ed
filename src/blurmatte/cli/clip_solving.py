"""What `solve` does with a clip: options, progress, and the answer."""

from __future__ import annotations

import os
import shlex
import sys
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

import blurmatte as bm
from blurmatte.cli.console import (
    ExitCode,
    about,
    complain,
    optional,
    say,
    say_json,
    switch,
    waiting,
    warn,
)
from blurmatte.cli.paths import CLIPS_OF_LAYERS, STILL, check_folder, given_files
from blurmatte.cli.quantities import check_count
from blurmatte.cli.selection import (
    GUESSED,
    FrameSelection,
    MatchMode,
    ObjectColor,
    Selection,
    matching_of,
    stated_model,
)
from blurmatte.formats import is_clip

CLIP = "A clip, or a row of images"
_NUMBERED = "#", "%"
_LAYERS = *(name[1:] for name in (*STILL, *CLIPS_OF_LAYERS)), "solution"


@dataclass(frozen=True)
class MaybePlate:
    """The plate, and how it may be changed to match the image."""

    plate: list[Path] | None = optional("FILE|none", "Without the object; none: guess; clip: made.")
    match: MatchMode = "auto"

    def __post_init__(self) -> None:
        matching_of(self.match)
        if self.is_guessed and len(self.files) > 1:
            raise ValueError("--plate none guesses the plate: give it alone, or leave it out")

    @property
    def files(self) -> list[Path]:
        """All that were given."""
        return self.plate or []

    @property
    def of_clip(self) -> Path | None:
        """The one of a clip, if it was given; ValueError if there are several."""
        if len(self.files) > 1:
            raise ValueError(
                f"give one --plate with a clip, got {len(self.files)}; make one of several pictures "
                "with blurmatte plate"
            )
        return next(iter(self.files), None)

    @property
    def is_guessed(self) -> bool:
        """Whether there is none, and a single picture must do."""
        return GUESSED in self.files


@dataclass(frozen=True)
class ClipOptions(FrameSelection):
    """How a clip is solved and written."""

    layers: str | None = optional(
        "KIND", "exr, png, tif, mov, or solution: EXRs with all numbers.", CLIP
    )
    several: bool = switch("--several", "All objects of that color.", CLIP)
    table: str | None = optional("csv|parquet", "Of the frames; csv.", CLIP)
    workers: int | None = optional("N", "Processes; one for each core.", CLIP)
    scheduler: str | None = optional("ADDRESS", "Of a Dask cluster: tcp://host:8786.", CLIP)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.layers is not None and self.layers not in _LAYERS:
            raise ValueError(f"--layers must be {', '.join(_LAYERS)}, got {self.layers!r}")
        if self.table not in (None, "csv", "parquet"):
            raise ValueError(f"--table must be csv or parquet, got {self.table!r}")
        check_count("--workers", self.workers)
        if self.workers is not None and self.scheduler is not None:
            raise ValueError("give --workers or --scheduler; a cluster has its own workers")

    def means_clip(
        self, images: list[str], out: Path, plate: Path | None, each_alone: bool
    ) -> bool:
        """Whether the images are frames of one clip, and not pictures of their own.

        Numbered pictures are, unless an option is given that only pictures have: `each_alone`.
        """
        asked = self.layers or self.several or self.table or self.frames or self.rate
        if asked or self.scheduler or _is_movie(out):
            return True
        if len(images) > 1:
            return False
        path = Path(images[0])
        numbered = any(mark in path.name for mark in _NUMBERED) and not path.exists()
        if numbered or path.is_dir() or "*" in images[0]:
            return (numbered and not each_alone) or plate is None
        return is_clip(path)


def solve_clip(
    images: list[str],
    plate: MaybePlate,
    out: Path,
    selection: Selection,
    options: ClipOptions,
    occluder: Path | None,
    solver: bm.matting.Solver | None,
    required: bm.Grade | None,
    as_json: bool,
) -> None:
    """Write a layer for each frame of a clip, and say what came of it."""
    from blurmatte.motion.clip.workers import return_freed_memory

    _check_used(plate, selection)
    if options.scheduler is not None:  # its workers run in other folders
        images = [str(Path(image).absolute()) for image in images]
    folder = out.with_suffix("") if _is_movie(out) else out
    check_folder(folder)
    return_freed_memory()
    colors, reading, given = selection.colors, selection.reading, plate.of_clip
    with about(Path(images[0])):
        frames = reading.frames(images, options.frames)
        run = bm.clips.ClipRun(
            given_files(images, given, occluder, *(colors.color or ())),
            frames,
            None if given is None else reading.read(given),
            _model(colors),
            options.several,
            _extension(out, options),
            _ignored(selection, occluder, frames.size),
            f".{options.table or 'csv'}",
            shlex.join(["blurmatte", *sys.argv[1:]]),
            options.layers == "solution",
            options.rate,
            solver,
        )
        with _workers(options, folder, len(frames)) as workers, waiting("reading the clip"):
            *_, report = bm.save_clip(run, folder, workers)
            assert isinstance(report, bm.clips.ClipReport)
    if _is_movie(out) and (folder / "layers.mov").exists():
        os.replace(folder / "layers.mov", out)
    _answer(report, folder, out, as_json)
    _check_grades(report, required)


def _check_used(plate: MaybePlate, selection: Selection) -> None:
    """Raise ValueError for options that would change nothing."""
    if selection.reading.camera_noise is not None:
        raise ValueError(
            "--noise is for single pictures; that of a clip is measured in its frames: leave it out"
        )
    if plate.match != "auto":
        raise ValueError(
            f"--match {plate.match} is for single pictures; the plate of a clip is compared with each "
            "frame as it is, but for its light: leave --match out"
        )


def _is_movie(out: Path) -> bool:
    """Whether all layers become one file, and not a folder."""
    return out.suffix.lower() in CLIPS_OF_LAYERS


def _ignored(selection: Selection, occluder: Path | None, size: tuple[int, int]) -> Any:
    """(H, W) bool: behind the occluder or outside the region, where no change counts; or None."""
    hidden = None if occluder is None else selection.hidden(occluder, size)
    region = selection.inside(size)
    if region is None:
        return hidden
    return ~region.mask if hidden is None else hidden | ~region.mask


def _extension(out: Path, options: ClipOptions) -> str:
    if _is_movie(out):
        if options.layers not in (None, "mov"):
            raise ValueError(f"--layers {options.layers} needs a folder as --out, got {out}")
        return out.suffix.lower()
    return ".exr" if options.layers in (None, "solution") else f".{options.layers}"


def _model(colors: ObjectColor) -> bm.ColorModel | None:
    """The color model of the options; None: it is to be found in the frames."""
    if colors.kinds & {"point", "core"}:
        raise ValueError("of a clip give --color as hex or a model file; or leave it out")
    if colors.max_brightness is not None:
        raise ValueError(
            "--max-brightness is for a single picture; of a clip give --color as hex or a model file"
        )
    if colors.color:
        return stated_model(colors.color)
    return bm.ColorModel.any() if colors.rank == 3 else None


def _workers(
    options: ClipOptions, folder: Path, count: int
) -> AbstractContextManager[bm.motion.Workers]:
    if options.scheduler is not None:
        return bm.clips.cluster_workers(options.scheduler, folder)
    return bm.motion.Workers(options.workers or min(os.cpu_count() or 1, max(count // 8, 1)))


def _answer(report: bm.clips.ClipReport, folder: Path, out: Path, as_json: bool) -> None:
    layers = [record for record in report.records if record.layer]
    for problem in report.problems:
        warn(problem)
    if as_json:
        rows = [record.numbers() for record in report.records]
        numbers = {"folder": folder, "grades": report.grades, "empty_layers": report.empty}
        say_json({**numbers, "shots": report.shots, "frames": rows})
        return
    graded = ", ".join(f"{count} {grade}" for grade, count in report.grades.items() if count)
    speed = (
        f"; {report.new} solved now, in {report.seconds:.0f} s" if report.new else "; all were done"
    )
    empty = f"; {report.empty} empty ones of the other frames" if report.empty else ""
    lines = [f"{len(layers)} layers: {graded or 'none'}{empty}{speed}"]
    if len(report.shots) > 1:
        lines += [str(shot) for shot in report.shots]
    lines.append(str(out if _is_movie(out) else report.files[0]))
    say("\n".join(lines))


def _check_grades(report: bm.clips.ClipReport, required: bm.Grade | None) -> None:
    """Raise Exit if there is no layer, or a grade is lower than required."""
    grades = [bm.Grade(record.grade) for record in report.records if record.layer]
    if not grades:
        complain("no frame shows an object that can be separated")
        raise typer.Exit(ExitCode.REFUSED)
    if required is not None and min(grades) < required:
        complain(f"some grades are lower than {required}; all files were written")
        raise typer.Exit(ExitCode.LOW_GRADE)

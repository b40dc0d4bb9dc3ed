"""The commands that look at files: show, info and find, also of clips."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, answer, argument, complain, flag, output, say, waiting
from blurmatte.cli.paths import SHEET, check_file, expanded
from blurmatte.cli.selection import GUESSED, CameraReading, PlateOptions, Reading, matching_of


@command("show out/layer.exr", "show throw.tif --transfer linear -o look.png")
def show(
    file: Annotated[Path, argument("FILE", "A picture, a layer or a solution.")],
    reading: Reading,
    out: Annotated[
        Path | None,
        output("Write the sheet, open nothing: .png or .jpg.", "SHEET"),
    ] = None,
) -> None:
    """Show FILE on a sheet."""
    from blurmatte.cli.contents import picture_in  # not for --help: imports all of the library

    check_file(out, "a sheet", *SHEET)
    with about(file), waiting("drawing the sheet"):
        sheet = bm.figures.draw_look(picture_in(file, reading))
    target = out or Path(tempfile.mkdtemp(prefix="blurmatte-")) / f"{file.stem}.png"
    with about(target):
        bm.write(target, sheet)
    say(str(target))
    if out is None and typer.launch(str(target)) != 0:
        complain("open the file that is named above; no program was found to show it with")


@command("info throw.png", "info out/layer.exr --json", "info --compile")
def info(
    reading: Reading,
    file: Annotated[
        Path | None,
        argument("[FILE]", "A picture, a clip, a layer, a solution, a model, noise or a curve."),
    ] = None,
    shots: Annotated[
        bool, flag("--shots", "Of a clip also its shots: all frames are decoded.")
    ] = False,
    compile_all: Annotated[
        bool, flag("--compile", "Compile all kernels now, and keep them.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Describe the contents of FILE; without FILE, versions, extras and platform.

    A picture, a clip, a layer, a solution, a color model, a report, noise or a transfer curve.
    """
    if file is None:
        if shots or reading != Reading():
            raise ValueError("--shots, --transfer and --max-pixels describe a FILE; give one")
        _describe_environment(compile_all, as_json)
        return
    if compile_all:
        raise ValueError("--compile concerns no FILE; leave one of the two out")
    from blurmatte.cli.contents import (  # not for --help: imports all of the library
        contents,
        shots_in,
    )

    with about(file) as said:
        lines, numbers = contents(file, reading, said)
        if shots:
            found = shots_in(file, reading)
            lines = [*lines, *(f"shot {k}: {shot}" for k, shot in enumerate(found, 1))]
            numbers["shots"] = [asdict(shot) for shot in found]
    answer(as_json, {"file": file, **numbers}, lines)


def _describe_environment(compile_all: bool, as_json: bool) -> None:
    """Print what blurmatte runs on, after all kernels were compiled if that is asked for."""
    from blurmatte.cli.environment import environment
    from blurmatte.cli.kernels import compile_kernels

    if compile_all:
        with waiting("compiling the kernels"):
            compile_kernels()
    lines, numbers = environment()
    answer(as_json, numbers, lines)


@command("find throw.png --plate none", "find throw.png --plate empty_room.png")
def find(
    image: Annotated[str, argument("IMAGE", "The picture with the object.")],
    plate: PlateOptions,
    reading: CameraReading,
    as_json: AsJson = False,
) -> None:
    """Propose values of --region: where something moved.

    Without a plate: where something is that a smooth scene around it does not explain.
    """
    path = expanded([image])[0]
    with about(path), waiting("finding regions"):
        C = reading.read(path)
        if plate.plate == GUESSED:
            boxes = bm.background.regions_that_stand_out(C)
        else:
            B = bm.match_plate(reading.read(plate.plate), C, matching_of(plate.match))
            boxes = [streak.box for streak in bm.find_streaks(C, B)]
        if not boxes:
            raise bm.errors.MotionError(
                "nothing stands out from a smooth scene; mark where the object may have been with "
                "--region of solve"
                if plate.plate == GUESSED
                else "nothing moved: no region differs from the plate by more than noise"
            )
    lines = [f"--region {','.join(map(str, box))}" for box in boxes]
    answer(as_json, {"regions": [list(map(int, box)) for box in boxes]}, lines)

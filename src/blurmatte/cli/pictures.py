"""The commands that look at files: show, info and find, also of clips.

Without a file, info states versions, platform, extras, and where compiled kernels are kept.
"""

from __future__ import annotations

import os
import platform
import re
import tempfile
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Annotated, Any

import typer

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, answer, argument, complain, output, say, switch, waiting
from blurmatte.cli.paths import SHEET, check_file, expanded
from blurmatte.cli.selection import GUESSED, CameraReading, PlateOptions, Reading, matching_of

_ALL, _DEVELOPERS = "all", "dev"  # extras that repeat others, and of developers
_SUFFIXES = "*.nbi", "*.nbc"  # of numba's files


@command("show out/layer.exr", "show throw.tif --transfer linear -o look.png")
def show(
    file: Annotated[Path, argument("FILE", "A picture, a layer or a solution.")],
    reading: Reading,
    out: Annotated[
        Path | None, output("Write the sheet, open nothing: .png or .jpg.", "SHEET")
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
    shots: bool = switch("--shots", "Of a clip also its shots: all frames are decoded."),
    compile_all: bool = switch("--compile", "Compile all kernels now, and keep them."),
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
            numbers["shots"] = found
    answer(as_json, {"file": file, **numbers}, lines)


def _describe_environment(compile_all: bool, as_json: bool) -> None:
    """Print what blurmatte runs on, after all kernels were compiled if that is asked for."""
    if compile_all:
        from blurmatte.cli.kernels import compile_kernels

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


def environment() -> tuple[Iterable[str], dict[str, Any]]:
    """Lines for people, and the same as values."""
    from blurmatte.compiling import kernel_folder

    libraries, extras = _required()
    folder = kernel_folder()
    kept = [] if folder is None else [p for end in _SUFFIXES for p in folder.rglob(end)]
    numbers = {
        "blurmatte": bm.__version__,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "libraries": libraries,
        "extras": extras,
        "kernels": {"folder": folder, "bytes": sum(path.stat().st_size for path in kept)},
    }
    return _lines(numbers), numbers


def _lines(numbers: dict[str, Any]) -> Iterable[str]:
    """The same in lines."""
    yield f"blurmatte {numbers['blurmatte']}"
    yield f"{numbers['python']}, {numbers['cores']} cores, {numbers['platform']}"
    yield _named(numbers["libraries"])
    extras = numbers["extras"].items()
    present = {name: packages for name, packages in extras if None not in packages.values()}
    for name, packages in present.items():
        yield f"extra {name}: {_named(packages)}"
    missing = ", ".join(name for name, _ in extras if name not in present)
    yield f"extras that are not installed: {missing or 'none'}"
    kernels = numbers["kernels"]
    if kernels["folder"] is None:
        yield "compiled kernels: kept nowhere; NUMBA_CACHE_DIR names a folder"
    else:
        yield f"compiled kernels: {kernels['bytes'] / 1e6:.1f} MB below {kernels['folder']}"


def _named(versions: dict[str, str | None]) -> str:
    """Packages with their versions."""
    return ", ".join(f"{name} {found or 'missing'}" for name, found in versions.items())


def _required() -> tuple[dict[str, str | None], dict[str, dict[str, str | None]]]:
    """Versions of the libraries that every command needs, and of those of each extra.

    Empty if blurmatte runs from its source without being installed.
    """
    libraries: dict[str, str | None] = {}
    extras: dict[str, dict[str, str | None]] = {}
    try:
        lines = requires("blurmatte") or ()
    except PackageNotFoundError:
        return libraries, extras
    for line in lines:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if extra is None:
            libraries[name] = _version(name)
        elif extra[1] not in (_ALL, _DEVELOPERS):
            extras.setdefault(extra[1], {})[name] = _version(name)
    return libraries, extras


def _version(name: str) -> str | None:
    """The version of an installed package; None if it is missing."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None

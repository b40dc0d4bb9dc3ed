"""Paths on the command line: rows of pictures, and checks of what a command will write."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from glob import glob
from pathlib import Path
from typing import Any

import blurmatte as bm
from blurmatte.formats import MOV, MP4, NUMBERS, Writes, is_clip, pictures_in, written

SHEET, PICTURE = written(Writes.SHEET), written(Writes.PICTURE)
STILL, CLIPS = written(Writes.LAYER), written(Writes.CLIP)  # of layers, and of pictures
CLIPS_OF_LAYERS = written(Writes.LAYERS)
_FILES = *PICTURE, *CLIPS, *NUMBERS
OUTPUTS = "out", "overlay", "sheet", "preview", "plot"  # the options that name files to write

# What the command reads: from identities of files to their names.
_inputs: ContextVar[dict[object, Path]] = ContextVar("inputs", default={})  # noqa: B039
ROWS = "folder, ####, %04d, '*'"


def check_file(path: Path | None, what: str, *endings: str) -> None:
    """Raise FileError if a path has none of the `endings`, is a folder, or lies in none."""
    from blurmatte.files.atomic import check_replaceable

    if path is None:
        return
    check_ending(path, what, *endings)
    if path.is_dir():
        raise bm.errors.FileError(f"{path}: is a folder; give the name of a file")
    check_replaceable(path)
    if not path.parent.is_dir():
        raise bm.errors.FileError(
            f"{path}: there is no folder {path.parent}; make it, or check the name"
        )
    _check_writable(path, path.parent)


def check_plot(path: Path | None) -> None:
    """Check that a plot can be drawn and written, before work; raises BlurmatteError."""
    from blurmatte.figures.drawing import plot_library

    check_file(path, "a plot", *SHEET)
    if path is not None:
        plot_library()


def check_ending(path: Path, what: str, *endings: str) -> None:
    """Check that a name ends with one of these, and can be written; raises FileError."""
    from blurmatte.files.atomic import ending_of

    ending = ending_of(path, endings)
    if ending is None:
        raise bm.errors.FileError(
            f"{path}: {what} is written as {' or '.join(endings)}; change the ending"
        )
    if ending in (MOV.extensions[0], MP4.extensions[0]):  # an extra writes them
        from blurmatte.files.clip_decoding import video_library

        video_library(path)


def check_folder(path: Path) -> None:
    """Raise FileError if a folder is named like a file, or it or one above it is one or read-only."""
    if path.suffix.lower() in _FILES and not path.exists():
        raise bm.errors.FileError(
            f"{path}: give a folder, whose name does not end with {path.suffix}"
        )
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not there.is_dir():
        raise bm.errors.FileError(f"{path}: {there.name} is a file; give the name of a folder")
    _check_writable(path, there)


@contextmanager
def protecting(values: Mapping[str, Any], inputs: Iterable[Path]) -> Iterator[list[str]]:
    """Protect all files that the values of options name, and other `inputs`, from being replaced.

    Yields warnings of sets of files that a stopped run left incomplete. Raises FileError if an input
    is a pipe or a device, or one of `OUTPUTS` is an input or another output.
    """
    read = [path for name in values.keys() - OUTPUTS for path in _named(values[name])]
    read += inputs
    there = [path for path in read if _is_file(path)]
    token = _inputs.set({key: path for path in there for key in _identities(path)})
    try:
        check_outputs(*(values.get(name) for name in OUTPUTS))
        yield [line for folder in {path.parent for path in there} for line in _incomplete(folder)]
    finally:
        _inputs.reset(token)


def check_outputs(*outputs: Path | None, inputs: Iterable[Path] = ()) -> None:
    """Raise FileError if a file to write is an input or another output, also through links or rows.

    None and folders are allowed.
    """
    taken = _inputs.get() | {key: path for path in inputs for key in _identities(path)}
    written = dict[object, Path]()
    for path in outputs:
        if path is None or path.is_dir():
            continue
        for key in _identities(path):
            if key in taken:
                named = "it" if taken[key] == path else str(taken[key])
                raise bm.errors.FileError(
                    f"{path}: would be replaced, and {named} is read; choose another --out"
                )
            if key in written:
                raise bm.errors.FileError(f"{path}: would be written twice; choose another name")
        written |= dict.fromkeys(_identities(path), path)


def _incomplete(folder: Path) -> list[str]:
    from blurmatte.files.atomic import INCOMPLETE

    return [
        f"{mark}: files of this folder are incomplete, for a run was stopped; run the same again"
        for mark in sorted(folder.glob(f"*{INCOMPLETE}"))
    ]


def _named(value: Any) -> list[Path]:
    """The files that the value of an option may name."""
    texts = value if isinstance(value, list) else [value]
    files = [Path(text) for text in texts if isinstance(text, str | Path)]
    files += [Path(text.partition(":")[2]) for text in texts if isinstance(text, str)]  # NAME:FILE
    return [*files, *(path / "layer.exr" for path in files if isinstance(value, Path))]


def _identities(path: Path) -> tuple[object, ...]:
    """What two names of one file have in common."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # it is not there, or is no name at all
        return (os.path.realpath(path),)
    return os.path.realpath(path), (found.st_dev, found.st_ino)


def _is_file(path: Path) -> bool:
    """Whether it is there; raises FileError for a pipe or a device, which may be endless."""
    from blurmatte.files.errors import check_regular

    try:
        path.stat()
    except (OSError, ValueError):
        return False
    check_regular(path)
    return True


def _check_writable(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK):
        raise bm.errors.FileError(
            f"{path}: nothing can be written into {folder}; choose another folder"
        )


def with_folders(paths: Sequence[Path], out: Path) -> list[tuple[Path, Path]]:
    """Each file and the folder for its results: `out` itself if there is but one."""
    if len(paths) == 1:
        return [(paths[0], out)]
    stems = [path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise ValueError(f"give one file named {stem} at a time, got {stems.count(stem)}")
    return [(path, out / path.stem) for path in paths]


def pictures_of(texts: Iterable[str]) -> list[Path]:
    """The pictures that patterns and folders hold now, if any."""
    found: list[Path] = []
    for text in texts:
        with suppress(bm.errors.FileError):  # reading them says so
            found += _expanded(text)
    return found


def expanded(texts: Iterable[str]) -> list[Path]:
    """The files of these names, patterns (*, ####, %04d) and folders, each in the order of names."""
    return [path for text in texts for path in _expanded(text)]


def _expanded(text: str) -> list[Path]:
    from blurmatte.files.sequences import natural_order

    path = Path(text)
    if path.is_dir():
        found = pictures_in(path)
    elif path.exists() or not _is_pattern(path):
        return [path]
    else:
        numbered = re.sub(r"#+|%\d*d", "[0-9]*", path.name)
        found = [Path(name) for name in glob(str(path.parent / numbered), recursive=True)]
    if not found:
        raise bm.errors.FileError(f"{text}: there are no such files; check the name or the pattern")
    return sorted(found, key=natural_order)


def layer_in(text: str) -> str:
    """The name of a layer: of a folder with the results of one picture, that of its layer.exr."""
    inside = Path(text) / "layer.exr"
    return str(inside) if inside.is_file() else text


def given_files(images: Iterable[str], *others: str | Path | None) -> tuple[Path, ...]:
    """The files of images and options, each once; options may be values of other kinds."""
    paths = [*expanded(images), *(Path(one) for one in others if one is not None)]
    return tuple(dict.fromkeys(path for path in paths if path.is_file()))


def is_row(source: Path) -> bool:
    """Whether a clip or a row of files is meant, and not one picture or layer."""
    several = source.is_dir() or (_is_pattern(source) and not source.is_file())
    return several or is_clip(source)


def _is_pattern(path: Path) -> bool:
    return re.search(r"[#*?\[]|%\d*d", path.name) is not None or "*" in str(path)

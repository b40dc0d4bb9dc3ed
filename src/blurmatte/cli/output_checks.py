"""Checks of the files that a command will write, before it begins to work."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import blurmatte as bm

SHEET = ".png", ".jpg"
PICTURE = ".png", ".tif", ".jpg", ".exr"


def check_file(path: Path | None, what: str, *endings: str) -> None:
    """Check that a file can be written; None is allowed.

    Raises
    ------
    FileError
        If its ending is none of `endings`, it is a folder, or there is no folder for it.
    """
    if path is None:
        return
    check_ending(path, what, *endings)
    if path.is_dir():
        raise bm.FileError(f"{path}: is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise bm.FileError(f"{path}: there is no folder {path.parent}; make it, or check the name")
    _check_writable(path, path.parent)


def check_ending(path: Path, what: str, *endings: str) -> None:
    """Check that a name ends with one of these; raises FileError."""
    from blurmatte.files.atomic import extension_of

    if extension_of(path) not in endings:
        raise bm.FileError(
            f"{path}: {what} is written as {' or '.join(endings)}; change the ending"
        )


def check_folder(path: Path) -> None:
    """Check that a folder exists or can be made.

    Raises
    ------
    FileError
        If it or one above it is a file, or may not be written to.
    """
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not there.is_dir():
        raise bm.FileError(f"{path}: {there.name} is a file; give the name of a folder")
    _check_writable(path, there)


def check_other(path: Path | None, *inputs: str | Path | None) -> None:
    """Check that a file to write is none of those to read; None is allowed.

    Raises
    ------
    FileError
        If it is.
    """
    if path is None:
        return
    for read in inputs:
        if read is not None and path.resolve() == Path(read).resolve():
            raise bm.FileError(f"{path}: is read, and would be replaced; choose another name")


def check_kept(inputs: Iterable[Path], folder: Path) -> None:
    """Check that no result in a folder would replace one of the inputs.

    Raises
    ------
    FileError
        If an input is in that folder and has the name of a result.
    """
    from blurmatte.results import RESULT_FILES

    results = {(folder / name).resolve() for name in RESULT_FILES}
    for path in inputs:
        if path.resolve() in results:
            raise bm.FileError(
                f"{path}: would be replaced by the result of that name; choose another --out"
            )


def _check_writable(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK):
        raise bm.FileError(f"{path}: nothing can be written into {folder}; choose another folder")

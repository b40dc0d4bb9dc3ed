"""Atomic writes: a file, or several files of a folder, are written completely or not at all.

A run that is stopped leaves temporary files, which the next one that writes into the folder removes. If
it was stopped while it moved a set of files, the last file of the set is missing, and a file that ends
with `.incomplete` says so until the set is written again.
"""

import os
import platform
import re
import secrets
import shutil
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path

from blurmatte.errors import FileError
from blurmatte.formats import Writes, named

INCOMPLETE = ".incomplete"  # added to the name of the last file of a set while it is moved
_HOST = f"{zlib.crc32(platform.node().encode()):08x}"
_SESSION = secrets.token_hex(4)  # of this process: another one may get its number later
_COUNTER = count()
_TEMPORARY = re.compile(r"\.blurmatte-([0-9a-f]{8})-(\d+)-([0-9a-f]{8})-\d+(\.\w+)*")
_NOTE = "blurmatte was stopped while it replaced these files; run the same command again\n"


def extension_of(path: Path) -> str:
    """The extension of a file name in its canonical form: .png, .tif, .jpg, .exr …"""
    form = named(path)
    picture = form is not None and Writes.PICTURE in form.writes
    return form.extensions[0] if form is not None and picture else path.suffix.lower()


def ending_of(path: Path, endings: Iterable[str]) -> str | None:
    """Which of some endings a file name has, the longest of several: .napari.csv rather than .csv."""
    name = path.name.lower()
    found = [end for end in endings if name.endswith(end) or end == extension_of(path)]
    return max(found, key=len, default=None)


@contextmanager
def replacing(target: Path, extension: str) -> Iterator[Path]:
    """A temporary file in the folder of `target` that replaces it if no exception is raised.

    It is on the disk before, and has the permissions of the file that it replaces.
    """
    final = Path(os.path.realpath(target))  # a symbolic link stays a link
    check_replaceable(target)
    _remove_leftovers(final.parent)
    temporary = _temporary(final.parent, extension)
    try:
        temporary.touch(final.stat().st_mode & 0o777 if final.exists() else 0o666, exist_ok=False)
        yield temporary
        _keep_mode(final, temporary)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, final)
    except FileError as error:
        raise FileError(str(error).replace(str(temporary), str(target))) from error
    except OSError as error:
        reason = (error.strerror or str(error)).replace(str(temporary), target.name)
        raise _unwritable(target, reason) from error
    finally:
        with suppress(OSError):  # the error that prevented the write is the one to report
            temporary.unlink(missing_ok=True)


@contextmanager
def moved_together(folder: Path) -> Iterator[tuple[Path, list[str]]]:
    """A temporary folder inside `folder`, and a list of the names of the files written there.

    They move up in that order if no exception is raised. The older file of the last name is removed
    before, so that a set without its last file is incomplete.

    Raises FileError if they cannot be written. Files that existed before are not changed then.
    """
    made = _missing_folders({folder})
    _remove_leftovers(folder)
    temporary, names = _temporary(folder), list[str]()
    try:
        temporary.mkdir(mode=0o700, parents=True)
        yield temporary, names
        for name in names:
            if (folder / name).is_dir():
                raise FileError(f"{folder / name}: move or rename this folder; a file has its name")
            check_replaceable(folder / name)
        made = _missing_folders({(folder / name).parent for name in names}) + made
        if names:
            _move(names, temporary, folder)
        made = []
    except FileError as error:
        raise FileError(str(error).replace(str(temporary), str(folder))) from error
    except OSError as error:
        raise _unwritable(folder, error.strerror or str(error)) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        for empty in made:
            with suppress(OSError):  # it was not created, or another program uses it
                empty.rmdir()


def check_replaceable(target: Path) -> None:
    """Raise FileError if a folder, a pipe or a device has the name of a file to write."""
    if target.is_dir():
        raise FileError(f"{target}: give the name of a file; this is a folder")
    if target.exists() and not target.is_file():
        raise FileError(f"{target}: give the name of a file; this is a pipe or a device")


def _move(names: list[str], temporary: Path, folder: Path) -> None:
    *others, last = names
    mark = folder / f"{Path(last).name}{INCOMPLETE}"
    mark.write_text(_NOTE, encoding="utf-8", newline="\n")
    for name in names:
        _keep_mode(folder / name, temporary / name)
    (folder / last).unlink(missing_ok=True)
    for name in (*others, last):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(temporary / name, folder / name)
    mark.unlink()


def _keep_mode(old: Path, new: Path) -> None:
    """Give `new` the permissions of the file that it replaces."""
    if old.exists():
        shutil.copymode(old, new)


def _temporary(folder: Path, extension: str = "") -> Path:
    """A new name that says which process uses it."""
    return folder / f".blurmatte-{_HOST}-{os.getpid()}-{_SESSION}-{next(_COUNTER)}{extension}"


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove temporary files of processes of this computer that have ended; once for each folder."""
    with suppress(OSError):  # it does not exist, or others may not look into it
        for path in folder.iterdir():
            name = _TEMPORARY.fullmatch(path.name)
            if name is None or name[1] != _HOST or _runs(int(name[2]), name[3]):
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _runs(process: int, session: str) -> bool:
    if process == os.getpid():
        return session == _SESSION
    if os.name != "posix":  # no harmless way to ask
        return True
    try:
        os.kill(process, 0)  # no signal: only a test whether it is there
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _unwritable(target: Path, reason: str) -> FileError:
    return FileError(
        f"{target}: check the folder and the free disk space; it cannot be written ({reason})"
    )


def _missing_folders(folders: set[Path]) -> list[Path]:
    """Those of the folders and their parents that do not exist, the innermost first."""
    missing = {p for folder in folders for p in (folder, *folder.parents) if not p.exists()}
    return sorted(missing, key=lambda p: len(p.parts), reverse=True)

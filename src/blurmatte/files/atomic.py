"""Atomic writes: a file, or several files of a folder, are written completely or not at all."""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from blurmatte.errors import FileError

_ALIASES = {".jpeg": ".jpg", ".tiff": ".tif"}


def extension_of(path: Path) -> str:
    """The extension of a file name in its canonical form: .png, .tif, .jpg, .exr …"""
    return _ALIASES.get(path.suffix.lower(), path.suffix.lower())


@contextmanager
def replacing(target: Path, extension: str) -> Iterator[Path]:
    """A temporary file in the folder of `target` that replaces it if no exception is raised."""
    final = Path(os.path.realpath(target))  # a symbolic link stays a link
    if final.is_dir():
        raise FileError(f"{target}: give the name of a file; this is a folder")
    temporary = final.with_name(f".blurmatte-{secrets.token_hex(6)}{extension}")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
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
def moved_together(folder: Path) -> Iterator[Path]:
    """A temporary folder inside `folder` whose files move up if no exception is raised.

    Raises
    ------
    FileError
        If they cannot be written. Files that existed before are not changed then.
    """
    made = _missing_folders({folder})
    temporary = folder / f".blurmatte-{secrets.token_hex(6)}"
    try:
        temporary.mkdir(parents=True)
        yield temporary
        names = sorted(p.relative_to(temporary) for p in temporary.rglob("*") if not p.is_dir())
        for name in names:
            if (folder / name).is_dir():
                raise FileError(f"{folder / name}: move or rename this folder; a file has its name")
        made = _missing_folders({(folder / name).parent for name in names}) + made
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (temporary / name).replace(folder / name)
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


def _unwritable(target: Path, reason: str) -> FileError:
    return FileError(
        f"{target}: check the folder and the free disk space; it cannot be written ({reason})"
    )


def _missing_folders(folders: set[Path]) -> list[Path]:
    """Those of the folders and their parents that do not exist, the innermost first."""
    missing = {p for folder in folders for p in (folder, *folder.parents) if not p.exists()}
    return sorted(missing, key=lambda p: len(p.parts), reverse=True)

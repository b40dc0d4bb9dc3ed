"""Several files in one folder: all of them or none."""

import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from blurmatte.errors import FileError
from blurmatte.files.writing import write


def write_together(folder: str | Path, things: Mapping[str, Any]) -> list[Path]:
    """Write things under names in a folder: beside their places first, and then moved.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.
    things : mapping
        By the name of the file, which may lie in folders of its own: what `write` takes.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    FileError
        If one of them cannot be written. What was there before stays as it was.
    """
    folder = Path(folder)
    with moved_together(folder) as aside:
        for name, thing in things.items():
            (aside / name).parent.mkdir(parents=True, exist_ok=True)
            write(aside / name, thing)
    return [folder / name for name in things]


@contextmanager
def moved_together(folder: Path) -> Iterator[Path]:
    """A folder inside `folder`: what is put there moves up if all goes well, and else is gone.

    Raises
    ------
    FileError
        If that is not possible. What was there before stays as it was.
    """
    made = _missing_folders({folder})
    aside = folder / f".blurmatte-{secrets.token_hex(6)}"
    try:
        aside.mkdir(parents=True)
        yield aside
        names = sorted(p.relative_to(aside) for p in aside.rglob("*") if not p.is_dir())
        for name in names:
            if (folder / name).is_dir():
                raise FileError(f"{folder / name}: is a folder; move it out of the way")
        made = _missing_folders({(folder / name).parent for name in names}) + made
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (aside / name).replace(folder / name)
        made = []
    except FileError as error:
        raise FileError(str(error).replace(str(aside), str(folder))) from error
    except OSError as error:
        raise FileError(
            f"{folder}: cannot be written ({error.strerror or error}); "
            "check the folder and the space on its disk"
        ) from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
        for empty in made:
            _forget(empty)


def _missing_folders(folders: set[Path]) -> list[Path]:
    """The folders and their parents as far as they are not there, the innermost first."""
    missing = {p for folder in folders for p in (folder, *folder.parents) if not p.exists()}
    return sorted(missing, key=lambda p: len(p.parts), reverse=True)


def _forget(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:  # it never was, or somebody put something there
        return

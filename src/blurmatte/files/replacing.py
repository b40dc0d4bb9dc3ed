"""A file is there whole or not at all: it is written beside its target and then renamed."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from blurmatte.errors import FileError

_ALIASES = {".jpeg": ".jpg", ".tiff": ".tif"}


def extension_of(path: Path) -> str:
    """What the ending of a file's name says it is, each kind by one name: .png, .tif, .jpg, .exr …"""
    return _ALIASES.get(path.suffix.lower(), path.suffix.lower())


@contextmanager
def replacing(target: Path, extension: str) -> Iterator[Path]:
    """A new file beside `target` that takes its place if all goes well, and else is gone."""
    final = Path(os.path.realpath(target))  # a link stays a link
    if final.is_dir():
        raise FileError(f"{target}: is a folder; give the name of a file")
    temporary = final.with_name(f".blurmatte-{secrets.token_hex(6)}{extension}")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        os.replace(temporary, final)
    except FileError as error:
        raise FileError(str(error).replace(str(temporary), str(target))) from error
    except OSError as error:
        reason = (error.strerror or str(error)).replace(str(temporary), target.name)
        raise FileError(
            f"{target}: cannot be written ({reason}); check the folder and the space on its disk"
        ) from error
    finally:
        _forget(temporary)


def _forget(temporary: Path) -> None:
    # The folder may be gone or closed to us; the error that told so is the one to hear.
    try:
        temporary.unlink(missing_ok=True)
    except OSError:
        return

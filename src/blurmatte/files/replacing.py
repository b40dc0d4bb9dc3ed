"""A file is there whole or not at all: written beside its target under another name, then renamed."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from blurmatte.errors import FileError


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

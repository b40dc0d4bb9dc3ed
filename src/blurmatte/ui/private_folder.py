"""The private folder of a session, locked, so that the next session sees whether it is in use."""

import html
import os
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

_PREFIX = "blurmatte-"
_LOCK = "in-use"  # a file that the server of the folder has locked as long as it lives
_ENTRY = "open.html"


class PrivateFolder:
    """A folder that only its owner can read, locked until it is deleted or this process ends.

    Raises
    ------
    OSError
        If it cannot be made.
    """

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX)).resolve()
        self._lock = _locked(self.path / f"{_LOCK}.new")
        if self._lock is not None:  # others see the file only when it is locked
            (self.path / f"{_LOCK}.new").rename(self.path / _LOCK)

    def write_entry(self, address: str) -> Path:
        """A page that leads to an address; lists of processes show its path, and not the address."""
        link = html.escape(address)
        page = (
            '<!doctype html><meta charset="utf-8"><title>blurmatte</title>'
            '<meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={link}"><a href="{link}">blurmatte</a>\n'
        )
        path = self.path / _ENTRY
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(file, "w", encoding="utf-8") as opened:
            opened.write(page)
        return path

    def remove_entry(self) -> None:
        """Delete the page of the address."""
        with suppress(OSError):
            (self.path / _ENTRY).unlink(missing_ok=True)

    def delete(self) -> None:
        """Delete all of it."""
        _delete(self.path)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def delete_left_folders() -> None:
    """Delete private folders of this user whose servers were killed together with their viewers."""
    if sys.platform == "win32":
        return
    with suppress(OSError):
        for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
            if _is_own(path) and (path / _LOCK).is_file():
                lock = _locked(path / _LOCK)
                if lock is not None:
                    _delete(path)
                    os.close(lock)


def _is_own(path: Path) -> bool:
    """Whether it is a folder, no link to one, of this user."""
    with suppress(OSError):
        found = path.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return False


def _delete(path: Path) -> None:
    """Delete a folder, its lock last, so that an interrupted deletion is completed later."""
    with suppress(OSError):
        for one in path.iterdir():
            if one.is_dir() and not one.is_symlink():
                shutil.rmtree(one, ignore_errors=True)
            elif one.name != _LOCK:
                one.unlink(missing_ok=True)
    shutil.rmtree(path, ignore_errors=True)


def _locked(path: Path) -> int | None:
    """The number of a file that this process has locked; None if that is impossible."""
    if sys.platform == "win32":
        return None
    import fcntl

    number = None
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        if number is not None:
            os.close(number)
        return None
    return number

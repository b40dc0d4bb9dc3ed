"""Compilation of kernels by numba, whose cache may be damaged or in a folder that is read only."""

import hashlib
import os
import pickle
import stat
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from blurmatte.errors import BlurmatteWarning

_Files: Any = caching.IndexDataCacheFile  # numba has no types
_DIGEST = hashlib.sha256().digest_size
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}  # of all kernels
FAST_MATH = {"nsz", "arcp", "contract", "reassoc"}  # infinity and NaN stay as they are


class _CheckedFiles(_Files):  # type: ignore[misc]
    """The cache of one kernel, with checksums: numba would run damaged code."""

    def save(self, key: Any, data: Any) -> None:
        """Save compiled code, unless the disk is full."""
        with suppress(OSError):
            super().save(key, data)

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()

    def _load_index(self) -> Any:
        head = pickle.dumps(self._version, protocol=-1)
        try:
            content = Path(self._index_path).read_bytes()
        except OSError:
            return {}
        whole = content.startswith(head) and _is_whole(content[len(head) :])
        return super()._load_index() if whole else {}

    def _load_data(self, name: str) -> Any:
        if not _is_whole(Path(self._data_path(name)).read_bytes()):
            raise OSError("damaged")  # it is compiled again then
        return super()._load_data(name)


def _is_whole(content: bytes) -> bool:
    return hashlib.sha256(content[:-_DIGEST]).digest() == content[-_DIGEST:]


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba.njit without the interpreter's lock, and without exceptions for divisions by zero.

    The code is kept for the next process, wherever it can be. Warns once if numba's usual folders
    cannot be written to.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        """The kernel of a function, kept on disk."""
        kernel = numba.njit(**_OPTIONS | options)(function)
        try:
            kernel.enable_caching()
        except RuntimeError:  # numba found no folder
            if not _moved_cache():
                return kernel
            kernel.enable_caching()
        kernel._cache._cache_file.__class__ = _CheckedFiles
        return kernel

    return compiled


def _moved_cache() -> bool:
    """Let numba keep code in the folder for temporary files; False if that is impossible, too."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return False
    folder = _own_folder()
    os.environ["NUMBA_CACHE_DIR"] = "" if folder is None else str(folder)  # of other processes, too
    config: Any = numba.config
    config.reload_config()
    where = "nowhere, so each run compiles them again" if folder is None else f"in {folder}"
    warnings.warn(
        f"the home folder cannot be written to; compiled code is kept {where}; NUMBA_CACHE_DIR names "
        "another folder",
        BlurmatteWarning,
        stacklevel=4,
    )
    return folder is not None


def _own_folder() -> Path | None:
    """A folder that nobody else can write to, for code in it is run."""
    try:
        folder = Path(tempfile.gettempdir()) / f"blurmatte-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except (AttributeError, OSError):  # Windows has other users and another home
        return None
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return folder if own and not found.st_mode & 0o077 else None

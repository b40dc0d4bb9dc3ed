"""Compilation of kernels by numba, whose cache may be damaged or in a folder that is read only."""

import hashlib
import os
import pickle
import stat
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any, TypeVar

import numpy as np

from blurmatte.errors import warn

_DIGEST = hashlib.sha256().digest_size
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}  # of all kernels
# With numbers of Python, kernels for 32-bit floats would compute in doubles.
ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)
FAST_MATH = {"nsz", "arcp", "contract", "reassoc"}  # infinity and NaN stay as they are

S = TypeVar("S")
T = TypeVar("T")


def in_threads(function: Callable[[S], T], things: Iterable[S]) -> list[T]:
    """Results of a function in the order of its arguments; the first exception is raised.

    The time is mostly that of compiled code, which releases the interpreter's lock.
    """
    several = list(things)
    if len(several) < 2:
        return [function(thing) for thing in several]
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(several))) as threads:
        return list(threads.map(function, several))


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba.njit without the interpreter's lock, and without exceptions for divisions by zero.

    numba takes half a second to import, which the first call of a kernel does. The code is kept for
    the next process, wherever it can be. Warns once if numba's usual folders cannot be written to.
    """
    return lambda function: _Kernel(function, options)


class _Kernel:
    """A function to be compiled; at its first call numba's kernel takes its place in its module."""

    _lock = RLock()

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func, self._options, self._compiled = function, options, None

    def __call__(self, *arguments: Any) -> Any:
        with self._lock:
            compiled = self.compiled()
        return compiled(*arguments)

    def compiled(self) -> Any:
        """Numba's kernel; those that it calls are replaced by theirs, as numba must know them."""
        if self._compiled is None:
            self._compiled = _kept(self.py_func, self._options)
            names = self.py_func.__globals__
            kernels = {name: x for name, x in names.items() if isinstance(x, _Kernel)}
            names.update({name: kernel.compiled() for name, kernel in kernels.items()})
        return self._compiled


def _kept(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """The kernel of a function, kept on disk."""
    import numba

    kernel = numba.njit(**_OPTIONS | options)(function)
    try:
        kernel.enable_caching()
    except RuntimeError:  # numba found no folder
        if not _moved_cache():
            return kernel
        kernel.enable_caching()
    kernel._cache._cache_file.__class__ = _checked_files()
    return kernel


def kernel_folder() -> Path | None:
    """The folder below which compiled kernels are kept; None if they are kept nowhere."""
    place = _kept(_is_whole, {})._cache.cache_path
    if place is None:
        return None
    own = Path(__file__).parent
    return own if Path(place).parent == own else Path(place).parent


@cache
def _checked_files() -> type:
    """Numba's cache of one kernel, with checksums: numba would run damaged code."""
    from numba.core import caching

    Files: Any = caching.IndexDataCacheFile  # numba has no types

    class CheckedFiles(Files):  # type: ignore[misc]
        """Files of a cache, with checksums."""

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

    return CheckedFiles


def _is_whole(content: bytes) -> bool:
    return hashlib.sha256(content[:-_DIGEST]).digest() == content[-_DIGEST:]


def _moved_cache() -> bool:
    """Let numba keep code in the folder for temporary files; False if that is impossible, too."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return False
    folder = _own_folder()
    os.environ["NUMBA_CACHE_DIR"] = "" if folder is None else str(folder)  # of other processes, too
    import numba

    config: Any = numba.config
    config.reload_config()
    where = "nowhere, so each run compiles them again" if folder is None else f"in {folder}"
    warn(
        f"the home folder cannot be written to; compiled code is kept {where}; NUMBA_CACHE_DIR names "
        "another folder"
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

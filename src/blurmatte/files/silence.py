"""Silence about damaged files: libraries print errors past sys.stderr that are raised as well."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

_STDERR_LOCK = Lock()  # two threads that silence stderr would restore the wrong descriptor


@contextmanager
def silent_libraries() -> Iterator[None]:
    """Discard what is written to the descriptor of stderr."""
    with _STDERR_LOCK:
        try:
            kept = os.dup(2)
        except OSError:  # a program without a terminal has no stderr
            yield
            return
        try:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)

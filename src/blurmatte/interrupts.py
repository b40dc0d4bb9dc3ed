"""Interrupts of the command line: one ends the program with exit code 130, without a traceback.

It imports nothing of the package: an interrupt during those imports ends the program the same way.
"""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

EXIT_CODE = 130
_QUIET = "ignore:resource_tracker:UserWarning"  # of processes, about those that were ended
_SECONDS_TO_END = 2.0  # for temporary files to be removed

_interrupted = False


def interrupted() -> bool:
    """Whether this process was interrupted: errors that follow from it are not reported."""
    return _interrupted


def catch_interrupts() -> None:
    """Unwind at the first interrupt; end at the second, or if unwinding takes too long.

    Libraries that swallow the exception, and compiled kernels, which no exception reaches, would else
    go on.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    signal.set_wakeup_fd(writer.fileno())
    signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _report_unraisable
    filters = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = f"{filters},{_QUIET}" if filters else _QUIET

    def watch() -> None:
        """End this process some seconds after a signal."""
        with writer:  # keeps it open
            reader.recv(1)
            time.sleep(_SECONDS_TO_END)
            os._exit(EXIT_CODE)

    threading.Thread(target=watch, daemon=True).start()


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    global _interrupted
    if _interrupted:
        os._exit(EXIT_CODE)
    _interrupted = True
    raise SystemExit(EXIT_CODE)  # typer would print "Aborted!" for a KeyboardInterrupt


def _report_unraisable(unraisable: Any) -> None:
    """End at an interrupt inside a destructor or a callback, which Python would only print."""
    if _interrupted:
        os._exit(EXIT_CODE)
    sys.__unraisablehook__(unraisable)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Start processes that an interrupt of the terminal does not reach until they catch it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_now() -> NoReturn:
    """End without waiting for threads, which would print their complaints."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(EXIT_CODE)

"""Entry point of the command `blurmatte`.

It is outside of the package, whose imports take most of a second: an interrupt during the imports
ends the program as quietly as a later one.
"""

import os
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn

_INTERRUPTED = 130  # the exit code
_QUIET = "ignore:resource_tracker:UserWarning"  # of processes, about those that were ended
_SECONDS_TO_END = 2.0  # for temporary files to be removed

_interrupted = False


def interrupted() -> bool:
    """Whether this process was interrupted: errors that follow from it are not reported."""
    return _interrupted


def run() -> None:
    """Run the command line; an interrupt ends it with exit code 130 and no traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        _catch_interrupts()
    try:
        from blurmatte.cli import app

        app()
    except KeyboardInterrupt:
        _end()
    except OSError as error:
        if _interrupted:
            _end()
        # An error of stdout: commands report the files that they cannot write.
        print(f"blurmatte: cannot write the answer: {error.strerror}", file=sys.stderr)
        raise SystemExit(2) from None
    except BaseException:
        if _interrupted:
            _end()
        raise


def _catch_interrupts() -> None:
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
        with writer:  # keeps it open
            reader.recv(1)
            time.sleep(_SECONDS_TO_END)
            os._exit(_INTERRUPTED)

    threading.Thread(target=watch, daemon=True).start()


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    global _interrupted
    if _interrupted:
        os._exit(_INTERRUPTED)
    _interrupted = True
    raise SystemExit(_INTERRUPTED)  # typer would print "Aborted!" for a KeyboardInterrupt


def _report_unraisable(unraisable: Any) -> None:
    """End at an interrupt inside a destructor or a callback, which Python would only print."""
    if _interrupted:
        os._exit(_INTERRUPTED)
    sys.__unraisablehook__(unraisable)


def _end() -> NoReturn:
    """End without waiting for threads, which would print their complaints."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(_INTERRUPTED)

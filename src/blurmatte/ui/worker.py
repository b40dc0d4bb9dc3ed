"""The worker: a process that runs command lines, one after the other, with everything imported."""

from __future__ import annotations

import io
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from blurmatte.interrupts import catch_interrupts
from blurmatte.ui.helper import end_group

# Runs the words of a command line behind `blurmatte`, and gives each change of its progress as
# (stage, done, of, seconds left); its exit code.
Report: TypeAlias = Callable[[str, int, int | None, float | None], None]
Program: TypeAlias = Callable[[Sequence[str], Report], int]

_WARM_UP = (  # what loads, and on a new machine compiles, the kernels that most jobs need
    ("render", "easy", "-o", "scene", "--quiet"),
    ("solve", "scene/image.png", "--plate", "scene/plate.png", "-o", "out", "--quiet"),
)


@dataclass(frozen=True)
class Line:
    """A command line to run."""

    job: int
    words: tuple[str, ...]  # behind `blurmatte`
    shown: tuple[str, ...]  # the same as people see it, without private folders
    folder: Path  # in which it runs


@dataclass(frozen=True)
class Said:
    """A line that a job printed on stderr."""

    job: int
    text: str


@dataclass(frozen=True)
class Step:
    """Progress of a job."""

    job: int
    stage: str
    done: int
    of: int | None
    seconds_left: float | None


@dataclass(frozen=True)
class Ended:
    """How a job ended, and what it printed on stdout."""

    job: int
    code: int
    printed: str


READY, INTERRUPT = "ready", "interrupt"


def work(pipe: Connection, program: Program) -> None:
    """Warm up, then run each line that comes; end with the server."""
    catch_interrupts()
    lines: queue.SimpleQueue[Line] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, lines), daemon=True).start()
    _warm_up(program)
    pipe.send(READY)
    while True:
        line = lines.get()
        pipe.send(_ended(pipe, program, line))


def _listen(pipe: Connection, lines: queue.SimpleQueue[Line]) -> None:
    """Take lines and interrupts; the end of the pipe is the end of the server."""
    while True:
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            end_group()
        if message == INTERRUPT:
            signal.raise_signal(signal.SIGINT)
        else:
            lines.put(message)


def _warm_up(program: Program) -> None:
    """Solve a small scene, unseen."""

    def unseen(*_: Any) -> None:
        pass

    with TemporaryDirectory(prefix="blurmatte-") as folder:
        os.chdir(folder)
        try:
            for words in _WARM_UP:
                with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                    program(words, unseen)
        finally:
            os.chdir("/" if os.name == "posix" else Path(folder).anchor)


def _ended(pipe: Connection, program: Program, line: Line) -> Ended:
    """Run a line in its folder."""

    def report(stage: str, done: int, of: int | None, seconds_left: float | None) -> None:
        pipe.send(Step(line.job, stage, done, of, seconds_left))

    os.chdir(line.folder)
    sys.argv = ["blurmatte", *line.shown]  # which reports name
    printed, said = io.StringIO(), _Sender(pipe, line.job)
    with redirect_stdout(printed), redirect_stderr(said):
        code = program(line.words, report)
        said.flush_all()
    return Ended(line.job, code, printed.getvalue())


class _Sender(io.TextIOBase):
    """Sends each line that is written."""

    encoding = "utf-8"

    def __init__(self, pipe: Connection, job: int) -> None:
        self._pipe, self._job, self._begun = pipe, job, ""

    def write(self, text: str) -> int:
        """Keep what is no whole line yet."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            with suppress(OSError):
                self._pipe.send(Said(self._job, line))
        return len(text)

    def flush_all(self) -> None:
        """Send the last line, too."""
        if self._begun:
            self.write("\n")

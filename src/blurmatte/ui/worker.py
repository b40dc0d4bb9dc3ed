"""The worker: a process that runs command lines, one after the other, with everything imported."""

from __future__ import annotations

import io
import os
import queue
import shutil
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import mkdtemp
from typing import TypeAlias

from blurmatte.interrupts import catch_interrupts, interrupted
from blurmatte.ui.helper import end_group

# Runs the words of a command line behind `blurmatte`, and gives each change of its progress as
# (stage, done, of, seconds left); its exit code.
Report: TypeAlias = Callable[[str, int, int | None, float | None], None]
Program: TypeAlias = Callable[[Sequence[str], Report], int]

# What loads, and on a new machine compiles, the kernels that most jobs need.
_SCENE = """
size = [96, 64]
plate = {kind = "colorful", tile = 16}
body = {kind = "ball", radius = 9, color = "#f2a01c"}
path = {kind = "line", start = [28.3, 22.7], end = [68.1, 40.2]}
camera = {code_std = 0.0078}
"""
_WARM_UP = (
    ("render", "scene.toml", "-o", "scene"),
    ("solve", "scene/image.png", "--plate", "scene/plate.png", "-o", "out"),
    ("measure", "out/layer.exr"),
    (
        *("edit", "out/layer.exr", "--image", "scene/image.png", "--plate", "scene/plate.png"),
        *("--fade", "0.5", "-o", "faded.png"),
    ),
)


@dataclass(frozen=True)
class Line:
    """A command line to run."""

    job: int
    words: tuple[str, ...]  # behind `blurmatte`
    shown: tuple[str, ...]  # the same as people see it, without private folders
    renamed: Mapping[str, str]  # of the words that differ, those that are run to those shown


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


def work(pipe: Connection, program: Program, folder: Path) -> None:
    """Warm up, then run each line that comes in the folder; end with the server."""
    catch_interrupts()
    lines: queue.SimpleQueue[Line] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, lines), daemon=True).start()
    _warm_up(program, folder, lines)
    # What a killed job leaves in the folder for temporary files ends with the page. Only now: compiled
    # code that the warm-up kept there is for the next page, too.
    tempfile.tempdir = os.environ["TMPDIR"] = mkdtemp(dir=folder.parent)
    pipe.send(READY)
    while not interrupted():  # the program ends at an interrupt, this process ends here
        line = lines.get()
        pipe.send(_ended(pipe, program, line, folder))
    end_group()


def _listen(pipe: Connection, lines: queue.SimpleQueue[Line]) -> None:
    """Take lines and interrupts; the end of the pipe is the end of the server."""
    while True:
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            end_group()
        if message != INTERRUPT:
            lines.put(message)
        elif hasattr(signal, "pthread_kill"):  # wakes the thread if it waits
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        else:
            signal.raise_signal(signal.SIGINT)


def _warm_up(program: Program, folder: Path, lines: queue.SimpleQueue[Line]) -> None:
    """Solve a small scene, unseen, unless there is something to do."""
    warming = Path(mkdtemp(dir=folder.parent))
    os.chdir(warming)
    Path("scene.toml").write_text(_SCENE, encoding="utf-8")
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), suppress(Exception):
        for words in _WARM_UP:
            if lines.empty():
                program(words, lambda *_: None)
    os.chdir(folder)
    shutil.rmtree(warming, ignore_errors=True)


def _ended(pipe: Connection, program: Program, line: Line, folder: Path) -> Ended:
    """Run a line in the folder."""

    def report(stage: str, done: int, of: int | None, seconds_left: float | None) -> None:
        pipe.send(Step(line.job, stage, done, of, seconds_left))

    os.chdir(folder)
    sys.argv = ["blurmatte", *line.shown]  # which reports name
    printed, said = io.StringIO(), _Sender(pipe, line)
    # Entering forgets which warnings were given before.
    with redirect_stdout(printed), redirect_stderr(said), warnings.catch_warnings():
        code = program(line.words, report)
        said.flush_all()
    return Ended(line.job, code, _renamed(printed.getvalue(), line))


def _renamed(text: str, line: Line) -> str:
    """A text with the names of files as people know them."""
    for ran, shown in line.renamed.items():
        text = text.replace(ran, shown)
    return text


class _Sender(io.TextIOBase):
    """Sends each line that is written."""

    encoding = "utf-8"

    def __init__(self, pipe: Connection, line: Line) -> None:
        self._pipe, self._line, self._begun = pipe, line, ""

    def write(self, text: str) -> int:
        """Keep what is no whole line yet."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            with suppress(OSError):
                self._pipe.send(Said(self._line.job, _renamed(line, self._line)))
        return len(text)

    def flush_all(self) -> None:
        """Send the last line, too."""
        if self._begun:
            self.write("\n")

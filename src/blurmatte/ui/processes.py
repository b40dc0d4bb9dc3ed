"""Processes that serve the page, and end with the server however that ends.

The server imports this module for its messages, so NumPy is imported in the processes alone.
"""

import asyncio
import io
import multiprocessing
import os
import queue
import shutil
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, TypeAlias

from blurmatte.interrupts import catch_interrupts, interrupted, without_interrupts

_SPAWN = multiprocessing.get_context("spawn")
_SECONDS_TO_UNWIND = 1.5  # after an interrupt, before a process is killed
_SECONDS_TO_READ = 1.0  # what a process sent before it ended
_SECONDS_OF_KILLED = 0.3  # in which the other processes of a server that was killed end
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


class Helper:
    """A process and the pipe to it; what it sends goes to `receive`, in the server's event loop.

    Parameters
    ----------
    work : callable
        Runs in the process, with its end of the pipe and `args`; importable by name.
    receive : callable
        Gets each message of the process; None when it has ended.
    """

    def __init__(
        self, work: Callable[..., None], receive: Callable[[Any], None], *args: Any
    ) -> None:
        self._pipe, far = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_alone, args=(work, far, *args), daemon=False)
        with without_interrupts():  # it imports before it can ignore them
            self._process.start()
        far.close()  # else its end would not be noticed
        self._sending, self._is_ended = threading.Lock(), False
        loop = asyncio.get_running_loop()
        self._reader = threading.Thread(target=self._read, args=(loop, receive), daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        assert self._process.pid is not None
        return self._process.pid

    def send(self, message: Any) -> None:
        """Send a message; ignored if the process has ended, which `receive` hears."""
        with self._sending, suppress(OSError, ValueError):
            self._pipe.send(message)

    async def end(self, interrupt: Any = None) -> None:
        """End the process with all that it started; first let it unwind if `interrupt` makes it."""
        if interrupt is not None:
            self.send(interrupt)
            # Not by `join`, which gives its number free while others of its group may live.
            await asyncio.to_thread(wait, [self._process.sentinel], _SECONDS_TO_UNWIND)
        await asyncio.to_thread(self.kill)

    def kill(self) -> None:
        """End the process with all that it started, now."""
        if self._is_ended:
            return
        self._is_ended = True
        if hasattr(os, "killpg"):
            with suppress(OSError):  # it may have no group yet
                os.killpg(self.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self._reader.join(_SECONDS_TO_READ)

    def _read(self, loop: asyncio.AbstractEventLoop, receive: Callable[[Any], None]) -> None:
        """Hand over messages until the process ends.

        Only this thread closes the pipe: its number would else go to another pipe while it is read.
        """
        message: Any = ...
        while message is not None:
            try:
                message = self._pipe.recv()
            except (EOFError, OSError):
                message = None
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(receive, message)
        with self._sending:
            self._pipe.close()


def _alone(work: Callable[..., None], pipe: Connection, *args: Any) -> None:
    """Work in a group of processes of its own, which signals of the terminal do not reach."""
    if hasattr(os, "setsid"):
        os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    work(pipe, *args)


def end_group() -> None:
    """End this process and all that it started."""
    if hasattr(os, "killpg"):
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


@dataclass(frozen=True)
class Question:
    """What the server asks."""

    number: int
    name: str
    values: dict[str, Any]


@dataclass(frozen=True)
class PictureAnswer:
    """Bytes, or numbers, or why there is none."""

    number: int
    data: bytes = b""
    numbers: dict[str, Any] = field(default_factory=dict)
    refusal: str = ""


def look(pipe: Connection, private: Path) -> None:
    """Answer questions until the server ends, and then delete its private folder."""
    from blurmatte.ui.pictures import ShownPictures  # imports all of the library

    pictures = ShownPictures()
    waiting: deque[Question] = deque()
    while True:
        while not waiting or wait([pipe], 0):
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                time.sleep(_SECONDS_OF_KILLED)
                shutil.rmtree(private, ignore_errors=True)
                end_group()
            if isinstance(message, Question):
                waiting.append(message)
            else:
                waiting = deque(one for one in waiting if one.number != message)
        asked = waiting.popleft()
        pipe.send(PictureAnswer(asked.number, *pictures.answer(asked.name, asked.values)))


@dataclass(frozen=True)
class Line:
    """A command line to run."""

    job: int
    words: tuple[str, ...]  # behind `blurmatte`
    shown: tuple[str, ...]  # the same as people see it, without private folders


@dataclass(frozen=True)
class ErrorLine:
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
    for ran, shown in zip(line.words, line.shown, strict=True):
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
                self._pipe.send(ErrorLine(self._line.job, _renamed(line, self._line)))
        return len(text)

    def flush_all(self) -> None:
        """Send the last line, too."""
        if self._begun:
            self.write("\n")

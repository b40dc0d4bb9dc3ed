"""What the command line prints: answers to stdout; progress, warnings and errors to stderr.

An error or a warning is one line that begins with the name of the program and of the file. On a
terminal it is wrapped, and cut after three lines unless details are asked for (`-v`).
"""

from __future__ import annotations

import json
import logging
import re
import shutil
import sys
import textwrap
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, TextIO, TypeVar

import typer

import blurmatte as bm
from blurmatte.interrupts import EXIT_CODE

T = TypeVar("T")

GENERAL = "General"  # the group of options that all commands have

# What is done to solve one picture, as it is logged, in this order; some of it is not always needed.
STAGES = (
    "reading the picture",
    "matching the plate",
    "finding the streak",
    "fitting the sweep",
    "solving alpha",
    "solving alpha without a shape",
    "writing the results",
)

_IN_OPTIONS = (  # Python's names in messages of the library, and what the command line calls them
    (r'\w+="?\w*"? \((--[^)]*)\)', r"\1"),
    (r"\b[a-z]+_[a-z_]+ \((--[^)]*)\)", r"\1"),
    (r", (\w+=|ColorModel\.any\(\))", ""),
    (r"\bexposure_times\b", "--exposures"),
    (r"\b(the )?exposure_time\b", "--exposure"),
    (r"\b(a |the )?line[_ ]time\b(?= (needs|of))|(?<=check )line_time\b", "--line-time"),
)


def argument(metavar: str, help: str) -> Any:
    """An argument of a command."""
    return typer.Argument(metavar=metavar, help=help)


def option(metavar: str, help: str, group: str | None = None, *names: str) -> Any:
    """An option of a command with a value, listed in a group of its help."""
    return typer.Option(
        *names, metavar=metavar, help=help, show_default=False, rich_help_panel=group
    )


def optional(metavar: str, help: str, group: str | None = None, default: Any = None) -> Any:
    """An option with a value, which may be left out: of a command, or of a group, as its field."""
    return field(default=default, metadata={"option": option(metavar, help, group)})


def switch(name: str, help: str, group: str | None = None) -> Any:
    """As `optional`, without a value."""
    return field(default=False, metadata={"option": flag(name, help, group)})


def output(help: str, metavar: str = "FILE") -> Any:
    """The option that names what to write."""
    return option(metavar, help, None, "--out", "-o")


def flag(name: str, help: str, group: str | None = None, *short: str) -> Any:
    """An option of a command without a value."""
    return typer.Option(name, *short, help=help, rich_help_panel=group)


class ExitCode(IntEnum):
    """How a command ends; the table in docs/cli.md."""

    DONE = 0
    UNEXPECTED = 1
    REFUSED = 2
    LOW_GRADE = 3
    INTERRUPTED = EXIT_CODE


@dataclass(frozen=True)
class Verbosity:
    """How much is printed on stderr: `quiet` errors only, `verbose` also stages and tracebacks."""

    quiet: bool = False
    verbose: bool = False

    def __post_init__(self) -> None:
        if self.quiet and self.verbose:
            raise ValueError("give --quiet or --verbose, not both")


_verbosity: ContextVar[Verbosity] = ContextVar("verbosity", default=Verbosity())  # noqa: B039
# What this command said of the encoding of a file, without its name.
_facts: ContextVar[set[str]] = ContextVar("facts", default=set())  # noqa: B039


@contextmanager
def printing(verbosity: Verbosity) -> Iterator[None]:
    """Print that much within this context, and show warnings, and stages that the library logs."""
    token, facts = _verbosity.set(verbosity), _facts.set(set())
    logger, stages = logging.getLogger("blurmatte"), _Stages()
    level = logger.level
    logger.addHandler(stages)
    logger.setLevel(logging.INFO)
    usual = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        """A warning in one line if it is blurmatte's."""
        if issubclass(category, bm.errors.BlurmatteWarning):
            warn(str(message))  # not about a file, else `about` had shown it
        else:
            usual(message, category, *place)

    warnings.showwarning = show  # type: ignore[assignment]
    try:
        yield
    finally:
        warnings.showwarning = usual
        logger.removeHandler(stages)
        logger.setLevel(level)
        _verbosity.reset(token)
        _facts.reset(facts)


class _Stages(logging.Handler):
    """Shows what the library does: behind the spinner, or one line each if details are asked for."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.begun = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Show the stage; print it if details are asked for."""
        if (task := _task.get()) is not None:
            task.stage(record.getMessage(), getattr(record, "counted", None))
        if _verbosity.get().verbose:
            _write(
                f"blurmatte: {time.monotonic() - self.begun:.1f} s: {record.getMessage()}",
                sys.stderr,
            )


def verbosity() -> Verbosity:
    """How much is printed now, for another process."""
    return _verbosity.get()


def say(text: str) -> None:
    """Print an answer, whatever bytes the names of files hold."""
    _write(text.encode("utf-8", "backslashreplace").decode(), sys.stdout)


def say_json(value: Any, indent: int | None = 2) -> None:
    """Print an answer as JSON; null stands for what is not finite."""
    from blurmatte.files.documents import plain  # not for --help

    whole = (sys.stdout.encoding or "").lower().startswith("utf")  # else letters are escaped
    say(json.dumps(plain(value), indent=indent, ensure_ascii=not whole))


def answer(as_json: bool, numbers: Any, lines: Iterable[object]) -> None:
    """Print an answer: its numbers as JSON, or lines for people."""
    if as_json:
        say_json(numbers)
    else:
        say("\n".join(map(str, lines)))


def swatches(model: bm.ColorModel) -> list[str]:
    """The mean color of several, and the possible colors, the likeliest first, as blocks of color.

    On a terminal only.
    """
    if model.rank == 3 or not sys.stdout.isatty():
        return []
    blocks = [[_block(*bytes.fromhex(color[1:])) for color in one.hex] for one in model.possible]
    mean = [_block(*bytes.fromhex(model.color[1:]))] if model.rank == 2 and model.color else []
    return [*mean, *(" ".join(row) for row in zip(*blocks, strict=True))]


def _block(red: int, green: int, blue: int) -> str:
    return typer.style("    ", bg=(red, green, blue))


WITHOUT_HUE = "gray, without a hue"  # the color of an object in gray pictures


def in_degrees(model: bm.ColorModel) -> str:
    """A model in one line: the color that names the object, its rank, and how sure the colors are."""
    if model.rank == 3:
        return model.in_words
    sure = f"± {model.angle_std:.2g}°" if model.evidence else "given"
    return f"{model.in_words}, {sure}"


def color_numbers(model: bm.ColorModel) -> dict[str, Any]:
    """The numbers of a color model, as in report.json, and sentences."""
    numbers = {name: value for name, value in model.numbers().items() if name != "to_srgb"}
    return {**numbers, "in_words": bm.explain(model)}


def grade_lines(solution: bm.Solution) -> list[str]:
    """The grade of an answer with its reasons, in a line; none if it has no grade."""
    from blurmatte.explain.solution import grade_in_words  # imports all of the library

    return grade_in_words(solution)


def by(size: tuple[int, int]) -> str:
    """A size in words: 640x480."""
    return f"{size[0]}x{size[1]}"


def warn(text: str) -> None:
    """Print a warning, unless `--quiet` was given."""
    if not _verbosity.get().quiet:
        complain(f"warning: {text}")


def complain(text: str) -> None:
    """Print one line to stderr, in the language of the command line."""
    line = " ".join(f"blurmatte: {in_options(text)}".split())
    if sys.stderr.isatty():
        width = max(shutil.get_terminal_size().columns - 1, 40)
        most = None if _verbosity.get().verbose else 3
        line = textwrap.fill(
            line, width, subsequent_indent="  ", max_lines=most, placeholder=" … (all of it: -v)",
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
    _write(line, sys.stderr)


def in_options(text: str) -> str:
    """A message of the library in the language of the command line: --color instead of model=."""
    for names, option in _IN_OPTIONS:
        text = re.sub(names, option, text)
    return text


def explain_failure(error: BaseException) -> None:
    """Print the traceback of an error if details are asked for."""
    if _verbosity.get().verbose:
        _write("".join(traceback.format_exception(error)).rstrip(), sys.stderr)


def _write(text: str, stream: TextIO) -> None:
    """To a screen as it is now: what is drawn there meanwhile makes room."""
    typer.echo(text, file=stream if stream.isatty() else None, err=stream is sys.stderr)


def _was_said(line: str) -> bool:
    """Whether a command said this of another file before."""
    fact = line.partition(": ")[2]
    known = fact in _facts.get()
    _facts.get().add(fact)
    return known


class NamedError(bm.BlurmatteError):
    """Its message begins with the name of the file, as that of every FileError does."""


@contextmanager
def about(path: Path) -> Iterator[list[str]]:
    """Name the file in every error and warning within; the list grows by the warnings."""
    said: list[str] = []
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
            """Print a warning of blurmatte once, with the file's name."""
            if not issubclass(category, bm.errors.BlurmatteWarning):
                usual(message, category, *place)
                return
            named = issubclass(category, bm.errors.TransferWarning) or str(message).startswith(
                f"{path}: "
            )
            line = in_options(str(message) if named else f"{path}: {message}")
            if line not in said:
                said.append(line)
                if not (issubclass(category, bm.errors.TransferWarning) and _was_said(line)):
                    warn(line)

        warnings.simplefilter("always", bm.errors.BlurmatteWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        try:
            yield said
        except (bm.errors.FileError, NamedError):
            raise
        except MemoryError as error:
            raise NamedError(f"{path}: too large for the memory; reduce it") from error
        except (bm.BlurmatteError, ValueError, TypeError, OSError) as error:
            raise NamedError(f"{path}: {error}") from error


@dataclass(frozen=True)
class Progress:
    """How far a command is, as a terminal and other programs show it."""

    stage: str
    done: int = 0
    of: int | None = None  # things to do; None if that is not counted
    seconds_left: float | None = None


Listener = Callable[[Progress], None]


@dataclass
class _Task:
    """What is done now; whoever listens gets its progress at every change."""

    listener: Listener
    title: str
    of: int | None
    done: int = 0
    name: str = ""
    # Things done in a stage, of how many, and seconds left
    counted: tuple[int, int, float] | None = None
    begun: float = field(default_factory=time.monotonic)

    def stage(self, name: str, counted: tuple[int, int, float] | None = None) -> None:
        """Say what is done now, which of the stages it is, and how far if that is counted."""
        if name in STAGES:
            name = f"{STAGES.index(name) + 1}/{len(STAGES)} {name}"
        self.name, self.counted = name, counted
        self.report()

    def advance(self) -> None:
        """One thing more is done."""
        self.done += 1
        self.report()

    def report(self) -> None:
        """Give the progress to the listener."""
        done, of, left = self.done, self.of, None
        if self.counted is not None and not of:
            done, of, left = self.counted
        elif self.of and self.done:
            left = (time.monotonic() - self.begun) / self.done * (self.of - self.done)
        counted = self.title if self.of else ""
        stage = ": ".join(filter(None, (counted, self.name))) or self.title
        self.listener(Progress(stage, done, of, left))


_task: ContextVar[_Task | None] = ContextVar("task", default=None)
_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Give progress to a listener within this context, in place of a terminal."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def with_progress(things: Iterable[T], doing: str, count: int | None = None) -> Iterator[T]:
    """Iterate, and show what is done, for how long and, of several things, how far.

    `count` is needed if `things` has no length.
    """
    if count is None:
        assert isinstance(things, Sized)
        count = len(things)
    with _doing(doing, count if count > 1 else None) as task:
        for thing in things:
            yield thing
            if task is not None:
                task.advance()


@contextmanager
def waiting(doing: str) -> Iterator[None]:
    """Show what is done and for how long."""
    with _doing(doing, None):
        yield


@contextmanager
def _doing(doing: str, count: int | None) -> Iterator[_Task | None]:
    """A task, unless nobody looks; within another one a stage of that."""
    if (around := _task.get()) is not None:
        around.stage(doing)
        yield None
        return
    shown: AbstractContextManager[Listener | None] = nullcontext(_listener.get())
    if _listener.get() is None and sys.stderr.isatty() and not _verbosity.get().quiet:
        shown = _bar(doing, count)
    with shown as listener:
        task = None if listener is None else _Task(listener, doing, count)
        token = _task.set(task)
        try:
            if task is not None:
                task.report()
            yield task
        finally:
            _task.reset(token)


@contextmanager
def _bar(doing: str, count: int | None) -> Iterator[Listener]:
    """A spinner on the terminal, or a bar if there is a count."""
    from rich import progress
    from rich.console import Console

    far = (progress.BarColumn(), progress.TaskProgressColumn(), progress.TimeRemainingColumn())
    bar = progress.Progress(
        progress.SpinnerColumn(),
        progress.TextColumn("{task.description}", markup=False),
        *(() if count is None else far),
        progress.TimeElapsedColumn(),
        console=Console(stderr=True, soft_wrap=True),
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # what goes to a file must not come here
    )
    with bar:
        shown = bar.add_task(doing, total=count)
        yield lambda now: bar.update(shown, description=now.stage, completed=now.done)

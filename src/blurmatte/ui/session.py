"""What a page works with: files by number, jobs by number, and the processes that serve it."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path, PurePosixPath
from tempfile import mkdtemp
from typing import Any

from blurmatte.formats import FORMATS, Holds
from blurmatte.ui.helper import Helper
from blurmatte.ui.viewer import Answer, Question, look
from blurmatte.ui.worker import INTERRUPT, READY, Ended, Line, Program, Said, Step, work

MAX_UPLOAD_BYTES = 20 << 30  # of one dropped file
FREE_BYTES = 2 << 30  # of the disk, which dropped files leave
COMMANDS = (
    *(
        "solve",
        "find",
        "color",
        "paints",
        "measure",
        "locate",
        "track",
        "edit",
        "remove",
        "compose",
    ),
    *("sharpen", "stack", "plate", "info", "render"),
)
_MAX_NAME = 120  # characters of a file's name
_REPORTED_SECONDS = 0.1  # between two states that are sent to a page


class RefusedError(ValueError):
    """What was asked is not done; the message says why."""


@dataclass(frozen=True)
class Held:
    """A file that the page may use."""

    number: int
    path: Path
    shown: str  # what a command line calls it
    kind: str  # picture, clip or other

    @property
    def state(self) -> dict[str, Any]:
        """As the page gets it."""
        size = self.path.stat().st_size if self.path.exists() else 0
        return {"number": self.number, "name": self.path.name, "bytes": size, "kind": self.kind}


class State(StrEnum):
    """Of a job."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    REFUSED = "refused"
    CANCELLED = "cancelled"
    FAILED = "failed"


@dataclass
class Job:
    """A command line, and what became of it."""

    number: int
    words: tuple[str, ...]
    shown: tuple[str, ...]
    folder: Path  # of its results
    title: str
    state: State = State.WAITING
    step: Step | None = None
    said: list[str] = field(default_factory=list)
    printed: str = ""
    code: int | None = None
    started: float | None = None
    seconds: float | None = None

    @property
    def ended(self) -> bool:
        """Whether it neither waits nor runs."""
        return self.state not in (State.WAITING, State.RUNNING)

    @property
    def files(self) -> list[str]:
        """Its results, relative to its folder."""
        paths = sorted(p for p in self.folder.rglob("*") if p.is_file() and p.name[0] != ".")
        return [p.relative_to(self.folder).as_posix() for p in paths]

    @property
    def answer(self) -> Any:
        """What it printed, as JSON if it is that; None before its end."""
        if not self.ended:
            return None
        with suppress(ValueError):
            return json.loads(self.printed)
        return self.printed

    @property
    def status(self) -> dict[str, Any]:
        """As the page gets it, without its answer."""
        step = self.step
        return {
            "number": self.number,
            "title": self.title,
            "line": ["blurmatte", *self.shown],
            "state": self.state,
            "code": self.code,
            "stage": None if step is None else step.stage,
            "done": 0 if step is None else step.done,
            "of": None if step is None else step.of,
            "seconds_left": None if step is None else step.seconds_left,
            "seconds": self.seconds,
            "said": self.said,
            "files": self.files if self.ended else [],
        }


class Session:
    """Files and jobs of a page, in private folders that end with it.

    Parameters
    ----------
    program : callable
        Runs command lines, in the worker.
    version : str
        Of the program.
    files : sequence of Path
        Used where they are.
    out : Path, optional
        Where results stay; by default they are deleted at the end.
    """

    def __init__(
        self, program: Program, version: str, files: Sequence[Path] = (), out: Path | None = None
    ) -> None:
        self._program = program
        self.version = version
        self._private = Path(mkdtemp(prefix="blurmatte-"))
        self._dropped = self._private / "files"
        self._dropped.mkdir()
        self._results = (out or self._private / "results").absolute()
        self._results.mkdir(parents=True, exist_ok=True)
        self.keeps_results = out is not None
        self.files: dict[int, Held] = {}
        self.jobs: dict[int, Job] = {}
        self._worker: Helper | None = None
        self._viewer: Helper | None = None
        self.worker_state = "off"
        self._running: Job | None = None
        self._asked: dict[int, asyncio.Future[Answer]] = {}
        self._questions = 0
        self._changed = asyncio.Event()
        self._revision = 0
        for path in files:
            self._hold(path.absolute(), str(path))

    # Files

    def _hold(self, path: Path, shown: str) -> Held:
        held = Held(len(self.files) + 1, path, shown, kind_of(path))
        self.files[held.number] = held
        self._announce()
        return held

    async def receive(self, name: str, pieces: AsyncIterator[bytes], announced: int | None) -> Held:
        """Copy a dropped file, piece by piece; RefusedError if it is too large or cut off."""
        room = self._room()
        if announced is not None and announced > room:
            raise RefusedError(_too_large(room))
        path = self._new_path(name)
        part = path.with_name(f".{path.name}.part")
        count = 0
        try:
            with part.open("xb") as file:
                async for piece in pieces:
                    count += len(piece)
                    if count > room:
                        raise RefusedError(_too_large(room))
                    await asyncio.to_thread(file.write, piece)
            if announced is not None and count != announced:
                raise RefusedError(f"{path.name}: {count} of {announced} bytes came; drop it again")
            if count == 0:
                raise RefusedError(f"{path.name}: is empty; drop another file")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return self._hold(path, path.name)

    def _room(self) -> int:
        """Bytes that may be dropped."""
        return min(MAX_UPLOAD_BYTES, shutil.disk_usage(self._dropped).free - FREE_BYTES)

    def _new_path(self, name: str) -> Path:
        """A path in the private folder for a file of that name; RefusedError if it is none."""
        name = PurePosixPath(name.replace("\\", "/")).name
        name = "".join(c for c in name if c.isprintable() and c not in '<>:"|?*').lstrip(".-")
        if not name:
            raise RefusedError("the file has no name; give it one")
        stem, dot, ending = name[-_MAX_NAME:].rpartition(".")
        stem, ending = (stem, f".{ending}") if dot else (ending, "")
        taken = {held.path.name for held in self.files.values()}
        taken |= {p.name.strip(".").removesuffix(".part") for p in self._dropped.iterdir()}
        names = (stem + (f"-{k}" if k else "") + ending for k in range(len(taken) + 1))
        return self._dropped / next(one for one in names if one not in taken)

    def source(self, file: int | None, job: int | None, name: str | None) -> Path:
        """A file, or a result of a job; RefusedError if there is none."""
        if file is not None:
            if file not in self.files:
                raise RefusedError(f"there is no file {file}; drop it again")
            return self.files[file].path
        if job not in self.jobs or name not in self.jobs[job].files:
            raise RefusedError(f"job {job} has no result {name}; choose one of its list")
        return self.jobs[job].folder / name

    # Jobs

    def add(self, words: Sequence[Any], title: str) -> Job:
        """Queue a command line; RefusedError if its words are none.

        Each word is a text; `{"file": number}`; `{"job": number, "name": result}`, where the result may
        be a row, layer.######.exr, or empty, the folder of an earlier job; or `{"out": name}`, a result
        of this job or, empty, its folder.
        """
        number = len(self.jobs) + 1
        if not words or words[0] not in COMMANDS:
            raise RefusedError(f"a job is one of the commands {', '.join(COMMANDS)}")
        folder = self._results / self._folder_name(number)
        pairs = [self._word(word, folder) for word in words]
        ran, shown = (tuple(column) for column in zip(*pairs, strict=True))
        folder.mkdir()
        job = self.jobs[number] = Job(number, ran, shown, folder, title[:_MAX_NAME])
        self._next()
        return job

    def _folder_name(self, number: int) -> str:
        """Of the results of a job; with `--out` those of earlier pages stay."""
        earlier = [int(p.name) for p in self._results.iterdir() if p.name.isdigit()]
        return str(max(earlier, default=0) + 1) if self.keeps_results else str(number)

    def _word(self, word: Any, folder: Path) -> tuple[str, str]:
        """A word as it is run, and as it is shown."""
        match word:
            case str():
                value = word.partition("=")[2] if word.startswith("--") else word
                parts = PurePosixPath(value.replace("\\", "/"))
                if parts.is_absolute() or ".." in parts.parts or value[:1] == "~" or "\0" in word:
                    raise RefusedError(
                        f"{word!r} names a file by its path; choose it by its number"
                    )
                return word, word
            case {"file": int(number)}:
                path = self.source(number, None, None)
                return str(path), self.files[number].shown
            case {"job": int(number), "name": str(name)}:
                job = self.jobs.get(number)
                if job is not None and (not name or _is_row(name, job.files)):
                    path = job.folder / name
                else:
                    path = self.source(None, number, name)
                return self._relative(path), self._relative(path)
            case {"out": str(name)}:
                path = (folder / name).resolve()
                if not path.is_relative_to(folder.resolve()):
                    raise RefusedError(f"{name!r} is no name of a result")
                return self._relative(folder / name), self._relative(folder / name)
        raise RefusedError(f"a word of a command line is a text or an object, got {word!r}")

    def _relative(self, path: Path) -> str:
        return path.relative_to(self._results).as_posix()

    async def cancel(self, job: Job) -> None:
        """End a job; what a killed command leaves is left."""
        if job.state is State.WAITING:
            job.state = State.CANCELLED
            self._announce()
        elif job.state is State.RUNNING:
            job.state = State.CANCELLED
            await self._restart_worker()

    def resume(self, job: Job) -> None:
        """Queue an ended job again, in its folder; a clip goes on by its manifest."""
        if not job.ended:
            raise RefusedError(f"job {job.number} has not ended; cancel it first")
        job.state, job.said, job.printed, job.step = State.WAITING, [], "", None
        self._next()

    def _next(self) -> None:
        """Run the first job that waits, if the worker is free."""
        self._announce()
        waiting = next((j for j in self.jobs.values() if j.state is State.WAITING), None)
        if waiting is None or self._running is not None or self.worker_state != "ready":
            return
        assert self._worker is not None
        self._running, waiting.state, waiting.started = waiting, State.RUNNING, time.monotonic()
        line = Line(waiting.number, waiting.words, waiting.shown, self._results)
        self._worker.send(line)

    def _hear_worker(self, message: Any) -> None:
        """Take what the worker sent."""
        match message:
            case None:
                self._lose_worker()
            case str(word) if word == READY:
                self.worker_state = "ready"
                self._next()
            case Step(job=number):
                self.jobs[number].step = message
                self._announce()
            case Said(job=number, text=text):
                self.jobs[number].said.append(text)
                self._announce()
            case Ended(job=number, code=code, printed=printed):
                job, self._running = self.jobs[number], None
                job.code, job.printed = code, printed
                self._close(job, {0: State.DONE, 3: State.DONE, 2: State.REFUSED})
                self._next()

    def _close(self, job: Job, states: dict[int | None, State]) -> None:
        if job.state is State.RUNNING:
            job.state = states.get(job.code, State.FAILED)
        job.seconds = None if job.started is None else time.monotonic() - job.started

    def _lose_worker(self) -> None:
        """The worker died: its job failed, unless it was cancelled; start another one."""
        job, self._running = self._running, None
        if self.worker_state in ("off", "ending"):
            return
        if job is not None:
            job.code = None
            job.said.append("blurmatte: the process died, perhaps for want of memory; try again")
            self._close(job, {})
        died_warm = self.worker_state == "ready"
        self.worker_state = "off"
        if died_warm:
            self._start_worker()
        self._announce()

    async def _restart_worker(self) -> None:
        job, self.worker_state = self._running, "ending"
        self._announce()
        if self._worker is not None:
            await self._worker.end(INTERRUPT)
        if job is not None:
            self._close(job, {})
        self._running = None
        self._start_worker()

    # Processes

    def open(self) -> None:
        """Start the processes, unless they run."""
        if self.worker_state == "off":
            self._start_worker()
        if self._viewer is None:
            self._viewer = Helper(look, self._hear_viewer, self._private)

    def _start_worker(self) -> None:
        self.worker_state = "starting"
        worker = Helper(work, self._of_worker(), self._program)
        self._worker = worker
        self._announce()

    def _of_worker(self) -> Callable[[Any], None]:
        """What hears one worker, and nothing of those before."""
        serial = object()
        self._serial = serial

        def hear(message: Any) -> None:
            if self._serial is serial:
                self._hear_worker(message)

        return hear

    async def ask(self, question: str, **values: Any) -> Answer:
        """Ask the viewer; RefusedError if it cannot answer."""
        self.open()
        assert self._viewer is not None
        self._questions += 1
        number = self._questions
        future: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._asked[number] = future
        self._viewer.send(Question(number, question, values))
        try:
            answer = await future
        finally:
            self._asked.pop(number, None)
            if future.cancelled():
                self._viewer.send(number)  # nobody waits for it
        if answer.refusal:
            raise RefusedError(answer.refusal)
        return answer

    def _hear_viewer(self, message: Any) -> None:
        """Take an answer of the viewer; if it died, start another one with the next question."""
        if message is None:
            self._viewer = None
            for number, future in self._asked.items():
                if not future.done():
                    died = "the viewer died, perhaps for want of memory; try again"
                    future.set_result(Answer(number, b"", {}, died))
            return
        asked = self._asked.get(message.number)
        if asked is not None and not asked.done():
            asked.set_result(message)

    async def close(self) -> None:
        """End the processes, and delete what is private."""
        self._serial, self.worker_state = object(), "ending"
        for helper in (self._worker, self._viewer):
            if helper is not None:
                await helper.end()
        shutil.rmtree(self._private, ignore_errors=True)

    # States

    def _announce(self) -> None:
        self._revision += 1
        self._changed.set()

    @property
    def state(self) -> dict[str, Any]:
        """All that a page shows of the session."""
        return {
            "version": self.version,
            "worker": self.worker_state,
            "keeps_results": self.keeps_results,
            "files": [held.state for held in self.files.values()],
            "jobs": [job.status for job in self.jobs.values()],
        }

    async def states(self) -> AsyncIterator[dict[str, Any]]:
        """The state now, and after each change."""
        seen = -1
        while True:
            if self._revision != seen:
                seen = self._revision
                yield self.state
                await asyncio.sleep(_REPORTED_SECONDS)
                continue
            self._changed.clear()
            await self._changed.wait()


def _is_row(name: str, names: Sequence[str]) -> bool:
    """Whether it is the pattern of a row of these names: layer.######.exr."""
    pattern = re.compile(re.escape(name).replace(r"\#", r"\d"))
    return "#" in name and any(pattern.fullmatch(one) for one in names)


def kind_of(path: Path) -> str:
    """Picture, clip or other, by the extension, which decides what the page offers first."""
    ending = path.suffix.lower().lstrip(".")
    for form in FORMATS:
        if f".{ending}" in form.extensions:
            if form.one_picture:
                return "picture"
            return "clip" if form.holds is Holds.CLIP else "other"
    return "other"


def _too_large(room: int) -> str:
    return (
        f"the file is larger than the {max(room, 0) / 2**30:.1f} GB that can be copied; name it in the "
        "terminal instead: blurmatte ui FILE"
    )

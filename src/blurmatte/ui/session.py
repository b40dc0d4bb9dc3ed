"""What a page works with: files by number, jobs by number, and the processes that serve it."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import stat
import threading
import time
import unicodedata
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn

from blurmatte.formats import Holds, format_at
from blurmatte.ui.private_folder import PrivateFolder, delete_left_folders
from blurmatte.ui.processes import (
    INTERRUPT,
    READY,
    Ended,
    ErrorLine,
    Helper,
    Line,
    PictureAnswer,
    Program,
    Question,
    Step,
    look,
    work,
)

MAX_UPLOAD_BYTES = 20 << 30  # of one dropped file
FREE_BYTES = 2 << 30  # of the disk, which dropped files leave
COMMANDS = (
    *("solve", "find", "color", "paints", "measure", "locate", "track", "edit", "remove"),
    *("compose", "sharpen", "stack", "plate", "info", "render"),
)
_MAX_TITLE = 120  # letters
_MAX_NAME_BYTES = 180  # of a dropped file, in UTF-8: file systems take 255 with what is added to it
_MAX_ENDING_BYTES = 20
_MAX_SAID = 1000  # lines that are kept of a job's warnings
_REPORTED_SECONDS = 0.1  # between two states that are sent to a page
_BEAT_SECONDS = 1.0  # between two states of a job that runs, if nothing else changes
_DEVICES = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)(\.|$)", re.I)
_FRACTION = re.compile(r"\d[\d.]*/\d[\d.]*")
_DIED = "blurmatte: the process died, perhaps for want of memory; try again"


class RefusedError(ValueError):
    """What was asked is not done; the message says why."""


@dataclass(frozen=True)
class PageFile:
    """A file that the page may use."""

    number: int
    path: Path
    shown: str  # what a command line calls it
    kind: str  # picture, clip or other

    @property
    def state(self) -> dict[str, Any]:
        """As the page gets it."""
        size = 0
        with suppress(OSError):  # it was deleted
            size = self.path.stat().st_size
        return {"number": self.number, "name": self.path.name, "bytes": size, "kind": self.kind}


class JobState(StrEnum):
    """Of a job."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    REFUSED = "refused"
    CANCELLED = "cancelled"
    FAILED = "failed"


class WorkerState(StrEnum):
    """Of the process that runs jobs."""

    OFF = "off"
    STARTING = "starting"
    READY = "ready"
    ENDING = "ending"


@dataclass
class Job:
    """A command line, and what became of it."""

    number: int
    words: tuple[str, ...]
    shown: tuple[str, ...]
    folder: Path  # of its results
    title: str
    state: JobState = JobState.WAITING
    step: Step | None = None
    stepped: float = 0.0  # when, as the times below on the monotonic clock
    said: list[str] = field(default_factory=list)
    printed: str = ""
    code: int | None = None
    started: float | None = None
    took: float | None = None  # seconds
    listed: list[str] = field(default_factory=list)  # its results at its end

    @property
    def ended(self) -> bool:
        """Whether it neither waits nor runs."""
        return self.state not in (JobState.WAITING, JobState.RUNNING)

    @property
    def files(self) -> list[str]:
        """Its results, relative to its folder."""
        return self.listed if self.ended else results_in(self.folder)

    @property
    def answer(self) -> Any:
        """What it printed, as JSON if it is that; None before its end."""
        if not self.ended:
            return None
        with suppress(ValueError, RecursionError):
            return json.loads(self.printed, parse_constant=_refuse)
        return self.printed

    @property
    def status(self) -> dict[str, Any]:
        """As the page gets it, without its answer."""
        step, seconds, left = self.step, self.took, None
        if self.state is JobState.RUNNING and self.started is not None:
            seconds = time.monotonic() - self.started
        if step is not None and step.seconds_left is not None:
            left = max(step.seconds_left - (time.monotonic() - self.stepped), 0.0)
        return {
            "number": self.number,
            "title": self.title,
            "line": ["blurmatte", *self.shown],
            "state": self.state,
            "code": self.code,
            "stage": None if step is None else step.stage,
            "done": 0 if step is None else step.done,
            "of": None if step is None else step.of,
            "seconds_left": left,
            "seconds": seconds,
            "said": self.said,
            "files": self.listed if self.ended else [],
        }

    def say(self, line: str) -> None:
        """Keep a line that it printed on stderr, unless there are too many."""
        if len(self.said) < _MAX_SAID:
            self.said.append(line)
        elif len(self.said) == _MAX_SAID:
            self.said.append("blurmatte: more lines are not shown")

    def end(self, state: JobState) -> None:
        """Nothing more comes of it, for now."""
        self.state, self.step, self.listed = state, None, results_in(self.folder)
        self.took = None if self.started is None else time.monotonic() - self.started

    def again(self) -> None:
        """Wait as a new one does."""
        self.state, self.said, self.printed, self.listed = JobState.WAITING, [], "", []
        self.step = self.code = self.started = self.took = None


class Session:
    """Files and jobs of a page, and the processes that serve it, in an `async with` statement.

    Its folder is private and is deleted at the end. Jobs run in it: there dropped files and results
    have the names that their command lines show.

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
        self._out = out
        self._place: PrivateFolder | None = None
        self._private = self._folder = Path()
        self._results = Path()  # a folder of each job
        self.files: dict[int, PageFile] = {}
        self.jobs: dict[int, Job] = {}
        self._worker: Helper | None = None
        self._viewer: Helper | None = None
        self.worker_state = WorkerState.OFF
        self._running: Job | None = None
        self._restart: asyncio.Task[None] | None = None
        self._asked: dict[int, asyncio.Future[PictureAnswer]] = {}
        self._questions = 0
        self._changed = asyncio.Event()
        self._revision = 0
        self._is_ending = False
        for path in files:
            self._hold(path.absolute(), str(path))

    async def __aenter__(self) -> Session:
        """Make the folders, and start the processes; OSError if that is impossible."""
        if self._out is not None:
            self._out.mkdir(parents=True, exist_ok=True)
        self._place = PrivateFolder()
        self._private = self._place.path
        self._folder = self._private / "files"
        self._results = self._folder if self._out is None else self._out.absolute()
        try:
            self._folder.mkdir()
            self._viewer = Helper(look, self._hear_viewer, self._private)
            self._start_worker()
        except BaseException:
            await self.__aexit__()
            raise
        threading.Thread(target=delete_left_folders, daemon=True).start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """End the processes, and delete what is private; the viewer does so if this is cut short."""
        self.end_states()
        self._deafen_worker(WorkerState.ENDING)
        if self._restart is not None:
            await asyncio.wait([self._restart])
        if self._worker is not None:
            await self._worker.end()
        if self._place is not None:
            await asyncio.to_thread(self._place.delete)
        if self._viewer is not None:
            await self._viewer.end()

    def write_entry(self, address: str) -> Path:
        """A private page that leads a browser to the address, until it is asked for something."""
        assert self._place is not None
        return self._place.write_entry(address)

    def remove_entry(self) -> None:
        """Delete the page that leads to the address."""
        if self._place is not None:
            self._place.remove_entry()

    # Files

    def _hold(self, path: Path, shown: str) -> PageFile:
        held = PageFile(len(self.files) + 1, path, shown, kind_of(path))
        self.files[held.number] = held
        self._announce()
        return held

    async def receive(
        self, name: str, pieces: AsyncIterator[bytes], announced: int | None
    ) -> PageFile:
        """Copy a dropped file, piece by piece; RefusedError if it is too large or cut off."""
        if announced is not None and announced > self.room:
            raise RefusedError(_too_large(self.room))
        path = self._new_path(name)
        part = path.with_name(f".{path.name}.part")
        count = 0
        try:
            with part.open("xb") as file:
                async for piece in pieces:
                    count += len(piece)
                    if count > MAX_UPLOAD_BYTES or len(piece) > self.room:
                        raise RefusedError(_too_large(self.room))
                    await asyncio.to_thread(file.write, piece)
            if announced is not None and count != announced:
                raise RefusedError(f"{path.name}: {count} of {announced} bytes came; drop it again")
            if count == 0:
                raise RefusedError(f"{path.name}: is empty; drop another file")
            part.replace(path)
        except OSError as error:
            raise RefusedError(f"{path.name}: cannot be copied: {error.strerror}") from error
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        return self._hold(path, path.name)

    @property
    def room(self) -> int:
        """Bytes that a dropped file may have now."""
        free = 0
        with suppress(OSError):  # the folder was deleted
            free = shutil.disk_usage(self._folder).free
        return max(0, min(MAX_UPLOAD_BYTES, free - FREE_BYTES))

    def _new_path(self, name: str) -> Path:
        """A path in the private folder for a file of that name; RefusedError if it is none."""
        name = unicodedata.normalize("NFC", PurePosixPath(name.replace("\\", "/")).name)
        name = "".join(c for c in name if c.isprintable() and c not in '<>:"|?*')
        name = name.lstrip(" .-~").rstrip(" .")
        if not name:
            raise RefusedError("the file has no name; give it one")
        if _DEVICES.match(name):
            name = f"_{name}"
        stem, dot, ending = name.rpartition(".")
        if not dot or len(ending.encode()) > _MAX_ENDING_BYTES:
            stem, ending = name, ""
        stem = stem.encode()[:_MAX_NAME_BYTES].decode(errors="ignore")
        taken = [held.path.name for held in self.files.values()]
        taken += [p.name.removesuffix(".part").lstrip(".") for p in self._folder.iterdir()]
        folded = {one.casefold() for one in taken}  # on some file systems A and a are one name
        names = (
            f"{stem}{f'-{k}' if k else ''}{dot if ending else ''}{ending}"
            for k in range(len(folded) + 1)
        )
        return self._folder / next(one for one in names if one.casefold() not in folded)

    def source(self, file: int | None, job: int | None, name: str | None) -> Path:
        """A file, or a result of a job; RefusedError if there is none."""
        if file is not None:
            if file not in self.files:
                raise RefusedError(f"there is no file {file}; drop it again")
            return self.files[file].path
        if job in self.jobs and name in self.jobs[job].files:
            folder = self.jobs[job].folder
            if (folder / name).resolve() == folder.resolve() / name and (folder / name).is_file():
                return folder / name
        raise RefusedError(f"job {job} has no result {name}; choose one of its list")

    # Jobs

    def add(self, words: Sequence[Any], title: str) -> Job:
        """Queue a command line; RefusedError if its words are none.

        Each word is a text; `{"file": number}`; `{"job": number, "name": result}`, where the result may
        be a row, layer.######.exr, or empty, the folder of an earlier job; or `{"out": name}`, a result
        of this job or, empty, its folder.
        """
        if not words or words[0] not in COMMANDS:
            raise RefusedError(f"a job is one of the commands {', '.join(COMMANDS)}")
        number = len(self.jobs) + 1
        try:
            folder = self._new_folder()
            pairs = [self._word(word, folder) for word in words]
            folder.mkdir()
        except OSError as error:
            raise RefusedError(
                f"{self._results}: no folder can be made: {error.strerror}"
            ) from error
        ran, shown = (tuple(column) for column in zip(*pairs, strict=True))
        job = self.jobs[number] = Job(number, ran, shown, folder, _text(title)[:_MAX_TITLE])
        self._next()
        return job

    def _new_folder(self) -> Path:
        """Of the results of a job: the next number, for with `--out` those of earlier pages stay."""
        names = [path.name for path in self._results.iterdir()]
        numbers = [int(name) for name in names if name.isascii() and name.isdecimal()]
        return self._results / str(max(numbers, default=0) + 1)

    def _word(self, word: Any, folder: Path) -> tuple[str, str]:
        """A word as it is run, and as it is shown."""
        match word:
            case str():
                plain = _FRACTION.sub("", _text(word))  # an exposure as 1/60 is no path
                if any(c in plain for c in "/\\") or ".." in plain:
                    raise RefusedError(
                        f"{word!r} names a file by its path; choose it by its number"
                    )
                return word, word
            case {"file": int(number)}:
                path = self.source(number, None, None)
                return self._ran(path), self.files[number].shown
            case {"job": int(number), "name": str(name)}:
                job = self.jobs.get(number)
                if job is not None and (not name or _is_row(name, job.files)):
                    path = job.folder / name
                else:
                    path = self.source(None, number, name)
                return self._ran(path), self._shown(path)
            case {"out": str(name)}:
                path = folder / _text(name)
                if not path.resolve().is_relative_to(folder.resolve()) or name[:1] == ".":
                    raise RefusedError(f"{name!r} is no name of a result")
                return self._ran(path), self._shown(path)
        raise RefusedError(f"a word of a command line is a text or an object, got {word!r}")

    def _ran(self, path: Path) -> str:
        """What the worker calls a file: by its name if it lies where jobs run."""
        inside = path.is_relative_to(self._folder)
        return path.relative_to(self._folder).as_posix() if inside else str(path)

    def _shown(self, path: Path) -> str:
        """What people call a result: as they gave `--out`."""
        return str((self._out or Path()) / path.relative_to(self._results))

    async def cancel(self, job: Job) -> None:
        """End a job; what a killed command leaves is left."""
        if job.state is JobState.WAITING:
            job.end(JobState.CANCELLED)
            self._announce()
        elif job.state is JobState.RUNNING:
            self._deafen_worker(WorkerState.ENDING)  # also to the end of the job, if that comes now
            job.end(JobState.CANCELLED)
            self._announce()
            self._restart = asyncio.create_task(self._restarted(job))
            await asyncio.shield(self._restart)

    def resume(self, job: Job) -> None:
        """Queue an ended job again, in its folder; a clip continues by its manifest."""
        if not job.ended:
            raise RefusedError(f"job {job.number} has not ended; cancel it first")
        job.again()
        self._next()

    def _next(self) -> None:
        """Run the first job that waits, if the worker is free."""
        self._announce()
        waiting = next((j for j in self.jobs.values() if j.state is JobState.WAITING), None)
        if waiting is None or self._running is not None or self._is_ending:
            return
        if self.worker_state is WorkerState.OFF:
            self._start_worker()
        if self.worker_state is WorkerState.ENDING:
            return
        assert self._worker is not None
        self._running, waiting.state, waiting.started = waiting, JobState.RUNNING, time.monotonic()
        if self.worker_state is WorkerState.STARTING:
            waiting.step = Step(waiting.number, "getting ready", 0, None, None)
        self._worker.send(Line(waiting.number, waiting.words, waiting.shown))

    def _hear_worker(self, message: Any) -> None:
        """Take what the worker sent."""
        match message:
            case None:
                self._lose_worker()
            case str(word) if word == READY:
                self.worker_state = WorkerState.READY
                self._next()
            case Step(job=number):
                self.jobs[number].step, self.jobs[number].stepped = message, time.monotonic()
                self._announce()
            case ErrorLine(job=number, text=text):
                self.jobs[number].say(text)
                self._announce()
            case Ended(job=number, code=code, printed=printed):
                job, self._running = self.jobs[number], None
                job.code, job.printed = code, printed
                job.end(_STATES.get(code, JobState.FAILED))
                self._next()

    # Processes

    def _start_worker(self) -> None:
        self.worker_state = WorkerState.STARTING
        self._worker = Helper(work, self._of_worker(), self._program, self._folder)
        self._announce()

    def _of_worker(self) -> Callable[[Any], None]:
        """What hears one worker, and nothing of those before."""
        serial = self._serial = object()

        def hear(message: Any) -> None:
            if self._serial is serial:
                self._hear_worker(message)

        return hear

    def _deafen_worker(self, state: WorkerState) -> None:
        """Hear nothing more of the worker, which has nothing to do any more."""
        self._serial, self._running, self.worker_state = object(), None, state

    def _lose_worker(self) -> None:
        """The worker died, and with it the job; one that was ready is replaced.

        One that dies while it gets ready is not, before there is another job: the next would die, too.
        """
        was, job, worker = self.worker_state, self._running, self._worker
        self._deafen_worker(WorkerState.OFF)
        if worker is not None:
            worker.kill()  # what it had started
        lost = [one for one in self.jobs.values() if one.state is JobState.WAITING]
        for one in [
            *([] if job is None else [job]),
            *(lost if was is WorkerState.STARTING else []),
        ]:
            one.say(_DIED)
            one.end(JobState.FAILED)
        if was is WorkerState.READY:
            self._start_worker()
        self._next()

    async def _restarted(self, job: Job) -> None:
        """End the worker with its job, and warm another."""
        if self._worker is not None:
            await self._worker.end(INTERRUPT)
        job.listed = results_in(job.folder)
        self.worker_state = WorkerState.OFF
        if not self._is_ending:
            self._start_worker()
            self._next()

    async def ask(self, question: str, **values: Any) -> PictureAnswer:
        """Ask the viewer; RefusedError if it cannot answer."""
        if self._viewer is None and not self._is_ending:
            self._viewer = Helper(look, self._hear_viewer, self._private)
        if self._viewer is None or self._is_ending:
            raise RefusedError("the page is closed; start blurmatte ui again")
        self._questions += 1
        number = self._questions
        future: asyncio.Future[PictureAnswer] = asyncio.get_running_loop().create_future()
        self._asked[number] = future
        viewer = self._viewer
        viewer.send(Question(number, question, values))
        try:
            answer = await future
        finally:
            self._asked.pop(number, None)
            if future.cancelled():
                viewer.send(number)  # nobody waits for it
        if answer.refusal:
            raise RefusedError(answer.refusal)
        return answer

    def _hear_viewer(self, message: Any) -> None:
        """Take an answer of the viewer; if it died, start another one with the next question."""
        if message is None:
            if self._viewer is not None and not self._is_ending:
                self._viewer.kill()
                self._viewer = None
            died = "the viewer died, perhaps for want of memory; try again"
            for number, future in self._asked.items():
                if not future.done():
                    future.set_result(PictureAnswer(number, refusal=died))
            return
        asked = self._asked.get(message.number)
        if asked is not None and not asked.done():
            asked.set_result(message)

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
            "keeps_results": self._out is not None,
            "room": self.room,
            "files": [held.state for held in self.files.values()],
            "jobs": [job.status for job in self.jobs.values()],
        }

    async def states(self) -> AsyncIterator[dict[str, Any]]:
        """The state now, after each change, and every second while a job runs, until the end."""
        while not self._is_ending:
            seen = self._revision
            yield self.state
            await asyncio.sleep(_REPORTED_SECONDS)
            while self._revision == seen:
                self._changed.clear()
                try:
                    beat = None if self._running is None else _BEAT_SECONDS
                    await asyncio.wait_for(self._changed.wait(), beat)
                except TimeoutError:
                    break

    def end_states(self) -> None:
        """Let the requests that wait for a change end."""
        self._is_ending = True
        self._announce()


_STATES = {
    0: JobState.DONE,
    3: JobState.DONE,
    2: JobState.REFUSED,
}  # of exit codes; others are failures


def results_in(folder: Path) -> list[str]:
    """The files of a folder, relative to it; links, which may lead out, and hidden ones are none."""
    found = []
    for root, folders, names in os.walk(folder):  # follows no links
        folders[:] = [name for name in folders if name[0] != "."]
        for name in names:
            path = Path(root, name)
            with suppress(OSError):
                if name[0] != "." and stat.S_ISREG(path.lstat().st_mode):
                    found.append(path.relative_to(folder).as_posix())
    return sorted(found)


def _is_row(name: str, names: Sequence[str]) -> bool:
    """Whether it is the pattern of a row of these names: layer.######.exr."""
    pattern = re.compile(re.escape(name).replace(r"\#", r"\d"))
    return "#" in name and any(pattern.fullmatch(one) for one in names)


def kind_of(path: Path) -> str:
    """Picture, clip or other, which decides what the page offers first."""
    form = format_at(path)
    if form is None:
        return "other"
    if form.one_picture:
        return "picture"
    return "clip" if form.holds is Holds.CLIP else "other"


def _text(text: str) -> str:
    """A text; RefusedError if it is none that can be written or name a file."""
    with suppress(UnicodeError):
        if "\0" not in text and text.encode() is not None:
            return text
    raise RefusedError("a text holds letters that are none")


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no JSON")


def _too_large(room: int) -> str:
    return (
        f"the file is larger than the {max(room, 0) / 2**30:.1f} GB that can be copied; name it in the "
        "terminal instead: blurmatte ui FILE"
    )

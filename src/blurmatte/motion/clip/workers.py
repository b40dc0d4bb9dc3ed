"""Workers: processes that share the frames of a clip.

They are those of `concurrent.futures`, not of joblib: with its loky, too, a task of a killed process
must be submitted again, interrupts ignored and the work sent once: only `_save` and `_loaded` would go.

The log says how far a stage is; programs and terminals show it.
"""

from __future__ import annotations

import concurrent.futures
import ctypes
import logging
import mmap
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from blurmatte.errors import BlurmatteError
from blurmatte.interrupts import without_interrupts
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import CodedSequence

FRAMES_PER_TASK = 10, 50  # of a clip that each process opens itself, at least and at most
TASKS_PER_WORKER = 2  # at least, if there are enough frames
MAX_ATTEMPTS = 3  # of a task whose process dies
RETRIES = 2  # of a task whose worker of a cluster is lost
_ALIGNMENT = 64  # bytes, of arrays in a file
_M_MMAP_THRESHOLD = -3  # its number in malloc.h
_MMAP_THRESHOLD_BYTES = 2 << 20

Result = TypeVar("Result")
T = TypeVar("T")

LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage, and after each frame

_work: tuple[Path, Callable[..., Any]] | None = None


class Workers:
    """Processes that share work, in a `with` statement.

    They start in the background, in about a second. Programs that use more than one need the usual
    `if __name__ == "__main__":`.

    Parameters
    ----------
    count : int
        Number of processes; 1 is this process alone, unless there is an executor.
    executor : Executor, optional
        Does the work instead of processes of this machine, such as that of a Dask client
        (`client.get_executor(retries=2)`). It stays open.
    folder : str or Path, optional
        Where all workers read what the tasks share; needed if they run on other machines.

    Raises
    ------
    ValueError
        If the count is less than 1.

    Examples
    --------
    >>> with bm.motion.Workers(1) as workers:
    ...     rows = bm.measure_clip(frames[:3], plate, solution.model, workers=workers)
    """

    def __init__(
        self,
        count: int,
        executor: concurrent.futures.Executor | None = None,
        folder: str | Path | None = None,
    ) -> None:
        if not isinstance(count, int) or count < 1:  # type: ignore[redundant-expr]
            raise ValueError(f"workers must be at least 1, got {count!r}")
        self.count = count
        self._executor = executor
        self._parent = folder
        self._pool: concurrent.futures.ProcessPoolExecutor | None = None
        self._folder: TemporaryDirectory[str] | None = None
        self._sent_count = 0

    def __enter__(self) -> Workers:
        if self._executor is None and self.count > 1:
            with without_interrupts():  # processes inherit it, and import for a second
                for _ in range(self.count):
                    self._started().submit(int)  # a process starts with its first task
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
        if self._folder is not None:
            self._folder.cleanup()

    def in_order(
        self, work: Callable[..., Result], tasks: Iterable[tuple[Any, ...]], waiting: int = 2
    ) -> Iterator[Result]:
        """Results of `work` for each task, in order.

        Parameters
        ----------
        work : callable
            Sent to each process once.
        tasks : iterable of tuple
            Its arguments; a few of them are in memory at a time.
        waiting : int
            Tasks in memory for each process, 1 or more. Tasks that are running when the iteration is
            stopped are wasted.
        """
        yield from successes(self.outcomes(work, tasks, waiting))

    def over(
        self,
        frames: Sequence[LinearImage],
        work: Callable[..., Result],
        parts: Iterable[tuple[Any, ...]],
        waiting: int = 2,
    ) -> Iterator[Result | Failure]:
        """As `outcomes`, for parts of a clip, which is sent to each process once.

        Parameters
        ----------
        frames : sequence of LinearImage
            Each process opens a clip itself; pictures in memory are sent with each part.
        work : callable
            Gets the frames of a part first.
        parts : iterable of tuple
            A slice of the frames, and more arguments of the work.
        waiting
            As in `in_order`.
        """
        if isinstance(frames, CodedSequence):
            return self.outcomes(partial(_on_part, frames, work), parts, waiting)
        return self.outcomes(work, ((frames[which], *more) for which, *more in parts), waiting)

    def outcomes(
        self, work: Callable[..., Result], tasks: Iterable[tuple[Any, ...]], waiting: int = 2
    ) -> Iterator[Result | Failure]:
        """As `in_order`, with a `Failure` for each task that raised, or whose process died repeatedly.

        Tasks of a process that was killed are done again.
        """
        if self.count == 1 and self._executor is None:
            for task in tasks:
                yield _attempted(work, task)
            return
        path, pending = self._sent(work), deque[_Pending]()
        try:
            for task in tasks:
                pending.append(self._submitted(path, task))
                if len(pending) >= waiting * self.count:
                    yield self._outcome(path, pending)
            while pending:
                yield self._outcome(path, pending)
        finally:
            for one in pending:
                one.future.cancel()

    def _outcome(self, path: Path, pending: deque[_Pending]) -> Any:
        """The result of the first pending task, which is removed."""
        while True:
            one = pending.popleft()
            try:
                return one.future.result()
            except concurrent.futures.BrokenExecutor as error:
                self._pool = None
                if one.attempt >= MAX_ATTEMPTS or self._executor is not None:
                    return Failure(one.task, error)
                again = [replace(one, attempt=one.attempt + 1), *pending]
                pending.clear()
                pending.extend(
                    replace(self._submitted(path, old.task), attempt=old.attempt) for old in again
                )
            except Exception as error:
                return Failure(one.task, error)

    def _submitted(self, path: Path, task: tuple[Any, ...]) -> _Pending:
        shared = self._executor is None  # another machine may lose the file of a work that ended
        try:
            return _Pending(task, self._started().submit(_do, path, shared, *task))
        except concurrent.futures.BrokenExecutor:
            self._pool = None  # a process died while the tasks before were waited for
            return _Pending(task, self._started().submit(_do, path, shared, *task))

    def _started(self) -> concurrent.futures.Executor:
        if self._executor is not None:
            return self._executor
        if self._pool is None:
            # A process that is forked from one with threads may hang.
            context = multiprocessing.get_context("spawn")
            self._pool = concurrent.futures.ProcessPoolExecutor(self.count, context, _begin)
        return self._pool

    def _sent(self, work: Callable[..., Any]) -> Path:
        """File from which each process reads the work once: plates are too large for each task."""
        if self._folder is None:
            self._folder = TemporaryDirectory(
                prefix=".blurmatte-", dir=self._parent, ignore_cleanup_errors=True
            )
        self._sent_count += 1
        path = Path(self._folder.name).absolute() / str(self._sent_count)
        _save(path, work)
        return path


@contextmanager
def cluster_workers(scheduler: Any, folder: str | Path) -> Iterator[Workers]:
    """The workers of a Dask cluster; needs the `cluster` extra.

    Parameters
    ----------
    scheduler : str or distributed.Client
        Its address, such as "tcp://host:8786", or a client, which stays open.
    folder : str or Path
        On a disk that all machines reach by the same path; inputs and results are there, too.

    Raises
    ------
    BlurmatteError
        If `distributed` is not installed.
    ValueError
        If the cluster has no workers.

    Examples
    --------
    >>> from distributed import Client  # doctest: +SKIP
    >>> client = Client("tcp://host:8786")  # doctest: +SKIP
    >>> with bm.clips.cluster_workers(client, "/shared/rally") as workers:  # doctest: +SKIP
    ...     events = list(bm.save_clip(run, "/shared/rally", workers))
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise BlurmatteError('a cluster needs: pip install "blurmatte[cluster]"') from error
    client = scheduler if isinstance(scheduler, Client) else Client(scheduler)
    try:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise ValueError(f"the scheduler {scheduler} has no workers; start some: dask worker")
        Path(folder).mkdir(parents=True, exist_ok=True)
        executor = client.get_executor(retries=RETRIES)
        with Workers(threads, executor, folder) as workers:
            yield workers
    finally:
        if client is not scheduler:
            client.close()


@dataclass(frozen=True)
class Failure:
    """A task without a result.

    Parameters
    ----------
    task : tuple
        Its arguments.
    error : Exception
    """

    task: tuple[Any, ...]
    error: Exception


@dataclass(frozen=True)
class _Pending:
    task: tuple[Any, ...]
    future: concurrent.futures.Future[Any]
    attempt: int = 1


def _attempted(work: Callable[..., Result], task: tuple[Any, ...]) -> Result | Failure:
    try:
        return work(*task)
    except Exception as error:
        return Failure(task, error)


def _on_part(frames: Any, work: Callable[..., Any], which: slice, *more: Any) -> Any:
    """The result of a work on a part of a clip."""
    return work(frames[which], *more)


def spread_out(items: Sequence[T], count: int, starts: Iterable[float]) -> Iterator[Sequence[T]]:
    """About so many items from all over a sequence at a time, then others between them.

    Starts are fractions of the distance between items.
    """
    step = -(-len(items) // count) or 1
    for first in dict.fromkeys(int(step * start) for start in starts):
        yield items[first::step]


def successes(outcomes: Iterable[Result | Failure]) -> Iterator[Result]:
    """Results of tasks; the error of the first that failed is raised."""
    for outcome in outcomes:
        if isinstance(outcome, Failure):
            raise outcome.error
        yield outcome


def parts_of(
    frames: Sequence[LinearImage], workers: Workers, skip: int = 0
) -> Iterator[tuple[slice, int]]:
    """Parts of a clip for `Workers.over`, each with the index of its first frame."""
    rest = len(frames) - skip
    if isinstance(frames, CodedSequence):
        least, most = FRAMES_PER_TASK
        length = min(max(rest // (TASKS_PER_WORKER * workers.count), least), most)
        parts = frames.parts(skip, length)
    else:  # pictures in memory are sent one by one
        parts = (slice(index, index + 1) for index in range(skip, len(frames)))
    yield from ((which, which.start) for which in parts)


def shared(workers: int | Workers) -> AbstractContextManager[Workers]:
    """The given workers, which stay open, or new ones that a `with` statement closes."""
    return nullcontext(workers) if isinstance(workers, Workers) else Workers(workers)


def _begin() -> None:
    # An interrupt reaches all processes of a terminal. A worker that dies with a lock of the pool would
    # block the main process; the main process ends the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)  # there are as many processes as cores
    return_freed_memory()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def return_freed_memory() -> None:
    """Let this process return the memory of arrays at once; glibc keeps that of 32 MB and less."""
    _call_glibc("mallopt", _M_MMAP_THRESHOLD, _MMAP_THRESHOLD_BYTES)


def trim_memory() -> None:
    """Return memory that was freed, and lies between blocks in use, to the system."""
    _call_glibc("malloc_trim", 0)


def _call_glibc(name: str, *arguments: int) -> None:
    if sys.platform == "linux":
        with suppress(AttributeError):  # of other C libraries
            getattr(ctypes.CDLL(None), name)(*arguments)


def _end_with_parent() -> None:
    """A main process that is killed cannot end its workers."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(path: Path, shared: bool, *task: Any) -> Any:
    global _work
    work = _work
    if work is None or work[0] != path:
        _work = work = None  # frees its memory first
        _work = work = path, _loaded(path, shared)
    return work[1](*task)


def _save(path: Path, work: Any) -> None:
    """Write a work; its arrays lie behind it, where `_loaded` maps them."""
    arrays: list[pickle.PickleBuffer] = []
    data = pickle.dumps(work, protocol=5, buffer_callback=arrays.append)
    views = [array.raw() for array in arrays]
    head = pickle.dumps((len(data), [view.nbytes for view in views]))
    with path.open("wb") as file:
        parts: list[Any] = [len(head).to_bytes(_ALIGNMENT, "little"), head, data, *views]
        for part in parts:
            file.write(bytes(-file.write(part) % _ALIGNMENT))


def _loaded(path: Path, shared: bool) -> Any:
    """The work of a file. Processes of one machine may share the memory of its arrays."""
    with path.open("rb") as file:
        if shared:
            whole = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        else:
            whole = memoryview(bytearray(path.stat().st_size))
            file.readinto(whole)

    def part(start: int, size: int) -> tuple[memoryview, int]:
        """A part of the file, and where the next one begins."""
        return whole[start : start + size], start + size + -size % _ALIGNMENT

    head, at = part(_ALIGNMENT, int.from_bytes(whole[:_ALIGNMENT], "little"))
    size, sizes = pickle.loads(head)
    data, at = part(at, size)
    arrays = []
    for size in sizes:
        array, at = part(at, size)
        arrays.append(array)
    return pickle.loads(data, buffers=arrays)


def logged(things: Iterable[T], stage: str, count: int) -> Iterator[T]:
    """The same; the log says how many are done and when all will be, in words and as `counted`."""
    begun = time.monotonic()
    LOG.info(stage)
    for done, thing in enumerate(things, 1):
        seconds = (time.monotonic() - begun) * (count - done) / done
        counted = {"counted": (done, count, seconds)}
        LOG.info(f"{stage}: {done} of {count}, {seconds:.0f} s remain", extra=counted)
        yield thing

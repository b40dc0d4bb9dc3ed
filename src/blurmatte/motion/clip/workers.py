"""Workers: processes that share the frames of a clip."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from multiprocessing import resource_tracker
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import CodedSequence

FRAMES_PER_TASK = 10  # of a clip that each process opens itself
MAX_ATTEMPTS = 3  # of a task whose process dies

Answer = TypeVar("Answer")

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
    """

    def __init__(
        self,
        count: int,
        executor: concurrent.futures.Executor | None = None,
        folder: str | Path | None = None,
    ) -> None:
        if not isinstance(count, int) or count < 1:
            raise ValueError(f"workers must be at least 1, got {count!r}")
        self.count = count
        self._executor = executor
        self._parent = folder
        self._pool: concurrent.futures.ProcessPoolExecutor | None = None
        self._folder: TemporaryDirectory[str] | None = None
        self._sent_count = 0

    def __enter__(self) -> Workers:
        if self._executor is None and self.count > 1:
            with _without_interrupts():  # processes inherit it, and import for a second
                for _ in range(self.count):
                    self._started().submit(int)  # a process starts with its first task
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
        if self._folder is not None:
            self._folder.cleanup()

    def in_order(
        self,
        work: Callable[..., Answer],
        tasks: Iterable[tuple[Any, ...]],
        waiting: int = 2,
    ) -> Iterator[Answer]:
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
        for outcome in self.outcomes(work, tasks, waiting):
            if isinstance(outcome, Failure):
                raise outcome.error
            yield outcome

    def outcomes(
        self,
        work: Callable[..., Answer],
        tasks: Iterable[tuple[Any, ...]],
        waiting: int = 2,
    ) -> Iterator[Answer | Failure]:
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
                if one.attempt >= MAX_ATTEMPTS or self._executor is not None:
                    self._pool = None
                    return Failure(one.task, error)
                self._pool = None
                again = [replace(one, attempt=one.attempt + 1), *pending]
                pending.clear()
                pending.extend(
                    replace(self._submitted(path, old.task), attempt=old.attempt) for old in again
                )
            except Exception as error:
                return Failure(one.task, error)

    def _submitted(self, path: Path, task: tuple[Any, ...]) -> _Pending:
        try:
            return _Pending(task, self._started().submit(_do, path, *task))
        except concurrent.futures.BrokenExecutor:
            self._pool = None  # a process died while the tasks before were waited for
            return _Pending(task, self._started().submit(_do, path, *task))

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
            self._folder = TemporaryDirectory(prefix=".blurmatte-", dir=self._parent)
        self._sent_count += 1
        path = Path(self._folder.name).absolute() / str(self._sent_count)
        path.write_bytes(pickle.dumps(work, pickle.HIGHEST_PROTOCOL))
        return path


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


def _attempted(work: Callable[..., Answer], task: tuple[Any, ...]) -> Answer | Failure:
    try:
        return work(*task)
    except Exception as error:
        return Failure(task, error)


def tasks_of(
    frames: Sequence[LinearImage], skip: int = 0
) -> Iterator[tuple[Sequence[LinearImage], slice, int]]:
    """Parts of a clip: frames, which of them, and the index of the first.

    Clips are opened by each process; pictures in memory are sent to it one by one.
    """
    if isinstance(frames, CodedSequence):
        for first in range(skip, len(frames), FRAMES_PER_TASK):
            yield frames, slice(first, min(first + FRAMES_PER_TASK, len(frames))), first
        return
    for index in range(skip, len(frames)):
        yield frames[index : index + 1], slice(None), index


def shared(workers: int | Workers) -> AbstractContextManager[Workers]:
    """The given workers, which stay open, or new ones that a `with` statement closes."""
    return nullcontext(workers) if isinstance(workers, Workers) else Workers(workers)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    # An interrupt reaches all processes of a terminal. A worker that dies with a lock of the pool would
    # block the main process; the main process ends the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)  # there are as many processes as cores
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A main process that is killed cannot end its workers."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(path: Path, *task: Any) -> Any:
    global _work
    if _work is None or _work[0] != path:
        _work = path, pickle.loads(path.read_bytes())
    return _work[1](*task)

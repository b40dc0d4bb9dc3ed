"""Workers: processes that share the frames of a clip."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

Answer = TypeVar("Answer")

_work: tuple[Path, Callable[..., Any]] | None = None


class Workers:
    """Processes that share work, in a `with` statement.

    They start in the background, in about a second. Programs that use more than one need the usual
    `if __name__ == "__main__":`.

    Parameters
    ----------
    count : int
        Number of processes; 1 is this process alone.

    Raises
    ------
    ValueError
        If it is less than 1.
    """

    def __init__(self, count: int) -> None:
        if not isinstance(count, int) or count < 1:
            raise ValueError(f"workers must be at least 1, got {count!r}")
        self.count = count
        self._pool: concurrent.futures.ProcessPoolExecutor | None = None
        self._folder: TemporaryDirectory[str] | None = None
        self._sent_count = 0

    def __enter__(self) -> Workers:
        for _ in range(self.count if self.count > 1 else 0):
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
        if self.count == 1:
            for task in tasks:
                yield work(*task)
            return
        pool, path = self._started(), self._sent(work)
        pending: deque[concurrent.futures.Future[Answer]] = deque()
        try:
            for task in tasks:
                pending.append(pool.submit(_do, path, *task))
                if len(pending) >= waiting * self.count:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()

    def _started(self) -> concurrent.futures.ProcessPoolExecutor:
        if self._pool is None:
            # A process that is forked from one with threads may hang.
            context = multiprocessing.get_context("spawn")
            self._pool = concurrent.futures.ProcessPoolExecutor(
                self.count, context, _ignore_interrupts
            )
        return self._pool

    def _sent(self, work: Callable[..., Any]) -> Path:
        """File from which each process reads the work once: plates are too large for each task."""
        if self._folder is None:
            self._folder = TemporaryDirectory()
        self._sent_count += 1
        path = Path(self._folder.name) / str(self._sent_count)
        path.write_bytes(pickle.dumps(work, pickle.HIGHEST_PROTOCOL))
        return path


def shared(workers: int | Workers) -> AbstractContextManager[Workers]:
    """The given workers, which stay open, or new ones that a `with` statement closes."""
    return nullcontext(workers) if isinstance(workers, Workers) else Workers(workers)


def _ignore_interrupts() -> None:
    # An interrupt reaches all processes of a terminal. A worker that dies with a lock of the pool would
    # block the main process; the main process ends the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(path: Path, *task: Any) -> Any:
    global _work
    if _work is None or _work[0] != path:
        _work = path, pickle.loads(path.read_bytes())
    return _work[1](*task)

"""Workers: processes that share the frames of a clip."""

import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

Answer = TypeVar("Answer")

_WAITING = 2  # tasks for each process: frames that are held in memory

_work: tuple[Path, Callable[..., Any]] | None = None


class Workers:
    """Processes that share work, for the time of a `with`.

    Each takes a second to start; what comes before the work goes on meanwhile. Programs that ask for
    more than one need the usual `if __name__ == "__main__":`.

    Parameters
    ----------
    count : int
        How many; 1 is this process alone.

    Raises
    ------
    ValueError
        If that is less than 1.
    """

    def __init__(self, count: int) -> None:
        if not isinstance(count, int) or count < 1:
            raise ValueError(f"workers must be at least 1, got {count!r}")
        self.count = count
        self._pool: ProcessPoolExecutor | None = None
        self._folder: TemporaryDirectory[str] | None = None
        self._works = 0

    def __enter__(self) -> "Workers":
        for _ in range(self.count if self.count > 1 else 0):
            self._started().submit(_ready)
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
        waiting: int = _WAITING,
    ) -> Iterator[Answer]:
        """What `work` makes of each task, in order.

        Parameters
        ----------
        work : callable
            Sent to each process once.
        tasks : iterable of tuple
            Its arguments; a few of them are in memory at a time.
        waiting : int
            How many for each process, 1 or more. What is left over when nobody asks for more is done
            in vain.
        """
        if self.count == 1:
            for task in tasks:
                yield work(*task)
            return
        pool, place = self._started(), self._sent(work)
        given: deque[Future[Answer]] = deque()
        try:
            for task in tasks:
                given.append(pool.submit(_do, place, *task))
                if len(given) >= waiting * self.count:
                    yield given.popleft().result()
            while given:
                yield given.popleft().result()
        finally:
            for left in given:
                left.cancel()

    def _started(self) -> "ProcessPoolExecutor":
        if self._pool is None:
            from concurrent.futures import ProcessPoolExecutor
            from multiprocessing import get_context

            # A process that was forked from one with threads may hang.
            self._pool = ProcessPoolExecutor(self.count, get_context("spawn"), _begin)
        return self._pool

    def _sent(self, work: Callable[..., Any]) -> Path:
        """Where each process reads the work, once: plates are too large to go with each task."""
        if self._folder is None:
            self._folder = TemporaryDirectory()
        self._works += 1
        place = Path(self._folder.name) / str(self._works)
        place.write_bytes(pickle.dumps(work, pickle.HIGHEST_PROTOCOL))
        return place


def shared(workers: int | Workers) -> AbstractContextManager[Workers]:
    """Those that were given, which go on, or as many new ones for the time of a `with`."""
    return nullcontext(workers) if isinstance(workers, Workers) else Workers(workers)


def _begin() -> None:
    # An interrupt reaches all processes of a terminal. One that dies of it holding a lock of the pool
    # would let the first wait forever; it is the first that ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _ready() -> None:
    """Nothing: a process starts when there is something for it to do."""


def _do(place: Path, *task: Any) -> Any:
    global _work
    if _work is None or _work[0] != place:
        _work = place, pickle.loads(place.read_bytes())
    return _work[1](*task)

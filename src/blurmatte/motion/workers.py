"""in_order: one function over many frames, by several processes, in order."""

import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

Answer = TypeVar("Answer")

_WAITING = 2  # frames for each process: what is held in memory

_work: Callable[..., Any] | None = None


def in_order(
    work: Callable[..., Answer], tasks: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[Answer]:
    """What `work` makes of each task, in order.

    Parameters
    ----------
    work : callable
        Sent to each process once.
    tasks : iterable of tuple
        Its arguments; a few of them are in memory at a time.
    workers : int
        1: in this process.
    """
    if workers == 1:
        for task in tasks:
            yield work(*task)
        return
    from concurrent.futures import Future, ProcessPoolExecutor
    from multiprocessing import get_context

    # A process that was forked from one with threads may hang.
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, (work,)) as pool:
        waiting: deque[Future[Answer]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(_do, *task))
                if len(waiting) >= _WAITING * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for left in waiting:
                left.cancel()


def _begin(work: Callable[..., Any]) -> None:
    global _work
    _work = work
    # An interrupt reaches all processes of a terminal. One that dies of it holding a lock of the pool
    # would let the first wait forever; it is the first that ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(*task: Any) -> Any:
    assert _work is not None
    return _work(*task)

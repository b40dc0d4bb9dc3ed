"""Jobs in worker processes, each with a limit of CPU time that native code cannot ignore.

A worker arms the system's timer of CPU time (ITIMER_PROF) around what is limited. When it runs out,
OutOfTime is raised, and the worker continues with its next job. If native code does not return, the
system's limit of CPU time (RLIMIT_CPU) ends the process, and another one takes its place. Unix only.
"""

import os
import resource
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from threading import Thread
from traceback import format_exc
from typing import Any, TypeVar

# Threads of linear algebra would wait for each other, and change the order of sums.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_SPAWN = get_context("spawn")
_PROGRESS_S = 10.0  # between two lines

# Relative error of the CPU time of a process that the system samples at its ticks, for the limit
_TICK_ERROR = 0.1


T = TypeVar("T")


@dataclass(frozen=True)
class Ended:
    """A worker that ended within its job.

    Parameters
    ----------
    exit_code : int
        Of the process; negative: the signal that ended it.
    """

    exit_code: int

    @property
    def by_limit(self) -> bool:
        """Whether its CPU time ran out."""
        return self.exit_code == -signal.SIGXCPU


class OutOfTime(BaseException):
    """The CPU time of a job ran out; no Exception, which what is stopped might catch."""


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Raise OutOfTime if what is done within takes more CPU time, all threads together.

    If that has not come through after as long again, the system ends this process.
    """
    stopped = False

    def stop(*_: object) -> None:
        nonlocal stopped
        stopped = True
        raise OutOfTime

    before = signal.signal(signal.SIGPROF, stop)
    soft, hard = resource.getrlimit(resource.RLIMIT_CPU)
    last = (
        ceil((1 + _TICK_ERROR) * time.process_time() + 2 * seconds) + 1
    )  # the system counts whole seconds
    resource.setrlimit(resource.RLIMIT_CPU, (last, hard))
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    except SystemError as error:  # of a compiled kernel that returned while it was raised
        if not stopped:
            raise
        raise OutOfTime from error
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def run_each(
    function: Callable[[Any], Any], jobs: Iterable[Any], processes: int
) -> Iterator[tuple[Any, Any]]:
    """Jobs and what became of them, a result or `Ended`, in the order in which they end.

    Parameters
    ----------
    function : callable
        Of a module: job to result. What it raises ends the run.
    jobs : iterable
    processes : int
        1 or more.

    Raises
    ------
    RuntimeError
        If a worker cannot start.
    """
    for name in _ONE_THREAD:
        os.environ[name] = "1"
    waiting = iter(jobs)
    workers: list[_Worker] = []
    try:
        for job in waiting:
            workers.append(_Worker.start(function, job))
            if len(workers) == processes:
                break
        while workers:
            ready = set(wait([worker.connection for worker in workers]))
            for worker in [w for w in workers if w.connection in ready]:
                workers.remove(worker)
                result = worker.result()
                yield worker.job, result
                workers += worker.following(function, result, waiting)
    finally:
        for worker in workers:
            worker.process.kill()


def with_progress(
    results: Iterable[T], count: int, noun: str, answered: Callable[[T], bool]
) -> Iterator[T]:
    """The same, and now and then a line of how many there are, and how many have an answer."""
    start = shown = time.monotonic()
    answers = 0
    for n, result in enumerate(results, 1):
        yield result
        answers += answered(result)
        now = time.monotonic()
        if now - shown >= _PROGRESS_S or n == count:
            shown, rate = now, 60 * n / max(now - start, 1e-3)
            left = (count - n) / rate
            print(
                f"{n} of {count} {noun}, {answers} answered, {rate:.1f} a minute, "
                f"{left:.0f} minutes left",
                flush=True,
            )


@dataclass(frozen=True, eq=False)
class _Worker:
    """A process that is busy with a job."""

    process: Any
    connection: Connection
    job: Any

    @classmethod
    def start(cls, function: Callable[[Any], Any], job: Any) -> "_Worker":
        ours, theirs = _SPAWN.Pipe()
        process = _SPAWN.Process(target=_serve, args=(theirs, function), daemon=True)
        process.start()
        theirs.close()
        try:
            ours.recv()  # it has imported what it needs
        except EOFError:
            process.join()
            raise RuntimeError(
                f"a worker process could not start: it ended with code {process.exitcode}; "
                "its own message is above"
            ) from None
        ours.send(job)
        return cls(process, ours, job)

    def result(self) -> Any:
        """That of the job, or how the process ended within it."""
        try:
            result = self.connection.recv()
        except EOFError:
            self.process.join()
            return Ended(self.process.exitcode)
        if isinstance(result, _Raised):
            raise RuntimeError(f"job {self.job}") from result.error
        return result

    def following(
        self, function: Callable[[Any], Any], result: Any, waiting: Iterator[Any]
    ) -> list["_Worker"]:
        """The worker of the next job: this one if it is alive; none if no job waits."""
        for job in waiting:
            if isinstance(result, Ended):
                return [_Worker.start(function, job)]
            self.connection.send(job)
            return [_Worker(self.process, self.connection, job)]
        self.connection.close()
        return []


@dataclass(frozen=True)
class _Raised:
    error: Exception


def _serve(connection: Connection, function: Callable[[Any], Any]) -> None:
    """Do jobs until the connection is closed."""
    Thread(target=_end_with_parent, daemon=True).start()
    connection.send("ready")
    while True:
        try:
            job = connection.recv()
        except EOFError:
            os._exit(0)  # nothing is left to write, and libraries complain at a usual exit
        try:
            result = function(job)
        except Exception as error:
            error.add_note(format_exc())  # where it was raised is not pickled
            result = _Raised(error)
        connection.send(result)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

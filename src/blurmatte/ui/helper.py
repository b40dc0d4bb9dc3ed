"""Processes that serve the page, and end with the server however that ends."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from blurmatte.interrupts import without_interrupts

_SPAWN = multiprocessing.get_context("spawn")
_SECONDS_TO_UNWIND = 1.5  # after an interrupt, before a process is killed
_SECONDS_TO_READ = 1.0  # what a process sent before it ended


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

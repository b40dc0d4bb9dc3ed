"""Processes that serve the page, and end with the server however that ends."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

_SPAWN = multiprocessing.get_context("spawn")
_SECONDS_TO_UNWIND = 1.5  # after an interrupt, before a process is killed


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
        self._process.start()
        far.close()  # else its end would not be noticed
        loop = asyncio.get_running_loop()
        reader = threading.Thread(target=_read, args=(self._pipe, loop, receive), daemon=True)
        reader.start()

    @property
    def pid(self) -> int:
        """Of the process."""
        assert self._process.pid is not None
        return self._process.pid

    def send(self, message: Any) -> None:
        """Send a message; ignored if the process has ended, which `receive` hears."""
        with suppress(OSError, ValueError):
            self._pipe.send(message)

    async def end(self, interrupt: Any = None) -> None:
        """End the process with all that it started; first let it unwind if `interrupt` makes it."""
        if interrupt is not None:
            self.send(interrupt)
            await asyncio.to_thread(self._process.join, _SECONDS_TO_UNWIND)
        await asyncio.to_thread(self.kill)

    def kill(self) -> None:
        """End the process with all that it started, now."""
        if hasattr(os, "killpg"):
            with suppress(OSError):  # its group outlives it while it has members
                os.killpg(self.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _alone(work: Callable[..., None], pipe: Connection, *args: Any) -> None:
    """Work in a group of processes of its own, which signals of the terminal do not reach."""
    if hasattr(os, "setsid"):
        os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    work(pipe, *args)


def end_group() -> None:
    """End this process and all that it started."""
    if hasattr(os, "killpg"):
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


def _read(
    pipe: Connection, loop: asyncio.AbstractEventLoop, receive: Callable[[Any], None]
) -> None:
    """Hand over messages until the process ends."""
    message: Any = ...
    while message is not None:
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            message = None
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(receive, message)

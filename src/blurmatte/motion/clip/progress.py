"""logged: how far a stage is, in the log; programs and terminals show it."""

import logging
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

LOG = logging.getLogger("blurmatte")  # INFO at the beginning of each stage, and after each frame


def logged(things: Iterable[T], stage: str, count: int) -> Iterator[T]:
    """The same; the log says how many are done and when all will be, in words and as `counted`."""
    begun = time.monotonic()
    LOG.info(stage)
    for done, thing in enumerate(things, 1):
        seconds = (time.monotonic() - begun) * (count - done) / done
        counted = {"counted": (done, count, seconds)}
        LOG.info(f"{stage}: {done} of {count}, {seconds:.0f} s remain", extra=counted)
        yield thing

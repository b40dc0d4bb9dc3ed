"""The viewer: a process that answers what the page asks of pictures.

The server imports it for its messages, so NumPy is imported only in the process.
"""

from __future__ import annotations

import shutil
import time
from collections import deque
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from blurmatte.ui.helper import end_group

_SECONDS_OF_KILLED = 0.3  # in which the other processes of a server that was killed end


@dataclass(frozen=True)
class Question:
    """What the server asks."""

    number: int
    name: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Looked:
    """An answer: bytes, or numbers, or why there is none."""

    number: int
    data: bytes = b""
    numbers: dict[str, Any] = field(default_factory=dict)
    refusal: str = ""


def look(pipe: Connection, private: Path) -> None:
    """Answer questions until the server ends, and then delete its private folder."""
    from blurmatte.ui.pictures import ShownPictures  # imports all of the library

    pictures = ShownPictures()
    waiting: deque[Question] = deque()
    while True:
        while not waiting or wait([pipe], 0):
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                time.sleep(_SECONDS_OF_KILLED)
                shutil.rmtree(private, ignore_errors=True)
                end_group()
            if isinstance(message, Question):
                waiting.append(message)
            else:
                waiting = deque(one for one in waiting if one.number != message)
        asked = waiting.popleft()
        pipe.send(Looked(asked.number, *pictures.answer(asked.name, asked.values)))

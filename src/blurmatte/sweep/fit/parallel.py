"""thread_map: the same done with several things at once, on all cores.

Nearly all of a descent is compiled code, which lets go of the interpreter.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")


def thread_map(function: Callable[[S], T], things: Iterable[S]) -> list[T]:
    """What a function says of each, in their order; the first exception is raised."""
    several = list(things)
    if len(several) < 2:
        return [function(thing) for thing in several]
    with ThreadPoolExecutor(min(cpu_count() or 1, len(several))) as threads:
        return list(threads.map(function, several))

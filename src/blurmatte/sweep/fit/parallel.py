"""thread_map: a function applied to several arguments at once, on all cores.

Fits run mostly in compiled code, which releases the interpreter's lock.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")


def thread_map(function: Callable[[S], T], things: Iterable[S]) -> list[T]:
    """Results of a function in the order of its arguments; the first exception is raised."""
    several = list(things)
    if len(several) < 2:
        return [function(thing) for thing in several]
    with ThreadPoolExecutor(min(cpu_count() or 1, len(several))) as threads:
        return list(threads.map(function, several))

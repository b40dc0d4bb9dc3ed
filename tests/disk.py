"""A disk that is full, for tests of files that are written completely or not at all."""

import resource
from contextlib import contextmanager


@contextmanager
def room_for(size):
    """A disk that is full after `size` bytes of any one file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

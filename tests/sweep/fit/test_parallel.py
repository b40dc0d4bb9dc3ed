"""The same done with several things at once."""

from threading import Barrier, get_ident

import pytest

from blurmatte.sweep import thread_map as module
from blurmatte.sweep.fit.parallel import thread_map


def test_answers_come_in_the_order_of_the_things():
    """invariant: whichever is done first."""
    assert thread_map(lambda x: x * x, iter(range(20))) == [x * x for x in range(20)]
    assert thread_map(abs, []) == []


def test_things_are_done_at_once(monkeypatch):
    """invariant: each waits here until the other has begun."""
    monkeypatch.setattr(module, "cpu_count", lambda: 2)
    both = Barrier(2, timeout=10)
    assert sorted(thread_map(lambda _: both.wait(), range(2))) == [0, 1]


def test_one_thing_needs_no_thread():
    """invariant"""
    assert thread_map(lambda _: get_ident(), [0]) == [get_ident()]


def test_what_fails_says_so():
    """door"""
    with pytest.raises(ZeroDivisionError):
        thread_map(lambda x: 1 // x, [1, 0, 2])

"""The same done with several things at once."""

from threading import Barrier, get_ident

import pytest

from blurmatte.sweep import side_by_side as module
from blurmatte.sweep.side_by_side import side_by_side


def test_answers_come_in_the_order_of_the_things():
    """invariant: whichever is done first."""
    assert side_by_side(lambda x: x * x, iter(range(20))) == [x * x for x in range(20)]
    assert side_by_side(abs, []) == []


def test_things_are_done_at_once(monkeypatch):
    """invariant: each waits here until the other has begun."""
    monkeypatch.setattr(module, "cpu_count", lambda: 2)
    both = Barrier(2, timeout=10)
    assert sorted(side_by_side(lambda _: both.wait(), range(2))) == [0, 1]


def test_one_thing_needs_no_thread():
    """invariant"""
    assert side_by_side(lambda _: get_ident(), [0]) == [get_ident()]


def test_what_fails_says_so():
    """door"""
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda x: 1 // x, [1, 0, 2])

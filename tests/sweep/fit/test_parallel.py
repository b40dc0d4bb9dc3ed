"""thread_map: order, concurrency, exceptions."""

from threading import Barrier, get_ident

import pytest

from blurmatte.sweep.fit import parallel
from blurmatte.sweep.fit.parallel import thread_map


def test_results_keep_the_order_of_the_arguments():
    """invariant: in any order of completion."""
    assert thread_map(lambda x: x * x, iter(range(20))) == [x * x for x in range(20)]
    assert thread_map(abs, []) == []


def test_calls_run_concurrently(monkeypatch):
    """invariant: each waits until the other has begun."""
    monkeypatch.setattr(parallel, "cpu_count", lambda: 2)
    both = Barrier(2, timeout=10)
    assert sorted(thread_map(lambda _: both.wait(), range(2))) == [0, 1]


def test_a_single_call_runs_in_the_calling_thread():
    """invariant"""
    assert thread_map(lambda _: get_ident(), [0]) == [get_ident()]


def test_exceptions_are_raised():
    """door"""
    with pytest.raises(ZeroDivisionError):
        thread_map(lambda x: 1 // x, [1, 0, 2])

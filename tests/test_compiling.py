"""The cache of compiled kernels, and threads that run them."""

import os
import subprocess
import sys
from threading import Barrier, get_ident

import pytest

from blurmatte.compiling import in_threads

KERNEL = """
from blurmatte.compiling import njit
@njit(nogil=True)
def twice(x):
    return 2 * x
"""
USE = "import kernel; print(kernel.twice(21), *kernel.twice.stats.cache_hits.values())"


def answer(folder, **environment):
    """What a process prints that runs the kernel: its result, and hits of the cache."""
    command = [sys.executable, "-c", USE]
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    inherited = {key: x for key, x in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    env = inherited | {"PYTHONPATH": path, **environment}
    return subprocess.run(command, env=env, capture_output=True, text=True)


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_damaged_cache_is_rebuilt(tmp_path, ending):
    """Exact: compiled again where a byte is wrong or the end is missing, then found again."""
    (tmp_path / "kernel.py").write_text(KERNEL)
    cache = tmp_path / "cache"
    assert answer(tmp_path, NUMBA_CACHE_DIR=str(cache)).stdout.split() == ["42"]
    assert answer(tmp_path, NUMBA_CACHE_DIR=str(cache)).stdout.split() == ["42", "1"]
    (file,) = cache.rglob(f"*.{ending}")
    whole = file.read_bytes()
    middle = len(whole) // 2
    flipped = whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :]
    for damaged in (flipped, whole[:middle]):
        file.write_bytes(damaged)
        assert answer(tmp_path, NUMBA_CACHE_DIR=str(cache)).stdout.split() == ["42"]
        assert answer(tmp_path, NUMBA_CACHE_DIR=str(cache)).stdout.split() == ["42", "1"]


def test_cache_moves_if_no_folder_can_be_written(tmp_path):
    """Exact: to the folder for temporary files, with one warning; files stand where folders would."""
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "__pycache__").touch()
    (tmp_path / "home").touch()
    (tmp_path / "tmp").mkdir()
    home = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), str(tmp_path / "home"))
    home["TMPDIR"] = str(tmp_path / "tmp")
    first, second = (answer(tmp_path, **home, PYTHONDONTWRITEBYTECODE="1") for _ in range(2))
    assert (first.stdout.split(), second.stdout.split()) == (["42"], ["42", "1"])
    assert first.stderr.count("cannot be written to; compiled code is kept in") == 1


def test_results_keep_the_order_of_the_arguments():
    """invariant: in any order of completion."""
    assert in_threads(lambda x: x * x, iter(range(20))) == [x * x for x in range(20)]
    assert in_threads(abs, []) == []


def test_calls_run_concurrently(monkeypatch):
    """invariant: each waits until the other has begun."""
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    both = Barrier(2, timeout=10)
    assert sorted(in_threads(lambda _: both.wait(), range(2))) == [0, 1]


def test_a_single_call_runs_in_the_calling_thread():
    """invariant"""
    assert in_threads(lambda _: get_ident(), [0]) == [get_ident()]


def test_exceptions_are_raised():
    """door"""
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda x: 1 // x, [1, 0, 2])

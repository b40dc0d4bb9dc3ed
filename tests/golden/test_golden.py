"""Results must not change when names and structure change."""

import json
import os
import subprocess
import sys

import pytest
from benchmarks.golden import COMMON_INSTRUCTIONS, GOLDEN, differences, machine
from benchmarks.table import ROOT


@pytest.mark.battery
def test_results_are_as_recorded(tmp_path):
    """Exact: with kernels that are read from a cache, as when they were recorded.

    A kernel that was compiled in the same process may round differently.
    """
    recorded = json.loads(GOLDEN.read_text())["machine"]
    if recorded != machine():
        pytest.skip(f"recorded on {recorded}, this is {machine()}")
    compiled = {**os.environ, **COMMON_INSTRUCTIONS, "NUMBA_CACHE_DIR": str(tmp_path)}
    compiling = sys.executable, "-m", "blurmatte", "info", "--compile"
    subprocess.run(compiling, cwd=ROOT, env=compiled, check=True, capture_output=True)
    command = sys.executable, "-m", "benchmarks.golden"
    done = subprocess.run(command, cwd=ROOT, env=compiled, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_differences_are_found():
    one = {"alpha": [1.0, 1e6], "grade": "assumed"}
    assert not differences(one, {"alpha": [1.0, 1e6 + 1e-4], "grade": "assumed"})
    assert differences(one, {"alpha": [1.0, 1e6 + 1e-2], "grade": "assumed"})
    assert differences(one, {"alpha": [1.0, 1e6], "grade": "plausible"})
    assert differences(one, {"alpha": [1.0], "grade": "assumed"})

"""Commands killed at file events: nothing is torn or mixed, and a rerun gives the same bytes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def kill(folder, every, *names):
    """Of a killing of commands: how often, and what was wrong."""
    command = [sys.executable, "-m", "tests.fuzz.kills", folder, str(every), *names]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    answer = json.loads(ended.stdout)
    return answer["kills"], answer["wrong"]


def test_killed_commands_leave_whole_files_and_can_be_run_again(tmp_path):
    """Exact: some events of commands that write sets, rows and journals."""
    kills, wrong = kill(tmp_path, 61, "solve", "row", "track")
    assert wrong == []
    assert kills > 3


@pytest.mark.battery
def test_commands_killed_at_every_event_leave_whole_files_and_can_be_run_again(tmp_path):
    """Exact: all commands that write, into an empty folder and over older files."""
    kills, wrong = kill(tmp_path, 1)
    assert wrong == []
    assert kills > 600

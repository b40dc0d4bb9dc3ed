"""What stopped runs leave, and what keeps its properties."""

import os
import subprocess
import sys

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.files.atomic import INCOMPLETE, moved_together, replacing


def ended_process():
    """The number of a process that is gone."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.fixture
def temporary_name(tmp_path):
    """The name of a temporary file of this process."""
    with replacing(tmp_path / "a.json", ".json") as path:
        return path.name


def test_removes_leftovers_of_processes_that_ended(tmp_path, temporary_name):
    """Exact: of ended ones alone; also of an ended one with the number of this process."""
    start, host, pid, session, rest = temporary_name.split("-")
    folder = tmp_path / "out"
    (folder / "-".join([start, host, str(ended_process()), session, "5"])).mkdir(parents=True)
    (folder / "-".join([start, host, pid, "0" * 8, rest])).touch()
    kept = {
        "-".join([start, host, str(os.getppid()), session, rest]),
        "-".join([start, "0" * 8, str(ended_process()), session, rest]),  # of another computer
        "-".join([start, host, pid, session, "99.json"]),
        ".blurmatte-mine",
    }
    for name in kept:
        (folder / name).touch()
    bm.write(folder / "b.json", {"a": 1})
    assert {path.name for path in folder.iterdir()} == kept | {"b.json"}


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_keeps_permissions(tmp_path):
    for name in ("a.png", "b.json"):
        (tmp_path / name).touch(0o600)
    bm.write(tmp_path / "a.png", np.zeros((2, 2)))
    with moved_together(tmp_path) as (temporary, names):
        for name in ("b.json", "c.json"):
            bm.write(temporary / name, {"a": 1})
            names.append(name)
    modes = [(tmp_path / name).stat().st_mode & 0o777 for name in ("a.png", "b.json", "c.json")]
    assert modes[:2] == [0o600, 0o600]
    assert modes[2] & 0o400


def test_set_without_its_last_file_is_marked(tmp_path, monkeypatch):
    """Exact: stopped while files move, the last is missing and a mark there; then both are right."""

    def write(text):
        with moved_together(tmp_path) as (temporary, names):
            for name in ("a.json", "b.json"):
                bm.write(temporary / name, {"text": text})
                names.append(name)

    write("old")
    real = os.replace

    def stopped(source, target):
        if str(target) == str(tmp_path / "b.json"):
            raise KeyboardInterrupt
        real(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", stopped)
        with pytest.raises(KeyboardInterrupt):
            write("new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", f"b.json{INCOMPLETE}"}
    write("new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.json", "b.json"}


@pytest.mark.skipif(os.name != "posix", reason="named pipes")
def test_pipe_is_neither_read_nor_replaced(tmp_path):
    for name in ("pipe.png", "pipe.json"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(bm.errors.FileError, match="is a pipe or a device"):
        bm.read(tmp_path / "pipe.png")
    with pytest.raises(bm.errors.FileError, match="is a pipe or a device"):
        bm.read_noise(tmp_path / "pipe.json")
    with pytest.raises(bm.errors.FileError, match="is a pipe or a device"):
        bm.write(tmp_path / "pipe.json", {"a": 1})
    assert (tmp_path / "pipe.json").is_fifo()

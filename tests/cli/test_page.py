"""The command that serves the page, and its jobs against the same lines in a terminal."""

import asyncio
import socket
import subprocess
import sys
import time

import pytest
from tests.commands import run
from tests.scenes import ball_in, on_line

import blurmatte as bm
from blurmatte.cli.app import run_line
from blurmatte.rendering import Ball, Camera, Shot, colorful_plate
from blurmatte.ui.session import JobState, Session

BLOCKED = """
import sys
from blurmatte.__main__ import run
sys.modules[{!r}] = None
sys.argv[1:] = ["ui", "--no-browser"]
run()
"""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["gone.png"], "gone.png: there is no such file; check the name"),
        (["folder"], "folder: is a folder; name the files in it"),
        (["--out", "file"], "file: file is a file; give the name of a folder"),
        (["--out", "file/results"], "file/results: file is a file; give the name of a folder"),
        (["--port", "65536"], "--port must be 0 to 65535, got 65536"),
        (["--port", "-1"], "--port must be 0 to 65535, got -1"),
    ],
)
def test_what_cannot_be_served_is_refused_in_one_line(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    done = run("ui", "--no-browser", *words)
    assert (done.exit_code, done.stderr) == (2, f"blurmatte: {said}\n")


def test_a_taken_port_is_refused_in_one_line_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = run("ui", "--no-browser", "--port", str(port))
    assert done.exit_code == 2
    assert done.stderr.startswith(f"blurmatte: port {port} cannot be used: Address already in use")
    assert done.stderr.endswith("choose another --port\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("library", ["starlette", "uvicorn"])
def test_a_missing_extra_is_one_line_with_its_remedy(library):
    command = [sys.executable, "-c", BLOCKED.format(library)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    line = f'blurmatte: the page needs {library}: pip install "blurmatte[ui]"\n'
    assert (done.returncode, done.stdout, done.stderr) == (2, "", line)


def in_terminal(line, folder):
    subprocess.run([sys.executable, "-m", *line], cwd=folder, check=True, capture_output=True)


def of_page(*steps):
    """Run coroutines, one after the other, with a session of the program."""

    async def during():
        async with Session(run_line, bm.__version__) as session:
            for step in steps:
                await asyncio.wait_for(step(session), 300)

    asyncio.run(during())


async def dropped(session, path):
    async def pieces():
        yield path.read_bytes()

    return {"file": (await session.receive(path.name, pieces(), path.stat().st_size)).number}


async def ended(job):
    while not job.ended:
        await asyncio.sleep(0.05)


@pytest.mark.battery
def test_files_of_a_job_have_the_bytes_of_the_line_that_is_shown(tmp_path):
    ball_in(tmp_path, plate="plate [1].png")

    async def solve(session):
        files = [await dropped(session, tmp_path / n) for n in ("image.png", "plate [1].png")]
        words = ["solve", files[0], "--plate", files[1], "-o", {"out": ""}, "--json"]
        job = session.add(words, "solve")
        await ended(job)
        assert (job.state, job.answer["grade"]) == (JobState.DONE, "confirmed")
        in_terminal(job.status["line"], tmp_path)
        for name in job.files:
            written = (tmp_path / "1" / name).read_bytes()
            assert (job.folder / name).read_bytes() == written or name == "report.json"
        assert "layer.exr" in job.files
        layer = {"job": 1, "name": "layer.exr"}
        edit = ["edit", layer, "--image", files[0], "--plate", files[1], "--fade", "0.5"]
        job = session.add([*edit, "-o", {"out": "faded.png"}], "fade")
        await ended(job)
        assert job.files == ["faded.png"]

    of_page(solve)


@pytest.mark.battery
def test_a_clip_that_is_cancelled_and_resumed_has_the_bytes_of_one_that_was_not(tmp_path):
    plate, camera = colorful_plate((96, 72), 2, tile=18), Camera(code_std=1 / 255)
    shots = []
    for k in range(6):
        truth = on_line(plate, (18 + 8 * k, 30), (30 + 8 * k, 36), Ball(8))
        shots.append(Shot(truth.scene, camera).photograph(truth))
    bm.write_frames(tmp_path / "clip.mov", [image for image, _ in shots], 25)
    bm.write(tmp_path / "plate.png", shots[0][1])

    async def cancelled(session):
        clip, scene = [await dropped(session, tmp_path / n) for n in ("clip.mov", "plate.png")]
        line = ["solve", clip, "--plate", scene, "-o", {"out": ""}, "--json", "--workers", "2"]
        line += ["--solver", "pixelwise"]
        job = session.add(line, "cut")
        manifest = job.folder / "manifest.jsonl"
        while not (manifest.exists() and manifest.read_bytes().count(b"\n") > 4):
            assert not job.ended, job.said
            await asyncio.sleep(0.02)
        begun = time.monotonic()
        await session.cancel(job)
        assert time.monotonic() - begun < 2
        session.resume(job)
        await ended(job)
        whole = session.add(line, "whole")
        await ended(whole)
        assert (job.state, whole.state) == (JobState.DONE, JobState.DONE)
        assert job.files == whole.files
        for name in job.files:
            if name not in ("report.json", "manifest.jsonl"):  # which hold the times they took
                assert (job.folder / name).read_bytes() == (whole.folder / name).read_bytes(), name

    of_page(cancelled)

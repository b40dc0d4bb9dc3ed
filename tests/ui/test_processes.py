"""Processes of the page: what they say, and how they end."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from tests.ui.programs import is_alive, program, wait_for

from blurmatte.ui.processes import INTERRUPT, READY, Ended, ErrorLine, Helper, Line, Step, work

pytestmark = pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs groups of processes")


def echo(pipe, first):
    """Send what comes."""
    pipe.send(first)
    with suppress(EOFError):
        while True:
            pipe.send(pipe.recv())


def parent(pipe):
    """Start a process, and unwind at a message."""
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    pipe.send(child.pid)
    pipe.recv()
    pipe.send("unwound")


async def heard(work, *args, until=1):
    """A helper, and its first messages."""
    got = []
    helper = Helper(work, got.append, *args)
    while len(got) < until:
        await asyncio.sleep(0.01)
    return helper, got


def test_messages_go_both_ways_and_none_is_the_end():
    async def run():
        helper, got = await heard(echo, "first")
        helper.send("second")
        while len(got) < 2:
            await asyncio.sleep(0.01)
        await helper.end()
        await asyncio.sleep(0.01)
        helper.send("ignored")
        return helper.pid, got

    pid, got = asyncio.run(run())
    assert got == ["first", "second", None]
    assert not is_alive(pid)


def test_the_end_is_that_of_all_it_started_and_lets_it_unwind():
    async def run(interrupt):
        helper, got = await heard(parent)
        assert is_alive(got[0])
        begun = time.monotonic()
        await helper.end(interrupt)
        await asyncio.sleep(0.01)
        return got, time.monotonic() - begun

    (child, *rest), seconds = asyncio.run(run("now"))
    wait_for(lambda: not is_alive(child))
    assert rest == ["unwound", None]
    assert seconds < 1.5


def test_an_interrupt_of_the_terminal_does_not_reach_it_not_even_while_it_starts():
    async def run():
        got = []
        usual = signal.signal(signal.SIGINT, signal.SIG_IGN)  # of this process
        signal.signal(signal.SIGINT, lambda *_: None)
        try:
            helper = Helper(echo, got.append, "first")
            os.kill(helper.pid, signal.SIGINT)
            while not got:
                await asyncio.sleep(0.01)
            os.kill(helper.pid, signal.SIGINT)
            helper.send("second")
            while len(got) < 2:
                await asyncio.sleep(0.01)
            await helper.end()
        finally:
            signal.signal(signal.SIGINT, usual)
        return got

    assert asyncio.run(run())[:2] == ["first", "second"]


@pytest.fixture
def folder(tmp_path):
    """Where jobs run."""
    (tmp_path / "files").mkdir()
    return tmp_path / "files"


def run(folder, *lines, until, then=None):
    """All messages of a worker until one of them is `until`, or as many have come."""

    async def talk():
        got = []
        worker = Helper(work, got.append, program, folder)
        for number, words in enumerate(lines, 1):
            shown = tuple(os.path.basename(word) for word in words)
            worker.send(Line(number, words, shown))
        while not any(until(one) for one in got):
            await asyncio.sleep(0.01)
        if then is not None:
            then(worker, got)
        await worker.end(None if then is None else INTERRUPT)
        await asyncio.sleep(0.01)
        return got

    return asyncio.run(asyncio.wait_for(talk(), 20))


def test_lines_are_run_in_the_folder_in_their_order_with_what_they_say(folder):
    got = run(
        folder,
        ("solve", "write", "a.exr"),
        ("solve", "refuse", "/private/a.png"),
        ("solve", "name", "/private/b.png"),
        until=lambda one: isinstance(one, Ended) and one.job == 3,
    )
    assert got == [
        READY,
        Step(1, "writing", 1, 2, 3.0),
        Ended(1, 0, '{"grade": "confirmed"}\n'),
        ErrorLine(2, "blurmatte: a.png: is no picture"),
        Ended(2, 2, ""),
        Ended(3, 0, "b.png b.png\n"),
        None,
    ]
    assert (folder / "a.exr").read_bytes() == b"layer"
    assert [path.name for path in folder.iterdir()] == ["a.exr"]  # nothing of the warm-up


def test_a_warning_is_given_in_every_job(folder):
    warned = ("solve", "warn")
    got = run(folder, warned, warned, until=lambda one: isinstance(one, Ended) and one.job == 2)
    said = [
        one.job for one in got if isinstance(one, ErrorLine) and "UserWarning: the same" in one.text
    ]
    assert said == [1, 2]


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs signals of threads")
def test_an_interrupt_ends_a_job_at_once_with_its_processes(folder):
    got = run(
        folder,
        ("solve", "sleep"),
        until=lambda one: isinstance(one, Step),
        then=lambda worker, got: None,
    )
    pids = [int(word) for word in got[1].stage.split()]
    wait_for(lambda: not any(map(is_alive, pids)))
    assert not any(isinstance(one, Ended) for one in got)

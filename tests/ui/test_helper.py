"""Processes that serve the page."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from tests.ui.programs import is_alive, wait_for

from blurmatte.ui.helper import Helper

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

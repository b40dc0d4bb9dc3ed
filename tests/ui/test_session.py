"""Files and jobs of a page: hostile names, lies about sizes, races of jobs and processes."""

import asyncio
import json
import shutil
from collections import namedtuple
from pathlib import Path

import pytest
from tests.ui.programs import dying, is_alive, program, wait_for

import blurmatte.ui.session
from blurmatte.ui.processes import INTERRUPT, READY, Ended, Line, Step
from blurmatte.ui.session import FREE_BYTES, JobState, RefusedError, Session, kind_of

DEVICES = ["CON", "nul.png", "COM1.txt", "lpt9", "aux.tar.gz"]


class Stub:
    """A helper without a process: tests say what it sends."""

    made: list

    def __init__(self, work, receive, *args):
        self.hear, self.sent, self.ended = receive, [], []
        self.ending = None
        Stub.made.append(self)

    def send(self, message):
        self.sent.append(message)

    def kill(self):
        self.ended.append("killed")

    async def end(self, interrupt=None):
        if self.ending is not None:
            await self.ending.wait()
        self.ended.append(interrupt)


@pytest.fixture
def stubs(monkeypatch):
    """The helpers of a session: the viewer, then one worker after the other."""
    monkeypatch.setattr(blurmatte.ui.session, "Helper", Stub)
    Stub.made = []
    return Stub.made


def during(test, **options):
    """Run a coroutine with a session."""

    async def run():
        async with Session(program, "1", **options) as session:
            await asyncio.wait_for(test(session), 20)
            return session

    return asyncio.run(run())


async def pieces(*parts, then=None):
    for part in parts:
        yield part
    if then is not None:
        raise then


async def dropped(session, name, *parts):
    return await session.receive(name, pieces(*(parts or (b"x",))), None)


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../../etc/passwd", "passwd"),
        ("..\\..\\boot.ini", "boot.ini"),
        ("C:\\pictures\\a.png", "a.png"),
        ("/a/b.png", "b.png"),
        (".bashrc", "bashrc"),
        ("-rf.png", "rf.png"),
        ("~root", "root"),
        ("a\nb\t\0\x7f.png", "ab.png"),
        ("a\u202egnp.exe", "agnp.exe"),
        ('<a>:"|?*.png', "a.png"),
        ("a.png. . ", "a.png"),
        ("🎾 throw ö.png", "🎾 throw ö.png"),
        ("o\u0308.png", "ö.png"),
        *((name, f"_{name}") for name in DEVICES),
    ],
)
def test_a_dropped_file_gets_a_name_that_every_system_takes(name, kept):
    async def test(session):
        held = await dropped(session, name)
        assert held.path == session._folder / kept
        assert held.path.read_bytes() == b"x"

    during(test)


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize("name", ["", "..", "/", "a/", "...", "\n", "<>"])
def test_a_file_without_a_name_is_refused(name):
    async def test(session):
        if name == "a/":
            assert (await dropped(session, name)).path.name == "a"
            return
        with pytest.raises(RefusedError, match="has no name"):
            await dropped(session, name)

    during(test)


@pytest.mark.usefixtures("stubs")
def test_long_names_and_two_of_one_name_are_kept_apart():
    async def test(session):
        long = [await dropped(session, "🎾" * 300 + ".png") for _ in range(12)]
        same = [await dropped(session, name) for name in ("a.png", "A.PNG", "a.png", "1")]
        names = [held.path.name.casefold() for held in long + same]
        assert len(set(names)) == len(names)
        assert all(held.path.suffix.lower() == ".png" for held in long)
        assert [held.path.name for held in same] == ["a.png", "A-1.PNG", "a-2.png", "1"]
        assert session.add(["info", {"file": 1}, {"out": ""}], "").shown[-1] == "2"  # 1 is a file

    during(test)


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize(
    ("announced", "parts", "free", "why"),
    [
        (None, [b""], 99, "is empty"),
        (0, [], 99, "is empty"),
        (5, [b"abc"], 99, "3 of 5 bytes came"),
        (2, [b"abc"], 99, "3 of 2 bytes came"),
        (10 << 30, [b"abc"], 9, "larger than"),
        (21 << 30, [b"abc"], 99, "larger than the 20.0 GB"),
        (None, [b"abc"], 1, "larger than the 0.0 GB"),
        (3, [b"abc"], 2, "larger than the 0.0 GB"),
    ],
)
def test_lies_and_sizes_are_refused_and_leave_nothing(monkeypatch, announced, parts, free, why):
    usage = namedtuple("usage", "free")(free << 30)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)

    async def test(session):
        with pytest.raises(RefusedError, match=why):
            await session.receive("a.png", pieces(*parts), announced)
        assert not list(session._folder.iterdir())
        assert not session.files

    during(test)


@pytest.mark.usefixtures("stubs")
def test_a_disk_that_fills_and_a_file_that_is_cut_leave_nothing(monkeypatch):
    room = iter([9 << 30, 9 << 30, *[FREE_BYTES] * 9])
    usage = namedtuple("usage", "free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(next(room)))

    async def test(session):
        with pytest.raises(RefusedError, match="larger than"):
            await session.receive("a.png", pieces(b"abc", b"def", b"ghi"), None)
        monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(9 << 30))
        for error in (RefusedError("cut"), OSError(28, "No space left on device")):
            with pytest.raises(RefusedError, match=r"cut|a.png: cannot be copied: No space left"):
                await session.receive("a.png", pieces(b"abc", then=error), None)
        assert not list(session._folder.iterdir())

    during(test)


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize(
    "word",
    [
        *("/etc/passwd", "../a", "..", "a/b", "-o/tmp/x", "-o..", "--out=/tmp/x", "--out=../x"),
        *(
            "core:/etc/passwd",
            "C:\\a",
            "\\\\host\\share",
            "1/2/../..",
            "1/../..",
            "a\0b",
            "a\ud800",
        ),
        *(
            {"file": 9},
            {"file": "1"},
            {"out": "../x"},
            {"out": "/x"},
            {"out": ".x"},
            {"out": "a\0"},
        ),
        *(
            {"job": 1, "name": "../x"},
            {"job": 7, "name": ""},
            {"job": 1, "name": "link.txt"},
            5,
            None,
        ),
    ],
    ids=repr,
)
def test_a_word_that_names_a_path_is_refused(word, tmp_path):
    (tmp_path / "secret").write_text("x")

    async def test(session):
        first = session.add(["info", {"out": "a"}], "")
        (first.folder / "link.txt").symlink_to(tmp_path / "secret")
        with pytest.raises(RefusedError):
            session.add(["solve", word], "")
        assert list(session.jobs) == [1]

    during(test)


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize("words", [[], ["ui"], ["--version"], [{"out": ""}], [["solve"]]])
def test_only_commands_of_the_page_are_jobs(words):
    async def test(session):
        with pytest.raises(RefusedError, match="a job is one of the commands solve"):
            session.add(words, "")

    during(test)


@pytest.mark.usefixtures("stubs")
def test_a_line_is_run_as_it_is_shown(tmp_path):
    mine = tmp_path / "mine.png"
    mine.write_bytes(b"x")

    async def test(session):
        await dropped(session, "a b.png")
        words = ["measure", {"file": 2}, "--exposure", "1/60", "--plate", {"file": 1}]
        job = session.add([*words, "-o", {"out": "m.json"}], "speed")
        shown = ["measure", "a b.png", "--exposure", "1/60", "--plate", str(mine)]
        assert job.shown == job.words == (*shown, "-o", "1/m.json")
        (job.folder / "m.json").write_text("{}")
        assert session.add(["info", {"job": 1, "name": "m.json"}], "").shown == ("info", "1/m.json")
        assert session.add(["info", {"job": 1, "name": ""}], "").shown == ("info", "1")

    during(test, files=[mine])


@pytest.mark.usefixtures("stubs")
def test_results_that_are_kept_are_shown_as_out_was_given_and_never_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept" / "7").mkdir(parents=True)
    (tmp_path / "kept" / "²").mkdir()

    async def test(session):
        job = session.add(["solve", "-o", {"out": "a.exr"}], "")
        assert job.shown[-1] == str(Path("kept", "8", "a.exr"))
        assert job.words[-1] == str(tmp_path / "kept" / "8" / "a.exr")
        (job.folder / "a.exr").write_bytes(b"x")

    session = during(test, out=Path("kept"))
    assert (tmp_path / "kept" / "8" / "a.exr").exists()
    assert not session._private.exists()


@pytest.mark.usefixtures("stubs")
def test_links_and_hidden_files_are_no_results(tmp_path):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "key").write_text("x")

    async def test(session):
        job = session.add(["solve", {"out": "a"}], "")
        for name in ("a.png", "b/c.png", ".part", ".work/d.png"):
            (job.folder / name).parent.mkdir(exist_ok=True)
            (job.folder / name).write_text("x")
        (job.folder / "link").symlink_to(tmp_path / "secret" / "key")
        (job.folder / "links").symlink_to(tmp_path / "secret")
        assert job.files == ["a.png", "b/c.png"]
        assert session.source(None, 1, "b/c.png").read_text() == "x"
        job.end(JobState.DONE)
        (job.folder / "a.png").unlink()
        (job.folder / "a.png").symlink_to(tmp_path / "secret" / "key")  # after it was listed
        for name in ("a.png", "link", "links/key", ".part", "../files", ""):
            with pytest.raises(RefusedError, match="has no result"):
                session.source(None, 1, name)

    during(test)


def test_a_job_that_ends_while_it_is_cancelled_is_cancelled_and_the_next_gets_a_new_worker(stubs):
    async def test(session):
        worker = stubs[1]
        worker.hear(READY)
        first, second = session.add(["solve", "a"], ""), session.add(["solve", "b"], "")
        assert (first.state, second.state) == (JobState.RUNNING, JobState.WAITING)
        worker.ending = asyncio.Event()
        cancelling = asyncio.create_task(session.cancel(first))
        await asyncio.sleep(0)
        worker.hear(Step(1, "late", 1, 2, None))
        worker.hear(Ended(1, 0, "{}"))
        worker.hear(None)
        assert (first.state, first.step, session.worker_state) == (
            JobState.CANCELLED,
            None,
            "ending",
        )
        assert second.state is JobState.WAITING
        await session.cancel(first)  # again: nothing more
        session.resume(first)
        worker.ending.set()
        await cancelling
        assert worker.ended == [INTERRUPT]
        assert len(stubs) == 3
        assert (first.state, second.state) == (JobState.RUNNING, JobState.WAITING)  # in their order
        stubs[2].hear(READY)
        assert [line.job for line in stubs[2].sent] == [1]
        stubs[2].hear(Ended(1, 0, "{}"))
        assert (first.state, first.code, second.state) == (JobState.DONE, 0, JobState.RUNNING)

    during(test)


def test_a_job_runs_and_is_cancelled_while_the_worker_gets_ready(stubs):
    async def test(session):
        job = session.add(["solve", "a"], "")
        assert isinstance(stubs[1].sent[0], Line)
        assert job.status["stage"] == "getting ready"
        waits = session.add(["solve", "b"], "")
        await session.cancel(waits)
        await session.cancel(job)
        stubs[2].hear(READY)
        assert (job.state, waits.state) == (JobState.CANCELLED, JobState.CANCELLED)
        assert stubs[2].sent == []
        assert session.worker_state == "ready"

    during(test)


def test_a_worker_that_dies_while_it_gets_ready_is_not_started_in_a_loop(stubs):
    async def test(session):
        first, second = session.add(["solve", "a"], ""), session.add(["solve", "b"], "")
        stubs[1].hear(None)
        assert (first.state, second.state) == (JobState.FAILED, JobState.FAILED)
        assert first.said == ["blurmatte: the process died, perhaps for want of memory; try again"]
        assert (len(stubs), session.worker_state) == (2, "off")
        stubs[0].hear(None)  # the viewer, too
        asking = asyncio.create_task(session.ask("describe", path=Path("a")))
        await asyncio.sleep(0)
        assert (len(stubs), session.worker_state) == (3, "off")
        asking.cancel()
        session.resume(first)
        assert (len(stubs), session.worker_state, first.state) == (4, "starting", JobState.RUNNING)

    during(test)


def test_a_worker_that_dies_with_a_job_is_replaced_and_the_next_job_runs(stubs):
    async def test(session):
        stubs[1].hear(READY)
        first, second = session.add(["solve", "a"], ""), session.add(["solve", "b"], "")
        stubs[1].hear(None)
        assert (first.state, second.state) == (JobState.FAILED, JobState.RUNNING)
        assert stubs[1].ended == ["killed"]  # with what it had started
        assert [line.job for line in stubs[2].sent] == [2]

    during(test)


def test_no_worker_is_started_behind_the_end(stubs):
    async def run():
        async with Session(program, "1") as session:
            stubs[1].hear(READY)
            job = session.add(["solve", "a"], "")
            stubs[1].ending = asyncio.Event()
            asyncio.get_running_loop().call_later(0.05, stubs[1].ending.set)
            cancelling = asyncio.create_task(session.cancel(job))
            await asyncio.sleep(0)
        await cancelling
        with pytest.raises(RefusedError, match="closed"):
            await session.ask("describe", path=Path("a"))
        return session

    session = asyncio.run(run())
    assert len(stubs) == 2
    assert not session._private.exists()


@pytest.mark.parametrize(
    ("code", "state"), [(0, "done"), (3, "done"), (2, "refused"), (1, "failed"), (130, "failed")]
)
def test_an_exit_code_is_a_state(stubs, code, state):
    async def test(session):
        stubs[1].hear(READY)
        job = session.add(["solve", "a"], "")
        stubs[1].hear(Step(1, "solving", 1, 4, 30.0))
        assert 29 < job.status["seconds_left"] <= 30
        stubs[1].hear(Ended(1, code, '{"a": NaN}'))
        assert (job.status["state"], job.status["code"]) == (state, code)
        assert job.answer == '{"a": NaN}'  # which is no JSON

    during(test)


@pytest.mark.usefixtures("stubs")
def test_states_come_at_changes_and_while_a_job_runs_and_end_with_the_session():
    async def test(session):
        states = session.states()
        assert (await anext(states))["jobs"] == []
        session.add(["solve", "a"], "a title")
        assert (await anext(states))["jobs"][0]["title"] == "a title"
        first, second = [(await anext(states))["jobs"][0]["seconds"] for _ in range(2)]
        assert 0.9 < second - first < 2
        session.end_states()
        with pytest.raises(StopAsyncIteration):
            await anext(states)

    during(test)


@pytest.mark.usefixtures("stubs")
def test_a_name_of_bytes_that_are_no_text_can_be_told(tmp_path):
    path = tmp_path / "a\udcff.png"
    try:
        path.write_bytes(b"x")
    except OSError:
        pytest.skip("this file system has none")
    session = during(lambda _: asyncio.sleep(0), files=[path, tmp_path / "gone.png"])
    assert json.loads(json.dumps(session.state))["files"][0]["name"] == path.name
    assert session.state["files"][1]["bytes"] == 0


def test_what_a_file_is_is_in_its_content(tmp_path):
    for name, content, kind in [
        ("a.txt", b"\x89PNG\r\n\x1a\n", "picture"),
        ("a.png", b"%PDF", "other"),
        ("a.mov", b"\0\0\0\x20ftypqt  ", "clip"),
        ("a.json", b"{}", "other"),
        ("a.xyz", b"?", "other"),
    ]:
        (tmp_path / name).write_bytes(content)
        assert kind_of(tmp_path / name) == kind, name


def test_a_job_from_its_line_to_its_answer_and_a_cancelled_one_with_all_its_processes():
    async def ended(session, job):
        while not job.ended:
            await asyncio.sleep(0.02)

    async def test(session):
        job = session.add(["solve", "write", {"out": "layer.exr"}], "")
        await ended(session, job)
        assert (job.state, job.files, job.answer) == (
            JobState.DONE,
            ["layer.exr"],
            {"grade": "confirmed"},
        )
        bad = session.add(["solve", "refuse", "a.png"], "")
        await ended(session, bad)
        assert (bad.state, bad.said) == (JobState.REFUSED, ["blurmatte: a.png: is no picture"])
        slow = session.add(["solve", "sleep"], "")
        while slow.step is None or not slow.step.stage[0].isdigit():
            await asyncio.sleep(0.02)
        pids = [int(word) for word in slow.step.stage.split()]
        assert all(map(is_alive, pids))
        begun = asyncio.get_running_loop().time()
        await session.cancel(slow)
        assert asyncio.get_running_loop().time() - begun < 2
        wait_for(lambda: not any(map(is_alive, pids)), 1)
        dies = session.add(["solve", "die"], "")
        await ended(session, dies)
        assert dies.state is JobState.FAILED
        session.pids = [session._worker.pid, session._viewer.pid]

    session = during(test)
    assert not any(map(is_alive, session.pids))
    assert not session._private.exists()


def test_a_program_that_cannot_start_ends_in_a_failed_job():
    async def run():
        async with Session(dying, "1") as session:
            while session.worker_state != "off":
                await asyncio.sleep(0.02)
            job = session.add(["solve", "a"], "")
            while not job.ended or session.worker_state != "off":  # once more, and no more
                await asyncio.sleep(0.02)
            return job.state

    assert asyncio.run(asyncio.wait_for(run(), 20)) is JobState.FAILED

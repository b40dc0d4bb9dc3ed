"""The server: who is answered, with which headers, and how it ends."""

import asyncio
import http.client
import io
import json
import mimetypes
import os
import signal
import socket
import subprocess
import sys
import time
import zipfile
from contextlib import closing
from pathlib import Path

import pytest
from tests.ui.programs import helpers, is_alive, program, wait_for

import blurmatte.ui.server
import blurmatte.ui.session
from blurmatte.ui.private_folder import delete_left_folders
from blurmatte.ui.server import Requests, _Guard, _pieces, serve
from blurmatte.ui.session import JobState, RefusedError, Session

ROOT = Path(__file__).parents[2]
HOST, KEY = "127.0.0.1:8123", "the-key"
BEARER = ("authorization", f"Bearer {KEY}")
SERVER = """
import os, sys
from tests.ui.programs import program
from blurmatte.ui.private_folder import delete_left_folders
from blurmatte.ui.server import serve
from blurmatte.ui.session import Session
if __name__ == "__main__":
    session = Session(program, "1")
    def opened(address):
        print(address, session.write_entry(address), flush=True)
    interrupted = serve(session, 0, opened)
    print(interrupted, "numpy" in sys.modules, flush=True)
"""


class Page:
    """A session behind its guard, without processes; and what is asked of it."""

    def __init__(self, session):
        self.session = session
        self.app = _Guard(Requests(session).app, HOST, KEY, session.remove_entry)

    def ask(self, method, path, body=b"", *headers, own=True):
        return asyncio.run(self.asked(method, path, body, *headers, own=own))

    async def asked(self, method, path, body=b"", *headers, own=True):
        """Status, headers and body of an answer."""
        given = [("host", HOST), BEARER, *headers] if own else headers
        bodies = list(body) if isinstance(body, list) else [body]
        path, _, query = path.partition("?")
        scope = {
            "type": "http", "asgi": {"version": "3.0", "spec_version": "2.3"}, "http_version": "1.1",
            "method": method, "path": path, "raw_path": path.encode(), "scheme": "http",
            "query_string": query.encode(), "root_path": "", "client": None, "server": None,
            "headers": [(name.encode(), value.encode()) for name, value in given],
        }  # fmt: skip
        sent = []

        async def receive():
            if bodies:
                part = bodies.pop(0)
                if part is None:
                    return {"type": "http.disconnect"}
                return {"type": "http.request", "body": part, "more_body": bool(bodies)}
            await asyncio.sleep(60)

        async def send(message):
            sent.append(message)

        try:
            await self.app(scope, receive, send)
        except RuntimeError:  # Starlette raises a defect again, for the log
            assert sent[0]["status"] == 500
        headers = [(k.decode(), v.decode()) for k, v in sent[0]["headers"]]
        names = [name for name, _ in headers]
        assert len(names) == len(set(names))
        return sent[0]["status"], dict(headers), b"".join(m.get("body", b"") for m in sent[1:])


class Stub:
    """A helper without a process."""

    def __init__(self, *_):
        self.sent = []

    def send(self, message):
        self.sent.append(message)


@pytest.fixture
def page(tmp_path, monkeypatch):
    monkeypatch.setattr(blurmatte.ui.session, "Helper", Stub)
    session = Session(program, "1")
    session._private, session._folder = tmp_path, tmp_path / "files"
    session._results = session._folder
    session._folder.mkdir()
    return Page(session)


SAFE = {
    "content-security-policy": "default-src 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


def fails():
    raise RuntimeError("a defect")


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/", 200),
        ("GET", "/page/index.html", 200),
        ("GET", "/api/state", 200),
        ("GET", "/nothing", 404),
        ("GET", "/api/nothing", 404),
        ("GET", "/api/jobs/9", 404),
        ("PATCH", "/api/jobs", 405),
        ("POST", "/api/jobs", 400),
        ("GET", "/api/jobs", 500),
    ],
)
def test_every_answer_is_safe_and_states_its_type(page, monkeypatch, method, path, status):
    if status == 500:
        monkeypatch.setattr(Session, "jobs", property(lambda _: fails(), lambda *_: None), False)
    found, headers, body = page.ask(method, path)
    assert found == status
    for name, value in SAFE.items():
        assert headers[name].startswith(value), name
    assert "unsafe" not in headers["content-security-policy"]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    if status == 200:
        assert headers["content-type"].split(";")[0] in ("text/html", "application/json")
    else:
        assert headers["content-type"] == "application/json"
        assert json.loads(body)["error"]
    assert ("allow" in headers) == (status == 405)


ALL = [
    ("GET", "/api/state"), ("GET", "/api/states"), ("PUT", "/api/files?name=a"), ("GET", "/api/jobs"),
    ("POST", "/api/jobs"), ("GET", "/api/jobs/1"), ("DELETE", "/api/jobs/1"),
    ("POST", "/api/jobs/1/resume"), ("GET", "/api/jobs/1/results.zip"),
    ("GET", "/api/jobs/1/results/a"), ("GET", "/api/look/describe?file=1"), ("POST", "/api/quit"),
    ("GET", "/api"), ("GET", "//api/state"), ("GET", "/api/../page/index.html"),
    ("OPTIONS", "/api/state"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path"), ALL)
def test_nothing_is_answered_without_the_key(page, method, path):
    for headers in [(), (("authorization", "Bearer "),), (("authorization", f"Basic {KEY}"),),
                    (("authorization", f"Bearer {KEY}x"),), (BEARER, BEARER)]:  # fmt: skip
        status, _, body = page.ask(method, path, b"", ("host", HOST), *headers, own=False)
        assert status == 403
        assert set(json.loads(body)) == {"error"}


@pytest.mark.parametrize("path", ["/", "/page/index.html", "/api/state"])
@pytest.mark.parametrize(
    "headers",
    [
        [],
        [("host", "localhost:8123")],
        [("host", "127.0.0.1")],
        [("host", "127.0.0.1:8124")],
        [("host", "evil.example:8123")],
        [("host", HOST), ("host", HOST)],
        [("host", HOST), ("origin", "http://evil.example")],
        [("host", "evil.example:8123"), ("origin", "http://evil.example:8123")],  # rebound
        [("host", HOST), ("origin", f"https://{HOST}")],
        [("host", HOST), ("origin", "null")],
        [("host", HOST), ("origin", f"http://{HOST}"), ("origin", "http://evil.example")],
        [("host", HOST), ("sec-fetch-site", "cross-site")],
    ],
    ids=str,
)
def test_another_host_or_origin_is_not_answered(page, path, headers):
    assert page.ask("GET", path, b"", BEARER, *headers, own=False)[0] == 403


def test_its_own_origin_is_answered(page):
    assert page.ask("GET", "/api/state", b"", ("origin", f"http://{HOST}"))[0] == 200


@pytest.mark.parametrize(
    ("method", "path", "mode", "place", "status"),
    [
        ("GET", "/", "navigate", "document", 200),  # as from the file that is opened
        ("GET", "/", "navigate", "iframe", 403),
        ("GET", "/", "cors", "empty", 403),
        ("POST", "/", "navigate", "document", 403),
        ("GET", "/api/state", "navigate", "document", 403),
    ],
)
def test_another_site_may_only_open_a_window(page, method, path, mode, place, status):
    how = ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", mode), ("sec-fetch-dest", place)
    assert page.ask(method, path, b"", *how)[0] == status


@pytest.mark.skipif(sys.platform != "linux", reason="reads modes of files")
def test_the_address_is_in_a_private_file_until_the_page_is_opened(server):
    entry = Path(server.entry)
    assert f"http://{server.place}/#{server.key}" in entry.read_text()
    assert entry.stat().st_mode & 0o777 == 0o600
    assert entry.parent.stat().st_mode & 0o777 == 0o700
    connection = http.client.HTTPConnection(server.place, timeout=10)
    connection.request("GET", "/")
    assert connection.getresponse().status == 200
    assert entry.exists()
    ask(server, "GET", "/api/state")
    assert not entry.exists()
    connection.close()


@pytest.mark.parametrize(
    "path",
    [
        *("/page/", "/page/../server.py", "/page/..", "/page//etc/passwd", "/page/%2e%2e/server.py"),
        *("/page/..\\server.py", "/page/index.html/", "/page/index.html\0", "/page/."),
        *("/api/jobs/1/results/../2/a", "/api/jobs/1/results//etc/passwd", "/api/jobs/1/results/"),
        *("/api/jobs/1/results/..", "/api/jobs/1/results/a\0", "/api/look/../state"),
        *("/api/look/describe?job=1&name=../x", "/api/look/describe?file=-1"),
        "/api/look/tile?job=1&name=a&part=matched&frame=0&level=0&x=0&y=0&basis_job=1&basis_name=../a",
        "/api/look/__init__?file=1",
        *("/api/look/describe", "/api/look/tile?file=1", "/api/look/describe?file=" + "9" * 5000),
    ],
)  # fmt: skip
def test_paths_lead_nowhere_else(page, path):
    job = page.session.add(["solve", {"out": "a"}], "")
    (job.folder / "a").write_text("x")
    status, _, body = page.ask("GET", path)
    assert status in (400, 404)
    assert b"import" not in body
    assert b"root:" not in body


def test_types_are_stated_whatever_the_system_says(page, monkeypatch):
    monkeypatch.setattr(mimetypes, "guess_type", lambda *_, **__: ("text/plain", None))
    names = "api.js", "style.css", "index.html"
    types = [page.ask("GET", f"/page/{name}")[1]["content-type"] for name in names]
    assert types == [f"text/{one}; charset=utf-8" for one in ("javascript", "css", "html")]
    job = page.session.add(["solve", {"out": "a"}], "")
    for name, kind in {
        "a.html": "text/html; charset=utf-8",
        "b ö.exr": "application/octet-stream",
    }.items():
        (job.folder / name).write_text("<script>")
        _, headers, body = page.ask("GET", f"/api/jobs/1/results/{name}")
        assert (headers["content-type"], body) == (kind, b"<script>")
        assert headers["content-disposition"].startswith("attachment")


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400), (b"[1]", 400), (b"{", 400), (b"\xff\xfe", 400), (b"[" * 100_000, 400),
        (b'{"words": "solve"}', 400), (b'{"words": ["solve"], "title": 5}', 400),
        (b'{"words": ["solve", "\\ud800"]}', 400), (b'{"words": ["solve"], "title": "\\ud800"}', 400),
        (b'{"words": [{}]}', 400), (b'{"words": ["ui"]}', 400), (b'{"words": [NaN]}', 400),
        ([b"x" * 2**19] * 3, 413), ([b'{"words"', None], 400),
    ],
)  # fmt: skip
def test_a_broken_request_is_refused_and_all_goes_on(page, body, status):
    found, _, said = page.ask("POST", "/api/jobs", body)
    assert found == status
    assert json.loads(said)["error"]
    assert not page.session.jobs
    assert page.ask("GET", "/api/state")[0] == 200


def test_a_file_is_the_body_as_it_came(page):
    path = "/api/files?name=a%20b.png"
    status, _, body = page.ask("PUT", path, [b"ab", b"", b"c"], ("content-length", "3"))
    assert (status, json.loads(body)) == (
        200, {"number": 1, "name": "a b.png", "bytes": 3, "kind": "other"}
    )  # fmt: skip
    assert page.session.files[1].path.read_bytes() == b"abc"


@pytest.mark.parametrize(
    ("path", "parts", "length", "why"),
    [
        ("/api/files?name=a", [b""], None, "is empty"),
        ("/api/files?name=a", [b"ab", None], "5", "was cut off"),
        ("/api/files?name=a", [b"ab", b"cd"], "5", "4 of 5 bytes"),
        ("/api/files?name=a", [b"ab"], str(30 << 30), "larger than"),
        ("/api/files?name=%00", [b"ab"], "2", "no name"),
        ("/api/files", [b"ab"], "2", "no name"),
    ],
)
def test_a_file_that_is_none_is_refused_and_leaves_nothing(page, path, parts, length, why):
    headers = [] if length is None else [("content-length", length)]
    status, _, body = page.ask("PUT", path, parts, *headers)
    assert status == 400
    assert why in json.loads(body)["error"]
    assert not list(page.session._folder.iterdir())


def test_a_file_that_stops_coming_is_given_up():
    class Stopping:
        async def stream(self):
            yield b"ab"
            await asyncio.sleep(30)

    async def read():
        return [piece async for piece in _pieces(Stopping(), silence=0.05)]

    with pytest.raises(RefusedError, match="the file stopped coming; drop it again"):
        asyncio.run(read())


def test_results_come_as_one_archive(page):
    job = page.session.add(["solve", {"out": "a"}], 'a "ball" ö')
    (job.folder / "sub").mkdir()
    for name, size in {"a.exr": 3_000_000, "sub/b.png": 5}.items():
        (job.folder / name).write_bytes(os.urandom(size))
    os.utime(job.folder / "a.exr", (0, 0))  # before the times of ZIP begin
    assert page.ask("GET", "/api/jobs/1/results.zip")[0] == 200
    job.end(JobState.DONE)
    _, headers, body = page.ask("GET", "/api/jobs/1/results.zip")
    assert headers["content-disposition"] == 'attachment; filename="a ball _.zip"'
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        assert archive.namelist() == ["a.exr", "sub/b.png"]
        assert all(archive.read(n) == (job.folder / n).read_bytes() for n in archive.namelist())


def test_a_result_that_was_deleted_is_not_found(page):
    job = page.session.add(["solve", {"out": "a"}], "")
    (job.folder / "a").write_text("x")
    job.end(JobState.DONE)
    (job.folder / "a").unlink()
    assert page.ask("GET", "/api/jobs/1/results/a")[0] == 400
    assert page.ask("GET", "/api/jobs/1/results.zip")[0] == 400


def test_a_port_that_is_taken_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} cannot be used: Address already in use"):
            serve(Session(program, "1"), port, print)


@pytest.fixture
def server(tmp_path):
    """A server with its processes, whose private folder lies in tmp_path."""
    environment = os.environ | {"TMPDIR": str(tmp_path), "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}
    (tmp_path / "serving.py").write_text(SERVER)
    command = [sys.executable, str(tmp_path / "serving.py")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True) as process:
        address, process.entry = process.stdout.readline().split()
        address, key = address.split("/#")
        process.place = address.removeprefix("http://")
        process.key = key
        process.folder = tmp_path
        yield process
        process.kill()


def ask(server, method, path, body=None):
    with closing(http.client.HTTPConnection(server.place, timeout=10)) as connection:
        connection.request(method, path, body, {"Authorization": f"Bearer {server.key}"})
        return json.loads(connection.getresponse().read())


def raw(server, *parts, half=False):
    """What a server answers to bytes."""
    host, _, port = server.place.partition(":")
    with socket.create_connection((host, int(port)), timeout=5) as connection:
        for part in parts:
            connection.sendall(part)
        if half:
            connection.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while b"\r\n\r\n" not in answer and (piece := connection.recv(9999)):
                answer += piece
        except ConnectionError:
            pass
    return answer


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_bytes_that_are_no_request_do_no_harm_and_quit_leaves_nothing(server):
    head = f"Host: {server.place}\r\nAuthorization: Bearer {server.key}\r\n".encode()
    put = b"PUT /api/files?name=a HTTP/1.1\r\n" + head
    assert raw(server, put + b"Content-Length: 9\r\n\r\nabc", half=True)[9:12] in (b"", b"400")
    for length in (b"-1", b"abc", b"1\r\nContent-Length: 2", b"9" * 5000):
        assert raw(server, put + b"Content-Length: " + length + b"\r\n\r\nabc")[9:12] in (
            b"",
            b"400",
        )
    chunked = put + b"Transfer-Encoding: chunked\r\n\r\n"
    assert raw(server, chunked + b"zz\r\nabc\r\n")[9:12] in (b"", b"400")
    assert raw(server, chunked + b"3\r\nabc\r\n0\r\n\r\n")[9:12] == b"200"
    for junk in (b"\0\1\2\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\nX: " + b"a" * 200_000):
        assert raw(server, junk, half=True)[9:12] in (b"", b"400")
    upgrade = (
        b"GET /api/state HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n"
    )
    assert raw(server, upgrade)[9:12] == b"403"
    encoded = b"GET /%61pi/state HTTP/1.1\r\nHost: " + server.place.encode() + b"\r\n\r\n"
    assert raw(server, encoded)[9:12] == b"403"
    port = server.place.partition(":")[2]
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", int(port)), timeout=1):
        pass
    state = ask(server, "GET", "/api/state")
    assert [one["bytes"] for one in state["files"]] == [3]
    pids = helpers(server)
    rss = Path(f"/proc/{server.pid}/status").read_text().partition("VmRSS:")[2].split()[0]
    assert int(rss) < 80 << 10
    ask(server, "POST", "/api/quit")
    assert server.communicate(timeout=5)[0].split() == ["False", "False"]  # and no NumPy
    wait_for(lambda: not any(map(is_alive, pids)))
    assert [path.name for path in server.folder.iterdir()] == ["serving.py"]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_a_server_that_is_ended_ends_its_processes_and_deletes_its_folder(server, name):
    ask(server, "PUT", "/api/files?name=a.png", b"x")
    ask(server, "POST", "/api/jobs", json.dumps({"words": ["solve", "sleep"]}))
    while not ((stage := ask(server, "GET", "/api/jobs/1")["stage"]) and stage[0].isdigit()):
        time.sleep(0.02)
    pids = [*helpers(server), *map(int, stage.split())]
    assert len(set(pids)) >= 4
    begun = time.monotonic()
    os.kill(server.pid, getattr(signal, name))
    said = server.communicate(timeout=5)[0].split()
    assert said == ([] if name == "SIGKILL" else ["True", "False"])
    wait_for(lambda: not any(map(is_alive, pids)), 3)
    wait_for(lambda: [path.name for path in server.folder.iterdir()] == ["serving.py"], 3)
    assert time.monotonic() - begun < 4


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_folder_that_was_left_is_deleted_at_the_next_start(server, monkeypatch):
    ask(server, "PUT", "/api/files?name=a.png", b"x")
    (folder,) = server.folder.glob("blurmatte-*")
    (server.folder / "blurmatte-other").mkdir()
    (server.folder / "blurmatte-link").symlink_to(server.folder)
    monkeypatch.setattr("tempfile.tempdir", str(server.folder))
    delete_left_folders()
    assert (folder / "files" / "a.png").exists()  # in use
    pids = helpers(server)
    for pid in (*pids, server.pid):  # at once, so that none can delete it
        os.kill(pid, signal.SIGSTOP)
    for pid in (*pids, server.pid):
        os.kill(pid, signal.SIGKILL)
    server.wait(5)
    assert (folder / "files" / "a.png").exists()
    delete_left_folders()
    names = sorted(path.name for path in server.folder.iterdir())
    assert names == ["blurmatte-link", "blurmatte-other", "serving.py"]

"""The server: the page and its requests, for the browser of this machine alone.

Every request needs this host and port, and whatever is not the page itself the key of the session,
which only the URL that was printed holds, in its fragment.
"""

import asyncio
import contextlib
import json
import os
import secrets
import signal
import socket
import zipfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import QueryParams
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from blurmatte.interrupts import EXIT_CODE
from blurmatte.ui.session import Job, RefusedError, Session

_HOST = "127.0.0.1"
_PAGE = files("blurmatte.ui") / "page"
# Stated, for registries of the system call scripts plain text.
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".json": "application/json",
    ".txt": "text/plain; charset=utf-8",
}
_DATA = "application/octet-stream"
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self' blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_KEY_BYTES = 32
_MAX_JSON_BYTES = 1 << 20
_SECONDS_OF_SILENCE = 60.0  # between pieces of a body, after which it is given up
_SECONDS_TO_DRAIN = 2.0  # of what comes of a refused file
_PIECE_BYTES = 1 << 20
_SECONDS_TO_CLOSE = 1  # for requests that run when the server ends


def serve(session: Session, port: int, opened: Callable[[str], None]) -> bool:
    """Serve a session until the page quits, or the process is interrupted or terminated.

    Parameters
    ----------
    session : Session
        Entered, and left at the end.
    port : int
        Of this machine; 0 takes a free one.
    opened : callable
        Gets the URL when the page can be opened, and the session is entered.

    Returns
    -------
    bool
        Whether a signal ended it.

    Raises
    ------
    OSError
        If the port is taken, or the folders cannot be made.
    """
    try:
        listening = socket.create_server((_HOST, port))
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise OSError(f"port {port} cannot be used: {why}; choose another --port") from error
    with listening:
        host = f"{_HOST}:{listening.getsockname()[1]}"
        return asyncio.run(_serve(session, listening, host, opened))


async def _serve(
    session: Session, listening: socket.socket, host: str, opened: Callable[[str], None]
) -> bool:
    key = secrets.token_urlsafe(_KEY_BYTES)
    async with session:
        opened(f"http://{host}/#{key}")
        requests = Requests(session)
        server = _Server(
            uvicorn.Config(
                _Guard(requests.app, host, key, session.remove_entry),
                http="h11",
                ws="none",
                lifespan="off",
                log_config=None,
                log_level="critical",
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=_SECONDS_TO_CLOSE,
            )
        )

        def stop() -> None:
            session.end_states()
            server.should_exit = True

        requests.quit = server.stop = stop
        await server.serve([listening])
    return server.is_interrupted


class _Server(uvicorn.Server):
    """A server that the first signal stops, and the second one ends."""

    stop: Callable[[], None]
    is_interrupted = False

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop at a signal, and stay deaf to it: uvicorn's own would raise it again at the end."""
        loop = asyncio.get_running_loop()

        def take(*_: Any) -> None:
            if self.is_interrupted:
                os._exit(EXIT_CODE)  # the viewer deletes what is private
            self.is_interrupted = True
            loop.call_soon_threadsafe(self.stop)

        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), take)
        yield


class _Guard:
    """Passes on only requests of this page, and adds the headers of all answers."""

    def __init__(self, app: ASGIApp, host: str, key: str, entered: Callable[[], None]) -> None:
        self._app, self._host, self._key = app, host.encode(), f"Bearer {key}".encode()
        self._entered = entered  # called when a request had the key

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        fault = self._fault(scope)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name.lower() for name, _ in message.get("headers", [])}
                more = [
                    (name.lower().encode(), value.encode())
                    for name, value in _HEADERS.items()
                    if name.lower().encode() not in own
                ]
                message["headers"] = [*message.get("headers", []), *more]
            await send(message)

        if fault is None:
            await self._app(scope, receive, with_headers)
        else:
            await _refusal(fault, 403)(scope, receive, with_headers)

    def _fault(self, scope: Scope) -> str | None:
        """Why a request is not answered; None if it is of the page."""
        given: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            given.setdefault(name.lower(), []).append(value)
        if given.get(b"host") != [self._host]:
            return "this page is reached by the address that blurmatte printed"
        if given.get(b"origin", [b"http://" + self._host]) != [b"http://" + self._host]:
            return "another site may not use this page"
        foreign = given.get(b"sec-fetch-site", [b"none"])[0] in (b"cross-site", b"same-site")
        if foreign and not _is_opening(scope, given):
            return "another site may not use this page"
        if scope["path"] != "/" and not scope["path"].startswith("/page/"):
            (key, *more) = given.get(b"authorization", [b""])
            if more or not secrets.compare_digest(key, self._key):
                return "open the page by the whole address that blurmatte printed"
            self._entered()
        return None


def _is_opening(scope: Scope, given: dict[bytes, list[bytes]]) -> bool:
    """Whether a window goes to the page, as by a link in a file; the page alone holds nothing."""
    how = [given.get(name) for name in (b"sec-fetch-mode", b"sec-fetch-dest")]
    at_start: bool = scope["method"] == "GET" and scope["path"] == "/"
    return at_start and how == [[b"navigate"], [b"document"]]


class _Json(JSONResponse):
    """Letters that are none, as in names of files, are escaped."""

    def render(self, content: Any) -> bytes:
        """The bytes of a value."""
        return json.dumps(content, allow_nan=False).encode()


def _refusal(why: str, status: int = 400) -> Response:
    return _Json({"error": why}, status)


async def _on_error(_: Request, error: Exception) -> Response:
    """What was refused or is not there, and why; anything else is a defect."""
    if isinstance(error, RefusedError):
        return _refusal(str(error))
    if isinstance(error, HTTPException):
        return _Json({"error": str(error.detail)}, error.status_code, error.headers)
    why = f"a defect of blurmatte, {type(error).__name__}: {error}; please report it"
    return _refusal(why, 500)


Handler = Callable[[Request], Awaitable[Response]]


class Requests:
    """What the page may ask of a session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.quit: Callable[[], None] = lambda: None
        routes: list[tuple[str, str, Handler]] = [
            ("GET", "/", self._index),
            ("GET", "/page/{name:path}", self._page),
            ("GET", "/api/state", self._state),
            ("GET", "/api/states", self._states),
            ("PUT", "/api/files", self._receive),
            ("GET", "/api/jobs", self._jobs),
            ("POST", "/api/jobs", self._add),
            ("GET", "/api/jobs/{job:int}", self._job),
            ("DELETE", "/api/jobs/{job:int}", self._cancel),
            ("POST", "/api/jobs/{job:int}/resume", self._resume),
            ("GET", "/api/jobs/{job:int}/results.zip", self._zip),
            ("GET", "/api/jobs/{job:int}/results/{name:path}", self._result),
            ("GET", "/api/look/{question}", self._look),
            ("POST", "/api/quit", self._quit),
        ]
        self.app = Starlette(
            routes=[Route(path, handler, methods=[method]) for method, path, handler in routes],
            exception_handlers=dict.fromkeys((RefusedError, HTTPException, Exception), _on_error),
        )

    async def _index(self, _: Request) -> Response:
        return Response((_PAGE / "index.html").read_bytes(), media_type=_TYPES[".html"])

    async def _page(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in _page_files():
            raise HTTPException(404, f"the page has no file {name}")
        data = _PAGE.joinpath(*name.split("/")).read_bytes()
        return Response(data, media_type=_TYPES.get(Path(name).suffix, _DATA))

    async def _state(self, _: Request) -> Response:
        return _Json(self._session.state)

    async def _states(self, _: Request) -> Response:
        """The state and its changes, a line of JSON each."""

        async def lines() -> AsyncIterator[str]:
            async for state in self._session.states():
                yield json.dumps(state) + "\n"

        return StreamingResponse(lines(), media_type="application/x-ndjson")

    async def _receive(self, request: Request) -> Response:
        """Take a file, which is the body as it is."""
        length = request.headers.get("content-length")
        name, pieces = request.query_params.get("name", ""), _pieces(request)
        try:
            size = None if length is None else int(length)
            held = await self._session.receive(name, pieces, size)
        except RefusedError:
            with contextlib.suppress(RefusedError, TimeoutError):
                async with asyncio.timeout(_SECONDS_TO_DRAIN):
                    async for _ in pieces:  # else the answer would not be read
                        pass
            raise
        return _Json(held.state)

    async def _jobs(self, _: Request) -> Response:
        return _Json([job.status for job in self._session.jobs.values()])

    async def _add(self, request: Request) -> Response:
        asked = await _json(request)
        words, title = asked.get("words"), asked.get("title", "")
        if not isinstance(words, list) or not isinstance(title, str):
            raise RefusedError("a job has words, a list, and a title, a text")
        return _Json(self._session.add(words, title).status)

    async def _job(self, request: Request) -> Response:
        job = self._named(request)
        answer = await asyncio.to_thread(lambda: job.answer)
        return _Json({**job.status, "answer": answer})

    async def _cancel(self, request: Request) -> Response:
        job = self._named(request)
        await self._session.cancel(job)
        return _Json(job.status)

    async def _resume(self, request: Request) -> Response:
        job = self._named(request)
        self._session.resume(job)
        return _Json(job.status)

    async def _result(self, request: Request) -> Response:
        job, name = self._named(request), request.path_params["name"]
        path = self._session.source(None, job.number, name)
        kind = _TYPES.get(path.suffix.lower(), _DATA)
        with contextlib.suppress(OSError):
            return FileResponse(path, media_type=kind, filename=path.name, stat_result=path.stat())
        raise HTTPException(404, f"{path.name} was deleted")

    async def _zip(self, request: Request) -> Response:
        """All results of a job, as an archive that is written while it is sent."""
        job = self._named(request)
        names = [name for name in job.files if (job.folder / name).is_file()]
        if not names:
            raise RefusedError(f"job {job.number} has no results")
        name = f"{job.title or job.words[0]}.zip".replace('"', "")
        safe = "".join(c if c.isascii() and c.isprintable() else "_" for c in name)
        headers = {"Content-Disposition": f'attachment; filename="{safe}"'}
        return StreamingResponse(
            _zipped(job.folder, names), media_type="application/zip", headers=headers
        )

    async def _look(self, request: Request) -> Response:
        """What the viewer reads of a file, or of a result of a job."""
        question, given = request.path_params["question"], request.query_params
        if question not in _QUESTIONS:
            raise HTTPException(404, f"there is no question {question}")
        kinds = _QUESTIONS[question]
        path = self._source(given)
        if missing := next((name for name in kinds if name not in given), ""):
            raise RefusedError(f"{missing} is missing")
        values = {name: _number(given[name], kind) for name, kind in kinds.items()}
        if question == "tile" and any(f"basis_{name}" in given for name in ("file", "job")):
            values["basis"] = self._source(given, "basis_")
        asking = asyncio.ensure_future(self._session.ask(question, path=path, **values))
        while not asking.done():
            await asyncio.wait([asking], timeout=0.2)
            if not asking.done() and await request.is_disconnected():
                asking.cancel()
                return Response(status_code=499)
        answer = asking.result()
        if answer.data:
            kind = _TYPES[".png"] if question == "preview" else _DATA
            return Response(answer.data, media_type=kind)
        return _Json(answer.numbers)

    def _source(self, given: QueryParams, prefix: str = "") -> Path:
        """A file by its number, or a result by its job and name."""
        file, job = (_number(given.get(prefix + name), int) for name in ("file", "job"))
        return self._session.source(file, job, given.get(f"{prefix}name"))

    async def _quit(self, _: Request) -> Response:
        self.quit()
        return _Json({})

    def _named(self, request: Request) -> Job:
        number = request.path_params["job"]
        if number not in self._session.jobs:
            raise HTTPException(404, f"there is no job {number}")
        return self._session.jobs[number]


# What the viewer answers: the values of each question, with their kinds.
_QUESTIONS: dict[str, dict[str, type]] = {
    "describe": {},
    "tile": {"part": str, "frame": int, "level": int, "x": int, "y": int},
    "preview": {"part": str, "frame": int, "side": int, "stops": float},
    "pixels": {"frame": int, "x": int, "y": int, "radius": int},
}


def _number(text: str | None, kind: type) -> Any:
    """A value of that kind; RefusedError if it is none, or negative."""
    if text is None or kind is str:
        return text
    try:
        value = kind(text)
    except (ValueError, OverflowError):
        raise RefusedError(f"{text!r} is no number") from None
    if kind is int and value < 0:
        raise RefusedError(f"{text} is below 0")
    return value


def _page_files() -> set[str]:
    """The names of the page's files."""
    root = Path(str(_PAGE))
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}


async def _pieces(request: Request, silence: float = _SECONDS_OF_SILENCE) -> AsyncIterator[bytes]:
    """The body of a request as it comes; RefusedError after so many seconds without a piece."""
    stream = request.stream().__aiter__()
    while True:
        try:
            yield await asyncio.wait_for(anext(stream), silence)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise RefusedError("the file stopped coming; drop it again") from None
        except ClientDisconnect:
            raise RefusedError("the file was cut off; drop it again") from None


async def _json(request: Request) -> dict[str, Any]:
    """The object in the body of a request."""
    body = bytearray()
    async for piece in _pieces(request):
        body += piece
        if len(body) > _MAX_JSON_BYTES:
            raise HTTPException(413, "the request is too long")
    try:
        value = json.loads(bytes(body))
    except (ValueError, RecursionError):
        raise RefusedError("the request is no JSON") from None
    if not isinstance(value, dict):
        raise RefusedError("the request is no object")
    return value


class _Tail:
    """A file to write to of which the end can be taken again and again."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def write(self, data: bytes) -> int:
        """Keep the bytes."""
        self._bytes += data
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def taken(self) -> bytes:
        """What was written since."""
        taken, self._bytes = bytes(self._bytes), bytearray()
        return taken


def _zipped(folder: Path, names: list[str]) -> Iterator[bytes]:
    """An archive of files of a folder, piece by piece."""
    tail = _Tail()
    with zipfile.ZipFile(tail, "w") as archive:  # type: ignore[call-overload]
        for name in names:
            path = folder / name
            entry = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
            with path.open("rb") as source, archive.open(entry, "w", force_zip64=True) as target:
                while piece := source.read(_PIECE_BYTES):
                    target.write(piece)
                    yield tail.taken()
            yield tail.taken()
    yield tail.taken()

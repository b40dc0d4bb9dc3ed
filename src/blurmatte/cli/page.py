"""The command that serves the page: ui."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.app import command, run_line
from blurmatte.cli.console import ExitCode, argument, optional, output, say, switch
from blurmatte.cli.paths import check_folder


@command("ui --out results/", "ui throw.png empty_room.png --port 8000 --no-browser")
def ui(
    files: Annotated[
        list[Path] | None, argument("FILES", "Pictures and clips to begin with.")
    ] = None,
    out: Annotated[
        Path | None, output("Keep the results here; else they are deleted.", "FOLDER")
    ] = None,
    port: int = optional("N", "Port of this machine; else a free one.", default=0),
    no_browser: bool = switch("--no-browser", "Print the address, open nothing."),
) -> None:
    """Open a page in the browser: all commands in a window, on this machine alone.

    Its address is printed first. Quit on the page, or Ctrl-C, ends it.
    """
    for file in files or []:
        if file.is_dir():
            raise bm.errors.FileError(f"{file}: is a folder; name the files in it")
        if not file.is_file():
            raise bm.errors.FileError(f"{file}: there is no such file; check the name")
    if out is not None:
        check_folder(out)
    if not 0 <= port < 65536:
        raise ValueError(f"--port must be 0 to 65535, got {port}")
    try:
        from blurmatte.ui.server import serve
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        raise ValueError(f'the page needs {library}: pip install "blurmatte[ui]"') from error
    from blurmatte.ui import Session

    session = Session(run_line, bm.__version__, files or [], out)

    def opened(address: str) -> None:
        """Print the address, and open it."""
        say(address)
        if not no_browser:  # by a file: all users of a machine see the arguments of a browser
            _open(session.write_entry(address).as_uri())

    if serve(session, port, opened):
        raise typer.Exit(ExitCode.INTERRUPTED)


def _open(address: str) -> None:
    """Open an address in a browser, which a Ctrl-C in this terminal does not end."""
    nothing = subprocess.DEVNULL
    command = [sys.executable, "-m", "webbrowser", address]
    with suppress(OSError):
        opening = subprocess.Popen(
            command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True
        )
        threading.Thread(target=opening.wait, daemon=True).start()

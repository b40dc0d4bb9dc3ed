"""The command that serves the page: ui."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.app import command, run_line
from blurmatte.cli.console import argument, flag, option, say
from blurmatte.cli.output_checks import check_folder


@command("ui", "ui throw.png empty_room.png --out results/")
def ui(
    files: Annotated[
        list[Path] | None, argument("FILE", "Pictures and clips to begin with.")
    ] = None,
    out: Annotated[
        Path | None,
        option("FOLDER", "Keep the results there; else they end with it.", None, "--out", "-o"),
    ] = None,
    port: Annotated[int, option("N", "Of this machine; else a free one.")] = 0,
    no_browser: Annotated[bool, flag("--no-browser", "Print the address, open nothing.")] = False,
) -> None:
    """Open a page in the browser: the whole job in a window, on this machine alone.

    Prints its address. Ctrl-C, or Quit on the page, ends it.
    """
    for file in files or []:
        if not file.is_file():
            raise bm.FileError(f"{file}: no such file; check the name")
    if out is not None:
        check_folder(out)
    if not 0 <= port < 65536:
        raise ValueError(f"--port must be 0 to 65535, got {port}")
    try:
        from blurmatte.ui.server import serve
    except ImportError as error:
        raise ValueError(f"the page needs {error.name}: pip install 'blurmatte[ui]'") from error
    from blurmatte.ui import Session

    def opened(address: str) -> None:
        """Print the address, and open it."""
        say(address)
        if not no_browser:
            typer.launch(address)

    serve(Session(run_line, bm.__version__, files or [], out), port, opened)

"""What the command line says: answers to stdout, everything else to stderr."""

import sys
from typing import TextIO

import typer

import blurmatte as bm


def swatches(model: bm.ColorModel) -> list[str]:
    """The colors still possible as blocks of color, the likeliest first, where they can be shown."""
    if model.rank == 3 or not sys.stdout.isatty():
        return []
    blocks = [[_block(*bytes.fromhex(color[1:])) for color in m.hex] for m in model.possible]
    return [" ".join(row) for row in zip(*blocks, strict=True)]


def _block(red: int, green: int, blue: int) -> str:
    return typer.style("    ", bg=(red, green, blue))


def in_degrees(model: bm.ColorModel) -> str:
    """A model in one line: its colors, rank, and how sure they are."""
    if model.rank == 3:
        return "any colors  rank 3"
    sure = f"± {model.angle_std:.2g}°" if model.evidence else "given"
    return f"{' + '.join(model.hex)}  rank {model.rank}, {sure}"


def by(size: tuple[int, int]) -> str:
    """A size in words: 640x480."""
    return f"{size[0]}x{size[1]}"


def say(text: str) -> None:
    """To stdout, whatever bytes the names of files hold."""
    _write(text.encode("utf-8", "backslashreplace").decode(), sys.stdout)


def complain(text: str) -> None:
    """One line to stderr."""
    _write(f"blurmatte: {' '.join(text.split())}", sys.stderr)


def _write(text: str, stream: TextIO) -> None:
    """To a screen as it is now: what is drawn there meanwhile makes room."""
    typer.echo(text, file=stream if stream.isatty() else None, err=stream is sys.stderr)

"""The command that makes a plate: plate."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from glob import glob
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.printing import by, say
from blurmatte.cli.program import about, app, bar, told
from blurmatte.cli.targets import check_ending, check_folder, check_other

When = Annotated[
    str | None, typer.Option(metavar="N|Ns", help="A frame, counted from 0; or seconds, like 2.5s.")
]


@app.command()
@told
def plate(
    source: Annotated[
        list[str],
        typer.Argument(metavar="CLIP", help="A clip; or pictures, a folder or a glob of them."),
    ],
    out: Annotated[Path, typer.Option(help="Where to write the plate: .exr keeps its error.")],
    start: When = None,
    stop: When = None,
    step: Annotated[int, typer.Option(help="Use every frame of that many.")] = 1,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Make a plate of a CLIP: the scene without what moves in front of it.

    A sheet to look at is written beside it, called like it with _overview.png at the end.
    """
    if step < 1:
        raise ValueError(f"--step must be at least 1, got {step}")
    curve = Files(transfer, max_pixels).curve
    check_ending(out, "a plate", ".exr", ".png", ".tif", ".jpg")
    check_folder(out.parent)
    check_other(out, *_read(source))
    with about(Path(source[0])):
        frames = bm.read_frames(source[0] if len(source) == 1 else source, curve, max_pixels)
        frames = frames[frame_number(start, frames.rate) : frame_number(stop, frames.rate) : step]
        with _watched(frames) as watched:
            fit = bm.make_plate(watched)
    with about(out):
        written = bm.save_plate(out, fit)
    say("\n".join([f"plate of {len(fit.gain)} frames, {by(fit.plate.size)}", *bm.explain(fit)]))
    say("\n".join(map(str, written)))


def _read(source: list[str]) -> Iterator[str]:
    """The files that are named, that fit a pattern, or that lie in a folder."""
    for text in source:
        yield text
        yield from glob(f"{text}/*" if Path(text).is_dir() else text)


def frame_number(text: str | None, rate: float | None) -> int | None:
    """A frame's number, of what counts frames or, with an s behind it, seconds."""
    if text is None:
        return None
    if not re.fullmatch(r"\d+|\d+(\.\d*)?s", text):
        raise ValueError(f"a frame must be a number like 120, or seconds like 4.5s, got {text!r}")
    if not text.endswith("s"):
        return int(text)
    if rate is None:
        raise ValueError(f"{text}: pictures have no time; count them")
    return round(float(text[:-1]) * rate)


@contextmanager
def _watched(frames: bm.Frames[bm.LinearImage]) -> Iterator[bm.Frames[bm.LinearImage]]:
    """The same frames, with a bar on stderr for each run through them, if a person is watching."""
    if not sys.stderr.isatty():
        yield frames
        return
    with bar(several=True) as shown:

        def load(numbers: range) -> Iterator[bm.LinearImage]:
            yield from shown.track(frames.load(numbers), len(numbers), description="reading")

        yield replace(frames, load=load)

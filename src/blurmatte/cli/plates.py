"""The command that makes a plate: plate."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, answer, by, with_progress
from blurmatte.cli.paths import PICTURE, check_ending, check_folder, check_outputs
from blurmatte.cli.quantities import frame_range
from blurmatte.cli.selection import Clip, FrameRange, Out, Reading


@command(
    "plate rally.mp4 -o plate.exr",
    "plate rally.mp4 -o plate.exr --frames 12.5s:30s:2",
)
def plate(
    source: Clip,
    out: Out,
    reading: Reading,
    frames: FrameRange = None,
    as_json: AsJson = False,
) -> None:
    """Make a plate from CLIP: the scene without moving objects.

    As .exr it keeps its error. A sheet to look at is written next to it, as NAME_overview.png.
    """
    from blurmatte.results import plate_files

    frame_range("--frames", frames)
    reading.curve  # noqa: B018  # refuses an unknown name
    check_ending(out, "a plate", *PICTURE)
    check_folder(out.parent)
    check_outputs(*plate_files(out))
    with about(Path(source[0])):
        fit = bm.make_plate(_watched(reading.frames(source, frames)))
    with about(out):
        written = bm.results.save_plate(out, fit)
    words, count, size = bm.explain(fit), len(fit.gain), fit.plate.size
    numbers = {"frames": count, "size": size, "in_words": words, "files": written}
    answer(as_json, numbers, [f"plate of {count} frames, {by(size)}", *words, *written])


def _watched(frames: bm.Frames[bm.LinearImage]) -> bm.Frames[bm.LinearImage]:
    """The same frames, with a progress bar for each pass."""
    if not sys.stderr.isatty():
        return frames

    def load(numbers: range) -> Iterator[bm.LinearImage]:
        """Frames of these numbers, with a progress bar."""
        yield from with_progress(frames.load(numbers), "reading", len(numbers))

    return replace(frames, load=load)

"""Rows of layers, changed one after another: alone, over a picture, or in their own pictures."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import blurmatte as bm
from blurmatte.cli.changes import RowOptions
from blurmatte.cli.console import about, say, with_progress
from blurmatte.cli.paths import check_outputs, pictures_of
from blurmatte.cli.selection import Reading

if TYPE_CHECKING:
    from blurmatte.checks import Bools

Shown: TypeAlias = "tuple[bm.LinearImage, Bools]"
# The picture with another object, and the pixels that changed; of picture, layer and streak.
Retouch: TypeAlias = "Callable[[bm.LinearImage, bm.Layer, Bools], Shown]"


def edit_row(
    reading: Reading, source: str, out: Path, edit: Callable[[bm.Layer], Any], options: RowOptions
) -> None:
    """Write what becomes of each layer; only one of them is in memory at a time."""
    _checked_target(out, source)
    with about(Path(source)):
        row = bm.read_layers(source, max_pixels=reading.max_pixels)
    with about(out):
        edited: Any = map(edit, with_progress(row, "editing"))
        bm.write_frames(out, edited, options.rate or row.rate, options.start(row))
    say(str(out))


def retouch_row(
    reading: Reading, source: str, image: Path, out: Path, retouch: Retouch, options: RowOptions
) -> None:
    """Write all frames of a clip or of a row of pictures, those with a layer retouched."""
    from blurmatte.files.atomic import moved_together
    from blurmatte.files.sequences import source_paths

    target = _checked_target(out, source, str(image))
    with about(image):
        frames = bm.read_frames(image, reading.curve, reading.max_pixels)
        originals = None if frames.clip is not None else source_paths(image)
    with about(Path(source)):
        layers = _layers_of(source, reading, frames)
    shown = _shown(frames, layers, Path(source), retouch)
    start = options.start(frames)
    with about(out):
        if target is None or originals is None:
            rate = options.rate or frames.rate
            bm.write_frames(out, (picture for picture, _ in shown), rate, start)
            say(str(out))
            return
        numbers = range(start, start + len(frames)) if isinstance(start, int) else start
        files = [target(number) for number in numbers]
        with moved_together(out.parent) as (temporary, names), warnings.catch_warnings():
            warnings.simplefilter("ignore", bm.errors.TransferWarning)  # given when they were read
            for name, original, one in zip(files, originals, shown, strict=True):
                curve = reading.curve_of(original)
                bm.write_changed(temporary / name, original, *one, curve, reading.max_pixels)
                names.append(name)
    say(str(out))


def layer_and_streak(path: Path, reading: Reading) -> tuple[bm.Layer, Bools]:
    """The layer, and (H, W) bool: the pixels to remove.

    That is where the solution says that something moved, or of a mere layer where it is.
    """
    try:
        solution = bm.read_solution(path, reading.max_pixels)
    except bm.errors.FileError:  # no solution: a layer, or reading it as one says what is wrong
        layer = bm.read_layer(path, max_pixels=reading.max_pixels)
        return layer, layer.alpha > 0
    return solution.layer, solution.streak


def _checked_target(out: Path, *sources: str) -> Callable[[int], str] | None:
    """The names of numbered files to write, none of which may be read; None for one file."""
    from blurmatte.files.sequences import numbering

    numbers = numbering(out)
    check_outputs(*(numbers.files() if numbers else ()), inputs=pictures_of(sources))
    return numbers.name if numbers else None


def _layers_of(
    source: str, reading: Reading, frames: bm.Frames[bm.LinearImage]
) -> Iterator[tuple[int, bm.Layer, Bools]]:
    """Layers with the numbers of their frames; a .mov has one for each frame.

    Raises ValueError if no layer has the number of a frame, or sizes differ.
    """
    from blurmatte.files.sequences import source_paths

    row = bm.read_layers(source, max_pixels=reading.max_pixels)
    bm.checks.check_same_size("the layer", row.size, "the image", frames.size)
    mine, known = row.frame_numbers, frames.frame_numbers
    if row.clip is not None:
        if len(row) != len(frames):
            raise ValueError(
                f"give all pictures that it is from: it has {len(row)} frames, they are {len(frames)}"
            )
        return ((k, layer, layer.alpha > 0) for k, layer in zip(known, row, strict=False))
    if not set(mine) & set(known):
        raise ValueError(
            f"give the pictures that it is from: layers are numbered {mine[0]} to {mine[-1]}, "
            f"pictures {known[0]} to {known[-1]}"
        )
    paths = source_paths(source)
    return ((k, *layer_and_streak(path, reading)) for k, path in zip(mine, paths, strict=True))


def _shown(
    frames: bm.Frames[bm.LinearImage],
    layers: Iterator[tuple[int, bm.Layer, Bools]],
    source: Path,
    retouch: Retouch,
) -> Iterator[Shown]:
    """Each frame; those without a layer as they are."""
    layer = next(layers, None)
    progress = with_progress(frames, "editing", len(frames))
    for number, picture in zip(frames.frame_numbers, progress, strict=False):
        while layer is not None and layer[0] < number:
            layer = next(layers, None)
        if layer is None or layer[0] > number or not layer[2].any():
            import numpy as np  # not for --help

            yield picture, np.zeros(picture.valid.shape, bool)
            continue
        with about(source):
            one = retouch(picture, *layer[1:])
        yield one

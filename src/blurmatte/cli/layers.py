"""The commands for many layers, and for the paints of one: stack and paints."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import (
    about,
    answer,
    argument,
    flag,
    grade_lines,
    option,
    say,
    waiting,
    with_progress,
)
from blurmatte.cli.paths import PICTURE, ROWS, check_file, check_folder, check_outputs
from blurmatte.cli.selection import Layer, Out, OutFolder, Reading
from blurmatte.formats import MAX_PIXELS


@command(
    "stack 'out/*/layer.exr' --over empty_room.png -o path.png",
    "stack layers/ball.mov -o path.exr",
)
def stack(
    layers: Annotated[list[str], argument("LAYER", f"Layers in their order, or a .mov: {ROWS}.")],
    out: Out,
    reading: Reading,
    over: Annotated[
        Path | None, option("FILE", "The picture behind all of them, usually the plate.")
    ] = None,
    long: Annotated[bool, flag("--long", "As one exposure as long as all together.")] = False,
) -> None:
    """Stack layers into one: the path of an object through a clip.

    Only one of them is in memory at a time.
    """
    if over is not None:
        check_file(out, "a picture", *PICTURE)
    with about(Path(layers[0])):
        source = layers[0] if len(layers) == 1 else layers
        row = bm.read_layers(source, max_pixels=reading.max_pixels)
        watched = with_progress(row, "stacking")
        whole = bm.compositing.long_exposure(watched) if long else bm.compositing.stack(watched)
    result: bm.Layer | bm.LinearImage = whole
    if over is not None:
        picture = reading.read(over)
        with about(over):
            result = whole.over(picture)
    with about(out):
        bm.write(out, result)
    say(str(out))


@command(
    'paints out/layer.exr --color "#d02020" --color "#2040d0" -o paints/',
)
def paints(
    layer: Layer,
    color: Annotated[list[str], option("HEX", "The color of a paint; repeat for each.")],
    out: OutFolder,
    max_pixels: Annotated[int, option("N", "Refuse larger pictures; 200 million.")] = MAX_PIXELS,
    as_json: AsJson = False,
) -> None:
    """Map how long each paint of an object was at each pixel.

    Writes paint1.png, paint1_std.png, … and overview.png into the folder.
    """
    from blurmatte.results import RESULT_FILES, exposure_files

    check_folder(out)
    results = [layer.parent / name for name in RESULT_FILES]  # its sheet has the name of ours
    check_outputs(*exposure_files(out, len(color)), inputs=filter(Path.exists, results))
    with about(layer), waiting("separating the paints"):
        solution = bm.read_solution(layer, max_pixels)
        exposures = bm.compositing.split_exposure(solution, *color)
        written = bm.results.save_exposures(out, solution.layer, exposures)
    sums = exposures.fraction.sum(axis=(0, 1), dtype=float)
    areas = list(zip(color, sums, strict=True))
    graded = grade_lines(solution)
    lines = [*graded, *(f"{name}: {total:.6g} pixels times exposure" for name, total in areas)]
    numbers: dict[str, Any] = {"grade": str(solution.grade) if graded else None}
    numbers |= {"pixels_times_exposure": dict(areas), "files": written}
    answer(as_json, numbers, [*lines, *written])

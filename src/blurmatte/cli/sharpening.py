"""The command that shows an object as it was at moments of the exposure: sharpen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, option, say, say_json, waiting
from blurmatte.cli.output_checks import SHEET, check_ending, check_file
from blurmatte.cli.rows import ROWS, expanded
from blurmatte.cli.selection import Out, Reading, matching_of

PICTURES = "Its pictures"
_CLIP = ".mov", ".mp4", ".gif", ".webp"
_OVER_PLATE = ".mp4", ".gif", ".webp"  # formats without alpha
_STILL = ".exr", ".png", ".tif"


@dataclass(frozen=True)
class Blurred:
    """The pictures that a layer is from; with them the path is refined."""

    image: Annotated[Path | None, option("FILE", "With the object.", PICTURES)] = None
    plate: Annotated[Path | None, option("FILE", "Without it.", PICTURES)] = None
    match: Annotated[
        str, option("MODE", "How it may be changed: auto, none, exposure, shift, full.", PICTURES)
    ] = "auto"

    def __post_init__(self) -> None:
        matching_of(self.match)
        if self.image is not None and self.plate is None:
            raise ValueError("--image needs --plate, the scene without the object")


@command(
    "sharpen out/layer.exr --frames 8 -o ball.mov",
    "sharpen out/layer.exr --image throw.jpg --plate empty_room.jpg --frames 8 -o ball.mp4",
    "sharpen 'out/*/layer.exr' --frames 4 -o slow.mov",
)
def sharpen(
    layer: Annotated[
        str, typer.Argument(metavar="LAYER", help=f"The layer.exr of solve, or several: {ROWS}.")
    ],
    pictures: Blurred,
    reading: Reading,
    out: Out,
    frames: Annotated[int, option("N", "Moments of each exposure, equally spaced.")] = 1,
    rate: Annotated[float, option("FPS", "Frames per second of a clip.")] = 8.0,
    sheet: Annotated[Path | None, option("FILE", "A sheet: before, after, and the error.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show an object sharp, as it was at moments of the exposure.

    Of one moment, the middle, a layer is written; of several, or of several layers in their order, a
    clip or a row of layers. A clip without alpha (.mp4, .gif, .webp) shows them over --plate.
    """
    if frames < 1:
        raise ValueError(f"--frames must be 1 or more, got {frames}")
    check_file(sheet, "a sheet", *SHEET)
    files = expanded([layer])
    if len(files) > 1 and (sheet is not None or pictures.image is not None):
        raise ValueError(f"--image and --sheet are for one layer; {layer} are {len(files)}")
    single = frames * len(files) == 1
    check_ending(out, "a sharp object", *(_STILL if single else (*_STILL, *_CLIP)))
    if out.suffix.lower() in _OVER_PLATE and pictures.plate is None:
        raise ValueError(f"{out.suffix} has no alpha: add --plate, or write .mov or .exr")
    answers: list[dict[str, Any]] = []
    with waiting("sharpening"):
        image, plate = _read(pictures, reading)
        sharps = _sharpened(files, image, plate, reading, sheet)
        _write(out, sharps, frames, plate, rate, answers)
    if as_json:
        say_json(answers[0] if len(answers) == 1 else {"layers": answers})
        return
    for answer in answers:
        say(
            "{frames} sharp, color ± {color_std:.3f} of white, misfit {misfit:.2f} (1 is noise), "
            "path {path_length_px:.1f} px".format(**answer)
        )
    if image is None:
        say("the path was not refined: that needs --image and --plate")


def _read(
    pictures: Blurred, reading: Reading
) -> tuple[bm.LinearImage | None, bm.LinearImage | None]:
    """Image and plate, matched, where they are given."""
    if pictures.plate is None:
        return None, None
    plate, _ = reading.read(pictures.plate)
    if pictures.image is None:
        return None, plate
    image, _ = reading.read(pictures.image)
    with about(pictures.plate):
        return image, bm.match_plate(plate, image, matching_of(pictures.match))


def _sharpened(
    files: Sequence[Path],
    image: bm.LinearImage | None,
    plate: bm.LinearImage | None,
    reading: Reading,
    sheet: Path | None,
) -> Iterator[bm.Sharp]:
    """The sharp object of each layer; only one of them is in memory at a time."""
    for file in files:
        with about(file):
            solution = bm.read_solution(file, reading.max_pixels)
            sharp = _deblurred(solution, image, plate)
        if sheet is not None:
            with about(sheet):
                bm.write(sheet, bm.draw_sharp(sharp, solution.layer))
        yield sharp


def _deblurred(
    solution: bm.Solution, image: bm.LinearImage | None, plate: bm.LinearImage | None
) -> bm.Sharp:
    """From the pictures if both are given, else from the solution."""
    if image is None or plate is None or solution.sweep is None:
        return bm.deblur_solution(solution)  # refuses if there is no path
    return bm.deblur(image, plate, solution.sweep)


def _write(
    out: Path,
    sharps: Iterator[bm.Sharp],
    frames: int,
    plate: bm.LinearImage | None,
    rate: float,
    answers: list[dict[str, Any]],
) -> None:
    """Write the moments of each object, and add its numbers to the answers."""

    def layers() -> Iterator[bm.Layer]:
        """All moments, in order."""
        for sharp in sharps:
            answers.append(
                {
                    "frames": frames,
                    "color_std": float((sharp.node_std**2).mean() ** 0.5),
                    "misfit": sharp.misfit,
                    "path_length_px": sharp.sweeps[0].length,
                }
            )
            yield from sharp.subframes(frames)

    shown: Any = layers()
    if out.suffix.lower() in _OVER_PLATE and plate is not None:
        shown = (one.over(plate) for one in shown)
    first = next(shown)
    second = next(shown, None)
    with about(out):
        if second is None:
            bm.write(out, first)
        else:
            bm.write_frames(out, chain([first, second], shown), rate)

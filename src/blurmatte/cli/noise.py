"""The command that measures the noise of a camera: calibrate noise."""

from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files, box_of, expanded
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.printing import say
from blurmatte.cli.program import about, calibrate, told
from blurmatte.cli.targets import SHEET, check_file, check_other


@calibrate.command()
@told
def noise(
    pictures: Annotated[
        list[str],
        typer.Argument(
            metavar="PICTURE", help="Frames of a still scene, taken alike, or one picture."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Where to write the noise: a .json.")] = None,
    region: Annotated[
        str | None,
        typer.Option(
            metavar="X0,Y0,X1,Y1",
            help="Where to look: of one picture without a plate, an even part. X1, Y1 are excluded.",
        ),
    ] = None,
    plate: Annotated[
        Path | None, typer.Option(help="For one picture: the same scene without the object.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw noise against light: a .png or .jpg.")
    ] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Measure the gain and the read noise of a camera, and how its noise hangs together."""
    check_file(out, "noise", ".json")
    check_file(plot, "a plot", *SHEET)
    files = Files(transfer, max_pixels)
    paths = [path for text in pictures for path in expanded(text)]
    check_other(plot, *paths, plate)
    with about(paths[0]):
        fit = _measured(paths, plate, region, files)
    if plot is not None:
        bm.write(plot, bm.draw_noise(fit))
    if out is not None:
        bm.write(out, fit)
    say("\n".join([str(fit), *bm.explain(fit)]))


def _measured(
    paths: list[Path], plate: Path | None, region: str | None, files: Files
) -> bm.NoiseFit:
    if plate is not None and len(paths) > 1:
        raise ValueError(f"--plate is for one picture, got {len(paths)}; frames need none")
    first, guessed = files.read(paths[0])
    if guessed and first.meta.transfer is not None:  # one warning will do
        files = replace(files, transfer=first.meta.transfer.name)
    inside = None if region is None else _inside(region, first)
    if plate is not None:
        return bm.measure_noise_against(first, files.read(plate)[0], inside)
    if len(paths) > 1:
        others = (files.read(path)[0] for path in paths[1:])
        return bm.measure_noise(chain([first], others), inside)
    if inside is None:
        raise ValueError(
            "one picture does not tell noise from scene: give several frames of a still scene, or "
            "--plate, or an even part with --region"
        )
    return bm.measure_noise_within(first, inside)


def _inside(
    region: str, picture: bm.LinearImage
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    return bm.Streak.from_box(box_of(region), picture.size).mask

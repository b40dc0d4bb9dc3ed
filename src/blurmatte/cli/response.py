"""The command that measures the curve of a camera: calibrate response."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files, expanded
from blurmatte.cli.options import MaxPixels
from blurmatte.cli.printing import say
from blurmatte.cli.program import about, calibrate, told
from blurmatte.cli.quantities import number
from blurmatte.cli.targets import SHEET, check_file, check_other


@calibrate.command()
@told
def response(
    pictures: Annotated[
        list[str],
        typer.Argument(
            metavar="PICTURE", help="One still scene, exposed differently; quoted globs work."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Where to write the curve: a .json.")] = None,
    exposures: Annotated[
        str | None,
        typer.Option(
            metavar="1/60,1/15,…",
            help="Exposure times, one for each picture, if the files do not tell.",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the curve: a .png or .jpg.")] = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Measure the curve of a camera from pictures of a still scene with different exposures."""
    check_file(out, "a curve", ".json")
    check_file(plot, "a plot", *SHEET)
    files = Files("linear", max_pixels)
    paths = [path for text in pictures for path in expanded(text)]
    check_other(plot, *paths)
    times = None if exposures is None else _seconds(exposures)
    fit = bm.fit_response([files.read(path)[0] for path in paths], times)
    if out is not None:
        fit = replace(fit, transfer=replace(fit.transfer, name=out.stem))
    if plot is not None:
        with about(plot):
            bm.write(plot, bm.draw_response(fit))
    if out is not None:
        bm.write(out, fit)
    say("\n".join([str(fit), *bm.explain(fit)]))


def _seconds(text: str) -> list[float]:
    """Numbers with commas between them, each whole, decimal or a fraction."""
    try:
        return [number(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--exposures must be seconds like 1/60,1/15,0.5, got {text!r}") from None

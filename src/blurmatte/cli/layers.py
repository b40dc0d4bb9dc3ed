"""The commands for many layers, and for what one is made of: stack and paints."""

from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.printing import say
from blurmatte.cli.program import about, app, told, with_progress
from blurmatte.cli.targets import PICTURE, check_file, check_folder, check_kept, check_other


@app.command()
@told
def stack(
    layers: Annotated[
        list[str],
        typer.Argument(
            metavar="LAYER", help="Layers in their order, a pattern, a folder, or a .mov."
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Where to write: a picture, or a layer without --over.")
    ],
    over: Annotated[
        Path | None, typer.Option(help="The picture behind all of them, usually the plate.")
    ] = None,
    long: Annotated[
        bool, typer.Option("--long", help="As one exposure as long as all together.")
    ] = False,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Put many layers into one: the whole way of an object through a clip.

    Only one of them is in memory at a time.
    """
    check_other(out, *layers, over)
    if over is not None:
        check_file(out, "a picture", *PICTURE)
    files = Files(transfer, max_pixels)
    with about(Path(layers[0])):
        source = layers[0] if len(layers) == 1 else layers
        row = bm.read_layers(source, max_pixels=max_pixels)
        watched = with_progress(row, "stacking")
        whole = bm.long_exposure(watched) if long else bm.stack(watched)
    if over is None:
        with about(out):
            bm.write(out, whole)
        return
    picture, _ = files.read(over)
    with about(over):
        together = whole.over(picture)
    with about(out):
        bm.write(out, together)


@app.command()
@told
def paints(
    layer: Annotated[
        Path, typer.Argument(metavar="LAYER", help="A layer.exr that solve wrote, of two colors.")
    ],
    color: Annotated[
        list[str], typer.Option(metavar="HEX", help="The color of a paint; repeat for each.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the maps, made if it is not there.")],
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Say how long each paint of an object of several colors was at each pixel.

    Writes paint1.png, paint1_std.png, … and overview.png into the folder.
    """
    check_folder(out)
    sheet = out / "overview.png"
    check_kept([sheet] if sheet.exists() else [], layer.parent)  # that of the solution
    with about(layer):
        solution = bm.read_solution(layer, max_pixels)
        exposures = bm.split_exposure(solution, *color)
    written = bm.save_exposures(out, solution.layer, exposures)
    for hex_color, total in zip(
        color, exposures.fraction.sum(axis=(0, 1), dtype=float), strict=True
    ):
        say(f"{hex_color}: {total:.6g} pixels times exposure")
    say("\n".join(map(str, written)))

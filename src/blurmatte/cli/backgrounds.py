"""Putting a layer over another picture: where, how large, and in which light."""

from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files, numbers
from blurmatte.cli.printing import by
from blurmatte.cli.program import about

Fit = Annotated[
    str | None,
    typer.Option(metavar="cover", help="Scale the picture to the layer's size and crop it."),
]

Place = Annotated[
    str | None,
    typer.Option(metavar="X,Y", help="Where in the picture the middle of the object goes."),
]

Scale = Annotated[
    float | None, typer.Option(help="How many times as large the object is there; 1 if not given.")
]

MatchLight = Annotated[
    Path | None,
    typer.Option(
        metavar="PLATE",
        help="Bring the object into the picture's light: by their mean, against this plate of its own.",
    ),
]


def onto(
    files: Files,
    layer: bm.Layer,
    over: Path,
    fit: str | None,
    place: str | None,
    scale: float | None,
    match_light: Path | None,
) -> tuple[bm.Layer, bm.LinearImage]:
    """The layer as it is to be put over the picture, and the picture."""
    if fit not in (None, "cover"):
        raise ValueError(f"--fit {fit}: there is only one fit, cover")
    if fit and (place or scale):
        raise ValueError("--fit changes the picture, --place and --scale the layer; give one")
    picture, _ = files.read(over)
    if match_light is not None:
        plate, _ = files.read(match_light)
        with about(match_light):
            layer = layer.relight(bm.light_gain(picture, plate))
    with about(over):
        if fit == "cover":
            picture = bm.cover(picture, layer.size)
        elif place is not None or scale is not None:
            center = None
            if place is not None:
                x, y = numbers("--place", place, "x,y")
                center = x, y
            layer = layer.place(picture.size, center, 1.0 if scale is None else scale)
        if picture.size != layer.size:
            raise ValueError(
                f"the picture is {by(picture.size)} pixels and the layer {by(layer.size)}; add "
                "--fit cover to scale and crop the picture, or --place X,Y to put the object in it"
            )
    return layer, picture

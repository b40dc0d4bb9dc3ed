"""Putting a layer over another picture: where, how large, and in which light."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
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


@dataclass(frozen=True)
class Behind:
    """A picture to put layers over, and where in it, how large and how bright they go."""

    path: Path
    picture: bm.LinearImage
    fit: str | None = None
    center: tuple[float, float] | None = None
    scale: float | None = None
    gain: npt.NDArray[np.float64] | None = None

    def under(self, layer: bm.Layer) -> tuple[bm.Layer, bm.LinearImage]:
        """The layer as it goes over the picture, and the picture, now of one size."""
        picture = self.picture
        with about(self.path):
            if self.gain is not None:
                layer = layer.relight(self.gain)
            if self.fit == "cover":
                picture = bm.cover(picture, layer.size)
            elif self.center is not None or self.scale is not None:
                scale = 1.0 if self.scale is None else self.scale
                layer = layer.place(picture.size, self.center, scale)
            if picture.size != layer.size:
                raise ValueError(
                    f"the picture is {by(picture.size)} pixels and the layer {by(layer.size)}; add "
                    "--fit cover to scale and crop the picture, or --place X,Y to put the object in it"
                )
        return layer, picture


def read_behind(
    files: Files,
    path: Path,
    fit: str | None,
    place: str | None,
    scale: float | None,
    match_light: Path | None,
) -> Behind:
    """What the options say."""
    if fit not in (None, "cover"):
        raise ValueError(f"--fit {fit}: there is only one fit, cover")
    if fit and (place or scale):
        raise ValueError("--fit changes the picture, --place and --scale the layer; give one")
    center = None
    if place is not None:
        x, y = numbers("--place", place, "x,y")
        center = x, y
    picture, _ = files.read(path)
    gain = None
    if match_light is not None:
        plate, _ = files.read(match_light)
        with about(match_light):
            gain = bm.light_gain(picture, plate)
    return Behind(path, picture, fit, center, scale, gain)

"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Image = Annotated[Path, typer.Argument(metavar="IMAGE", help="The picture with the streak.")]


Images = Annotated[
    list[str], typer.Argument(metavar="IMAGE", help="Pictures with a streak; quoted globs work.")
]


Plate = Annotated[Path, typer.Option(help="The same scene without the object.")]


Colors = Annotated[
    list[str] | None,
    typer.Option(
        "--color",
        metavar="HEX|X,Y[,RADIUS]|FILE.json|core",
        help="The object's color: sRGB-coded like #d8ff3c, pixels that show nothing else, a model "
        "that was written before, or the streak's opaque core. Repeat for more samples or a "
        "second color. Without it, the streak itself must tell.",
    ),
]


ColorFrom = Annotated[
    Path | None, typer.Option(help="A sharp picture of the object in which X,Y are picked.")
]


Rank = Annotated[int, typer.Option(help="1: shades of one color. 2: two, or highlights. 3: any.")]


Region = Annotated[
    str | None,
    typer.Option(metavar="X0,Y0,X1,Y1", help="Where the object moved; X1 and Y1 are excluded."),
]


Mask = Annotated[Path | None, typer.Option(help="A picture that is white where the object moved.")]


Occluder = Annotated[
    Path | None,
    typer.Option(help="A picture that is white where something still is in front of the object."),
]


TransferName = Annotated[
    str | None,
    typer.Option(
        metavar="srgb|rec709|linear|gamma2.2|slog3|FILE.json|auto",
        help="How code values encode light, if you know better than the files: a name, or a curve "
        "that calibrate response wrote; auto, of solve and color: what explains the streak.",
    ),
]


NoiseFile = Annotated[
    Path | None,
    typer.Option(
        "--noise",
        metavar="FILE.json",
        help="The camera's noise, as calibrate noise wrote it; else it is measured.",
    ),
]


MaxBrightness = Annotated[
    float | None,
    typer.Option(help="How bright the object can be at most, linear, 1 = white; helps find it."),
]


SolverName = Annotated[
    str,
    typer.Option(
        metavar="auto|swept|smooth|pixelwise|shaded",
        help="swept: a shape on a path; smooth: all pixels together; pixelwise: each alone; shaded: "
        "each alone, and the object's shadow with it. auto: swept and smooth, averaged by how likely "
        "they are.",
    ),
]


Smoothness = Annotated[
    float | None,
    typer.Option(help="With smooth: times as smooth as the data ask for; 1 if not given."),
]


MaxPixels = Annotated[int, typer.Option(help="Larger pictures are refused.")]
ShadedPlate = Annotated[
    Path | None, typer.Option(help="With shaded: the plate in the shadow of the object.")
]
MatchName = Annotated[
    str,
    typer.Option(
        metavar="auto|none|exposure|shift|full",
        help="How the plate may be changed to match the image: its light, its place too, or any "
        "small turn and smooth light. auto: what the pictures ask for.",
    ),
]
Require = Annotated[
    str | None,
    typer.Option(
        metavar="confirmed|plausible",
        help="The least grade: exit code 3 if an answer has a lesser one. Its files are written.",
    ),
]

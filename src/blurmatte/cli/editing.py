"""The command that changes a layer, or a picture by it: edit."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import blurmatte as bm
from blurmatte.cli.backgrounds import Fit, MatchLight, Place, Scale, onto
from blurmatte.cli.inputs import Files, matching_of, numbers
from blurmatte.cli.options import MatchName, MaxPixels, TransferName
from blurmatte.cli.program import about, app, told

_ORDER = "blurmatte.order"
_CHANGES = ("--fade", "--amplify", "--recolor", "--expose", "--gain")
_HEX = "#?[0-9a-fA-F]{6}"

Change = tuple[str, str]


class _InOrder(TyperCommand):
    """Remembers in which order the changes were asked for; options themselves forget."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        names = (word.split("=")[0] for word in args)
        ctx.meta[_ORDER] = [name for name in names if name in _CHANGES]
        return super().parse_args(ctx, args)


@app.command(cls=_InOrder)
@told
def edit(
    ctx: typer.Context,
    layer: Annotated[
        Path, typer.Argument(metavar="LAYER", help="A layer with alpha: EXR, PNG, TIFF.")
    ],
    out: Annotated[
        Path, typer.Option(help="Where to write: a picture, or a layer if nothing is behind it.")
    ],
    image: Annotated[
        Path | None,
        typer.Option(help="The picture the layer is from: it is kept wherever nothing changes."),
    ] = None,
    plate: Annotated[
        Path | None, typer.Option(help="The scene without the object, to come out behind it.")
    ] = None,
    over: Annotated[Path | None, typer.Option(help="Another picture to put it over.")] = None,
    fade: Annotated[
        list[str] | None,
        typer.Option(metavar="F", help="F times as opaque: 0.5 is half, 3 three times."),
    ] = None,
    amplify: Annotated[
        list[str] | None,
        typer.Option(
            metavar="G[,BRIGHTNESS]",
            help="G times as opaque, and as bright as can be: for faint ones.",
        ),
    ] = None,
    recolor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HEX|OLD=NEW[,OLD=NEW]", help="Another color, or others for its paints."
        ),
    ] = None,
    expose: Annotated[
        list[str] | None,
        typer.Option(metavar="STOPS", help="The object brighter by so many stops: 1 is twice."),
    ] = None,
    gain: Annotated[
        list[str] | None,
        typer.Option(metavar="R,G,B", help="The object's light times these, channel by channel."),
    ] = None,
    remove: Annotated[
        bool, typer.Option("--remove", help="Put the plate where the object was.")
    ] = False,
    grow: Annotated[
        int, typer.Option(help="With --remove: how many pixels more on every side.")
    ] = 0,
    fit: Fit = None,
    place: Place = None,
    scale: Scale = None,
    match_light: MatchLight = None,
    match: MatchName = "auto",
    sheet: Annotated[
        Path | None, typer.Option(help="A sheet to look at, before and after: .png or .jpg.")
    ] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Fade, amplify, recolor, expose or remove an object, in its own picture or another.

    Changes are made in the order in which they are given, in linear light.
    """
    given = {"--fade": fade, "--amplify": amplify, "--recolor": recolor, "--expose": expose}
    changes = list(_in_order(ctx.meta[_ORDER], {**given, "--gain": gain}))
    placed = bool(fit or place or scale or match_light)
    _check(image, plate, over, changes, remove, placed)
    files = Files(transfer, max_pixels)
    with about(layer):
        before = bm.read_layer(layer, files.curve, max_pixels)
        after = before.fade(0) if remove else _changed(before, changes)
    picture: bm.LinearImage | None = None
    result: bm.LinearImage | None = None
    if image is not None:
        picture, _ = files.read(image)
        scene = None if plate is None else _matched(files, plate, picture, match)
        with about(layer):
            if remove and scene is not None:
                streak = _streak(layer, before, max_pixels)
                result, touched = bm.remove(picture, scene, streak, grow)
            else:
                result, touched = bm.retouch(picture, before, after, scene)
        with about(out):
            bm.write_changed(out, image, result, touched, files.curve)
    elif (behind := over or plate) is not None:
        before, _ = onto(files, before, behind, fit, place, scale, match_light)
        after, under = onto(files, after, behind, fit, place, scale, match_light)
        picture, result = before.over(under), after.over(under)
        with about(out):
            bm.write(out, result)
    else:
        with about(out):
            bm.write(out, after)
    if sheet is not None:
        done = ", ".join(["remove"] * remove + [f"{name[2:]} {text}" for name, text in changes])
        with about(sheet):
            bm.write(sheet, bm.draw_edit(before, after, picture, result, done))


def _check(
    image: Path | None,
    plate: Path | None,
    over: Path | None,
    changes: Sequence[Change],
    remove: bool,
    placed: bool,
) -> None:
    """Refuse what does not go together, before anything is read."""
    if image is not None and over is not None:
        raise ValueError("--image keeps the object in its own picture, --over puts it in another")
    if placed and over is None:
        raise ValueError("--fit, --place, --scale and --match-light need --over, another picture")
    if remove and (image is None or plate is None):
        raise ValueError("--remove needs --image and --plate: what it was in, and what was behind")
    if remove and changes:
        raise ValueError(f"nothing is left to {changes[0][0][2:]} after --remove; give one of them")
    if not (remove or changes or over or (plate and image is None)):
        raise ValueError(f"nothing to do; give {', '.join(_CHANGES)}, --remove or --over")


def _in_order(order: Sequence[str], given: Mapping[str, list[str] | None]) -> Iterator[Change]:
    """The changes and their values, as they stand on the command line."""
    values = {name: iter(texts or ()) for name, texts in given.items()}
    for name in order:
        yield name, next(values[name])


def _changed(layer: bm.Layer, changes: Sequence[Change]) -> bm.Layer:
    """The layer after all changes, one after another."""
    for name, text in changes:
        match name:
            case "--fade":
                layer = layer.fade(*numbers(name, text, "a factor"))
            case "--amplify":
                layer = layer.amplify(*numbers(name, text, "a factor", "factor,brightness"))
            case "--expose":
                layer = layer.relight(2.0 ** numbers(name, text, "a number of stops")[0])
            case "--gain":
                layer = layer.relight(numbers(name, text, "a factor", "red,green,blue"))
            case _:
                layer = _recolored(layer, text)
    return layer


def _recolored(layer: bm.Layer, text: str) -> bm.Layer:
    """In one new color, or with a new color for each paint."""
    if re.fullmatch(_HEX, text):
        return layer.recolor(text)
    pairs = [pair.split("=") for pair in text.split(",")]
    if any(len(pair) != 2 or not all(re.fullmatch(_HEX, c) for c in pair) for pair in pairs):
        raise ValueError(
            f"--recolor must be a color like #d8ff3c, or OLD=NEW for each paint, got {text!r}"
        )
    return layer.recolor(*(new for _, new in pairs), paints=[old for old, _ in pairs])


def _matched(files: Files, plate: Path, image: bm.LinearImage, match: str) -> bm.LinearImage:
    behind, _ = files.read(plate)
    with about(plate):
        return bm.match_plate(behind, image, matching_of(match))


def _streak(path: Path, layer: bm.Layer, max_pixels: int) -> Any:
    """(H, W) bool: where the solution says that something moved; of a mere layer, where it is."""
    try:
        return bm.read_solution(path, max_pixels).streak
    except bm.FileError:  # no solution: a layer, which was read already
        return layer.alpha > 0

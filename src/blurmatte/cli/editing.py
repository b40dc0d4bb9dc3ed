"""The command that changes a layer, or a picture by it: edit."""

import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import blurmatte as bm
from blurmatte.cli.backgrounds import Behind, Fit, MatchLight, Place, Scale, read_behind
from blurmatte.cli.inputs import Files, is_row, matching_of, numbers
from blurmatte.cli.options import MatchName, MaxPixels, TransferName
from blurmatte.cli.program import about, app, told, with_progress

_ORDER = "blurmatte.order"
_CHANGES = ("--fade", "--amplify", "--recolor", "--expose", "--gain")
_HEX = "#?[0-9a-fA-F]{6}"
_LOOK = 640, 0.3  # pixels at most, and the rim around the object, of a preview
_RATE = 25.0
_NEEDED = "scipy.optimize", "numba"  # by what follows; their import takes as long as a large file

Change = tuple[str, str]


class _InOrder(TyperCommand):
    """Remembers in which order the changes were asked for; options themselves forget."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        names = (word.split("=")[0] for word in args)
        ctx.meta[_ORDER] = [name for name in names if name in _CHANGES]
        return super().parse_args(ctx, args)


@dataclass(frozen=True)
class _Edit:
    """One layer before and after, the pictures with either, and what is behind, as far as there are."""

    before: bm.Layer
    after: bm.Layer
    picture: bm.LinearImage | None = None
    result: bm.LinearImage | None = None
    plate: bm.LinearImage | None = None


@app.command(cls=_InOrder)
@told
def edit(
    ctx: typer.Context,
    layer: Annotated[
        str,
        typer.Argument(
            metavar="LAYER",
            help="A layer with alpha: EXR, PNG, TIFF; or a row of them: layer.####.exr, a .mov.",
        ),
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
            help="G times as opaque, and as bright as can be: for faint objects.",
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
        int, typer.Option(help="With --remove: so many pixels more on every side.")
    ] = 0,
    fit: Fit = None,
    place: Place = None,
    scale: Scale = None,
    match_light: MatchLight = None,
    match: MatchName = "auto",
    sheet: Annotated[
        Path | None, typer.Option(help="A sheet to look at, before and after: .png or .jpg.")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(help="The object coming and going: a .webp, .gif or .mp4 to look at."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Of a row: frames per second of the clip.")
    ] = None,
    start: Annotated[int, typer.Option(help="Of a row: the first number of its files.")] = 1,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Fade, amplify, recolor, expose or remove an object, in its own picture or another.

    Changes are made in the order in which they are given, in linear light.
    """
    given = {"--fade": fade, "--amplify": amplify, "--recolor": recolor, "--expose": expose}
    changes = list(_in_order(ctx.meta[_ORDER], {**given, "--gain": gain}))
    _check(image, plate, over, changes, remove, bool(fit or place or scale or match_light))
    files = Files(transfer, max_pixels)
    behind = None
    scene = over or plate
    if image is None and scene is not None:
        behind = read_behind(files, scene, fit, place, scale, match_light)
    path = Path(layer)
    if is_row(path):
        if image or sheet or preview:
            raise ValueError(
                f"{layer}: --image, --sheet and --preview go with one layer, not a row"
            )
        _edit_row(files, layer, out, changes, behind, rate, start)
        return
    own = [] if image is None else [name for name in (image, plate) if name is not None]
    (before, streak), pictures = _read(files, path, own, remove)
    with about(path):
        after = before.fade(0) if remove else _changed(before, changes)
    if image is None:
        done = _put(_Edit(before, after), behind)
        with about(out):
            bm.write(out, done.after if done.result is None else done.result)
    else:
        picture, matched = pictures[0], None
        if plate is not None:
            with about(plate):
                matched = bm.match_plate(pictures[1], picture, matching_of(match))
        with about(path):
            if remove and matched is not None:
                result, touched = bm.remove(picture, matched, streak, grow)
            else:
                result, touched = bm.retouch(picture, before, after, matched)
        done = _Edit(before, after, picture, result, matched)
        with about(out):
            bm.write_changed(out, image, result, touched, files.curve_of(image), max_pixels)
    if sheet is not None:
        names = ["remove"] * remove + [f"{name[2:]} {text}" for name, text in changes]
        with about(sheet):
            drawn = bm.draw_edit(
                done.before, done.after, done.picture, done.result, ", ".join(names)
            )
            bm.write(sheet, drawn)
    if preview is not None:
        with about(preview):
            _write_preview(preview, done)


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
        raise ValueError(f"after --remove nothing is left to {changes[0][0][2:]}; give one of them")
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


def _edit_row(
    files: Files,
    source: str,
    out: Path,
    changes: Sequence[Change],
    behind: Behind | None,
    rate: float | None,
    start: int,
) -> None:
    """Change layers one after another; only one of them is in memory at a time."""
    with about(Path(source)):
        row = bm.read_layers(source, max_pixels=files.max_pixels)
    seconds = rate or row.rate or _RATE

    def changed() -> Iterator[bm.Layer]:
        for layer in with_progress(row, "editing"):
            yield _changed(layer, changes)

    with about(out):
        if behind is None:
            bm.write_frames(out, changed(), seconds, start)
            return
        pictures = (above.over(below) for above, below in map(behind.under, changed()))
        bm.write_frames(out, pictures, seconds, start)


def _put(done: _Edit, behind: Behind | None) -> _Edit:
    """Over another picture, if there is one."""
    if behind is None:
        return done
    before, _ = behind.under(done.before)
    after, picture = behind.under(done.after)
    return _Edit(before, after, before.over(picture), after.over(picture), picture)


def _read(
    files: Files, path: Path, pictures: Sequence[Path], remove: bool
) -> tuple[tuple[bm.Layer, Any], list[bm.LinearImage]]:
    """The layer with its streak, and pictures, at the same time: of large ones this takes longest."""
    with about(path), ThreadPoolExecutor() as pool:
        for package in _NEEDED if pictures else ():
            pool.submit(import_module, package)
        layer = pool.submit(_layer_and_streak, path, files.max_pixels, remove)
        others = [
            pool.submit(bm.read, name, files.curve_of(name), files.max_pixels) for name in pictures
        ]
        return layer.result(), [other.result() for other in others]


def _layer_and_streak(path: Path, max_pixels: int, remove: bool) -> tuple[bm.Layer, Any]:
    """The layer, and (H, W) bool: where the solution says that something moved, if it is to go.

    Of a mere layer that is where it is.
    """
    if remove:
        try:
            solution = bm.read_solution(path, max_pixels)
        except bm.FileError:  # no solution: a layer, or what reading it as one will tell
            pass
        else:
            return solution.layer, solution.streak
    layer = bm.read_layer(path, max_pixels=max_pixels)
    return layer, layer.alpha > 0


def _write_preview(path: Path, done: _Edit) -> None:
    """The object coming and going, small: an alpha that rises and falls."""
    if done.picture is None or done.result is None:
        raise ValueError("a preview needs something behind it; give --plate, --over or --image")
    without = done.picture
    if done.plate is not None:
        without, _ = bm.retouch(done.picture, done.before, done.before.fade(0), done.plate)
    shown = done.after if done.after.alpha.any() else done.before
    x0, y0, x1, y1 = shown.box
    most, rim = _LOOK[0], int(_LOOK[1] * max(x1 - x0, y1 - y0))
    width, height = shown.size
    box = max(x0 - rim, 0), max(y0 - rim, 0), min(x1 + rim, width), min(y1 + rim, height)
    first, second = without.crop(box), done.result.crop(box)
    scale = min(1.0, most / max(first.size))
    size = max(1, round(scale * first.size[0])), max(1, round(scale * first.size[1]))
    frames = bm.fade_between(bm.cover(first, size), bm.cover(second, size))
    bm.write_frames(path, frames, _RATE)

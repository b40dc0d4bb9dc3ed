"""The command that changes a layer, or a picture by it: edit."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from blurmatte.cli.targets import SHEET, check_file, check_other

_ORDER = "blurmatte.order"
_CHANGES = ("--fade", "--amplify", "--recolor", "--expose", "--gain")
_HEX = "#?[0-9a-fA-F]{6}"
_LOOK = 640, 0.3  # pixels at most, and the rim around the object, of a preview
_RATE = 25.0
_PREVIEWS = ".webp", ".gif", ".mp4", ".mov"
_STOPS = 100  # light of 32 bits ends at 128

Change = Callable[[bm.Layer], bm.Layer]


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
    asked = list(_in_order(ctx.meta[_ORDER], {**given, "--gain": gain}))
    _check(image, plate, over, asked, remove, bool(fit or place or scale or match_light))
    if rate is not None and not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"--rate must be frames per second, above 0, got {rate:g}")
    check_file(sheet, "a sheet", *SHEET)
    check_file(preview, "a preview", *_PREVIEWS)
    for written in (out, sheet, preview):
        check_other(written, layer, image, plate, over, match_light)
    if preview is not None and image is None and over is None and plate is None:
        raise ValueError("a preview needs something behind it; give --plate, --over or --image")
    changes = [_change(name, text) for name, text in asked]
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
            if streak is not None and matched is not None:
                result, touched = bm.remove(picture, matched, streak, grow)
            else:
                result, touched = bm.retouch(picture, before, after, matched)
        done = _Edit(before, after, picture, result, matched)
        with about(out):
            bm.write_changed(out, image, result, touched, files.curve_of(image), max_pixels)
    if sheet is not None:
        names = ["remove"] * remove + [f"{name[2:]} {text}" for name, text in asked]
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
    asked: Sequence[tuple[str, str]],
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
    if remove and asked:
        raise ValueError(f"after --remove nothing is left to {asked[0][0][2:]}; give one of them")
    if not (remove or asked or over or (plate and image is None)):
        raise ValueError(f"nothing to do; give {', '.join(_CHANGES)}, --remove or --over")


def _in_order(
    order: Sequence[str], given: Mapping[str, list[str] | None]
) -> Iterator[tuple[str, str]]:
    """The options that change something and their values, as they stand on the command line."""
    values = {name: iter(texts or ()) for name, texts in given.items()}
    for name in order:
        yield name, next(values[name])


def _change(name: str, text: str) -> Change:
    """What an option and its value do to a layer."""
    match name:
        case "--fade":
            (factor,) = numbers(name, text, "a factor")
            return lambda layer: layer.fade(factor)
        case "--amplify":
            amounts = numbers(name, text, "a factor", "factor,brightness")
            return lambda layer: layer.amplify(*amounts)
        case "--expose":
            (stops,) = numbers(name, text, "a number of stops")
            if abs(stops) > _STOPS:
                raise ValueError(f"{name} must lie between -{_STOPS} and {_STOPS}, got {text!r}")
            return lambda layer: layer.relight(2.0**stops)
        case "--gain":
            gains = numbers(name, text, "a factor", "red,green,blue")
            return lambda layer: layer.relight(gains)
    old, new = _colors(text)
    return lambda layer: layer.recolor(*new, paints=old)


def _colors(text: str) -> tuple[list[str] | None, list[str]]:
    """Paints and their new colors; or one new color for all."""
    if re.fullmatch(_HEX, text):
        return None, [text]
    pairs = [pair.split("=") for pair in text.split(",")]
    if any(len(pair) != 2 or not all(re.fullmatch(_HEX, c) for c in pair) for pair in pairs):
        raise ValueError(
            f"--recolor must be a color like #d8ff3c, or OLD=NEW for each paint, got {text!r}"
        )
    return [old for old, _ in pairs], [new for _, new in pairs]


def _changed(layer: bm.Layer, changes: Sequence[Change]) -> bm.Layer:
    """The layer after all changes, one after another."""
    for change in changes:
        layer = change(layer)
    return layer


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
        for package in _needed(pictures):
            pool.submit(import_module, package)
        layer = pool.submit(_layer_and_streak, path, files.max_pixels, remove)
        others = [
            pool.submit(bm.read, name, files.curve_of(name), files.max_pixels) for name in pictures
        ]
        return layer.result(), [other.result() for other in others]


def _needed(pictures: Sequence[Path]) -> Iterator[str]:
    """What is imported for the image, and for the plate if there is one, as long as a file is read."""
    if pictures and pictures[0].suffix.lower() in (".jpg", ".jpeg"):
        yield "numba"  # for its blocks
    if len(pictures) > 1:
        yield "scipy.optimize"  # to match them


def _layer_and_streak(path: Path, max_pixels: int, remove: bool) -> tuple[bm.Layer, Any]:
    """The layer, and what is to go: (H, W) bool, where the solution says that something moved, of a
    mere layer where it is; None if it is to stay.
    """
    if not remove:
        return bm.read_layer(path, max_pixels=max_pixels), None
    try:
        solution = bm.read_solution(path, max_pixels)
    except bm.FileError:  # no solution: a layer, or what reading it as one will tell
        layer = bm.read_layer(path, max_pixels=max_pixels)
        return layer, layer.alpha > 0
    return solution.layer, solution.streak


def _write_preview(path: Path, done: _Edit) -> None:
    """The object coming and going, small: an alpha that rises and falls."""
    assert done.picture is not None
    assert done.result is not None
    without = done.picture
    if done.plate is not None:
        without, _ = bm.retouch(done.picture, done.before, done.before.fade(0), done.plate)
    shown = done.before if done.after.empty else done.after
    x0, y0, x1, y1 = shown.box
    most, rim = _LOOK[0], int(_LOOK[1] * max(x1 - x0, y1 - y0))
    width, height = shown.size
    box = max(x0 - rim, 0), max(y0 - rim, 0), min(x1 + rim, width), min(y1 + rim, height)
    first, second = without.crop(box), done.result.crop(box)
    scale = min(1.0, most / max(first.size))
    size = max(1, round(scale * first.size[0])), max(1, round(scale * first.size[1]))
    frames = bm.fade_between(bm.cover(first, size), bm.cover(second, size))
    bm.write_frames(path, frames, _RATE)

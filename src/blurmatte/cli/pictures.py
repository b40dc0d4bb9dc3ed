"""The commands for picture files: compose, show and info."""

import json
import math
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import blurmatte as bm
from blurmatte.cli.backgrounds import Fit, MatchLight, Place, Scale, read_behind
from blurmatte.cli.inputs import Files
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.printing import by, complain, in_degrees, say
from blurmatte.cli.program import about, app, told
from blurmatte.cli.targets import PICTURE, SHEET, check_file, check_other


@app.command()
@told
def compose(
    layer: Annotated[
        Path, typer.Argument(metavar="LAYER", help="A layer with alpha: EXR, PNG, TIFF.")
    ],
    over: Annotated[Path, typer.Option(help="The picture to put it over.")],
    out: Annotated[Path, typer.Option(help="Where to write: .png, .tif, .jpg or .exr.")],
    fit: Fit = None,
    place: Place = None,
    scale: Scale = None,
    match_light: MatchLight = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Put LAYER over another picture, in linear light."""
    check_file(out, "a picture", *PICTURE)
    check_other(out, layer, over, match_light)
    files = Files(transfer, max_pixels)
    with about(layer):
        top = bm.read_layer(layer, max_pixels=max_pixels)
    top, picture = read_behind(files, over, fit, place, scale, match_light).under(top)
    with about(out):
        bm.write(out, top.over(picture))


@app.command()
@told
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A picture, a layer or a solution.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Write the sheet there instead of opening it: .png or .jpg."),
    ] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Show FILE on a sheet: for a quick look."""
    check_file(out, "a sheet", *SHEET)
    check_other(out, file)
    files = Files(transfer, max_pixels)
    with about(file):
        thing: bm.LinearImage | bm.Layer | bm.Solution | None = _solution(file, max_pixels)
        if thing is None:
            picture, _ = files.read(file)
            thing = _layer(file, files.curve_of(file), max_pixels) or picture
        sheet = bm.draw_look(thing)
    target = out or Path(tempfile.mkdtemp(prefix="blurmatte-")) / f"{file.stem}.png"
    with about(target):
        bm.write(target, sheet)
    say(str(target))
    if out is None and typer.launch(str(target)) != 0:
        complain("no program was found to show it with; open the file that is named above")


@app.command()
@told
def info(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A picture, a layer, a solution, a model, noise or a curve."
        ),
    ],
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Say what is in FILE."""
    files = Files(transfer, max_pixels)
    with about(file) as said:
        if file.suffix.lower() == ".json":
            lines = _told_by_json(file)
        elif (solution := _solution(file, max_pixels)) is not None:
            lines = [str(solution), f"solver: {solution.solver}"]
            lines += [in_degrees(solution.model), *bm.explain(solution), *_named(solution.stats)]
            lines.append("every digit, and the points: stats in report.json")
        else:
            picture, _ = files.read(file, said)
            layer = _layer(file, files.curve_of(file), max_pixels)
            lines = list(_facts(file, picture, layer, transfer, guessed=bool(said)))
    say("\n".join(lines))


def _told_by_json(path: Path) -> list[str]:
    from blurmatte.files import holds_transfer

    if holds_transfer(path):
        curve = bm.read_transfer(path)
        return [f"{path}: transfer curve {curve.name}", *bm.explain(curve)]
    try:
        noise = bm.read_noise(path)
    except bm.FileError:  # whatever is wrong, reading it as a model will tell
        try:
            model = bm.read_color_model(path)
        except bm.FileError as error:
            if not path.is_file():
                raise
            if (words := _words_of(path)) is not None:
                return [f"{path}: a report, text that holds all numbers", *words]
            raise bm.FileError(
                f"{error}; nor is it noise or a curve of blurmatte calibrate"
            ) from error
        return [in_degrees(model), *bm.explain(model)]
    rows = (
        ("gain", noise.gain),
        ("read noise", noise.read_std),
        ("of the light", noise.relative_std),
    )
    said = (f"{name}: {', '.join(f'{x:.3g}' for x in np.ravel(row))}" for name, row in rows)
    return [str(noise), *said]


def _words_of(path: Path) -> list[str] | None:
    """The sentences in a report of `solve` or `measure`, if it is one."""
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    words = report.get("in_words") if isinstance(report, dict) else None
    return list(map(str, words)) if isinstance(words, list) else None


def _named(stats: Mapping[str, Any], of: str = "") -> Iterator[str]:
    """Numbers about a solution, each in a line; those that belong together under one name."""
    for name, value in stats.items():
        if isinstance(value, Mapping):
            yield from _named(value, f"{of}{name}.")
        else:
            yield f"{of}{name}: {_short(value)}"


def _short(value: Any) -> str:
    """As people read it: six digits, and of rows of points how many."""
    if isinstance(value, tuple) and np.ndim(value) > 1 and np.shape(value)[-1] == 2:
        return f"{' x '.join(map(str, np.shape(value)[:-1]))} points"
    if isinstance(value, tuple):
        between = "; " if np.ndim(value) > 1 else ", "
        return between.join(map(_short, value)) or "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "not known" if value is None else str(value)


def _solution(path: Path, max_pixels: int) -> bm.Solution | None:
    """The Solution in an EXR, if it is one."""
    if path.suffix.lower() != ".exr":
        return None
    try:
        return bm.read_solution(path, max_pixels)
    except bm.FileError:  # whatever is wrong, reading it as a picture will tell
        return None


def _layer(path: Path, curve: bm.Transfer | None, max_pixels: int) -> bm.Layer | None:
    """The layer in a picture file, if it has an alpha that is not 1 everywhere."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bm.TransferWarning)  # reading the picture told it
            layer = bm.read_layer(path, curve, max_pixels)
    except bm.FileError:
        return None
    return layer if layer.alpha.min() < 1 else None


def _facts(
    path: Path,
    picture: bm.LinearImage,
    layer: bm.Layer | None,
    transfer: str | None,
    guessed: bool,
) -> Iterator[str]:
    from blurmatte.files.errors import kind_of
    from blurmatte.files.raster import load

    meta = picture.meta
    bits = "float" if meta.levels is None else f"{math.ceil(np.log2(meta.levels))} bit"
    colors = "gray" if meta.gray else "RGB"
    what = ""
    if layer is not None:
        way = "premultiplied" if load(path, max(1, layer.alpha.size)).associated else "straight"
        what = f" and {way} alpha: a layer"
    yield f"{path}: {kind_of(path)}, {by(picture.size)} pixels, {bits} {colors}{what}"
    source = "as you said" if transfer else "a guess: nothing in the file says"
    if not (transfer or guessed):
        source = "its ICC profile says" if meta.icc_profile else "its tags or its kind say"
    yield f"transfer: {meta.transfer.name if meta.transfer else 'linear'} ({source})"
    yield f"colors: {_colors(meta)}"
    if meta.camera:
        yield f"camera: {meta.camera}"
    time = f"{meta.exposure_time:.6g} s" if meta.exposure_time else "not told"
    yield f"exposure time: {time}"
    profile = f"{len(meta.icc_profile)} bytes" if meta.icc_profile else "none"
    yield f"ICC profile: {profile}"
    if layer is None:
        yield f"valid (not clipped, opaque): {np.mean(picture.valid):.2%}"
        yield f"light: {picture.rgb.min():.4g} to {picture.rgb.max():.4g}, 1 is white"
        if picture.noise is not None:
            std = float(np.median(np.sqrt(picture.variance)))
            yield f"error of the light, of each pixel: {std:.2g} in the middle, 1 is white"
        return
    alpha, light = layer.alpha, layer.premultiplied
    yield (
        f"alpha: up to {alpha.max():.4g}, above 0 in {np.mean(alpha > 0):.2%} of the pixels, "
        f"sum {alpha.sum(dtype=float):.6g}"
    )
    yield f"light times alpha: {light.min():.4g} to {light.max():.4g}, 1 is white"


def _colors(meta: Any) -> str:
    """Whose red, green and blue the light is, and what would make white of it."""
    if meta.color_space != "camera":
        return "sRGB's primaries"
    if meta.white_balance is None:
        return "the camera's own; its white balance is not told"
    red, _, blue = meta.white_balance
    return (
        f"the camera's own; white balance as shot (not applied): red x{red:.4g}, blue x{blue:.4g}"
    )

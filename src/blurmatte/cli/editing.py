"""The commands that change an object: edit and remove in its own picture, compose over another.

Rows of layers are changed one after another: alone, over a picture, or in their own pictures.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

import blurmatte as bm
from blurmatte.cli.app import ORDER, command
from blurmatte.cli.changes import (
    Background,
    Change,
    Changes,
    LayerOrRow,
    Placement,
    Previews,
    RowOptions,
    change_of,
    changed,
)
from blurmatte.cli.console import about, option, optional, say, waiting, with_progress
from blurmatte.cli.paths import PICTURE, check_file, check_outputs, is_row, layer_in, pictures_of
from blurmatte.cli.selection import (
    GUESSED,
    Out,
    PlateOptions,
    Reading,
    SourceFiles,
    check_photographed,
    guess_behind,
    matching_of,
)
from blurmatte.formats import JPEG, format_at

if TYPE_CHECKING:
    from blurmatte.checks import Bools

Shown: TypeAlias = "tuple[bm.LinearImage, Bools]"
# The picture with another object, and the pixels that changed; of picture, layer and streak.
Retouch: TypeAlias = "Callable[[bm.LinearImage, bm.Layer, Bools], Shown]"

_NOT_OF_A_ROW = (
    "of a row give the plate that solve made of it, or remove from one picture after another"
)


@dataclass(frozen=True)
class _Edit:
    """A layer and its picture before and after a change, and the background if known."""

    before: bm.Layer
    after: bm.Layer
    picture: bm.LinearImage | None = None
    result: bm.LinearImage | None = None
    plate: bm.LinearImage | None = None


@dataclass(frozen=True)
class EditedPictures(SourceFiles):
    """The pictures that a layer is from; the image is kept where nothing changes."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plate is not None and self.image is None:
            raise ValueError("--plate needs --image; to put the object over it use compose --over")


@command(
    'edit out/layer.exr --image throw.jpg --plate empty_room.jpg --recolor "#2040ff" -o blue.jpg',
    'edit "layers/ball.####.exr" --fade 0.5 -o ball.mov',
)
def edit(
    ctx: typer.Context,
    layer: LayerOrRow,
    changes: Changes,
    own: EditedPictures,
    looks: Previews,
    row: RowOptions,
    reading: Reading,
    out: Out,
) -> None:
    """Change an object: fade, amplify, recolor or expose it.

    Without --image the changed layer is written. See also remove, and compose for another picture.
    """
    asked = changes.in_order(ctx.meta[ORDER])
    if not asked:
        raise ValueError("give a change: --fade, --amplify, --recolor, --expose or --gain")
    wanted = [change_of(name, text) for name, text in asked]
    layer = layer_in(layer)
    if _are_several(layer, looks, own.image):
        if own.image is None:
            edit_row(reading, layer, out, lambda one: _changed_if_any(one, wanted), row)
            return
        check_photographed(own.plate, _NOT_OF_A_ROW)
        scene = None if own.plate is None else reading.read(own.plate)

        def retouched(picture: bm.LinearImage, one: bm.Layer, _: Any) -> Shown:
            """The picture with the changed layer."""
            behind = _matched(own, scene, picture)
            return bm.retouch(picture, one, _changed_if_any(one, wanted), behind)

        retouch_row(reading, layer, own.image, out, retouched, row)
        return
    if own.image is None and looks.preview is not None:
        raise ValueError("--preview needs a background: --image, or compose --over")
    with waiting("editing"):
        if own.image is None:
            before = _layer(layer, reading)
            with about(Path(layer)):
                done = _Edit(before, changed(before, wanted))
            with about(out):
                bm.write(out, done.after)
            say(str(out))
        else:
            done, touched = _edit_picture(Path(layer), wanted, own.image, own, reading)
            _write_in_place(out, own.image, done, touched, reading)
        _write_looks(looks, done, ", ".join(f"{name[2:]} {text}" for name, text in asked))


def _edit_picture(
    layer: Path, wanted: Sequence[Change], image: Path, own: EditedPictures, reading: Reading
) -> tuple[_Edit, Any]:
    """The picture with its changed layer, and the mask of its changed pixels."""
    reader = partial(bm.read_layer, layer, max_pixels=reading.max_pixels)
    before, picture, scene = _read(reading, reader, layer, image, own.plate)
    with about(layer):
        after = changed(before, wanted)
    scene = _matched(own, scene, picture)
    with about(layer):
        if own.plate == GUESSED:
            scene = guess_behind(picture, layer_and_streak(layer, reading)[1]).plates[0]
        result, touched = bm.retouch(picture, before, after, scene)
    return _Edit(before, after, picture, result, scene), touched


@command(
    "remove out/layer.exr --image throw.jpg --plate empty_room.jpg -o gone.jpg",
    "remove out/layer.exr --image throw.jpg --plate empty_room.jpg --grow 3 -o gone.jpg",
    "remove 'out/layer.####.exr' --image rally.mp4 --plate out/plate.exr -o gone.mp4",
)
def remove(
    layer: LayerOrRow,
    image: Annotated[
        Path, option("FILE", "The picture that LAYER is from; of a row a clip or row.")
    ],
    plate: PlateOptions,
    looks: Previews,
    row: RowOptions,
    reading: Reading,
    out: Out,
    grow: int = optional("N", "N pixels more on every side.", default=0),
) -> None:
    """Remove an object from its picture, by the plate in its place.

    Of a row of layers, from those frames of a clip or of a row of pictures that have its number.
    """
    layer = layer_in(layer)
    source = Path(layer)
    if _are_several(layer, looks, image):
        check_photographed(plate.plate, _NOT_OF_A_ROW)
        scene = reading.read(plate.plate)

        def removed(picture: bm.LinearImage, _: bm.Layer, streak: Any) -> Shown:
            """The picture without its streak."""
            match = bm.background.fit_match(picture, scene, matching_of(plate.match))
            return bm.remove(picture, scene, streak, grow, match)

        retouch_row(reading, layer, image, out, removed, row)
        return
    with waiting("removing"):
        reader = partial(layer_and_streak, source, reading)
        (before, streak), picture, taken = _read(reading, reader, source, image, plate.plate)
        match: bm.background.Match | None = None
        if taken is None:
            with about(source):
                # The streak of a solution without a plate may be all of its region.
                streak = streak & ((before.alpha > 0) | before.premultiplied.any(axis=-1))
                scene = guess_behind(picture, streak, grow)
        else:
            with about(plate.plate):
                match = bm.background.fit_match(picture, taken, matching_of(plate.match))
                scene = taken
        with about(source):
            bm.checks.check_same_size("the layer", before.size, "the image", picture.size)
            result, touched = bm.remove(picture, scene, streak, grow, match)
        done = _Edit(before, before.fade(0), picture, result)
        _write_in_place(out, image, done, touched, reading)
        _write_looks(looks, done, "remove")


@command(
    "compose out/layer.exr --over beach.jpg --place 300,200 --scale 2 -o at_sea.jpg",
    "compose ball.mov --over empty_room.png --fade 0.5 -o ball.mp4",
)
def compose(
    ctx: typer.Context,
    layer: LayerOrRow,
    over: Annotated[Path, option("FILE", "The picture behind it.")],
    out: Out,
    placement: Placement,
    changes: Changes,
    looks: Previews,
    row: RowOptions,
    reading: Reading,
) -> None:
    """Put LAYER over another picture, in linear light."""
    asked = changes.in_order(ctx.meta[ORDER])
    wanted = [change_of(name, text) for name, text in asked]
    layer = layer_in(layer)
    if _are_several(layer, looks):
        ground = _behind(reading, over, placement)

        def composed(one: bm.Layer) -> bm.LinearImage:
            """The changed layer over the picture."""
            above, below = ground.under(_changed_if_any(one, wanted))
            return above.over(below)

        edit_row(reading, layer, out, composed, row)
        return
    check_file(out, "a picture", *PICTURE)
    with waiting("composing"):
        before = _layer(layer, reading)
        behind = _behind(reading, over, placement)
        with about(Path(layer)):
            after = changed(before, wanted)
        # Where nothing changes, the picture without the object is what was before.
        before, _ = behind.under(before if wanted else before.fade(0))
        after, picture = behind.under(after)
        result = after.over(picture)
        done = _Edit(before, after, before.over(picture), result, picture)
        with about(out):
            bm.write(out, result)
        say(str(out))
        _write_looks(
            looks, done, ", ".join(f"{name[2:]} {text}" for name, text in asked) or "compose"
        )


def _changed_if_any(layer: bm.Layer, wanted: Sequence[Change]) -> bm.Layer:
    """The layer of a row after all changes; an empty one, of a frame without the object, stays so."""
    return layer if layer.empty else changed(layer, wanted)


def _are_several(layer: str, looks: Previews, image: Path | None = None) -> bool:
    """Whether a row of layers is meant, or several pictures, of which there are no previews."""
    several = is_row(Path(layer)) or (image is not None and is_row(image))
    if several and (looks.sheet or looks.preview):
        raise ValueError(f"{layer}: --sheet and --preview need one layer, not a sequence")
    return several


def _behind(reading: Reading, over: Path, placement: Placement) -> Background:
    """The background, with the gain of the layers' light."""
    picture = reading.read(over)
    if placement.match_light is None:
        return Background(over, picture, placement)
    plate = reading.read(placement.match_light)
    with about(placement.match_light):
        return Background(over, picture, placement, bm.compositing.light_gain(picture, plate))


def _layer(layer: str, reading: Reading) -> bm.Layer:
    with about(Path(layer)):
        return bm.read_layer(layer, max_pixels=reading.max_pixels)


def _read(
    reading: Reading, layer: Callable[[], Any], path: Path, image: Path, plate: Path | None
) -> tuple[Any, bm.LinearImage, bm.LinearImage | None]:
    """The layer, its picture and the plate, unless that is guessed.

    They are read concurrently, because reading large ones is slow; so are modules imported that are
    needed later.
    """
    pictures = [image] if plate is None or plate == GUESSED else [image, plate]
    with about(path), ThreadPoolExecutor() as pool:
        if format_at(image) is JPEG:
            pool.submit(import_module, "numba")  # for its blocks
        if len(pictures) > 1:
            pool.submit(import_module, "scipy.optimize")  # to match them
        first = pool.submit(copy_context().run, layer)
        others = [
            pool.submit(
                copy_context().run, bm.read, name, reading.curve_of(name), reading.max_pixels
            )
            for name in pictures
        ]
        found, (picture, *scene) = first.result(), (other.result() for other in others)
        return found, picture, scene[0] if scene else None


def _matched(
    own: EditedPictures, scene: bm.LinearImage | None, picture: bm.LinearImage
) -> bm.LinearImage | None:
    """The plate if it was taken, matched to the picture."""
    if scene is None or own.plate is None:
        return None
    with about(own.plate):
        return bm.match_plate(scene, picture, matching_of(own.match))


def _write_in_place(out: Path, image: Path, done: _Edit, touched: Any, reading: Reading) -> None:
    """Write the file of the image with its changed pixels."""
    assert done.result is not None
    with about(out):
        curve = reading.curve_of(image)
        bm.write_changed(out, image, done.result, touched, curve, reading.max_pixels)
    say(str(out))


def _write_looks(looks: Previews, done: _Edit, names: str) -> None:
    """Write the sheet and the preview."""
    if looks.sheet is not None:
        with about(looks.sheet):
            drawn = bm.figures.draw_edit(done.before, done.after, done.picture, done.result, names)
            bm.write(looks.sheet, drawn)
    if looks.preview is not None:
        with about(looks.preview):
            _write_preview(looks.preview, done)


def _write_preview(path: Path, done: _Edit, longest: int = 640, rim: float = 0.3) -> None:
    """A fade in and out: factors of alpha that rise and fall.

    At most so many pixels wide or high; with a rim around the object, as a part of its size.
    """
    assert done.picture is not None
    assert done.result is not None
    without, shown, layer = done.picture, done.result, done.after
    if layer.empty:  # it was removed
        without, shown, layer = done.result, done.picture, done.before
    elif done.plate is not None:
        without, _ = bm.retouch(done.picture, done.before, done.before.fade(0), done.plate)
    x0, y0, x1, y1 = layer.box
    edge = int(rim * max(x1 - x0, y1 - y0))
    box = bm.checks.grown(layer.box, edge, layer.size)
    first, second = without.crop(box), shown.crop(box)
    scale = min(1.0, longest / max(first.size))
    size = max(1, round(scale * first.size[0])), max(1, round(scale * first.size[1]))
    frames = bm.compositing.fade_between(
        bm.compositing.cover(first, size), bm.compositing.cover(second, size)
    )
    bm.write_frames(path, frames)


def edit_row(
    reading: Reading, source: str, out: Path, edit: Callable[[bm.Layer], Any], options: RowOptions
) -> None:
    """Write what becomes of each layer; only one of them is in memory at a time."""
    _checked_target(out, source)
    with about(Path(source)):
        row = bm.read_layers(source, max_pixels=reading.max_pixels)
    with about(out):
        edited: Any = map(edit, with_progress(row, "editing"))
        bm.write_frames(out, edited, options.rate or row.rate, options.start(row))
    say(str(out))


def retouch_row(
    reading: Reading, source: str, image: Path, out: Path, retouch: Retouch, options: RowOptions
) -> None:
    """Write all frames of a clip or of a row of pictures, those with a layer retouched."""
    from blurmatte.files.atomic import moved_together
    from blurmatte.files.sequences import source_paths

    target = _checked_target(out, source, str(image))
    with about(image):
        frames = bm.read_frames(image, reading.curve, reading.max_pixels)
        originals = None if frames.clip is not None else source_paths(image)
    with about(Path(source)):
        layers = _layers_of(source, reading, frames)
    shown = _shown(frames, layers, Path(source), retouch)
    start = options.start(frames)
    with about(out):
        if target is None or originals is None:
            rate = options.rate or frames.rate
            bm.write_frames(out, (picture for picture, _ in shown), rate, start)
            say(str(out))
            return
        numbers = range(start, start + len(frames)) if isinstance(start, int) else start
        files = [target(number) for number in numbers]
        with moved_together(out.parent) as (temporary, names), warnings.catch_warnings():
            warnings.simplefilter("ignore", bm.errors.TransferWarning)  # given when they were read
            for name, original, one in zip(files, originals, shown, strict=True):
                curve = reading.curve_of(original)
                bm.write_changed(temporary / name, original, *one, curve, reading.max_pixels)
                names.append(name)
    say(str(out))


def layer_and_streak(path: Path, reading: Reading) -> tuple[bm.Layer, Bools]:
    """The layer, and (H, W) bool: the pixels to remove.

    That is where the solution says that something moved, or of a mere layer where it is.
    """
    try:
        solution = bm.read_solution(path, reading.max_pixels)
    except bm.errors.FileError:  # no solution: a layer, or reading it as one says what is wrong
        layer = bm.read_layer(path, max_pixels=reading.max_pixels)
        return layer, layer.alpha > 0
    return solution.layer, solution.streak


def _checked_target(out: Path, *sources: str) -> Callable[[int], str] | None:
    """The names of numbered files to write, none of which may be read; None for one file."""
    from blurmatte.files.sequences import numbering

    numbers = numbering(out)
    check_outputs(*(numbers.files() if numbers else ()), inputs=pictures_of(sources))
    return numbers.name if numbers else None


def _layers_of(
    source: str, reading: Reading, frames: bm.Frames[bm.LinearImage]
) -> Iterator[tuple[int, bm.Layer, Bools]]:
    """Layers with the numbers of their frames; a .mov has one for each frame.

    Raises ValueError if no layer has the number of a frame, or sizes differ.
    """
    from blurmatte.files.sequences import source_paths

    row = bm.read_layers(source, max_pixels=reading.max_pixels)
    bm.checks.check_same_size("the layer", row.size, "the image", frames.size)
    mine, known = row.frame_numbers, frames.frame_numbers
    if row.clip is not None:
        if len(row) != len(frames):
            raise ValueError(
                f"give all pictures that it is from: it has {len(row)} frames, they are {len(frames)}"
            )
        return ((k, layer, layer.alpha > 0) for k, layer in zip(known, row, strict=False))
    if not set(mine) & set(known):
        raise ValueError(
            f"give the pictures that it is from: layers are numbered {mine[0]} to {mine[-1]}, "
            f"pictures {known[0]} to {known[-1]}"
        )
    paths = source_paths(source)
    return ((k, *layer_and_streak(path, reading)) for k, path in zip(mine, paths, strict=True))


def _shown(
    frames: bm.Frames[bm.LinearImage],
    layers: Iterator[tuple[int, bm.Layer, Bools]],
    source: Path,
    retouch: Retouch,
) -> Iterator[Shown]:
    """Each frame; those without a layer as they are."""
    layer = next(layers, None)
    progress = with_progress(frames, "editing", len(frames))
    for number, picture in zip(frames.frame_numbers, progress, strict=False):
        while layer is not None and layer[0] < number:
            layer = next(layers, None)
        if layer is None or layer[0] > number or not layer[2].any():
            import numpy as np  # not for --help

            yield picture, np.zeros(picture.valid.shape, bool)
            continue
        with about(source):
            one = retouch(picture, *layer[1:])
        yield one

"""What may be done to a layer: changes in the order given, and a place in another picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import blurmatte as bm
from blurmatte.cli.console import about, argument, optional
from blurmatte.cli.paths import CLIPS, SHEET, check_file
from blurmatte.cli.quantities import check_rate, numbers

if TYPE_CHECKING:
    from blurmatte.checks import Array

CHANGES = "Changes, made in the order given"
PLACE = "Where it goes"
LOOKS = "To look at"
ROW = "Rows of layers"

_MAX_STOPS = 128  # light in files is float32, below 2**128

Change: TypeAlias = "Callable[[bm.Layer], bm.Layer]"

LayerOrRow = Annotated[
    str, argument("LAYER", "EXR, PNG, TIFF; or a row: layer.####.exr, a folder, '*', .mov.")
]


@dataclass(frozen=True)
class Changes:
    """Changes of a layer; their order is that of the command line."""

    fade: list[str] | None = optional("F", "F times as opaque: 0.5 is half.", CHANGES)
    amplify: list[str] | None = optional(
        "G[,BRIGHTNESS]", "G times as opaque, and bright.", CHANGES
    )
    recolor: list[str] | None = optional(
        "HEX|OLD=NEW,…", "Another color, or new ones for its paints.", CHANGES
    )
    expose: list[str] | None = optional("STOPS", "Brighter by so many stops: 1 is twice.", CHANGES)
    gain: list[str] | None = optional("R,G,B", "Its light times these.", CHANGES)

    def in_order(self, order: Sequence[str]) -> list[tuple[str, str]]:
        """Names of options and their values, in the order in which the names were typed."""
        values = {f"--{name}": iter(texts or ()) for name, texts in vars(self).items()}
        return [(name, next(values[name])) for name in order if name in values]


@dataclass(frozen=True)
class Previews:
    """Files to look at, in addition to the result."""

    sheet: Path | None = optional("FILE", "Before and after: .png, .jpg.", LOOKS)
    preview: Path | None = optional("FILE", "It comes and goes: .webp, .gif, .mp4.", LOOKS)

    def __post_init__(self) -> None:
        check_file(self.sheet, "a sheet", *SHEET)
        check_file(self.preview, "a preview", *CLIPS)


@dataclass(frozen=True)
class RowOptions:
    """How a row of layers is written."""

    rate: float | None = optional("R", "Frames per second of a clip.", ROW)
    first: int | None = optional("N", "First number; else those read.", ROW)

    def __post_init__(self) -> None:
        check_rate(self.rate)

    def start(self, row: bm.Frames[Any]) -> int | Sequence[int]:
        """The first number of the files, or the numbers of all, those of the frames read."""
        return row.frame_numbers if self.first is None else self.first


@dataclass(frozen=True)
class Placement:
    """Where in a picture a layer goes, how large, and in which light."""

    fit: str | None = optional("cover", "Scale and crop the picture to the layer.", PLACE)
    place: str | None = optional("X,Y", "The middle of the object.", PLACE)
    scale: float | None = optional("S", "S times as large.", PLACE)
    match_light: Path | None = optional(
        "PLATE", "From the light of its own plate to the picture's.", PLACE
    )

    def __post_init__(self) -> None:
        if self.fit not in (None, "cover"):
            raise ValueError(f"--fit must be cover, got {self.fit!r}")
        if self.fit and (self.place or self.scale):
            raise ValueError("--fit changes the picture, --place and --scale the layer; give one")
        if self.place is not None:
            numbers("--place", self.place, "x,y")

    @property
    def center(self) -> tuple[float, float] | None:
        """Where the middle of the object goes; None: the middle of the picture."""
        if self.place is None:
            return None
        x, y = numbers("--place", self.place, "x,y")
        return x, y


@dataclass(frozen=True)
class Background:
    """A picture to put layers over, where they go, and by how much their light is changed."""

    path: Path
    picture: bm.LinearImage
    placement: Placement = Placement()
    gain: Array | None = None

    def under(self, layer: bm.Layer) -> tuple[bm.Layer, bm.LinearImage]:
        """The layer as it goes over the picture, and the picture, now of one size."""
        from blurmatte.layer import empty_layer  # not for --help

        picture, placement = self.picture, self.placement
        with about(self.path):
            if self.gain is not None:
                layer = layer.relight(self.gain)
            if placement.fit == "cover":
                picture = bm.compositing.cover(picture, layer.size)
            elif placement.center is not None or placement.scale is not None:
                scale = 1.0 if placement.scale is None else placement.scale
                if layer.empty:  # of a frame without the object
                    layer = empty_layer(picture.size)
                else:
                    layer = layer.place(picture.size, placement.center, scale)
            if picture.size != layer.size:
                raise ValueError(
                    "add --fit cover to scale and crop the picture, or --place X,Y to put the object "
                    "in it: the picture is {}x{} pixels, the layer {}x{}".format(
                        *picture.size, *layer.size
                    )
                )
        return layer, picture


def changed(layer: bm.Layer, changes: Sequence[Change]) -> bm.Layer:
    """The layer after all changes, one after another."""
    for change in changes:
        layer = change(layer)
    return layer


def change_of(name: str, text: str) -> Change:
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
            if abs(stops) > _MAX_STOPS:
                raise ValueError(
                    f"{name} must lie between -{_MAX_STOPS} and {_MAX_STOPS}, got {text!r}"
                )
            return lambda layer: layer.relight(2.0**stops)
        case "--gain":
            gains = numbers(name, text, "a factor", "red,green,blue")
            return lambda layer: layer.relight(gains)
    old, new = _colors(text)
    return lambda layer: layer.recolor(*new, paints=old)


def _colors(text: str) -> tuple[list[str] | None, list[str]]:
    """Paints and their new colors; or one new color for all."""
    is_hex = bm.radiometry.transfer.is_hex
    if is_hex(text):
        return None, [text]
    pairs = [pair.split("=") for pair in text.split(",")]
    if any(len(pair) != 2 or not all(map(is_hex, pair)) for pair in pairs):
        raise ValueError(
            f"--recolor must be a color like #d8ff3c, or OLD=NEW for each paint, got {text!r}"
        )
    return [old for old, _ in pairs], [new for _, new in pairs]

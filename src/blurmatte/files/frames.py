"""Frames of a clip, or a row of pictures or layers, one after another, as often as they are asked for.

Nothing is held in memory: each run through reads the files again. clips.py decodes the clips.
"""

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from glob import glob, has_magic
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, overload

from blurmatte.checks import check_kind
from blurmatte.errors import FileError, TransferWarning
from blurmatte.files.clips import Clip, decode_frames, decode_layers, open_clip
from blurmatte.files.numbering import numbering
from blurmatte.files.raster import MAX_PIXELS
from blurmatte.files.reading import read, read_layer
from blurmatte.files.refusals import EXTENSIONS
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, Transfer

Source = str | Path | Sequence[str | Path]
Frame = TypeVar("Frame", LinearImage, Layer)


@dataclass(frozen=True)
class Frames(Sequence[Frame]):
    """Frames that are read when they are run through, again each time.

    `frames[100:400:3]` are Frames too, `frames[17]` is one LinearImage or Layer, len(frames) how many
    there are: of some clips only an estimate. `meta.time` of a LinearImage is in seconds, where it is
    known.

    Parameters
    ----------
    numbers : range
        Which frames of the source, counted from 0.
    size : (width, height)
        Of each, pixels.
    rate : float or None
        Frames of the source per second, on average; None for pictures.
    load : callable
        Reads the frames of a range of numbers, in order.
    """

    numbers: range
    size: tuple[int, int]
    rate: float | None
    load: Callable[[range], Iterator[Frame]] = field(repr=False)

    def __post_init__(self) -> None:
        if self.numbers.step < 1:
            raise ValueError(f"frames only run forwards, got steps of {self.numbers.step}")

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Frame]:
        return self.load(self.numbers)

    # The registry of `overload` would keep this module, and all it imports, beyond the end.
    if TYPE_CHECKING:

        @overload
        def __getitem__(self, which: int) -> Frame: ...
        @overload
        def __getitem__(self, which: slice) -> "Frames[Frame]": ...

    def __getitem__(self, which: int | slice) -> "Frame | Frames[Frame]":
        if isinstance(which, slice):
            return replace(self, numbers=self.numbers[which])
        number = self.numbers[which]
        for frame in self.load(range(number, number + 1)):
            return frame
        raise IndexError(f"frame {number} cannot be read; there are fewer than the file claims")


def read_frames(
    source: Source, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Frames[LinearImage]:
    """The frames of a clip, or pictures in their order, as linear light.

    Clips are read by FFmpeg (the `video` extra). Their tags say how code values encode light, what
    their primaries are, and whether they are to be turned; more than 8 bits stay more than 8 bits.

    Parameters
    ----------
    source : str, Path or a sequence of them
        A clip; or pictures: a folder of them, a pattern like "plates/*.png", a name with a place for
        the number like "plate.####.exr" or "plate.%04d.exr", or their names. Those of a folder or a
        pattern are sorted, with numbers in their names as numbers; numbers may be missing.
    transfer : Transfer, optional
        The curve of the code values, if you know better than the file. The EXRs of a row hold light
        already, and are read as they are.
    max_pixels : int
        Larger frames are refused.

    Returns
    -------
    Frames

    Raises
    ------
    FileError
        If there is nothing to read; if pictures differ in size, when they are run through.

    Warns
    -----
    BlurmatteWarning
        If a clip was cut short; the frames that are there are read.
    TransferWarning
        If nothing says how code values encode light: clips are taken as Rec. 709, pictures as sRGB.
    """
    return _frames(_paths(source), transfer, max_pixels, read, decode_frames)


def read_layers(
    source: Source, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Frames[Layer]:
    """The layers of a clip with alpha, or of a row of pictures with alpha, premultiplied.

    What `write_frames` wrote, or other programs: ProRes 4444, and other codecs with alpha, whose
    colors are taken as straight, for nothing in a clip tells; EXR, PNG, TIFF as in `read_layer`.

    Parameters
    ----------
    source, transfer, max_pixels
        As in `read_frames`.

    Returns
    -------
    Frames
        Of Layers.

    Raises
    ------
    FileError
        As in `read_frames` and `read_layer`; if there is no alpha.
    """
    return _frames(_paths(source), transfer, max_pixels, read_layer, decode_layers)


def _frames(
    paths: list[Path],
    transfer: Transfer | None,
    max_pixels: int,
    read_one: Callable[[Path, Transfer | None, int], Frame],
    decode: Callable[[Clip, range], Iterator[Frame]],
) -> Frames[Frame]:
    check_kind("transfer", transfer, Transfer | None, "use blurmatte.named_transfer(name)")
    if len(paths) == 1 and paths[0].suffix.lower() not in EXTENSIONS:
        clip = open_clip(paths[0], transfer, max_pixels, stacklevel=3)
        if decode is decode_layers and not clip.alpha:
            raise FileError(
                f"{clip.path}: has no alpha, so it holds no layers; "
                "give a .mov of ProRes 4444 with alpha, or a row of EXR or PNG"
            )
        return Frames(range(clip.count), clip.size, clip.rate, partial(decode, clip))
    told: list[Warning | str] = []  # what is assumed of one is told, and so it is of all
    size = _read(read_one, paths[0], transfer, max_pixels, told).size

    def load(numbers: range) -> Iterator[Frame]:
        for number in numbers:
            frame = _read(read_one, paths[number], transfer, max_pixels, told)
            _check_size(paths[number], frame.size, paths[0], size)
            yield frame

    return Frames(range(len(paths)), size, None, load)


def _read(
    read_one: Callable[[Path, Transfer | None, int], Frame],
    path: Path,
    transfer: Transfer | None,
    max_pixels: int,
    told: list[Warning | str],
) -> Frame:
    """One picture of a row; that its curve is assumed is only told if nothing was `told` before."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        frame = read_one(path, _curve_of(path, transfer), max_pixels)
    for one in said:
        if not issubclass(one.category, TransferWarning):
            warnings.warn(one.message, one.category, stacklevel=4)
        elif not told:
            told.append(one.message)
            warnings.warn(one.message, one.category, stacklevel=4)
    return frame


def _curve_of(path: Path, transfer: Transfer | None) -> Transfer | None:
    """The curve that was given for a row, which may hold code values and light side by side."""
    return None if path.suffix.lower() == ".exr" else transfer


def _paths(source: Source) -> list[Path]:
    if not isinstance(source, str | Path):
        paths = [Path(path) for path in source]
        if not paths:
            raise FileError("there are no frames to read; name a clip or pictures")
        return paths
    path = Path(source)
    numbers = None if path.exists() else numbering(path)
    if numbers is not None:
        return _sorted(numbers.files(), f"{source}: no file fits")
    if path.is_dir():
        inside = [p for p in path.iterdir() if p.suffix.lower() in EXTENSIONS]
        return _sorted(inside, f"{path}: the folder holds no {', '.join(EXTENSIONS)}")
    if has_magic(str(source)) and not path.exists():
        return _sorted([Path(p) for p in glob(str(source))], f"{source}: no file fits")
    return [path]


def _sorted(paths: list[Path], complaint: str) -> list[Path]:
    """By name, 10 after 9."""
    if not paths:
        raise FileError(f"{complaint}; name a clip or pictures")
    return sorted(
        paths,
        key=lambda path: [
            (int(part), "") if part.isdigit() else (-1, part)
            for part in re.split(r"(\d+)", str(path))
        ],
    )


def _check_size(path: Path, size: tuple[int, int], first: Path, wanted: tuple[int, int]) -> None:
    if size != wanted:
        raise FileError(
            f"{path}: is {size[0]}x{size[1]} pixels, but {first.name} {wanted[0]}x{wanted[1]}; "
            "frames must be of one size"
        )

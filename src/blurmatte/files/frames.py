"""Frames of a clip, or a row of pictures, one after another and as often as they are asked for.

Nothing is held in memory: each run through reads the files again. clips.py decodes the clips.
"""

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from glob import glob, has_magic
from pathlib import Path
from typing import TYPE_CHECKING, overload

from blurmatte.errors import FileError, TransferWarning
from blurmatte.files.clips import decode_frames, open_clip
from blurmatte.files.raster import MAX_PIXELS
from blurmatte.files.reading import read
from blurmatte.files.refusals import EXTENSIONS
from blurmatte.radiometry import LinearImage, Transfer

Source = str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class Frames(Sequence[LinearImage]):
    """Frames that are read when they are run through, again each time.

    `frames[100:400:3]` are Frames too, `frames[17]` is one LinearImage, len(frames) how many there
    are: of some clips only an estimate. `meta.time` of each frame is in seconds, where it is known.

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
    load: Callable[[range], Iterator[LinearImage]] = field(repr=False)

    def __post_init__(self) -> None:
        if self.numbers.step < 1:
            raise ValueError(f"frames only run forwards, got steps of {self.numbers.step}")

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[LinearImage]:
        return self.load(self.numbers)

    # The registry of `overload` would keep this module, and all it imports, beyond the end.
    if TYPE_CHECKING:

        @overload
        def __getitem__(self, which: int) -> LinearImage: ...
        @overload
        def __getitem__(self, which: slice) -> "Frames": ...

    def __getitem__(self, which: int | slice) -> "LinearImage | Frames":
        if isinstance(which, slice):
            return replace(self, numbers=self.numbers[which])
        number = self.numbers[which]
        for frame in self.load(range(number, number + 1)):
            return frame
        raise IndexError(f"frame {number} cannot be read; there are fewer than the file claims")


def read_frames(
    source: Source, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Frames:
    """The frames of a clip, or pictures in their order, as linear light.

    Clips are read by FFmpeg (the `video` extra). Their tags say how code values encode light, what
    their primaries are, and whether they are to be turned; more than 8 bits stay more than 8 bits.

    Parameters
    ----------
    source : str, Path or a sequence of them
        A clip; or pictures: a folder of them, a pattern like "plates/*.png", or their names. Those of
        a folder or a pattern are sorted, with numbers in their names as numbers.
    transfer : Transfer, optional
        The curve of the code values, if you know better than the file.
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
    TransferWarning
        If nothing says how code values encode light: clips are taken as Rec. 709, pictures as sRGB.
    """
    paths = _paths(source)
    if len(paths) == 1 and paths[0].suffix.lower() not in EXTENSIONS:
        clip = open_clip(paths[0], transfer, max_pixels, stacklevel=2)
        return Frames(
            range(clip.count), clip.size, clip.rate, lambda numbers: decode_frames(clip, numbers)
        )
    first = read(paths[0], transfer, max_pixels)

    def load(numbers: range) -> Iterator[LinearImage]:
        for number in numbers:
            yield _picture(paths[number], transfer, max_pixels, paths[0], first.size)

    size = first.size
    return Frames(range(len(paths)), size, None, load)


def _paths(source: Source) -> list[Path]:
    if not isinstance(source, str | Path):
        paths = [Path(path) for path in source]
        if not paths:
            raise FileError("there are no frames to read; name a clip or pictures")
        return paths
    path = Path(source)
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


def _picture(
    path: Path, transfer: Transfer | None, max_pixels: int, first: Path, size: tuple[int, int]
) -> LinearImage:
    """One of a row of pictures; the first has told already what is assumed of their curve."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TransferWarning)
        picture = read(path, transfer, max_pixels)
    if picture.size != size:
        raise FileError(
            f"{path}: is {picture.size[0]}x{picture.size[1]} pixels, but {first.name} "
            f"{size[0]}x{size[1]}; frames must be of one size"
        )
    return picture

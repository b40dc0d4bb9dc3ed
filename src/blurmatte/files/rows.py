"""Rows of layers or of pictures: to numbered files, or to a clip.

Frames are taken one at a time. What is written is there whole or not at all.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.encoders import save_animation, save_h264, save_prores
from blurmatte.files.numbering import numbering
from blurmatte.files.refusals import EXTENSIONS
from blurmatte.files.replacing import replacing
from blurmatte.files.together import moved_together
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage

Codes = npt.NDArray[np.uint8]
Thing = Layer | LinearImage | Codes

_CLIPS: dict[str, Callable[[Path, Iterable[Thing], float], None]] = {
    ".mov": save_prores,
    ".mp4": save_h264,
    ".gif": save_animation,
    ".webp": save_animation,
}


def write_frames(
    path: str | Path,
    things: Iterable[Layer] | Iterable[LinearImage] | Iterable[Codes],
    rate: float = 25.0,
    start: int = 1,
) -> list[Path]:
    """Write layers or pictures one after another; the name says how.

    =====================  =============================================================
    ball.####.exr          one file each, as `write` makes them: .exr .png .tif of layers; .jpg
                           of pictures, too. The number has at least as many digits as there are #;
                           ball.%04d.exr is the same
    .mov                   layers: ProRes 4444 with alpha, straight colors; pictures: ProRes 4444
    .mp4                   pictures: H.264 (4:2:0, 8 bit) to look at; odd sizes get one more row or
                           column, the last one again
    .gif .webp             pictures: short animations, all of which are held in memory
    =====================  =============================================================

    .mov and .mp4 (the `video` extra) are in the curve, primaries and limited range of Rec. 709, and say
    so. ProRes has 10 bits here: alpha loses nothing else, colors hardly anything but what is
    brighter than white. Nothing in a .mov tells that colors are straight: say so to the program that
    reads it (in Nuke with a Premult behind the Read). Linear light as it is needs .exr.

    Parameters
    ----------
    path : str or Path
        The target. Files of the same names are replaced, but only by whole ones, and only when all
        are written; of an older row others stay.
    things : iterable
        Layers, LinearImages, or (H, W, 3) uint8 arrays of sRGB; all of one kind and size. A generator
        will do: only one is needed at a time.
    rate : float
        Frames per second of a clip.
    start : int
        The first number of numbered files.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    FileError
        If the name does not say how, such things cannot be written like that, PyAV is missing, or the
        disk is full. Nothing is left behind; nor is it if `things` raises.
    TypeError, ValueError
        If there is nothing to write, things differ in kind or size, or an argument is no such number.
    """
    target = Path(path)
    if not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be a positive number of frames per second, got {rate}")
    if start < 0:
        raise ValueError(f"start must be 0 or more, got {start}")
    extension = target.suffix.lower()
    row = _alike(things)
    if extension not in _CLIPS:
        return _write_numbered(target, row, start)
    first = next(row)
    if isinstance(first, Layer) and extension != ".mov":
        raise FileError(
            f"{path}: {extension} cannot hold layers with their alpha; write .mov (ProRes 4444) or a "
            "row like ball.####.exr, or put them over a picture first"
        )
    with replacing(target, extension) as temporary:
        _CLIPS[extension](temporary, chain([first], row), rate)
    return [target]


def _write_numbered(target: Path, row: Iterator[Thing], start: int) -> list[Path]:
    numbers = numbering(target)
    if target.suffix.lower() not in EXTENSIONS:
        raise FileError(
            f"{target}: frames are written as {', '.join(_CLIPS)}, or as numbered "
            f"{', '.join(EXTENSIONS)}; change the ending"
        )
    if numbers is None:
        raise FileError(
            f"{target}: has no place for the number of a frame; name it like "
            f"{target.stem}.####{target.suffix}, or write .mov"
        )
    names = []
    with moved_together(target.parent) as aside:
        for number, thing in enumerate(row, start):
            names.append(numbers.name(number))
            write(aside / names[-1], thing)
    return [target.parent / name for name in names]


def _alike(things: Iterable[Thing]) -> Iterator[Thing]:
    """The same things, one after another, if all are like the first.

    Raises
    ------
    TypeError, ValueError
        At the first that is not, and if there are none.
    """
    kind, size = "", (0, 0)
    for number, thing in enumerate(things):
        if number == 0:
            kind, size = _kind(thing), _size(thing)
        if _kind(thing) != kind:
            raise TypeError(f"things must be of one kind: 0 is {kind}, {number} is {_kind(thing)}")
        if _size(thing) != size:
            raise ValueError(
                "things must be of one size: 0 is {}x{}, {} is {}x{}".format(
                    *size, number, *_size(thing)
                )
            )
        yield thing
    if not kind:
        raise ValueError("things must hold one frame or more, got none")


def _kind(thing: object) -> str:
    match thing:
        case Layer() | LinearImage():
            return f"a {type(thing).__name__}"
        case np.ndarray() if thing.dtype == np.uint8 and thing.ndim == 3 and thing.shape[2] == 3:
            return "a uint8 array"
        case np.ndarray():
            raise TypeError(
                f"arrays must be (height, width, 3) uint8, got {thing.shape} {thing.dtype}"
            )
    raise TypeError(
        f"things must be Layers, LinearImages or uint8 arrays, got a {type(thing).__name__}"
    )


def _size(thing: Thing) -> tuple[int, int]:
    if isinstance(thing, np.ndarray):
        return thing.shape[1], thing.shape[0]
    return thing.size

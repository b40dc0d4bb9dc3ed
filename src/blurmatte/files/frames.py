"""Frames of a clip or of an image sequence, read and written one at a time.

Frames are not held in memory: each iteration reads the files again.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, overload

import numpy as np

from blurmatte.checks import Codes8, as_array, check_kind, check_not_negative, check_positive
from blurmatte.errors import FileError, TransferWarning, listed, warn
from blurmatte.files.atomic import extension_of, moved_together, replacing
from blurmatte.files.clip_quantization import coding_errors
from blurmatte.files.clip_reading import (
    Clip,
    coded_picture,
    decode_coded,
    decode_frames,
    decode_layers,
    open_clip,
    sited_by,
)
from blurmatte.files.clip_writing import save_animation, save_h264, save_prores
from blurmatte.files.reading import read, read_layer
from blurmatte.files.sequences import (
    Source,
    missing_numbers,
    numbering,
    picture_numbers,
    source_paths,
)
from blurmatte.files.writing import write
from blurmatte.formats import EXR, MAX_PIXELS, Writes, format_at, is_clip, written
from blurmatte.layer import Layer
from blurmatte.radiometry.coded import CodedFrame, coded
from blurmatte.radiometry.compression import CodingErrors
from blurmatte.radiometry.image import LinearImage, are_gray
from blurmatte.radiometry.transfer import TRANSFER_HINT, Transfer

Frame = TypeVar("Frame", LinearImage, Layer)
Thing = Layer | LinearImage | Codes8

_GRAY_FRAMES = 4  # of a clip, at least, of which none has colors if it has none

_decode_pictures = partial(decode_frames, coding_errors=coding_errors)

_CLIP_WRITERS: dict[str, Callable[[Path, Iterable[Thing], float], None]] = {
    ".mov": save_prores,
    ".mp4": save_h264,
    ".gif": save_animation,
    ".webp": save_animation,
}


def _is_gray(clip: Clip, numbers: range) -> bool:
    """Whether some of the frames have no colors, so that it does not matter where chroma lies."""
    some = numbers[:: max(len(numbers) // _GRAY_FRAMES, 1)]
    frames = (frame for n in some for frame in decode_frames(clip, range(n, n + 1)))
    return all(are_gray(frame, frame) for frame in frames)


@dataclass(frozen=True)
class Frames(Sequence[Frame]):
    """Frames that are read when they are iterated over, again each time.

    `frames[100:400:3]` are Frames, `frames[17]` is one LinearImage or Layer, len(frames) is the number
    of frames, for some clips an estimate. `meta.time` of a LinearImage is in seconds, if known.

    Parameters
    ----------
    numbers : range
        Indices of the frames in the source, from 0.
    size : (width, height)
        Of each frame, pixels.
    rate : float or None
        Frames of the source per second, on average; None for pictures.
    load : callable
        Reads the frames of a range of indices, in order.
    clip : Clip, optional
        The clip, if they are frames of one.
    picture_numbers : tuple of int, optional
        Of all pictures of a sequence: the rising numbers in which alone their names differ.

    Examples
    --------
    >>> clip = bm.read_frames("clip", bm.SRGB)
    >>> len(clip), clip.size, clip.frame_numbers
    (6, (128, 72), [1, 2, 3, 4, 5, 6])
    >>> late = clip[3:]
    >>> [round(float(picture.rgb.mean()), 3) for picture in late]
    [0.186, 0.185, 0.186]
    """

    numbers: range
    size: tuple[int, int]
    rate: float | None
    load: Callable[[range], Iterator[Frame]] = field(repr=False)
    clip: Clip | None = field(default=None, repr=False)
    picture_numbers: tuple[int, ...] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.numbers.step < 1:
            raise ValueError(f"steps must be 1 or more, got {self.numbers.step}")

    @property
    def times(self) -> tuple[float, ...] | None:
        """Of all frames of a clip, seconds; None if they are not known."""
        return None if self.clip is None else self.clip.timing.times

    @property
    def place_std(self) -> tuple[float, float]:
        """Error of all places in x and in y, pixels, if it is not known where chroma lies."""
        return (0.0, 0.0) if self.clip is None else self.clip.place_std

    @property
    def curve_assumed(self) -> bool:
        """True if the transfer curve of a clip is not stated, and was not given."""
        return self.clip is not None and self.clip.curve_assumed

    def for_plate(self: "Frames[LinearImage]", plate: LinearImage | None) -> "Frames[LinearImage]":
        """The frames to be measured before a plate: their chroma where it agrees with the plate.

        Where subsampled chroma lies is seldom in a file. Give None for a plate that was made of them:
        then only the edges of the scene count.

        Warns
        -----
        BlurmatteWarning
            If nothing shows where chroma lies, or the numbers of pictures show that some are missing.
        """
        known = self.picture_numbers or (0,)
        if missing := listed(missing_numbers(known), 5):
            warn(
                f"add the missing pictures if you have them: {missing} of {known[0]} to {known[-1]} "
                "are missing, and times follow the numbers in the names"
            )
        if self.clip is None or not self.numbers:
            return self
        clip = self.clip
        if clip.siting == "" and _is_gray(clip, self.numbers):
            clip = replace(clip, siting=None)
        clip = sited_by(clip, plate, self.numbers[0])
        return replace(self, clip=clip, load=partial(_decode_pictures, clip))

    @property
    def frame_numbers(self) -> Sequence[int]:
        """Number of each frame: of pictures that in the name, of clips the index in the source."""
        known = self.picture_numbers
        return self.numbers if known is None else [known[n] for n in self.numbers]

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Frame]:
        return self.load(self.numbers)

    # The registry of `overload` would keep this module alive at interpreter shutdown.
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
        raise IndexError(f"frame {number} cannot be read; the clip has fewer than it states")

    def coded(self, which: slice) -> Iterator[CodedFrame]:
        """Some of the frames as code values, with their numbers in the source."""
        numbers = self.numbers[which]
        if self.clip is not None:
            yield from decode_coded(self.clip, numbers)
            return
        for number, image in zip(numbers, self.load(numbers), strict=False):
            if isinstance(image, LinearImage):
                yield coded(number, image)

    def parts(self, first: int, length: int) -> Iterator[slice]:
        """All frames from the first on, in parts of `length` frames.

        Those of a clip are up to twice as long if the next then begins at a key frame: others decode
        frames of the part before them, too.
        """
        while first < len(self):
            stop = min(first + length, len(self))
            if self.clip is not None and stop < len(self):
                key = self.clip.timing.key_from(self.numbers[stop])
                at = -(-(key - self.numbers.start) // self.numbers.step)
                stop = at if at <= min(first + 2 * length, len(self)) else stop
            yield slice(first, stop)
            first = stop

    def as_codes(self, picture: LinearImage) -> CodedFrame:
        """A picture of the same scene in the code values of the frames."""
        return coded(-1, picture) if self.clip is None else coded_picture(self.clip, picture)

    def coding_errors(self) -> CodingErrors | None:
        """Errors that a codec leaves in the frames; None if not known."""
        return None if self.clip is None else coding_errors(self.clip, self.numbers)


def read_frames(
    source: Source, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Frames[LinearImage]:
    """The frames of a clip, or the pictures of a sequence, as linear light.

    Clips are read by FFmpeg (the `video` extra). Their curve, primaries and rotation are applied, and
    more than 8 bits are kept.

    Parameters
    ----------
    source : str, Path or a sequence of them
        A clip; or pictures: a folder of them, a pattern like "plates/*.png", a name with a number
        like "plate.####.exr" or "plate.%04d.exr", or their names. Those of a folder or a pattern are
        sorted, with numbers in their names as numbers; numbers may be missing.
    transfer : Transfer, optional
        The curve of the code values; it replaces the one that the file states. EXRs of a sequence
        hold linear light and are read unchanged.
    max_pixels : int
        Larger frames are rejected.

    Returns
    -------
    Frames

    Raises
    ------
    FileError
        If there is nothing to read; during iteration, if pictures differ in size.

    Warns
    -----
    BlurmatteWarning
        If a clip is truncated; the existing frames are read.
    TransferWarning
        If the curve is not stated: clips are taken as Rec. 709, pictures as sRGB.

    Examples
    --------
    >>> clip = bm.read_frames("clip/####.png", bm.SRGB)
    >>> len(clip), clip.size
    (6, (128, 72))
    >>> third = clip[2]
    """
    return _frames(source_paths(source), transfer, max_pixels, read, _decode_pictures)


def read_layers(
    source: Source, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Frames[Layer]:
    """The layers of a clip with alpha, or of a sequence of pictures with alpha, premultiplied.

    Files from `write_frames` or other programs: ProRes 4444 and other codecs with alpha, whose colors
    are taken as straight because clips do not state it; EXR, PNG, TIFF as in `read_layer`.

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
        As in `read_frames`, and if there is no alpha.

    Warns
    -----
    BlurmatteWarning, TransferWarning
        As in `read_frames`.

    Examples
    --------
    >>> _ = bm.write_frames("ball/####.exr", [layer, layer.fade(0.5)])
    >>> [round(float(one.alpha.max()), 2) for one in bm.read_layers("ball/####.exr")]
    [0.34, 0.17]
    """
    return _frames(source_paths(source), transfer, max_pixels, read_layer, decode_layers)


def write_frames(
    path: str | Path,
    things: Iterable[Layer] | Iterable[LinearImage] | Iterable[Codes8],
    rate: float | None = None,
    start: int | Sequence[int] = 1,
) -> list[Path]:
    """Write layers or pictures as a sequence of files or as a clip, by the extension.

    =====================  =============================================================
    ball.####.exr          one file each, as written by `write`: .exr .png .tif of layers; .jpg
                           of pictures, too. The number has at least as many digits as there are #;
                           ball.%04d.exr is the same
    .mov                   layers: ProRes 4444 with alpha, straight colors; pictures: ProRes 4444
    .mp4                   pictures: H.264 (4:2:0, 8 bit) for viewing, extended to even sizes
    .gif .webp             pictures: short animations, all of which are held in memory
    =====================  =============================================================

    .mov and .mp4 (the `video` extra) have the curve, primaries and limited range of Rec. 709, and state
    them; that colors of a .mov are straight has to be set in the program that reads it. ProRes has 10
    bits here and clips at white: unclipped light needs .exr.

    Parameters
    ----------
    path : str or Path
        The target. Existing files of the same names are replaced when all frames are written; other
        files of an older sequence are kept.
    things : iterable
        Layers, LinearImages, or (H, W, 3) uint8 arrays of sRGB; all of one kind and size. One at a
        time is needed, so a generator is enough.
    rate : float, optional
        Frames per second of a clip; 25 if not given.
    start : int or sequence of int
        The number of the first file, or those of all.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    FileError
        If the extension does not fit, PyAV is missing, or the disk is full. No files are written
        then, nor if `things` raises.
    TypeError, ValueError
        If there are no frames, they differ in kind or size, or an argument is invalid.

    Examples
    --------
    >>> fading = bm.compositing.fade_between(image, plate, count=3)
    >>> files = bm.write_frames("fading/####.png", fading)
    >>> [file.name for file in files]
    ['0001.png', '0002.png', '0003.png']
    """
    target = Path(path)
    _check_numbers(rate, start)
    if target.suffix.lower() in _CLIP_WRITERS:
        return _write_clip(target, _checked(things), 25.0 if rate is None else rate)
    numbers = count(start) if isinstance(start, int) else start
    return _write_sequence(target, _checked(things), numbers)


def _check_numbers(rate: float | None, start: int | Sequence[int]) -> None:
    if rate is not None:
        check_positive("rate", rate, "frames per second")
    if isinstance(start, int):
        check_not_negative("start", start)


def _frames(
    paths: list[Path],
    transfer: Transfer | None,
    max_pixels: int,
    read_one: Callable[[Path, Transfer | None, int], Frame],
    decode: Callable[[Clip, range], Iterator[Frame]],
) -> Frames[Frame]:
    check_kind("transfer", transfer, Transfer | None, TRANSFER_HINT)
    if len(paths) == 1 and is_clip(paths[0]):
        clip = open_clip(paths[0], transfer, max_pixels)
        if decode is decode_layers and not clip.alpha:
            raise FileError(
                f"{clip.path}: give a .mov of ProRes 4444 with alpha, or a sequence of EXR or PNG; "
                "the clip has no alpha and holds no layers"
            )
        timing = clip.timing
        rate = timing.playback_rate if decode is decode_layers else timing.rate  # type: ignore[redundant-expr]
        numbers = range(timing.count)
        return Frames(numbers, clip.size, rate, partial(decode, clip), clip)
    reader = _PictureReader(tuple(paths), read_one, transfer, max_pixels)
    size = reader.picture(paths[0]).size
    load = replace(reader, size=size)
    return Frames(range(len(paths)), size, None, load, picture_numbers=picture_numbers(paths))


@dataclass(frozen=True)
class _PictureReader(Generic[Frame]):
    """Reads the pictures of a sequence; other processes can, too."""

    paths: tuple[Path, ...]
    read_one: Callable[[Path, Transfer | None, int], Frame]
    transfer: Transfer | None
    max_pixels: int
    size: tuple[int, int] = (0, 0)  # of the first picture
    warned: list[Warning | str] = field(default_factory=list)  # of an assumed curve

    def __call__(self, numbers: range) -> Iterator[Frame]:
        for path in (self.paths[number] for number in numbers):
            frame = self.picture(path)
            if frame.size != self.size:
                raise FileError(
                    "{}: give frames of one size; it has {}x{} pixels, but {} has {}x{}".format(
                        path, *frame.size, self.paths[0].name, *self.size
                    )
                )
            yield frame

    def picture(self, path: Path) -> Frame:
        """One picture; an assumed curve is warned of once, then `warned` is not empty."""
        curve = None if format_at(path) is EXR else self.transfer  # EXRs hold light
        with warnings.catch_warnings(record=True, action="always") as caught:
            frame = self.read_one(path, curve, self.max_pixels)
        for one in caught:
            if not (issubclass(one.category, TransferWarning) and self.warned):
                warn(str(one.message), one.category)
            if issubclass(one.category, TransferWarning):
                self.warned.append(one.message)
        return frame


def _write_clip(target: Path, frames: Iterator[Thing], rate: float) -> list[Path]:
    extension, first = target.suffix.lower(), next(frames)
    if isinstance(first, Layer) and extension not in written(Writes.LAYERS):
        raise FileError(
            f"{target}: write layers as .mov (ProRes 4444) or as a sequence like ball.####.exr, "
            f"or put them over a picture first; {extension} cannot hold alpha"
        )
    with replacing(target, extension) as temporary:
        _CLIP_WRITERS[extension](temporary, chain([first], frames), rate)
    return [target]


def _write_sequence(target: Path, frames: Iterator[Thing], numbers: Iterable[int]) -> list[Path]:
    names_of = numbering(target)
    endings = written(Writes.PICTURE)
    if extension_of(target) not in endings:
        raise FileError(
            f"{target}: change the extension; frames are written as {', '.join(_CLIP_WRITERS)}, or as "
            f"numbered {', '.join(endings)}"
        )
    if names_of is None:
        raise FileError(
            f"{target}: name it like {target.stem}.####{target.suffix}, or write .mov; "
            "the name has no frame number"
        )
    with moved_together(target.parent) as (temporary, names):
        for number, thing in zip(numbers, frames, strict=False):
            names.append(names_of.name(number))
            write(temporary / names[-1], thing)
        if next(frames, None) is not None:
            raise ValueError(f"start must have a number for each of the things, got {len(names)}")
    return [target.parent / name for name in names]


def _checked(things: Iterable[Thing]) -> Iterator[Thing]:
    """The frames; an error at the first that differs in kind or size, and if there are none."""
    kind, size = "", (0, 0)
    for number, given in enumerate(things):
        thing = as_array(f"frame {number} of things", given)
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

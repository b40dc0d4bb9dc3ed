"""A picture file as it lies on disk: numbers, channel names and tags, nothing decoded.

Sizes and formats are judged before memory is taken. See refusals.py for what is turned away.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

from blurmatte.checks import Bools
from blurmatte.errors import FileError
from blurmatte.files.png import PngFacts, inspect_png
from blurmatte.files.refusals import (
    RAW,
    check_format,
    check_png,
    check_size,
    damaged,
    kind_of,
    wanted_channels,
)

MAX_PIXELS = 200_000_000
# Only these are asked for: others may hold text in who knows what encoding.
_TAGS = (
    *("ICCProfile", "CICP", "Orientation", "ExposureTime", "Exif:ColorSpace"),
    *("oiio:UnassociatedAlpha", "oiio:BitsPerSample", "tiff:PhotometricInterpretation"),
    *("tiff:ColorSpace", "jpeg:ColorSpace"),
    *("blurmatte:model", "blurmatte:solver", "blurmatte:stats", "blurmatte:sweep"),
    *("blurmatte:camera", "blurmatte:light"),
)
# Some cameras pad the end of a JPEG; every other complaint of libjpeg costs pixels.
_HARMLESS = re.compile(r"extraneous bytes before marker 0xd9")


@dataclass(frozen=True, eq=False)
class Raster:
    """The numbers of a picture file, upright.

    Parameters
    ----------
    path : Path
        Where it came from.
    pixels : (H, W, n) uint8, uint16 or float32
        As stored.
    names : tuple of str
        Of the channels.
    inside : (H, W) bool
        False where the file holds no pixels: an EXR's data may cover a part of its picture.
    tags : mapping
        What the file says beside its pixels, by OpenImageIO's names.
    png : PngFacts or None
        More about a PNG.
    """

    path: Path
    pixels: npt.NDArray[Any]
    names: tuple[str, ...]
    inside: Bools
    tags: Mapping[str, Any]
    png: PngFacts | None

    @property
    def levels(self) -> int | None:
        """How many code values the numbers can take; None for floats."""
        dtype = self.pixels.dtype
        return None if dtype.kind == "f" else int(np.iinfo(dtype).max) + 1

    @property
    def gray(self) -> bool:
        """One channel of light is all there is."""
        return "R" not in self.names

    @property
    def associated(self) -> bool:
        """The colors are multiplied by alpha."""
        return not self.tags.get("oiio:UnassociatedAlpha", 0)

    @property
    def orientation(self) -> int:
        """The EXIF tag: how the stored pixels were turned to be upright; 1: not at all."""
        return int(self.tags.get("Orientation", 1))

    @property
    def colors(self) -> npt.NDArray[Any]:
        """(H, W, 3) numbers of red, green and blue; gray three times."""
        return self.channels("YYY" if self.gray else "RGB")

    @property
    def alpha(self) -> npt.NDArray[np.float32] | None:
        """(H, W) 0…1, or None if there is no such channel."""
        if "A" not in self.names:
            return None
        alpha = self.seen("A")[..., 0]
        if self.levels is None:
            return alpha
        return np.asarray(alpha / np.float32(self.levels - 1), dtype=np.float32)

    def channels(self, names: str | tuple[str, ...]) -> npt.NDArray[Any]:
        """(H, W, n) numbers of the channels that are called `names`."""
        return np.ascontiguousarray(self.seen(names))

    def seen(self, names: str | tuple[str, ...]) -> npt.NDArray[Any]:
        """The same without a copy, where the channels lie side by side."""
        at = [self.names.index(name) for name in names]
        if at == list(range(at[0], at[0] + len(at))):
            return self.pixels[..., at[0] : at[0] + len(at)]
        return self.pixels[..., at]


def load(path: Path, max_pixels: int = MAX_PIXELS, names: tuple[str, ...] | None = None) -> Raster:
    """Read a picture file as it is.

    Parameters
    ----------
    path : Path
        PNG, JPEG, TIFF or OpenEXR.
    max_pixels : int
        More are refused before memory is taken.
    names : tuple of str, optional
        The channels to keep, a Solution's; without it the picture's own: R, G, B or Y, A, and what
        plates.py puts beside them.

    Raises
    ------
    FileError
        If the file is missing, is damaged, or is of a kind that cannot hold light.
    """
    kind = kind_of(path)
    if kind == RAW:
        raise FileError(f"{path}: a camera RAW holds no layer; give an EXR, PNG or TIFF with alpha")
    png = inspect_png(path) if kind == "PNG" else None
    if png is not None:
        check_size(path, png.size, max_pixels)
        check_png(path, png)
    try:
        pixels, kept, tags, spec = _stored(path, kind, max_pixels, names)
    except UnicodeDecodeError as error:
        raise damaged(path, kind, ["a name in it is no text"]) from error
    pixels, inside = _whole(pixels, spec)
    turn = int(tags.get("Orientation", 1))
    return Raster(path, upright(pixels, turn), kept, upright(inside, turn), tags, png)


def _stored(
    path: Path, kind: str, max_pixels: int, names: tuple[str, ...] | None
) -> tuple[npt.NDArray[Any], tuple[str, ...], dict[str, Any], oiio.ImageSpec]:
    """Pixels, the names of their channels, the file's tags, and its header."""
    source, spec = _open(path, kind, max_pixels)
    try:
        if kind != "EXR":  # elsewhere an offset is the place on a page, and nothing is missing
            spec.x, spec.y, spec.full_x, spec.full_y = 0, 0, 0, 0
            spec.full_width, spec.full_height = spec.width, spec.height
        for size in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
            check_size(path, size, max_pixels)
        found = {name: spec.getattribute(name) for name in _TAGS}
        tags = {name: value for name, value in found.items() if value is not None}
        check_format(path, kind, spec, tags)
        kept = wanted_channels(path, tuple(spec.channelnames), names)
        return _pixels(path, kind, source, spec, kept), kept, tags, spec
    finally:
        source.close()
        if source.has_error:  # an error nobody asked for is printed when `source` is deleted
            source.geterror()


def _open(path: Path, kind: str, max_pixels: int) -> tuple[oiio.ImageInput, oiio.ImageSpec]:
    wish = oiio.ImageSpec()
    wish["oiio:UnassociatedAlpha"] = 1  # else straight colors come multiplied, in code values
    source = oiio.ImageInput.open(str(path), wish)
    if source is not None:
        return source, source.spec()
    reason = oiio.geterror()
    claim = re.search(r"claimed to be (\d+)x(\d+)", reason)
    if claim:
        check_size(path, (int(claim[1]), int(claim[2])), max_pixels)
    raise damaged(path, kind, reason.splitlines())


def _pixels(
    path: Path, kind: str, source: oiio.ImageInput, spec: oiio.ImageSpec, names: tuple[str, ...]
) -> npt.NDArray[Any]:
    at = [spec.channelnames.index(name) for name in names]
    form = spec.format if str(spec.format).startswith("uint") else oiio.FLOAT
    pixels = source.read_image(0, 0, min(at), max(at) + 1, form)
    complaints = [line for line in source.geterror().splitlines() if not _HARMLESS.search(line)]
    if pixels is None or complaints:
        raise damaged(path, kind, complaints)
    if at != list(range(min(at), max(at) + 1)):
        pixels = pixels[..., [i - min(at) for i in at]]
    return np.asarray(pixels)


def _whole(pixels: npt.NDArray[Any], spec: oiio.ImageSpec) -> tuple[npt.NDArray[Any], Bools]:
    """The full picture of which the file holds a window, and where that is."""
    data = (spec.x, spec.y, spec.width, spec.height)
    full = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    if data == full:
        return pixels, np.ones(pixels.shape[:2], bool)
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    shape = (spec.full_height, spec.full_width)
    whole, inside = np.zeros((*shape, pixels.shape[2]), pixels.dtype), np.zeros(shape, bool)
    to = np.s_[max(y, 0) : max(y + spec.height, 0), max(x, 0) : max(x + spec.width, 0)]
    height, width = inside[to].shape
    whole[to] = pixels[max(-y, 0) :, max(-x, 0) :][:height, :width]
    inside[to] = True
    return whole, inside


def upright(pixels: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Turn and mirror as the EXIF tag says: 2 mirrored, 3 upside down, 6 and 8 on a side, …"""
    turns = {3: 2, 4: 2, 5: 3, 6: 3, 7: 1, 8: 1}.get(orientation, 0)
    turned = np.rot90(pixels, turns)
    if orientation in (2, 4, 5, 7):
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)


def as_stored(pixels: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """Turn what is upright back to how a file with this EXIF tag stores it."""
    return upright(pixels, {6: 8, 8: 6}.get(orientation, orientation))

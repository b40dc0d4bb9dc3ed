"""Picture files as stored: numbers, channel names and tags, read without conversion.

Sizes and formats are checked before memory is allocated. OpenImageIO reads most formats; Pillow and
libheif (the extra `heic`) decode WebP, AVIF and HEIC. These are lossy, in most files with subsampled
chroma; how they quantize is not read.
"""

import io
import math
import mmap
import re
import struct
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL.ExifTags import Base as TiffTag

from blurmatte.checks import AnyArray, Bools, Floats32
from blurmatte.errors import FileError, optional_library, warn
from blurmatte.files.errors import (
    check_format,
    check_size,
    check_square_pixels,
    damaged,
    format_of,
    plain_name,
    silent_libraries,
    wanted_channels,
)
from blurmatte.files.exif import EXIF_MARK, Tag, fractions, nested, numbers, parse_tags
from blurmatte.files.icc import H273
from blurmatte.files.png import PngHeader, check_png, inspect_png
from blurmatte.formats import AVIF, BMP, EXR, FITS, HEIC, JPEG, MAX_PIXELS, PNG, RAW, TIFF, Format
from blurmatte.jpeg.structure import JpegError, check_header, metadata_segments
from blurmatte.radiometry.sensor import Orientation, exif_orientation

_CARDS = ("Bzero", "Bscale", "Bayerpat", "Exptime", "Exposure")  # of FITS, by OpenImageIO's names
_UNSIGNED_16 = 1 << 15  # BZERO of unsigned integers of 16 bits
# Other attributes are not read: they may hold text in an unknown encoding.
_TAGS = (
    *("ICCProfile", "Orientation", "ExposureTime", "Exif:ColorSpace"),
    *("oiio:UnassociatedAlpha", "oiio:BitsPerSample", "tiff:PhotometricInterpretation"),
    *(
        "tiff:ColorSpace",
        "jpeg:ColorSpace",
        "oiio:ColorSpace",
        "chromaticities",
        "tiff:subfiletype",
        "bmp:bitsperpixel",
    ),
    *("blurmatte:model", "blurmatte:solver", "blurmatte:stats", "blurmatte:sweep"),
    *("blurmatte:camera", "blurmatte:light"),
    *_CARDS,
)
# Some cameras pad the end of a JPEG; every other complaint of libjpeg means lost pixels.
_HARMLESS = re.compile(r"extraneous bytes before marker 0xd9")
# libtiff's complaints about compression.
_UNREADABLE = re.compile(r"([\w ]+) compression support is not|Compression scheme (\d+) ")
_METHODS = {"34712": "JPEG 2000", "50002": "JPEG XL", "52546": "JPEG XL"}
DCF, PRIMARIES = "DCF", "primaries"  # our names of tags of EXIF that OpenImageIO does not give
CICP = "CICP"  # and of the primaries, curve, matrix and range of AVIF and HEIC, by ITU-T H.273
# What Pillow and libheif raise for damaged files.
_DAMAGE = OSError, SyntaxError, ValueError, LookupError, EOFError, RuntimeError, TypeError
_JFIF_ASPECT = 0  # unit of JFIF's densities: they are the shape of a pixel [JFIF 1.02]
_MAX_DENOMINATOR = 1000  # of the shape of pixels, which files state as rounded numbers
_REDUCED_OR_MASK = 1 | 4  # bits of tiff:subfiletype: a smaller copy of another page, or its mask


@dataclass(frozen=True, eq=False)
class Raster:
    """The numbers of a picture file, upright."""

    path: Path  # the file
    format: Format
    pixels: AnyArray  # (H, W, n) uint8, uint16 or float32: as stored
    names: tuple[str, ...]  # names of the channels
    # (H, W) bool: false where the file holds no pixels: the data window of an EXR may be smaller
    # than its picture
    inside: Bools
    tags: Mapping[str, Any]  # attributes of the file, by OpenImageIO's names
    png: PngHeader | None  # the header of a PNG
    page: int = 0  # of a TIFF, the first that is no thumbnail
    bits: int = 0  # of a code value, if fewer than its type has; they span its whole range
    subsampled: bool = False  # true if a WebP, AVIF or HEIC has subsampled chroma
    exif: bytes = b""  # of these; the blocks are as stored
    xmp: bytes = b""

    @property
    def levels(self) -> int | None:
        """Number of code values; None for floats."""
        dtype = self.pixels.dtype
        return None if dtype.kind == "f" else int(np.iinfo(dtype).max) + 1

    @property
    def gray(self) -> bool:
        """True if there is one channel of light."""
        return "R" not in self.names

    @property
    def associated(self) -> bool:
        """True if the colors are multiplied by alpha."""
        return not self.tags.get("oiio:UnassociatedAlpha", 0)

    @property
    def orientation(self) -> Orientation:
        """That of the stored pixels."""
        return exif_orientation(self.tags.get("Orientation", 1))

    @property
    def colors(self) -> AnyArray:
        """(H, W, 3) numbers of red, green and blue; gray is repeated."""
        return self.channels("YYY" if self.gray else "RGB")

    @property
    def alpha(self) -> Floats32 | None:
        """(H, W) 0…1, or None if there is no such channel."""
        if "A" not in self.names:
            return None
        alpha = self.view("A")[..., 0]
        if self.levels is None:
            return alpha
        return np.asarray(alpha / np.float32(self.levels - 1), dtype=np.float32)

    def channels(self, names: str | tuple[str, ...]) -> AnyArray:
        """(H, W, n) contiguous numbers of the named channels."""
        return np.ascontiguousarray(self.view(names))

    def view(self, names: str | tuple[str, ...]) -> AnyArray:
        """(H, W, n) numbers of the named channels; a view if they are adjacent."""
        at = [self.names.index(name) for name in names]
        if at == list(range(at[0], at[0] + len(at))):
            return self.pixels[..., at[0] : at[0] + len(at)]
        return self.pixels[..., at]


def load(path: Path, max_pixels: int = MAX_PIXELS, names: tuple[str, ...] | None = None) -> Raster:
    """Read the numbers of a picture file.

    max_pixels: larger pictures are rejected before memory is allocated.
    names: the channels to read; by default those of the picture, see `wanted_channels`.

    Raises FileError if the file is missing, damaged, or of an unsupported kind.
    """
    form = format_of(path)
    if form is RAW:
        raise FileError(f"{path}: give an EXR, PNG or TIFF with alpha; a camera RAW holds no layer")
    if form.reader != "OpenImageIO":
        return _photo(path, form, max_pixels)
    png = inspect_png(path) if form is PNG else None
    if png is not None:
        check_size(path, png.size, max_pixels)
        check_png(path, png)
    if form is JPEG:
        try:  # of a file with a gain map, a library in OpenImageIO prints this error
            check_header(path.read_bytes())
        except JpegError as error:
            raise damaged(path, form, ["no marker where a segment ends"]) from error
    try:
        page, pixels, kept, tags, spec = _stored(path, form, max_pixels, names)
    except UnicodeDecodeError as error:
        raise damaged(path, form, ["a name is not text"]) from error
    if form is not EXR:
        tags |= _of_exif(_exif_block(path, form, png), page)
    pixels, inside = _full_picture(pixels, spec)
    pixels, inside = _upright((pixels, inside), tags)
    return Raster(path, form, pixels, kept, inside, tags, png, page)


def _photo(path: Path, form: Format, max_pixels: int) -> Raster:
    """A WebP, AVIF or HEIC, whose alpha is straight; a HEIC is decoded upright.

    Raises FileError if the file is damaged or an animation, or the extra is not installed.
    """
    content = path.read_bytes()
    try:
        source = _opened_photo(path, form, content)
        check_size(path, source.size, max_pixels)
        pixels = _pixels_of_photo(source)
    except FileError:
        raise
    except _DAMAGE as error:
        raise damaged(path, form, [str(error)]) from error
    info, bits = source.info, int(source.info.get("bit_depth") or 8)
    if pixels.dtype == np.uint16:  # from `bits` to the whole range
        top = 2**bits - 1
        pixels = ((pixels.astype(np.uint32) * 65535 + top // 2) // top).astype(np.uint16)
    exif = (info.get("exif") or b"").removeprefix(EXIF_MARK)
    stated = {"ICCProfile": info.get("icc_profile"), CICP: _cicp_of_photo(form, content)}
    tags = {"oiio:UnassociatedAlpha": 1, **{name: value for name, value in stated.items() if value}}
    tags |= _of_exif(exif, 0, alone=True)
    (pixels,) = _upright((pixels,), tags)
    names = {1: ("Y",), 2: ("Y", "A"), 3: tuple("RGB"), 4: tuple("RGBA")}[pixels.shape[2]]
    inside, subsampled = np.ones(pixels.shape[:2], bool), _shares_chroma(form, content, info)
    return Raster(
        *(path, form, pixels, names, inside, tags, None, 0),
        *(bits, subsampled, exif, info.get("xmp") or b""),
    )


def _opened_photo(path: Path, form: Format, content: bytes) -> Any:
    """An image of Pillow or of pillow-heif, not decoded."""
    if form is HEIC:
        return _opened_heic(path, content)
    from PIL.AvifImagePlugin import AvifImageFile
    from PIL.WebPImagePlugin import WebPImageFile

    source = (AvifImageFile if form is AVIF else WebPImageFile)(io.BytesIO(content))
    if getattr(source, "n_frames", 1) > 1:
        raise FileError(f"{path}: export its frames as PNG; it is an animation ({form})")
    return source


def _opened_heic(path: Path, content: bytes) -> Any:
    install = 'pip install "blurmatte[heic]", or export it as PNG or JPEG'
    needed = f"{path}: {install}; HEIC needs pillow-heif"
    pillow_heif = optional_library("pillow_heif", needed, FileError)
    images = pillow_heif.open_heif(content, convert_hdr_to_8bit=False, hdr_to_16bit=False)
    if len(images) > 1:
        warn(
            f"{path}: export another one if that is meant; it holds {len(images)} pictures, and the "
            "main one is read"
        )
    source = images[images.primary_index]
    pillow_heif.set_orientation(source.info)  # libheif has turned the picture
    return source


def _pixels_of_photo(source: Any) -> AnyArray:
    """(H, W, n) code values as stored."""
    if source.mode == "P" or source.mode.split(";")[0] in ("RGBa", "La"):
        raise ValueError(f"its colors ({source.mode}) are not supported")
    pixels = np.array(source)
    return pixels if pixels.ndim == 3 else pixels[..., None]


def _shares_chroma(form: Format, content: bytes, info: dict[str, Any]) -> bool:
    if form is HEIC:
        return info.get("chroma") in (420, 422)
    if form is AVIF:
        at = content.find(b"av1C") + 6  # flags of the configuration [AV1-ISOBMFF 2.3.3]
        return 6 <= at < len(content) and content[at] & 0b1100 > 0
    return b"VP8 " in content  # VP8L is lossless


def _cicp_of_photo(form: Format, content: bytes) -> tuple[int, ...]:
    """What the color box of an AVIF or HEIC states; its matrix and range are undone when decoded."""
    at = content.find(b"colrnclx") + 8
    if form not in (AVIF, HEIC) or at < 8 or len(content) < at + 4:
        return ()
    primaries, curve = struct.unpack_from(">2H", content, at)
    return () if H273.UNSPECIFIED in (primaries, curve) else (primaries, curve, 0, 1)


def _stored(
    path: Path, form: Format, max_pixels: int, names: tuple[str, ...] | None
) -> tuple[int, AnyArray, tuple[str, ...], dict[str, Any], Any]:
    """Page, pixels, channel names, tags, and OpenImageIO's ImageSpec."""
    source, spec = _open(path, form, max_pixels)
    try:
        page = _main_page(path, source) if form is TIFF else 0
        spec = source.spec()
        if form is not EXR:  # in other formats an offset is a position on a page
            spec.x, spec.y, spec.full_x, spec.full_y = 0, 0, 0, 0
            spec.full_width, spec.full_height = spec.width, spec.height
        for size in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
            check_size(path, size, max_pixels)
        check_square_pixels(path, (spec.width, spec.height), _pixel_aspect(path, form, spec))
        found = {name: spec.getattribute(name) for name in _TAGS}
        tags = {name: value for name, value in found.items() if value is not None}
        if form is FITS:
            _check_cards(path, str(spec.format), tags)
            tags |= _exposure_of_fits(tags)
        else:
            check_format(path, form, spec, tags)
        kept = wanted_channels(path, tuple(spec.channelnames), names)
        if form is BMP:  # most programs leave its fourth byte 0
            kept = tuple(name for name in kept if name != "A")
        pixels = _pixels(path, form, source, spec, kept)
        if form is FITS:
            pixels = _codes_of_fits(path, pixels, tags)
        if tags.get("tiff:PhotometricInterpretation") == 0:
            pixels = _white_is_top(path, pixels, kept, tags)
        return page, pixels, kept, tags, spec
    finally:
        source.close()
        if source.has_error:  # an error that is not fetched is printed when `source` is deleted
            source.geterror()


def _pixel_aspect(path: Path, form: Format, spec: Any) -> Fraction | None:
    """Width of a pixel over its height; None if the file does not state it.

    Of a JFIF, OpenImageIO gives the inverse where the densities have a unit.
    """
    if form is not JPEG:
        stated = float(spec.getattribute("PixelAspectRatio") or 0)
        if not (math.isfinite(stated) and stated > 0):
            return None
        return Fraction(stated).limit_denominator(_MAX_DENOMINATOR)
    for segment in metadata_segments(path.read_bytes()):
        if segment[:2] == b"\xff\xe0" and segment[4:9] == b"JFIF\0" and len(segment) >= 16:
            unit, x, y = struct.unpack(">BHH", segment[11:16])
            if not (x and y):
                return None
            return Fraction(x, y) if unit == _JFIF_ASPECT else Fraction(y, x)
    return None


def _main_page(path: Path, source: Any) -> int:
    """The first page of a TIFF that is neither a thumbnail nor a mask; `source` is moved to it."""
    pages: list[int] = []
    while source.seek_subimage(len(pages), 0):
        pages.append(int(source.spec().getattribute("tiff:subfiletype") or 0))
    if source.has_error:
        source.geterror()
    full = [page for page, kind in enumerate(pages) if not kind & _REDUCED_OR_MASK]
    if not full:
        raise FileError(
            f"{path}: export it again as a TIFF of one page; it holds a thumbnail, and no picture that "
            "can be read"
        )
    if len(full) > 1:
        warn(
            f"{path}: save the page that is wanted as a file of its own; "
            f"page {full[0] + 1} of {len(pages)} is read"
        )
    source.seek_subimage(full[0], 0)
    return full[0]


def _white_is_top(
    path: Path, pixels: AnyArray, names: tuple[str, ...], tags: Mapping[str, Any]
) -> AnyArray:
    """Gray of a TIFF in which 0 is white, inverted where OpenImageIO has not done so.

    It inverts 8 bits, and alpha as well.
    """
    premultiplied = "A" in names and not tags.get("oiio:UnassociatedAlpha", 0)
    if pixels.dtype.kind == "f" or premultiplied:
        raise FileError(
            f"{path}: export it with black as 0 (BlackIsZero); in the TIFF 0 is white (WhiteIsZero), "
            "which has no meaning for " + ("premultiplied colors" if premultiplied else "floats")
        )
    wrong = "A" if pixels.dtype == np.uint8 else "Y"
    columns = [i for i, name in enumerate(names) if name == wrong]
    pixels[..., columns] = np.iinfo(pixels.dtype).max - pixels[..., columns]
    return pixels


def _exif_block(path: Path, form: Format, png: PngHeader | None) -> bytes | mmap.mmap:
    """EXIF of a PNG or JPEG; a TIFF is such a block itself."""
    if png is not None:
        return png.exif.removeprefix(EXIF_MARK)
    if form in (BMP, FITS):
        return b""
    if form is JPEG:
        bodies = (segment[4:] for segment in metadata_segments(path.read_bytes()))
        return next((b.removeprefix(EXIF_MARK) for b in bodies if b.startswith(EXIF_MARK)), b"")
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _of_exif(block: bytes | mmap.mmap, page: int, alone: bool = False) -> dict[str, Any]:
    """DCF's name of the color space (such as b"R03"), chromaticities and exposure time, if stated.

    OpenImageIO gives the time only where it has the type that EXIF wants. If it has not read the file
    (`alone`), also orientation and color space, by its names.
    """
    try:
        tags = parse_tags(block, page)
    except ValueError:  # some cameras and programs write invalid EXIF
        return {}
    found: dict[str, Any] = {}
    interoperability = TiffTag.ExifOffset, TiffTag.ExifInteroperabilityOffset, TiffTag.InteropIndex
    if isinstance(index := nested(tags, *interoperability), Tag):
        found[DCF] = index.data.rstrip(b"\0")
    white, colors = (
        fractions(tags.get(name, {}))
        for name in (TiffTag.WhitePoint, TiffTag.PrimaryChromaticities)
    )
    if len(white) == 2 and len(colors) == 6:
        found[PRIMARIES] = (*colors, *white)
    stated: dict[str, Sequence[float]] = {
        "ExposureTime": fractions(nested(tags, TiffTag.ExifOffset, TiffTag.ExposureTime))
    }
    if alone:
        stated["Orientation"] = numbers(nested(tags, TiffTag.Orientation))
        stated["Exif:ColorSpace"] = numbers(nested(tags, TiffTag.ExifOffset, TiffTag.ColorSpace))
    return found | {name: values[0] for name, values in stated.items() if values}


def _check_cards(path: Path, kind: str, cards: Mapping[str, Any]) -> None:
    """Raise FileError for FITS of numbers that are no light from 0 to white, or of mosaics of colors.

    kind: the type of the numbers as stored.
    """
    try:
        zero, scale = _zero_and_scale(cards)
    except ValueError as error:
        raise FileError(f"{path}: save it again; its BZERO or BSCALE is no number") from error
    usual = {"uint8": (0, 1), "int16": (_UNSIGNED_16, 1)}
    if kind not in ("float", "double") and usual.get(kind) != (zero, scale):
        raise FileError(
            f"{path}: save it as unsigned integers of 16 bits (BZERO 32768), or as floats of which 1 "
            f"is a saturated pixel; its integers ({kind}, BZERO {zero:g}, BSCALE {scale:g}) have no "
            "white"
        )
    if cards.get("Bayerpat"):
        raise FileError(
            f"{path}: save it in color (debayer it); it is the mosaic {str(cards['Bayerpat']).strip()} "
            "of a color camera"
        )


def _codes_of_fits(path: Path, pixels: AnyArray, cards: Mapping[str, Any]) -> AnyArray:
    """Code values, or light, of the numbers as stored in a FITS, which are proportional to light.

    Unsigned integers of 16 bits are stored as signed ones from which BZERO, 32768, was subtracted.

    Raises FileError if most floats are above white: then they are counts of a camera.
    """
    if pixels.dtype == np.int16:
        return (pixels.astype(np.int32) + _UNSIGNED_16).astype(np.uint16)
    if pixels.dtype.kind != "f":
        return pixels
    zero, scale = _zero_and_scale(cards)
    light = np.asarray(zero + scale * pixels, np.float32)
    typical = float(np.nanmedian(light)) if np.isfinite(light).any() else 0.0
    if typical > 1:
        raise FileError(
            f"{path}: divide it by the value of a saturated pixel, so that 1 is white; half of its "
            f"floats are above {typical:.3g}"
        )
    return light


def _exposure_of_fits(cards: Mapping[str, Any]) -> dict[str, float]:
    """Seconds, by OpenImageIO's name, if they are stated."""
    found = (cards[name] for name in ("Exptime", "Exposure") if name in cards)
    seconds = next((float(one) for one in found if isinstance(one, int | float)), None)
    return {} if seconds is None else {"ExposureTime": seconds}


def _zero_and_scale(cards: Mapping[str, Any]) -> tuple[float, float]:
    """BZERO and BSCALE."""
    return float(cards.get("Bzero", 0)), float(cards.get("Bscale", 1))


def _silent(form: Format) -> AbstractContextManager[None]:
    """OpenImageIO's libraries for PNG, JPEG and its gain maps print what is wrong with a file."""
    return silent_libraries() if form in (PNG, JPEG) else nullcontext()


def _open(path: Path, form: Format, max_pixels: int) -> tuple[Any, Any]:
    """OpenImageIO's ImageInput and ImageSpec."""
    import OpenImageIO as oiio

    wish = oiio.ImageSpec()
    wish["oiio:UnassociatedAlpha"] = 1  # else straight code values are multiplied by alpha
    with plain_name(path, form) as name:
        with _silent(form):
            source = oiio.ImageInput.open(name, wish)
        if source is not None:
            return source, source.spec()
        reason = oiio.geterror().replace(name, str(path))
    claim = re.search(r"claimed to be (\d+)x(\d+)", reason)
    if claim:
        check_size(path, (int(claim[1]), int(claim[2])), max_pixels)
    raise damaged(path, form, reason.splitlines())


def _pixels(path: Path, form: Format, source: Any, spec: Any, names: tuple[str, ...]) -> AnyArray:
    at = [spec.channelnames.index(name) for name in names]
    kind = str(spec.format)
    dtype = kind if kind.startswith("uint") or (form is FITS and kind == "int16") else "float"
    with _silent(form):
        pixels = source.read_image(source.current_subimage(), 0, min(at), max(at) + 1, dtype)
    complaints = [line for line in source.geterror().splitlines() if not _HARMLESS.search(line)]
    method = _UNREADABLE.search(" ".join(complaints))
    if method:
        name = method[1] or _METHODS.get(method[2], f"method {method[2]}")
        raise FileError(
            f"{path}: save it without compression, or with ZIP (Deflate) or LZW; the {form} is "
            f"compressed by {name}, which cannot be read"
        )
    if pixels is None or complaints:
        raise damaged(path, form, complaints)
    if at != list(range(min(at), max(at) + 1)):
        pixels = pixels[..., [i - min(at) for i in at]]
    return np.asarray(pixels)


def _full_picture(pixels: AnyArray, spec: Any) -> tuple[AnyArray, Bools]:
    """The display window, of which the file may hold a part, and a mask of that part."""
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


def _upright(stored: Sequence[AnyArray], tags: Mapping[str, Any]) -> list[AnyArray]:
    """Stored arrays of pixels turned by the orientation of the file."""
    turn = exif_orientation(tags.get("Orientation", 1))
    return [np.ascontiguousarray(turn.upright(pixels)) for pixels in stored]

"""The errors for files that hold no usable picture.

Libraries print errors of damaged files past sys.stderr that are raised as well: those are discarded.
"""

import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np

from blurmatte.checks import Floats
from blurmatte.errors import FileError
from blurmatte.formats import HEAD_BYTES, JPEG, MAX_PIXELS, Format, Holds, recognized

VARIANCE, VALID = ("variance.R", "variance.G", "variance.B"), "valid"  # extra channels of an EXR
_PATTERN = re.compile(r"%\d*d|[*?{\[]")
_MAX_UNPROVEN = 50_000_000  # pixels: they need 2 GB at most
_PIXELS_PER_BYTE = 32  # of a larger picture; no camera's has more, a flat one in a PNG has 340
_STDERR_LOCK = Lock()  # two threads that silence stderr would restore the wrong descriptor
_BITS = {"uint8": 8, "uint16": 16, "half": 16, "float": 32, "double": 64}


# Of the test for colors that are not premultiplied, see `check_premultiplied`.
_LOW, _MIDDLE, _HIGH = 1 / 8, 1 / 4, 1 / 2  # alpha, relative to its 95 % quantile
_STRAIGHT_RATIO = 1.0  # of brightnesses: noise gives at most 0.8, straight colors 1.1 to 20
_MIN_LOW_FRACTION = 0.005  # of the pixels with alpha, that must have a low alpha
_MIN_LOW_PIXELS = 32


def format_of(path: Path) -> Format:
    """The format of a picture file, by its content, see `recognized`.

    Raises FileError if the file cannot be read or holds no picture that can be.
    """
    form = recognized(beginning(path, HEAD_BYTES, "give a picture file"), path)
    if form is None:
        raise FileError(
            f"{path}: export it again as PNG, JPEG, TIFF or OpenEXR; the file holds no picture of a "
            "known kind"
        )
    if form.holds is Holds.CLIP:
        raise FileError(
            f"{path}: extract one frame of the clip ({form}), because one picture is needed; or use "
            "blurmatte track or blurmatte solve (read_frames), which read clips"
        )
    if form.holds is Holds.OTHER:
        raise FileError(f"{path}: {form.remedy}; this kind of file ({form}) is not read")
    return form


@contextmanager
def plain_name(path: Path, form: Format | None) -> Iterator[str]:
    """A name by which a library opens or writes a file: of a link if its own is no text, or misleads.

    FFmpeg takes a name that is a pattern and ends like a picture for a sequence of pictures.
    """
    name, misnamed = str(path), form is not None and path.suffix.lower() not in form.extensions
    if os.fsencode(name).decode("utf-8", "replace") == name and not (
        misnamed and _PATTERN.search(name)
    ):
        yield name
        return
    suffix = path.suffix if form is None else form.extensions[0]
    with TemporaryDirectory(prefix="blurmatte-") as folder:
        link = Path(folder, f"file{suffix}")
        try:
            link.symlink_to(path.absolute())
        except OSError as error:
            raise FileError(f"{path}: rename it; its name cannot be read ({error})") from error
        yield str(link)


def beginning(path: Path, most: int, instead_of_folder: str) -> bytes:
    """The first bytes of a file, at most so many; a FileError if it cannot be read."""
    check_exists(path, instead_of_folder)
    try:
        with path.open("rb") as file:
            return file.read(most)
    except OSError as error:
        raise unreadable(path, error) from error


def check_exists(path: Path, instead_of_folder: str) -> None:
    """Raise FileError unless `path` is a file that is not empty."""
    check_regular(path)
    try:
        if path.is_dir():
            raise FileError(f"{path}: {instead_of_folder}; this is a folder")
        if path.stat().st_size == 0:
            raise FileError(f"{path}: copy or export it again; the file is empty")
    except OSError as error:
        raise unreadable(path, error) from error


def check_regular(path: Path) -> None:
    """Raise FileError for a pipe or a device, which may be endless."""
    with suppress(OSError):  # reading it says what is wrong
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise FileError(f"{path}: give a file; this is a pipe or a device")


def unreadable(path: str | Path, error: OSError) -> FileError:
    """The error for a file that the operating system does not open."""
    if isinstance(error, FileNotFoundError):
        return FileError(f"{path}: check the name; there is no such file")
    return FileError(f"{path}: check the path; the file cannot be read ({error.strerror})")


def damaged(path: Path, kind: Format | str, complaints: list[str]) -> FileError:
    """The error for a file that a library could not decode, with the library's first complaint."""
    line = next((text.strip() for text in complaints if text.strip()), "")
    for name in (f' ("{path}")', f"({path})", f"{path}: "):
        line = line.replace(name, "")
    line = "".join(c if c.isprintable() else "?" for c in line.replace(f'"{path}"', "it"))
    reason = f" ({line})" if line else ""
    return FileError(f"{path}: copy or export it again; the {kind} is damaged or truncated{reason}")


def check_square_pixels(
    path: Path, size: tuple[int, int], aspect: Fraction | None, command: str = ""
) -> None:
    """Raise FileError unless stored pixels of this size are shown in it, within a pixel.

    size: width and height as stored.
    aspect: the width of a pixel over its height; None or not above 0: not stated.
    command: that makes them square, with {} for the width and for the height; "" for none.
    """
    width, height = size
    if not aspect or aspect < 0 or abs(aspect - 1) * max(size) < 1:
        return
    shown = max(round(width * aspect), 1)
    how = f" ({command.format(shown, height)})" if command else f" as {shown}x{height}"
    raise FileError(
        f"{path}: export it with square pixels{how}, or correct the shape of pixels if the file "
        f"states it wrongly; its pixels are {aspect.numerator}:{aspect.denominator}, {width}x{height} "
        f"are shown as {shown}x{height}"
    )


def check_size(path: Path, size: tuple[int, int], max_pixels: int) -> None:
    """Raise FileError if a (width, height) exceeds the limit, or a small file claims a large picture.

    A limit above the default lets such files pass.
    """
    width, height = size
    if width * height > max_pixels:
        raise FileError(
            f"{path}: raise the limit with max_pixels= (--max-pixels) if the size is right; "
            f"{width} x {height} pixels are more than the limit of {max_pixels}"
        )
    stored = path.stat().st_size
    if width * height > max(_MAX_UNPROVEN, _PIXELS_PER_BYTE * stored) and max_pixels <= MAX_PIXELS:
        raise FileError(
            f"{path}: pass max_pixels={MAX_PIXELS + 1} (--max-pixels {MAX_PIXELS + 1}) if the size is "
            f"right; {width} x {height} pixels in {stored} bytes are hardly a picture (the limit is "
            f"{_MAX_UNPROVEN}, or {_PIXELS_PER_BYTE} pixels per byte)"
        )


def check_format(path: Path, kind: Format, spec: Any, tags: Mapping[str, Any]) -> None:
    """Raise FileError for CMYK, palettes, Lab, deep pictures and unsupported bit depths.

    `spec` is the ImageSpec of OpenImageIO.
    """
    color = str(tags.get(f"{kind.name.lower()}:ColorSpace", ""))
    if color in ("CMYK", "YCbCrK") or color.startswith("YCCK"):
        raise FileError(f"{path}: convert it to sRGB; the {kind} has CMYK colors for printing")
    # TIFF: gray, inverted gray, RGB, or YCbCr, which libtiff converts to RGB.
    if tags.get("tiff:PhotometricInterpretation", 2) not in (0, 1, 2, 6):
        raise FileError(f"{path}: convert it to RGB; its colors are {color or 'not supported'}")
    if tags.get("bmp:bitsperpixel", 24) < 24 and spec.nchannels > 1:
        raise FileError(f"{path}: export it as RGB; a palette rounds the colors of a BMP")
    if spec.deep:
        raise FileError(f"{path}: flatten it; a deep EXR has several values per pixel")
    form = str(spec.format)
    if form == "double" and spec.tile_width:  # OpenImageIO reads them as black
        raise FileError(f"{path}: export 32-bit floats; 64-bit floats in tiles cannot be read")
    bits = int(tags.get("oiio:BitsPerSample", _BITS.get(form, 0)))
    if bits != _BITS.get(form) or (kind is JPEG and form != "uint8"):
        raise FileError(
            f"{path}: export 8 or 16 bits, or float; {bits or ''} bits per channel ({form}) "
            "are not supported"
        )


def check_premultiplied(path: Path, light: Floats, alpha: Floats) -> None:
    """Raise FileError if the colors of a layer look straight.

    Straight pixels of low alpha are as bright as those of high alpha, and would exceed white after
    division by alpha. The statistic is the fraction of bright pixels of low alpha times the median
    brightness / alpha of middle alpha. Most pixels without alpha being lit also counts. A glow
    around an opaque object passes, as do lamps brighter than white. Very dark colors pass unnoticed.
    """
    visible = alpha > 0
    brightest = np.maximum(np.maximum(light[..., 0], light[..., 1]), light[..., 2])
    if not visible.any():
        return
    top = np.quantile(alpha[visible], 0.95)
    bright = brightest > np.quantile(brightest[alpha >= _HIGH * top], 0.25) / 2
    low, none = visible & (alpha < _LOW * top), ~visible
    middle = (alpha >= _LOW * top) & (alpha < _MIDDLE * top)
    enough = max(_MIN_LOW_PIXELS, _MIN_LOW_FRACTION * np.count_nonzero(visible))
    straight = (
        min(np.count_nonzero(low), np.count_nonzero(middle)) >= enough
        and bright[low].mean() * np.median(brightest[middle] / alpha[middle]) > _STRAIGHT_RATIO
    )
    if straight or (np.count_nonzero(none) >= enough and bright[none].mean() > 0.5):
        raise FileError(
            f"{path}: multiply its colors by alpha in the program that wrote it (Premult in Nuke, "
            "oiiotool --premult); its colors look straight, and those of an EXR are premultiplied"
        )


def wanted_channels(
    path: Path, present: tuple[str, ...], names: tuple[str, ...] | None
) -> tuple[str, ...]:
    """The channels `names` of a file, or by default those of its picture: light, alpha, noise.

    Raises FileError if some of them are not `present`.
    """
    listed = ", ".join(present[:12])
    if names is not None:
        missing = [name for name in names if name not in present]
        if missing:
            raise FileError(
                f"{path}: give the layer.exr of blurmatte solve (of a clip with --layers solution), or "
                "an EXR that blurmatte.write made of a Solution; this file holds no Solution (no "
                f"channel {missing[0]}, but {listed})"
            )
        return tuple(name for name in present if name in names)
    colors = next((p for p in ({"R", "G", "B"}, {"Y"}) if p <= set(present)), None)
    if colors is None or {"RY", "BY"} & set(present):
        raise FileError(
            f"{path}: export an RGB picture; the file has no channels R, G, B or Y, but {listed}"
        )
    return tuple(name for name in present if name in colors | {"A", VALID, *VARIANCE})


@contextmanager
def silent_libraries() -> Iterator[None]:
    """Discard what is written to the descriptor of stderr."""
    with _STDERR_LOCK:
        try:
            kept = os.dup(2)
        except OSError:  # a program without a terminal has no stderr
            yield
            return
        try:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)

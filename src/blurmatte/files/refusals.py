"""What can be wrong with a picture file, told in one line: the file, what is wrong, what to do."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from blurmatte.checks import Floats
from blurmatte.errors import FileError
from blurmatte.files.png import SIGNATURE as PNG_SIGNATURE
from blurmatte.files.png import PngFacts

EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")
RAW = "camera RAW"
_RAW_NAMES = (
    "3fr arw cr2 cr3 crw dcr dng erf fff iiq k25 kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 "
    "srf srw x3f"
)
RAW_EXTENSIONS = tuple(f".{name}" for name in _RAW_NAMES.split())
_CLIPS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mts")
VARIANCE, VALID = ("variance.R", "variance.G", "variance.B"), "valid"  # beside the light of an EXR

_SIGNATURES = {
    PNG_SIGNATURE: "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",  # the 64-bit offsets of BigTIFF
    b"MM\0+": "TIFF",
    b"\x76\x2f\x31\x01": "EXR",
}
_BITS = {"uint8": 8, "uint16": 16, "half": 16, "float": 32, "double": 64}
# What light that was not multiplied by alpha looks like: see `check_premultiplied`.
_LOW, _MIDDLE, _HIGH = 1 / 8, 1 / 4, 1 / 2  # of the alpha that most of the layer stays below
_AS_BRIGHT = (
    1.0  # noise made it 0.8 at most in trials; straight colors 1.1 and more, mostly 4 to 20
)
_LEAST_SHARE, _LEAST_PIXELS = 0.005, 32  # of low alpha, before anything is said
_PHOTOMETRIC = (0, 1, 2, 6)  # TIFF: gray, gray, RGB, YCbCr (which libtiff turns into RGB)


def kind_of(path: Path) -> str:
    """PNG, JPEG, TIFF, EXR or camera RAW, by the first bytes: names lie.

    Most RAW files begin like a TIFF, each maker's in its own way: there the name counts.
    """
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give a picture file")
    try:
        with path.open("rb") as file:
            start = file.read(8)
    except FileNotFoundError as error:
        raise FileError(f"{path}: there is no such file; check the name") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    named_raw = path.suffix.lower() in RAW_EXTENSIONS
    if path.suffix.lower() in _CLIPS:
        raise FileError(
            f"{path}: is a clip, and one picture is needed; take a frame of it, or give the clip to "
            "blurmatte measure or blurmatte plate (read_frames)"
        )
    if path.suffix.lower() not in EXTENSIONS and not named_raw:
        raise FileError(
            f"{path}: cannot read this kind of file; convert it to {', '.join(EXTENSIONS)}, "
            "or .dng if it is a camera RAW"
        )
    if not start:
        raise FileError(f"{path}: the file is empty; copy or export it again")
    for signature, kind in _SIGNATURES.items():
        if start.startswith(signature) and not (named_raw and kind == "TIFF"):
            return kind
    if named_raw:
        return RAW
    raise FileError(
        f"{path}: holds no PNG, JPEG, TIFF or OpenEXR picture, whatever its name says; "
        "export it again"
    )


def check_size(path: Path, size: tuple[int, int], max_pixels: int) -> None:
    """Refuse a (width, height) beyond the limit."""
    width, height = size
    if width * height > max_pixels:
        raise FileError(
            f"{path}: claims {width} x {height} pixels, more than the limit of {max_pixels}; "
            "if that is true, raise the limit with max_pixels= (--max-pixels)"
        )


def check_png(path: Path, png: PngFacts) -> None:
    """Refuse palettes and fewer than 8 bits; OpenImageIO would make 8 bits of both."""
    if png.palette:
        raise FileError(
            f"{path}: a palette PNG has lost the light of most pixels; export it as RGB"
        )
    if png.bits < 8:
        raise FileError(
            f"{path}: has fewer than 8 bits per channel ({png.bits}); export 8 or 16 bits"
        )


def check_format(path: Path, kind: str, spec: oiio.ImageSpec, tags: Mapping[str, Any]) -> None:
    """Refuse numbers that are no light: CMYK, palettes, Lab, odd depths."""
    color = str(tags.get(f"{kind.lower()}:ColorSpace", ""))
    if color in ("CMYK", "YCbCrK") or color.startswith("YCCK"):
        raise FileError(f"{path}: a CMYK {kind} is meant for printing; convert it to sRGB first")
    if tags.get("tiff:PhotometricInterpretation", 2) not in _PHOTOMETRIC:
        raise FileError(f"{path}: its pixels are {color or 'no light'}; convert it to RGB first")
    if spec.deep:
        raise FileError(f"{path}: a deep EXR has no single light per pixel; flatten it first")
    form = str(spec.format)
    bits = int(tags.get("oiio:BitsPerSample", _BITS.get(form, 0)))
    if bits != _BITS.get(form) or (kind == "JPEG" and form != "uint8"):
        raise FileError(
            f"{path}: {bits or ''} bits per channel ({form}) are not supported; "
            "export 8 or 16 bits, or float"
        )


def check_premultiplied(path: Path, light: Floats, alpha: Floats) -> None:
    """Refuse light that was not multiplied by alpha, as far as the numbers tell.

    Such pixels of low alpha are as bright as those of high alpha, and would be beyond white if they
    were divided by alpha. The share of the first times the second, 1 being white, is what is looked
    at; or whether most of the pixels without alpha are lit. A glow around something opaque is neither,
    and lamps brighter than white fade with alpha. What is very dark stays unnoticed.
    """
    there = alpha > 0
    brightest = np.maximum(np.maximum(light[..., 0], light[..., 1]), light[..., 2])
    if not there.any():
        return
    most = np.quantile(alpha[there], 0.95)
    bright = brightest > np.quantile(brightest[alpha >= _HIGH * most], 0.25) / 2
    low, none = there & (alpha < _LOW * most), ~there
    middle = (alpha >= _LOW * most) & (alpha < _MIDDLE * most)
    enough = max(_LEAST_PIXELS, _LEAST_SHARE * np.count_nonzero(there))
    straight = (
        min(np.count_nonzero(low), np.count_nonzero(middle)) >= enough
        and bright[low].mean() * np.median(brightest[middle] / alpha[middle]) > _AS_BRIGHT
    )
    if straight or (np.count_nonzero(none) >= enough and bright[none].mean() > 0.5):
        raise FileError(
            f"{path}: its colors look straight, for light does not fall with alpha; an EXR's are "
            "multiplied by alpha: do so where it was made (Premult in Nuke, oiiotool --premult)"
        )


def wanted_channels(
    path: Path, present: tuple[str, ...], names: tuple[str, ...] | None
) -> tuple[str, ...]:
    """Those of the channels `present` that are asked for: `names`, or else the picture's own.

    The picture's own are its light, its alpha, and what plates.py may have put beside them.
    """
    told = ", ".join(present[:12])
    if names is not None:
        missing = [name for name in names if name not in present]
        if missing:
            raise FileError(
                f"{path}: holds no Solution (no channel {missing[0]}, but {told}); "
                "give the layer.exr of blurmatte solve, or what blurmatte.write made of one"
            )
        return tuple(name for name in present if name in names)
    colors = next((p for p in ({"R", "G", "B"}, {"Y"}) if p <= set(present)), None)
    if colors is None or {"RY", "BY"} & set(present):
        raise FileError(
            f"{path}: has no channels R, G, B and no gray Y, but {told}; export a plain RGB picture"
        )
    return tuple(name for name in present if name in colors | {"A", VALID, *VARIANCE})


def damaged(path: Path, kind: str, complaints: list[str]) -> FileError:
    """The error for a file of which a library complained."""
    return FileError(
        f"{path}: the {kind} is damaged or cut short{_told(complaints, path)}; "
        "copy or export it again"
    )


def _told(complaints: list[str], path: Path) -> str:
    """The first of a library's complaints in brackets, without the file's name again."""
    line = next((text.strip() for text in complaints if text.strip()), "")
    for name in (f' ("{path}")', f"({path})", f"{path}: "):
        line = line.replace(name, "")
    told = "".join(c if c.isprintable() else "?" for c in line.replace(f'"{path}"', "it"))
    return f" ({told})" if told else ""

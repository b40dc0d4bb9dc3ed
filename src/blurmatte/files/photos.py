"""WebP, AVIF and HEIC, which Pillow and libheif (the extra `heic`) decode.

They are lossy, in most files with subsampled chroma. How they quantize is not read.
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import AnyArray
from blurmatte.errors import FileError, optional_library, warn
from blurmatte.files.errors import check_size, damaged
from blurmatte.files.exif import EXIF_MARK
from blurmatte.files.icc import H273
from blurmatte.formats import AVIF, HEIC, Format

_DAMAGE = OSError, SyntaxError, ValueError, LookupError, EOFError, RuntimeError, TypeError


@dataclass(frozen=True, eq=False)
class Photo:
    """What such a file holds, as it is stored; a HEIC already upright."""

    pixels: AnyArray  # (H, W, n) uint8, or uint16 with all of its range
    names: tuple[str, ...]  # of the channels; alpha is straight
    bits: int  # per code value
    subsampled: bool  # whether pixels share chroma
    profile: bytes  # ICC; this and the blocks below are empty if there is none
    exif: bytes
    xmp: bytes
    # Primaries, curve, matrix and full range of the decoded R'G'B' by H.273; empty if not stated
    cicp: tuple[int, ...]


def decoded(path: Path, form: Format, max_pixels: int) -> Photo:
    """The photograph in a WebP, AVIF or HEIC.

    Larger pictures than `max_pixels` are rejected before they are decoded.

    Raises FileError if the file is damaged or an animation, or the extra is not installed.
    """
    content = path.read_bytes()
    try:
        source = _opened(path, form, content)
        check_size(path, source.size, max_pixels)
        pixels = _pixels(source)
    except FileError:
        raise
    except _DAMAGE as error:
        raise damaged(path, form, [str(error)]) from error
    info, bits = source.info, int(source.info.get("bit_depth") or 8)
    if pixels.dtype == np.uint16:  # from `bits` to the whole range
        top = 2**bits - 1
        pixels = ((pixels.astype(np.uint32) * 65535 + top // 2) // top).astype(np.uint16)
    return Photo(
        pixels,
        {1: ("Y",), 2: ("Y", "A"), 3: tuple("RGB"), 4: tuple("RGBA")}[pixels.shape[2]],
        bits,
        _shares_chroma(form, content, info),
        info.get("icc_profile") or b"",
        (info.get("exif") or b"").removeprefix(EXIF_MARK),
        info.get("xmp") or b"",
        () if form not in (AVIF, HEIC) else _cicp(content),
    )


def _opened(path: Path, form: Format, content: bytes) -> Any:
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


def _pixels(source: Any) -> AnyArray:
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


def _cicp(content: bytes) -> tuple[int, ...]:
    """What the color box of an AVIF or HEIC states; its matrix and range are undone when decoded."""
    at = content.find(b"colrnclx") + 8
    if at < 8 or len(content) < at + 4:
        return ()
    primaries, curve = struct.unpack_from(">2H", content, at)
    return () if H273.UNSPECIFIED in (primaries, curve) else (primaries, curve, 0, 1)

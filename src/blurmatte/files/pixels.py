"""Arrays of finished numbers to PNG, TIFF and EXR by OpenImageIO, to JPEG by Pillow.

Nothing is converted here. Failures are OSError, as for any file.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

_FORMATS = {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "float32": oiio.FLOAT}
# OpenImageIO writes the time of day unless told another: the same picture is the same file.
_DATE = "1970:01:01 00:00:00"
_DATED = (".tif", ".exr")
_PNG_LEVEL = 4  # of zlib: a quarter of the time of 6, its usual one, for files 5 % larger
_STRIP = 256  # rows; a multiple of what a compressed block of EXR or TIFF holds
_EXIF_POINTER, _EXPOSURE_TIME, _COLOR_SPACE, _IS_SRGB = 0x8769, 0x829A, 0xA001, 1


def save_pixels(
    path: Path,
    parts: Sequence[npt.NDArray[Any]],
    names: Sequence[str],
    tags: Mapping[str, Any],
) -> None:
    """Write numbers as they are, losslessly: integers as integers, all floats as float32.

    Parameters
    ----------
    path : Path
        Its extension says the format.
    parts : sequence of (H, W) or (H, W, n) arrays
        What the channels hold, one part after another; the first says of what kind all are.
    names : sequence of str
        Of the channels.
    tags : mapping
        Attributes of the file, by OpenImageIO's names.

    Raises
    ------
    OSError
        If they do not all arrive.
    """
    dtype = np.dtype(np.float32) if parts[0].dtype.kind == "f" else parts[0].dtype
    height, width = parts[0].shape[:2]
    spec = oiio.ImageSpec(width, height, len(names), _FORMATS[dtype.name])
    spec.channelnames = tuple(names)
    if path.suffix == ".png":
        spec["png:compressionLevel"] = _PNG_LEVEL
    spec.alpha_channel = names.index("A") if "A" in names else -1
    if path.suffix in _DATED:
        spec["compression"] = "zip"
        spec["DateTime"] = _DATE
    for name, value in tags.items():
        spec[name] = value
    target = oiio.ImageOutput.create(str(path))
    if target is None:
        raise OSError(_first_line(oiio.geterror()))
    arrived = target.open(str(path), spec) and _send(target, parts, dtype)
    complaint = target.geterror()  # PNG reports a full disk here alone
    closed = target.close()
    complaint += target.geterror()
    if complaint or not (arrived and closed):
        raise OSError(_first_line(complaint))


def _send(
    target: oiio.ImageOutput, parts: Sequence[npt.NDArray[Any]], dtype: np.dtype[Any]
) -> bool:
    """Interleave the parts strip by strip, so that no second copy of the picture is needed."""
    height = len(parts[0])
    for row in range(0, height, _STRIP):
        end = min(row + _STRIP, height)
        strip = np.dstack([part[row:end] for part in parts]).astype(dtype, copy=False)
        if not target.write_scanlines(row, end, 0, np.ascontiguousarray(strip)):
            return False
    return True


def save_jpeg(path: Path, codes: npt.NDArray[np.uint8], exposure_time: float | None = None) -> None:
    """Write (H, W, 3) sRGB codes at quality 95, every pixel with its own color.

    Pillow does it: on a full disk OpenImageIO's JPEG library ends the process.

    Raises
    ------
    OSError
        If they do not all arrive.
    """
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    exif = Image.Exif()
    ifd = exif.get_ifd(_EXIF_POINTER)
    ifd[_COLOR_SPACE] = _IS_SRGB
    if exposure_time:
        ifd[_EXPOSURE_TIME] = IFDRational(round(exposure_time * 1e6), 1_000_000)
    content = io.BytesIO()  # straight to a file, Pillow would not notice a full disk
    Image.fromarray(codes).save(content, "JPEG", quality=95, subsampling=0, exif=exif)
    path.write_bytes(content.getbuffer())


def _first_line(text: str) -> str:
    return next((line.strip() for line in text.splitlines() if line.strip()), "no reason given")

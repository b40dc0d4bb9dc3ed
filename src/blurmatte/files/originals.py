"""An edited picture in the file it came from: its untouched pixels, its color profile, its EXIF.

Light is encoded as the file does it, and turned back as the file is stored. PNG and TIFF keep all
other code values. In a JPEG they would change with each compression; there, blocks keep their
coefficients instead.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, check_map, check_same_size
from blurmatte.errors import FileError
from blurmatte.files.beside import current_segments
from blurmatte.files.encoding import encoding_of, from_light
from blurmatte.files.jpeg import exchanged, read_jpeg
from blurmatte.files.jpeg_segments import JpegError
from blurmatte.files.jpeg_writing import jpeg_bytes
from blurmatte.files.keeping import raster_colors, save_new_jpeg, save_png, save_tiff
from blurmatte.files.raster import MAX_PIXELS, Raster, as_stored, load
from blurmatte.files.reading import light_of
from blurmatte.files.refusals import RAW, kind_of
from blurmatte.files.replacing import extension_of, replacing
from blurmatte.files.writing import Way, write
from blurmatte.radiometry import LinearImage, Transfer


def write_changed(
    path: str | Path,
    original: str | Path,
    picture: LinearImage,
    changed: Bools,
    transfer: Transfer | None = None,
    max_pixels: int = MAX_PIXELS,
) -> None:
    """Write the light of some pixels of a picture, and all else as the file `original` holds it.

    ============  ============================================================================
    .png .tif     Every other code value is the original's, and so are bits, alpha, orientation,
                  ICC profile, EXIF, XMP and resolution. From PNG to PNG all chunks are kept, from
                  TIFF to TIFF all tags of the first page but those about how its pixels lie.
    .jpg          Of a JPEG, only the blocks (MCUs) that hold a changed pixel are compressed anew, with
                  the original's tables; all others decode to the same pixels, but for one pixel of
                  color beside them where color is sampled less finely. All segments are kept.
                  Of a PNG or TIFF, the whole picture at quality 95.
    .exr          The light of the whole picture, as `write` does it.
    ============  ============================================================================

    What would show the old picture is left out: the small picture in EXIF, more pictures or pages,
    further channels, and Photoshop's layers. Other small pictures stay: in the notes of a camera maker,
    in XMP, in what Photoshop adds to a JPEG. A progressive JPEG becomes a sequential one, without
    restart markers. Light that the file cannot hold is clipped.

    Parameters
    ----------
    path : str or Path
        The target; `original` itself if you like. What is there is replaced, but only by a whole file.
    original : str or Path
        PNG, JPEG, TIFF or OpenEXR.
    picture : LinearImage
        Upright, as `read` gives it, of the size of the original.
    changed : (H, W) bool
        Where its light is written.
    transfer, max_pixels
        As `read` got them for the original.

    Raises
    ------
    FileError
        If the original cannot be read, or the target cannot hold it; the message says what to do.
    TypeError, ValueError
        If `picture` or `changed` have another size.

    Warns
    -----
    TransferWarning
        If nothing says how the original's code values encode light.
    """
    target, source = Path(path), Path(original)
    extension, kind = extension_of(target), kind_of(source)
    if extension not in (".png", ".tif", ".jpg", ".exr"):
        raise FileError(
            f"{path}: a picture is written as .png, .tif, .jpg or .exr; change the ending"
        )
    if kind == RAW:
        raise FileError(
            f"{original}: nothing is written into a camera RAW; give a developed picture as the "
            "original, or none and write .exr or .tif"
        )
    raster = load(source, max_pixels)
    height, width = raster.pixels.shape[:2]
    check_same_size("picture", picture.size, source.name, (width, height))
    check_map("changed", changed, (height, width), kinds="b")
    if extension == ".exr":
        write(target, _light(raster, picture, changed, transfer))
        return
    _check_holds(raster, kind, extension)
    pixels = _pixels(raster, picture, changed, transfer)
    stored = as_stored(pixels, raster.orientation)
    ways: Mapping[str, Way] = {
        ".png": partial(save_png, raster=raster, pixels=stored),
        ".tif": partial(save_tiff, raster=raster, pixels=stored),
        ".jpg": partial(save_new_jpeg, raster=raster, pixels=stored),
    }
    if kind == "JPEG":
        touched = as_stored(changed, raster.orientation)
        same = partial(_save_same_jpeg, raster=raster, pixels=stored, changed=touched)
        ways = {**ways, ".jpg": same}
    with replacing(target, extension) as temporary:
        ways[extension](temporary)


def _check_holds(raster: Raster, kind: str, extension: str) -> None:
    if kind == "EXR":
        raise FileError(f"{raster.path}: holds light, not code values; write .exr")
    if raster.levels is None and extension != ".tif":
        raise FileError(
            f"{raster.path}: holds floats, which a {extension} file cannot; write .tif or .exr"
        )


def _light(
    raster: Raster, picture: LinearImage, changed: Bools, transfer: Transfer | None
) -> LinearImage:
    before = light_of(raster, transfer, stacklevel=3).in_srgb()
    return LinearImage(
        np.where(changed[..., None], picture.in_srgb().rgb, before.rgb),
        valid=np.where(changed, picture.valid, before.valid),
        meta=before.meta,
    )


def _pixels(
    raster: Raster, picture: LinearImage, changed: Bools, transfer: Transfer | None
) -> npt.NDArray[Any]:
    """All channels of the file, upright, with the changed light encoded."""
    encoding = encoding_of(raster, transfer, stacklevel=3)
    values = from_light(picture.in_srgb().rgb[changed], encoding)
    if raster.levels is not None:
        values = np.rint(np.clip(values, 0, 1) * (raster.levels - 1))
    places = [raster.names.index(name) for name in ("Y" if raster.gray else "RGB")]
    if raster.gray:
        values = _gray(raster, values)
    pixels = raster.pixels.copy()
    for c, place in enumerate(places):
        pixels[..., place][changed] = values[:, c]
    return pixels


def _gray(raster: Raster, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(N, 1) code values of (N, 3) that are alike."""
    apart = np.ptp(values, axis=-1).max(initial=0)
    step = 1 if raster.levels is not None else 1e-3
    if apart > step:
        raise FileError(
            f"{raster.path}: is gray, and what changed is colored; convert it to RGB first"
        )
    return np.asarray(np.median(values, axis=-1, keepdims=True))


def _save_same_jpeg(path: Path, raster: Raster, pixels: npt.NDArray[Any], changed: Bools) -> None:
    try:
        jpeg = read_jpeg(raster.path.read_bytes())
        jpeg = exchanged(jpeg, raster_colors(raster, pixels), changed)
        content = jpeg_bytes(replace(jpeg, kept=current_segments(jpeg.kept)))
    except JpegError as error:
        raise FileError(
            f"{raster.path}: {error}, so its blocks cannot be exchanged; write .png instead"
        ) from error
    path.write_bytes(content)

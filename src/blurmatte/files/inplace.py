"""In-place edits: changed pixels are written into a copy of the original file.

Light is encoded as in the original, and rotated as stored. PNG and TIFF keep all other code values.
In a JPEG all code values would change with each compression, so its unchanged blocks keep their
coefficients instead.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import MAX_PIXELS, Bools, check_map, check_same_size
from blurmatte.errors import FileError
from blurmatte.files.atomic import extension_of, replacing
from blurmatte.files.encoding import encoding_of, from_light
from blurmatte.files.errors import RAW, kind_of
from blurmatte.files.metadata import (
    current_segments,
    raster_colors,
    save_new_jpeg,
    save_png,
    save_tiff,
)
from blurmatte.files.raster import Raster, as_stored, load
from blurmatte.files.reading import light_of
from blurmatte.files.writing import Writer, write
from blurmatte.jpeg import JpegError, jpeg_bytes, read_jpeg, replace_blocks
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.transfer import Transfer


def write_changed(
    path: str | Path,
    original: str | Path,
    picture: LinearImage,
    changed: Bools,
    transfer: Transfer | None = None,
    max_pixels: int = MAX_PIXELS,
) -> None:
    """Write the light of the changed pixels of a picture; keep the rest of the file `original`.

    ============  ============================================================================
    .png .tif     Every other code value is the original's, and so are bits, alpha, orientation,
                  ICC profile, EXIF, XMP and resolution. From PNG to PNG all chunks are kept, from
                  TIFF to TIFF all tags of the first page except those of the pixel layout.
    .jpg          From a JPEG, only the blocks (MCUs) with a changed pixel are compressed again, with
                  the original's tables; all others decode to the same pixels, except for one pixel
                  of color next to them where chroma is subsampled. All segments are kept.
                  From a PNG or TIFF, the whole picture at quality 95.
    .exr          The light of the whole picture, as written by `write`.
    ============  ============================================================================

    Parts that would show the old picture are removed: the EXIF thumbnail, further pictures or pages,
    further channels, and Photoshop's layers. Other previews stay: in the notes of a camera maker,
    in XMP, in Photoshop's additions to a JPEG. A progressive JPEG becomes a sequential one, without
    restart markers. Light that the file cannot hold is clipped.

    Parameters
    ----------
    path : str or Path
        The target; it may be `original`. An existing file is replaced by a complete file only.
    original : str or Path
        PNG, JPEG, TIFF or OpenEXR.
    picture : LinearImage
        Upright, as from `read`, with the size of the original.
    changed : (H, W) bool
        The pixels whose light is written.
    transfer, max_pixels
        As given to `read` for the original.

    Raises
    ------
    FileError
        If the original cannot be read, or the target cannot hold it; the message says what to do.
    TypeError, ValueError
        If `picture` or `changed` has another size.

    Warns
    -----
    TransferWarning
        If the original does not state how its code values encode light.
    """
    target, source = Path(path), Path(original)
    extension, kind = extension_of(target), kind_of(source)
    if extension not in (".png", ".tif", ".jpg", ".exr"):
        raise FileError(
            f"{path}: change the extension; a picture is written as .png, .tif, .jpg or .exr"
        )
    if kind == RAW:
        raise FileError(
            f"{original}: give a developed picture as the original, or none and write .exr or .tif; "
            "a camera RAW cannot be edited in place"
        )
    raster = load(source, max_pixels)
    height, width = raster.pixels.shape[:2]
    check_same_size("picture", picture.size, source.name, (width, height))
    check_map("changed", changed, (height, width), kinds="b")
    if extension == ".exr":
        write(target, _light(raster, picture, changed, transfer))
        return
    _check_holds(raster, kind, extension)
    pixels = as_stored(_pixels(raster, picture, changed, transfer), raster.orientation)
    writers: Mapping[str, Writer] = {
        ".png": partial(save_png, raster=raster, pixels=pixels),
        ".tif": partial(save_tiff, raster=raster, pixels=pixels),
        ".jpg": partial(save_new_jpeg, raster=raster, pixels=pixels),
    }
    if kind == "JPEG":
        stored = as_stored(changed, raster.orientation)
        same = partial(_save_same_jpeg, raster=raster, pixels=pixels, changed=stored)
        writers = {**writers, ".jpg": same}
    with replacing(target, extension) as temporary:
        writers[extension](temporary)


def _check_holds(raster: Raster, kind: str, extension: str) -> None:
    if kind == "EXR":
        raise FileError(f"{raster.path}: write .exr; the file holds light, not code values")
    if raster.levels is None and extension != ".tif":
        raise FileError(f"{raster.path}: write .tif or .exr; a {extension} file holds no floats")


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
    if raster.gray:
        values = _gray(raster, values)
    pixels = raster.pixels.copy()
    for c, name in enumerate("Y" if raster.gray else "RGB"):
        pixels[..., raster.names.index(name)][changed] = values[:, c]
    return pixels


def _gray(raster: Raster, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(N, 1) values of (N, 3) that are equal up to rounding."""
    tolerance = 1 if raster.levels is not None else 1e-3
    if np.ptp(values, axis=-1).max(initial=0) > tolerance:
        raise FileError(
            f"{raster.path}: convert it to RGB; it is gray, and the changed pixels are colored"
        )
    return np.asarray(np.median(values, axis=-1, keepdims=True))


def _save_same_jpeg(path: Path, raster: Raster, pixels: npt.NDArray[Any], changed: Bools) -> None:
    try:
        jpeg = read_jpeg(raster.path.read_bytes())
        jpeg = replace_blocks(jpeg, raster_colors(raster, pixels), changed)
        content = jpeg_bytes(replace(jpeg, metadata=current_segments(jpeg.metadata)))
    except JpegError as error:
        raise FileError(
            f"{raster.path}: write .png instead; its blocks cannot be replaced, because {error}"
        ) from error
    path.write_bytes(content)

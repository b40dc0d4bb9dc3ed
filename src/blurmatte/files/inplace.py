"""In-place edits: changed pixels are written into a copy of the original file.

Light is encoded as in the original, and rotated as stored. PNG and TIFF keep all other code values.
In a JPEG all code values would change with each compression, so its unchanged blocks keep their
coefficients instead.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from blurmatte.checks import AnyArray, Bools, check_map, check_same_size
from blurmatte.errors import FileError, warn
from blurmatte.files import metadata
from blurmatte.files.atomic import extension_of, replacing
from blurmatte.files.encoding import encoding_of, from_light
from blurmatte.files.errors import format_of
from blurmatte.files.raster import Raster, load
from blurmatte.files.reading import light_of
from blurmatte.files.writing import write
from blurmatte.formats import EXR, JPEG, MAX_PIXELS, PNG, RAW, TIFF, Writes, named, written
from blurmatte.jpeg.coding import jpeg_bytes, read_jpeg, replace_blocks
from blurmatte.jpeg.structure import JpegError, metadata_segments
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
    .jpg          From a JPEG, only blocks (MCUs) with a changed pixel are compressed again, with
                  its tables; all others decode to the same pixels, except for one pixel of color
                  next to them where chroma is subsampled. All segments are kept. From a PNG or
                  TIFF, the whole picture at quality 95.
    others        The light of the whole picture, as written by `write`.
    ============  ============================================================================

    Thumbnails, further pictures, pages, channels and layers are removed, as they would show the old
    picture. A progressive JPEG becomes sequential. Light that the file cannot hold is clipped.

    Parameters
    ----------
    path, original : str or Path
        The target, and a PNG, JPEG, TIFF or OpenEXR; they may be the same file.
    picture : LinearImage
        Upright, as from `read`, with the size of the original.
    changed : (H, W) bool
        The pixels whose light is written.
    transfer, max_pixels
        As given to `read` for the original.

    Raises
    ------
    FileError
        If the original cannot be read, or the target cannot hold it.
    TypeError, ValueError
        If `picture` or `changed` has another size.

    Warns
    -----
    TransferWarning
        If the original does not state how its code values encode light.
    BlurmatteWarning
        If it has a gain map, a clip or further pictures, which are not copied.

    Examples
    --------
    >>> gone, changed = bm.remove(image, plate, solution.streak)
    >>> bm.write_changed("gone.png", "throw.png", gone, changed)
    """
    target, source = Path(path), Path(original)
    raster, changed = _original(target, source, picture, changed, max_pixels)
    if named(target) is EXR:  # holds light
        write(target, _light(raster, picture, changed, transfer))
    else:
        _save_pixels(target, raster, _pixels(raster, picture, changed, transfer), changed)


def _original(
    target: Path, source: Path, picture: LinearImage, changed: Bools, max_pixels: int
) -> tuple[Raster, Bools]:
    """The original and the mask; raises unless the target can hold it and all have its size."""
    _check_formats(target, source)
    raster = load(source, max_pixels)
    _check_holds(raster, target)
    height, width = raster.pixels.shape[:2]
    check_same_size("picture", picture.size, source.name, (width, height))
    return raster, check_map("changed", changed, (height, width), kinds="b")


def _warn_of_further_pictures(target: Path, source: Path) -> None:
    """Warn of what a JPEG has besides its picture."""
    if format_of(source) is not JPEG:
        return
    if others := metadata.further_pictures(metadata_segments(source.read_bytes())):
        warn(
            f"{target}: without the {' and the '.join(others)} of {source.name}, which would show "
            "the old picture"
        )


def _check_formats(target: Path, source: Path) -> None:
    endings = written(Writes.PICTURE)
    if extension_of(target) not in endings:
        raise FileError(
            f"{target}: change the extension; a picture is written as {' or '.join(endings)}"
        )
    if format_of(source) is RAW:
        raise FileError(
            f"{source}: give a developed picture as the original, or none and write .exr or .tif; "
            "a camera RAW cannot be edited in place"
        )


def _check_holds(raster: Raster, target: Path) -> None:
    form = named(target)
    if form is EXR:
        return
    if raster.format is EXR:
        raise FileError(f"{raster.path}: write .exr; the file holds light, not code values")
    if raster.levels is None and form is not TIFF:
        raise FileError(f"{raster.path}: write .tif or .exr; a {form} file holds no floats")


def _save_pixels(target: Path, raster: Raster, upright: AnyArray, changed: Bools) -> None:
    _warn_of_further_pictures(target, raster.path)
    pixels, form = raster.orientation.stored(upright), named(target)
    with replacing(target, extension_of(target)) as temporary:
        if form is PNG:
            metadata.save_png(temporary, raster, pixels)
        elif form is TIFF:
            metadata.save_tiff(temporary, raster, pixels)
        elif raster.format is JPEG:
            _save_same_jpeg(temporary, raster, pixels, raster.orientation.stored(changed))
        else:
            metadata.save_new_jpeg(temporary, raster, pixels)


def _light(
    raster: Raster, picture: LinearImage, changed: Bools, transfer: Transfer | None
) -> LinearImage:
    before = light_of(raster, transfer).in_srgb()
    return LinearImage(
        np.where(changed[..., None], picture.in_srgb().rgb, before.rgb),
        valid=np.where(changed, picture.valid, before.valid),
        meta=before.meta,
    )


def _pixels(
    raster: Raster, picture: LinearImage, changed: Bools, transfer: Transfer | None
) -> AnyArray:
    """All channels of the file, upright, with the changed light encoded."""
    encoding = encoding_of(raster, transfer)
    values = from_light(picture.in_srgb().rgb[changed], encoding)
    if raster.levels is not None:
        values = np.rint(np.clip(values, 0, 1) * (raster.levels - 1))
    if raster.gray:
        values = _gray(raster, values)
    pixels = raster.pixels.copy()
    for c, name in enumerate("Y" if raster.gray else "RGB"):
        pixels[..., raster.names.index(name)][changed] = values[:, c]
    return pixels


def _gray(raster: Raster, values: AnyArray) -> AnyArray:
    """(N, 1) values of (N, 3) that are equal up to rounding."""
    tolerance = 1 if raster.levels is not None else 1e-3
    if np.ptp(values, axis=-1).max(initial=0) > tolerance:
        raise FileError(
            f"{raster.path}: convert it to RGB; it is gray, and the changed pixels are colored"
        )
    return np.asarray(np.median(values, axis=-1, keepdims=True))


def _save_same_jpeg(path: Path, raster: Raster, pixels: AnyArray, changed: Bools) -> None:
    try:
        jpeg = read_jpeg(raster.path.read_bytes())
        jpeg = replace_blocks(jpeg, metadata.raster_colors(raster, pixels), changed)
        content = jpeg_bytes(replace(jpeg, metadata=metadata.current_segments(jpeg.metadata)))
    except JpegError as error:
        raise FileError(
            f"{raster.path}: write .png instead; its blocks cannot be replaced, because {error}"
        ) from error
    path.write_bytes(content)

"""Picture files to linear light with the primaries of sRGB: images, and layers with alpha.

Integers are decoded by table; the highest code value is saturated. Straight and premultiplied files
both give premultiplied layers.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from blurmatte.checks import MAX_LIGHT, Bools, Floats, are_codes, check_kind
from blurmatte.errors import FileError
from blurmatte.files.encoding import encoding_of, icc_profile, to_light, to_srgb_primaries
from blurmatte.files.errors import check_premultiplied, format_of
from blurmatte.files.exr import with_exr_parts
from blurmatte.files.icc import Profile
from blurmatte.files.raster import Raster, load
from blurmatte.files.raw import read_raw
from blurmatte.formats import JPEG, MAX_PIXELS, RAW
from blurmatte.jpeg.coding import compression_of
from blurmatte.layer import Layer
from blurmatte.radiometry.image import LinearImage, Meta, decode
from blurmatte.radiometry.transfer import LINEAR, TRANSFER_HINT, Transfer


def read(
    path: str | Path, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> LinearImage:
    """Read a picture as linear light.

    PNG, JPEG, TIFF (8 and 16 bit, float), OpenEXR, FITS, BMP, WebP, AVIF, and HEIC (the extra
    `heic`), with the primaries of sRGB; the content of a file decides, not its extension. ICC profile
    and EXIF orientation are applied; EXR, FITS and float TIFF are linear unless a profile states
    otherwise. The
    variance and the valid pixels that `write` stores in an EXR are restored.
    Camera RAW (DNG, CR2, CR3, NEF, ARW, RAF, ORF, RW2, PEF …), in the colors of the camera, needs the
    extra `raw`.

    Parameters
    ----------
    path : str or Path
        The file.
    transfer : Transfer, optional
        The curve of its code values; it replaces the one that the file states.
    max_pixels : int
        Larger pictures are rejected before memory is allocated.

    Returns
    -------
    LinearImage
        float32. `valid` is False where a channel is saturated or alpha is below 1. `meta` holds the
        other properties of the file: `color_space`, `camera`, `white_balance` …

    Raises
    ------
    TypeError
        If `transfer` is not a Transfer.
    FileError
        If the file holds no usable light; the message says what to do.

    Warns
    -----
    TransferWarning
        If the file does not state how code values encode light, and they are taken as sRGB.

    Examples
    --------
    >>> picture = bm.read("throw.png")
    >>> print(picture)
    LinearImage(throw.png, 128x72, up to 0.50, 100.0% valid)
    """
    path = Path(path)
    check_kind("transfer", transfer, Transfer | None, TRANSFER_HINT)
    if format_of(path) is RAW:
        if transfer not in (None, LINEAR):
            raise FileError(
                f"{path}: omit transfer= (--transfer); the light of a camera RAW is linear, "
                f"not {transfer.name}"
            )
        return read_raw(path, max_pixels)
    return light_of(load(path, max_pixels), transfer)


def light_of(raster: Raster, transfer: Transfer | None) -> LinearImage:
    """The linear light of the numbers of a file; see `read`."""
    encoding = encoding_of(raster, transfer)
    image = _decoded(raster, encoding)
    valid = image.valid & raster.inside
    if raster.alpha is not None:
        valid &= raster.alpha >= 1
    image = replace(image, valid=valid, meta=_meta(raster, encoding))
    return with_exr_parts(image, raster)


def read_layer(
    path: str | Path, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Layer:
    """Read a picture with alpha: EXR (also of a Solution), PNG, TIFF.

    Parameters
    ----------
    path, transfer, max_pixels
        As in `read`.

    Returns
    -------
    Layer
        float32, premultiplied.

    Raises
    ------
    FileError
        As in `read`; also if there is no alpha, or the colors of an EXR look straight.

    Examples
    --------
    >>> layer = bm.read_layer("layer.exr")
    >>> layer.box
    (20, 20, 99, 55)
    """
    check_kind("transfer", transfer, Transfer | None, TRANSFER_HINT)
    raster = load(Path(path), max_pixels)
    alpha = raster.alpha
    if alpha is None:
        raise FileError(
            f"{path}: give an EXR, PNG or TIFF with alpha; the file has no alpha and is no layer"
        )
    encoding = encoding_of(raster, transfer)
    light = _premultiplied(raster, alpha, encoding)
    _check_finite(raster.path, light, alpha)
    if raster.associated and _is_linear(raster, encoding):
        check_premultiplied(raster.path, light, alpha)
    return Layer(alpha, light)


def read_mask(path: str | Path, max_pixels: int = MAX_PIXELS) -> Bools:
    """Read a mask: where a picture is opaque or, without transparent pixels, where it is white.

    Paint programs and background removers put the shape into alpha, and any color below it.

    Parameters
    ----------
    path : str or Path
        A PNG, JPEG, TIFF or OpenEXR.
    max_pixels : int
        Larger pictures are rejected before memory is allocated.

    Returns
    -------
    (H, W) bool
        True where alpha exceeds one half; if it does everywhere, or there is no alpha, where the
        largest channel exceeds half of white, as stored.

    Raises
    ------
    FileError
        If the file cannot be read, or its alpha and its black and white state different shapes.

    Examples
    --------
    >>> white = np.where(solution.streak, np.uint8(255), np.uint8(0))
    >>> bm.write("where.png", np.stack([white] * 3, axis=-1))
    >>> region = bm.read_mask("where.png")
    >>> bool((region == solution.streak).all())
    True
    """
    raster = load(Path(path), max_pixels)
    _check_finite(raster.path, raster.colors)
    white = np.asarray(raster.colors.max(axis=-1) > ((raster.levels or 2) - 1) / 2)
    if raster.alpha is None:
        return white
    opaque = np.asarray(raster.alpha > 0.5)
    if opaque.all():
        return white
    drawn = raster.colors[opaque]
    extreme = drawn.min(axis=-1) == drawn.max(axis=-1)
    extreme &= (drawn[:, 0] == 0) | (drawn[:, 0] == (raster.levels or 2) - 1)
    if white[opaque].any() and not white[opaque].all() and extreme.all():
        raise FileError(
            f"{path}: export the mask without alpha, or white with the shape in alpha; its opaque "
            "pixels are both black and white"
        )
    return opaque


def _decoded(raster: Raster, encoding: Profile | None) -> LinearImage:
    """Light of code values by table, of floats by formula; `valid` where not saturated."""
    colors = raster.colors
    if encoding is None or colors.dtype.kind == "f":
        if are_codes(colors):
            raise FileError(
                f"{raster.path}: save it as integers of 8 or 16 bits, or divide it so that 1 is white; "
                f"its floats are code values, whole numbers up to {colors.max():g}"
            )
        light = to_light(colors, encoding)
        _check_finite(raster.path, light)
        return LinearImage(light)
    red, green, blue = encoding.curves
    image = decode(colors, green)
    for c, curve in ((0, red), (2, blue)):
        if curve is not green:
            table = curve.table(np.iinfo(colors.dtype).max + 1)
            image.rgb[..., c] = table.astype(np.float32)[colors[..., c]]
    return replace(image, rgb=to_srgb_primaries(image.rgb, encoding))


def _is_linear(raster: Raster, encoding: Profile | None) -> bool:
    """True if the file holds linear light as floats, in any primaries."""
    curves = () if encoding is None else encoding.curves
    return raster.levels is None and all(curve is LINEAR for curve in curves)


def _premultiplied(raster: Raster, alpha: Floats, encoding: Profile | None) -> Floats:
    """Light times alpha. Curves apply to straight colors, so these are computed first."""
    alpha = alpha[..., None]
    if not raster.associated:
        light = _decoded(raster, encoding).rgb
        light *= alpha
        return light
    if _is_linear(raster, encoding):
        # Not divided by alpha, which is 0 in a glow; without a copy, because layers are large.
        return to_light(raster.view("YYY" if raster.gray else "RGB"), encoding)
    codes = raster.colors / np.float32((raster.levels or 2) - 1)
    straight = np.divide(codes, alpha, out=np.zeros_like(codes), where=alpha > 0)
    return np.asarray(to_light(straight, encoding) * alpha)


def _check_finite(path: Path, light: Floats, alpha: Floats | None = None) -> None:
    numbers = [light] if alpha is None else [light, alpha]
    if all(values.min() >= -MAX_LIGHT and values.max() <= MAX_LIGHT for values in numbers):
        return
    usual: Bools = np.asarray((np.abs(light) <= MAX_LIGHT).all(axis=-1))
    if alpha is not None:
        usual = usual & (np.abs(alpha) <= MAX_LIGHT)
    bad = usual.size - int(np.count_nonzero(usual))
    raise FileError(
        f"{path}: repair it in the program that wrote it; {bad} of {usual.size} pixels are NaN, "
        f"infinite, or beyond {MAX_LIGHT:g} times white"
    )


def _meta(raster: Raster, encoding: Profile | None) -> Meta:
    stated = raster.tags.get("ExposureTime", 0)
    seconds = float(stated) if isinstance(stated, int | float) else 0.0  # some programs write pairs
    compression = None  # that of other files is not known
    if raster.format is JPEG:
        compression = compression_of(raster.path.read_bytes(), raster.orientation)
    same_primaries = encoding is not None and encoding.matrix is None
    return Meta(
        source=raster.path.name,
        transfer=encoding.curves[1] if encoding else None,
        transfer_assumed=encoding is not None and encoding.assumed,
        levels=1 << raster.bits if raster.bits else raster.levels,
        exposure_time=seconds if math.isfinite(seconds) and seconds > 0 else None,
        icc_profile=icc_profile(raster),
        gray=raster.gray,
        color_space="sRGB",
        converted=encoding is not None and encoding.matrix is not None,
        compression=compression if same_primaries else None,
        subsampled=raster.subsampled or (compression is not None and max(compression.shared) > 1),
        readout=raster.orientation.readout,
    )

"""Picture files to linear light with the primaries of sRGB: images, and layers with alpha.

Light is decoded once, here. Integers are decoded by table; code values at the top of their range
are saturated. Straight and premultiplied files both end premultiplied.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from blurmatte.checks import Bools, Floats, check_kind
from blurmatte.errors import FileError
from blurmatte.files.camera import CAMERA_TAG, in_camera_colors
from blurmatte.files.encoding import encoding_of, icc_profile, to_light, to_srgb_primaries
from blurmatte.files.icc import Profile
from blurmatte.files.jpeg import compression_of
from blurmatte.files.plates import with_layers
from blurmatte.files.raster import MAX_PIXELS, Raster, load
from blurmatte.files.raw import read_raw
from blurmatte.files.refusals import RAW, check_premultiplied, kind_of
from blurmatte.layer import Layer
from blurmatte.radiometry import LINEAR, Compression, LinearImage, Meta, Transfer, decode


def read(
    path: str | Path, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> LinearImage:
    """Read a picture as linear light.

    PNG, JPEG, TIFF (8 and 16 bit, float) and OpenEXR, with the primaries of sRGB; ICC profile and
    EXIF orientation are honored; EXR and float TIFF are linear unless a profile says otherwise. The
    variance and the valid pixels that `write` puts into an EXR come back.
    And camera RAW (DNG, CR2, CR3, NEF, ARW, RAF, ORF, RW2, PEF …), in the colors of the camera, with
    the extra `raw`; see blurmatte.files.raw.

    Parameters
    ----------
    path : str or Path
        The file.
    transfer : Transfer, optional
        The curve of its code values, if you know better than the file.
    max_pixels : int
        Larger pictures are refused before memory is taken.

    Returns
    -------
    LinearImage
        float32. `valid` is False where a channel is saturated or alpha is below 1. `meta` says
        what else the file told: `color_space`, `camera`, `white_balance` …

    Raises
    ------
    TypeError
        If the transfer is none.
    FileError
        If there is no light to be had from the file; the message says what to do.

    Warns
    -----
    TransferWarning
        If nothing says how code values encode light, and they are taken as sRGB.
    """
    path = Path(path)
    check_kind("transfer", transfer, Transfer | None, "use blurmatte.named_transfer(name)")
    if kind_of(path) == RAW:
        _check_linear(path, transfer)
        return read_raw(path, max_pixels)
    return light_of(load(path, max_pixels), transfer, stacklevel=2)


def light_of(raster: Raster, transfer: Transfer | None, stacklevel: int) -> LinearImage:
    """The linear light of what a file holds; see `read`."""
    encoding = encoding_of(raster, transfer, stacklevel + 1)
    image = _decoded(raster, encoding)
    valid = image.valid & raster.inside
    if raster.alpha is not None:
        valid &= raster.alpha >= 1
    image = with_layers(replace(image, valid=valid, meta=_meta(raster, encoding)), raster)
    header = raster.tags.get(CAMERA_TAG)
    return image if header is None else in_camera_colors(raster.path, image, str(header))


def read_layer(
    path: str | Path, transfer: Transfer | None = None, max_pixels: int = MAX_PIXELS
) -> Layer:
    """Read a picture with alpha: EXR (a Solution's too), PNG, TIFF.

    Parameters
    ----------
    path, transfer, max_pixels
        As in `read`.

    Returns
    -------
    Layer
        float32, premultiplied whatever the file is.

    Raises
    ------
    FileError
        As in `read`, if there is no alpha, and if the colors of an EXR look straight.
    """
    check_kind("transfer", transfer, Transfer | None, "use blurmatte.named_transfer(name)")
    raster = load(Path(path), max_pixels)
    alpha = raster.alpha
    if alpha is None:
        raise FileError(
            f"{path}: has no alpha, so it is no layer; give an EXR, PNG or TIFF with alpha"
        )
    encoding = encoding_of(raster, transfer, stacklevel=2)
    light = _premultiplied(raster, alpha, encoding)
    _check_finite(raster.path, light, alpha)
    if encoding is None and raster.associated:
        check_premultiplied(raster.path, light, alpha)
    return Layer(alpha, light)


def _check_linear(path: Path, transfer: Transfer | None) -> None:
    if transfer not in (None, LINEAR):
        raise FileError(
            f"{path}: the light of a camera RAW is linear, not {transfer.name}; leave transfer= "
            "(--transfer) out"
        )


def _decoded(raster: Raster, encoding: Profile | None) -> LinearImage:
    """Light of code values by table, of floats by formula; `valid` where not saturated."""
    colors = raster.colors
    if encoding is None or colors.dtype.kind == "f":
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


def _premultiplied(raster: Raster, alpha: Floats, encoding: Profile | None) -> Floats:
    """Light times alpha. Curves are meant for straight colors, so those come first."""
    cover = alpha[..., None]
    if not raster.associated:
        return np.asarray(_decoded(raster, encoding).rgb * cover)
    if encoding is None:  # gray or in color: nothing is copied, for layers are large
        return to_light(raster.seen("YYY" if raster.gray else "RGB"), None)
    codes = raster.colors / np.float32((raster.levels or 2) - 1)
    straight = np.divide(codes, cover, out=np.zeros_like(codes), where=cover > 0)
    return np.asarray(to_light(straight, encoding) * cover)


def _check_finite(path: Path, light: Floats, alpha: Floats | None = None) -> None:
    numbers = [light] if alpha is None else [light, alpha]
    if all(np.isfinite([values.min(), values.max()]).all() for values in numbers):
        return
    finite: Bools = np.asarray(np.isfinite(light).all(axis=-1))
    if alpha is not None:
        finite = finite & np.isfinite(alpha)
    bad = finite.size - int(np.count_nonzero(finite))
    raise FileError(
        f"{path}: {bad} of {finite.size} pixels are NaN or infinite; "
        "repair them in the program that wrote the file"
    )


def _meta(raster: Raster, encoding: Profile | None) -> Meta:
    told = raster.tags.get("ExposureTime", 0)
    seconds = float(told) if isinstance(told, int | float) else 0.0  # some programs write pairs
    return Meta(
        source=raster.path.name,
        transfer=encoding.curves[1] if encoding else None,
        levels=raster.levels,
        exposure_time=seconds if math.isfinite(seconds) and seconds > 0 else None,
        icc_profile=icc_profile(raster),
        gray=raster.gray,
        color_space="sRGB",
        compression=_compression(raster, encoding),
    )


def _compression(raster: Raster, encoding: Profile | None) -> Compression | None:
    """Of a JPEG whose code values are those that its light is encoded as."""
    if kind_of(raster.path) != "JPEG" or encoding is None or encoding.matrix is not None:
        return None
    return compression_of(raster.path.read_bytes(), raster.orientation)

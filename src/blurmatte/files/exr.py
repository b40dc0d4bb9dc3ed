"""What an EXR of a LinearImage holds in addition to its light, and how it is read back.

R, G, B are light with the primaries of sRGB. Optional channels: variance.R …, light² (in camera
colors for a camera RAW), and valid, 1 where the pixel is usable. An attribute marks a file that has
them. Another holds the camera's matrix to sRGB, because RAW images match a plate only in the colors
of the camera.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from blurmatte.checks import MAX_GAIN, AnyArray
from blurmatte.errors import FileError
from blurmatte.files.documents import DocumentError, numbers, parse_json, to_json
from blurmatte.files.errors import VALID, VARIANCE
from blurmatte.files.raster import Raster
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.transfer import light_in_srgb

_CAMERA, _LAYERS = "blurmatte:camera", "blurmatte:light"


def exr_parts(
    image: LinearImage,
) -> tuple[list[AnyArray], Sequence[str], Mapping[str, str]]:
    """Arrays, channel names and attributes for an EXR of an image."""
    parts: list[AnyArray] = [image.in_srgb().rgb]
    names = list("RGB")
    if image.noise is not None:
        parts, names = [*parts, image.variance], [*names, *VARIANCE]
    if not image.valid.all():
        parts, names = [*parts, image.valid], [*names, VALID]
    tags = {_LAYERS: " ".join(names[3:])} if len(names) > 3 else {}
    meta = image.meta
    if meta.to_srgb is not None:
        kept = {name: getattr(meta, name) for name in ("camera", "white_balance", "to_srgb")}
        tags = {_CAMERA: to_json(kept), **tags}
    return parts, names, tags


def with_exr_parts(image: LinearImage, raster: Raster) -> LinearImage:
    """The image with the variance, the valid pixels and the camera colors that `write` stored.

    Raises FileError if another program has changed them.
    """
    if _LAYERS in raster.tags:
        image = _with_layers(image, raster)
    header = raster.tags.get(_CAMERA)
    return image if header is None else _in_camera_colors(raster.path, image, str(header))


def changed_header(path: str | Path, reason: ValueError) -> FileError:
    """The error for an EXR whose attributes are not those that `write` stored."""
    return DocumentError(
        f"{path}: give the EXR as blurmatte.write made it; another program or version wrote its "
        f"header ({reason})"
    )


def _with_layers(image: LinearImage, raster: Raster) -> LinearImage:
    noise, valid = image.noise, image.valid
    if set(VARIANCE) <= set(raster.names):
        noise = raster.channels(VARIANCE)
        if not (np.isfinite(noise).all() and (noise >= 0).all()):
            raise FileError(
                f"{raster.path}: give the EXR as blurmatte.write made it; "
                "its variance has negative or infinite values"
            )
    if VALID in raster.names:
        valid = valid & (raster.channels((VALID,))[..., 0] > 0.5)
    return replace(image, noise=noise, valid=valid)


@dataclass
class _CameraHeader:
    camera: str
    white_balance: Annotated[AnyArray, numbers(-MAX_GAIN, MAX_GAIN, None)] | None
    to_srgb: Annotated[AnyArray, numbers(-MAX_GAIN, MAX_GAIN, 3, 3)]


def _in_camera_colors(path: Path, image: LinearImage, header: str) -> LinearImage:
    """The image in the colors of its camera, to the rounding of the EXR's floats."""
    try:
        fields: _CameraHeader = parse_json(header, _CameraHeader)
        from_srgb = np.linalg.inv(fields.to_srgb).tolist()
    except ValueError as error:
        raise changed_header(path, error) from error
    balance = fields.white_balance
    meta = replace(
        image.meta,
        color_space="camera",
        camera=fields.camera,
        white_balance=None if balance is None else tuple(balance.tolist()),
        to_srgb=tuple(map(tuple, fields.to_srgb.tolist())),
    )
    return replace(image, rgb=light_in_srgb(image.rgb, from_srgb), meta=meta)

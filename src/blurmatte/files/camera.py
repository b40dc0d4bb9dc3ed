"""A picture in the colors of a camera as an EXR that every program shows right, and back.

A plate made of RAW files is a file of its own, and fits RAW images only in their colors. So the EXR
holds linear sRGB, and its header says how to get back.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from blurmatte.errors import FileError
from blurmatte.radiometry import LinearImage, Meta, light_in_srgb

CAMERA_TAG = "blurmatte:camera"
_KEPT = ("camera", "white_balance", "to_srgb")


def camera_header(meta: Meta) -> dict[str, str]:
    """What an EXR says of the camera beside its picture in sRGB; nothing if there was none."""
    if meta.to_srgb is None:
        return {}
    fields = {name: getattr(meta, name) for name in _KEPT}
    return {CAMERA_TAG: json.dumps(fields)}


def in_camera_colors(path: Path, image: LinearImage, header: str) -> LinearImage:
    """The sRGB picture of an EXR as the camera saw it, to the rounding of its floats.

    Raises
    ------
    FileError
        If the header is not what `camera_header` wrote.
    """
    try:
        fields = json.loads(header)
        camera, balance = str(fields["camera"]), fields["white_balance"]
        to_srgb = np.array(fields["to_srgb"], dtype=float).reshape(3, 3)
        from_srgb = np.linalg.inv(to_srgb).tolist()
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(
            f"{path}: another program has changed its header; "
            "give the EXR as blurmatte.write made it"
        ) from error
    meta = replace(
        image.meta,
        color_space="camera",
        camera=camera,
        white_balance=None if balance is None else tuple(balance),
        to_srgb=tuple(map(tuple, to_srgb.tolist())),
    )
    return replace(image, rgb=light_in_srgb(image.rgb, from_srgb), meta=meta)

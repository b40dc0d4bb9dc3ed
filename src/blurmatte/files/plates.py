"""A LinearImage whose noise is known as one EXR, and back: a plate keeps its variance.

R, G, B are the light, in the colors of sRGB as in any EXR. Beside them, for those who know them:
variance.R …, light² (of a camera's picture in the camera's colors), and valid, 1 where the pixel is
usable. The header tells that they are meant so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.raster import Raster
from blurmatte.files.refusals import VALID, VARIANCE
from blurmatte.radiometry import LinearImage

_MARK = "blurmatte:light"


def light_parts(
    image: LinearImage,
) -> tuple[list[npt.NDArray[Any]], Sequence[str], Mapping[str, str]]:
    """Arrays, the names of their channels, and what the header must say."""
    parts: list[npt.NDArray[Any]] = [image.in_srgb().rgb]
    names = list("RGB")
    if image.noise is not None:
        parts, names = [*parts, image.variance], [*names, *VARIANCE]
    if not image.valid.all():
        parts, names = [*parts, image.valid], [*names, VALID]
    return parts, names, {_MARK: " ".join(names[3:])} if len(names) > 3 else {}


def with_layers(image: LinearImage, raster: Raster) -> LinearImage:
    """The image with the variance and the valid pixels of its file, if `write` put them there.

    Raises
    ------
    FileError
        If another program has changed them.
    """
    if _MARK not in raster.tags:
        return image
    noise, valid = image.noise, image.valid
    if set(VARIANCE) <= set(raster.names):
        noise = raster.channels(VARIANCE)
        if not (np.isfinite(noise).all() and (noise >= 0).all()):
            raise FileError(
                f"{raster.path}: its variance holds numbers that are none; "
                "another program has changed it, give the EXR as blurmatte.write made it"
            )
    if VALID in raster.names:
        valid = valid & (raster.channels((VALID,))[..., 0] > 0.5)
    return replace(image, noise=noise, valid=valid)

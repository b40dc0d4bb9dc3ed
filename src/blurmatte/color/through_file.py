"""What a compressed file does to a color that hues tell.

Files let the colors of neighbors run together, and so the object's into the plate's: of something thin
the whole streak is a rim, and its hues then tell another color, to a degree or two. Where a file says
how it was compressed, a picture of what was found is drawn and written as that was: its color is known,
and what is found in it says by how much such an answer is off.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.streaks import Streak

Array = npt.NDArray[np.float64]

# Pixels, over which alpha and light that single ones tell are smoothed: what is drawn has no noise.
_SMOOTH = 1.5


def drawn(
    l: Array, image: LinearImage, plate: LinearImage, streak: Streak, count: int
) -> tuple[list[LinearImage], LinearImage]:
    """Images and the plate as they would be if a line of colors were right, out of the image's file.

    The plate went through its own file before it was known: it goes through this one, too, so that it
    is to what is drawn what it was to the image.

    Parameters
    ----------
    l : (3,) float
        Unit direction of the line.
    image, plate : LinearImage
        What is around the streak, noise known.
    streak : Streak
        Where the object moved; elsewhere the plate is drawn.
    count : int
        Of images, which differ in their noise; its draws are always the same.
    """
    compression, transfer = image.meta.sharing, image.meta.transfer or SRGB
    assert compression is not None
    light = _told(l, image, plate, streak)
    codes, noise = transfer.encode(light), np.sqrt(image.variance) / transfer.slope(light)
    normal = [np.random.default_rng(seed).normal(size=light.shape) for seed in range(count)]
    files = [compression.once(codes + noise * z) for z in normal]
    behind = transfer.encode(np.asarray(plate.rgb, float))
    files.append(compression.expected(behind, float(np.median(noise))))
    *images, behind = (transfer.decode(file).astype(image.rgb.dtype) for file in files)
    return [replace(image, rgb=rgb) for rgb in images], replace(plate, rgb=behind)


def _told(l: Array, image: LinearImage, plate: LinearImage, streak: Streak) -> Array:
    """(h, w, 3) light of an object of the line, with the alpha and brightness that pixels tell."""
    from scipy.ndimage import gaussian_filter

    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    across = B - (B @ l)[..., None] * l
    length2 = np.einsum("yxc,yxc->yx", across, across)
    lost = length2 - np.einsum("yxc,yxc->yx", C, across)
    alpha = gaussian_filter(lost, _SMOOTH) / np.maximum(gaussian_filter(length2, _SMOOTH), 1e-12)
    alpha = np.clip(np.where(streak.mask, alpha, 0), 0, 1)
    k = gaussian_filter((C - (1 - alpha)[..., None] * B) @ l, _SMOOTH)
    k = np.maximum(np.where(streak.mask, k, 0), 0)
    return np.asarray(k[..., None] * l + (1 - alpha)[..., None] * B)

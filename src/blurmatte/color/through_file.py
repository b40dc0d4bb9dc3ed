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

_SMOOTH = (
    1.5  # pixels: of alpha and light that single ones tell, so that what is drawn has no noise
)


def drawn(
    l: Array, image: LinearImage, plate: LinearImage, streak: Streak, seed: int
) -> LinearImage:
    """The image as it would be if a line of colors were right, with new noise, out of the same file.

    Parameters
    ----------
    l : (3,) float
        Unit direction of the line.
    image, plate : LinearImage
        What is around the streak, noise known.
    streak : Streak
        Where the object moved; elsewhere the plate is drawn.
    seed : int
        Of the noise.
    """
    from scipy.ndimage import gaussian_filter

    compression = image.meta.compression
    assert compression is not None
    B = np.asarray(plate.rgb, float)
    across = B - (B @ l)[..., None] * l
    length2 = np.einsum("yxc,yxc->yx", across, across)
    lost = length2 - np.einsum("yxc,yxc->yx", np.asarray(image.rgb, float), across)
    alpha = gaussian_filter(lost, _SMOOTH) / np.maximum(gaussian_filter(length2, _SMOOTH), 1e-12)
    alpha = np.clip(np.where(streak.mask, alpha, 0), 0, 1)
    k = gaussian_filter((image.rgb - (1 - alpha)[..., None] * B) @ l, _SMOOTH)
    light = np.maximum(np.where(streak.mask, k, 0), 0)[..., None] * l + (1 - alpha)[..., None] * B
    transfer = image.meta.transfer or SRGB
    noise = np.sqrt(image.variance) / transfer.slope(light)
    codes = transfer.encode(light) + noise * np.random.default_rng(seed).normal(size=light.shape)
    return replace(image, rgb=transfer.decode(compression.once(codes)).astype(image.rgb.dtype))

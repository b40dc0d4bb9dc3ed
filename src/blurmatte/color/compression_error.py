"""Error of a color estimate caused by compression of the image.

Chroma subsampling mixes the colors of object and plate at rims, which biases a color estimated from
hues by a degree or two for thin objects. If the compression is known, a picture with the estimated
color is rendered and compressed in the same way. The error of the estimate from it, whose color is
known, estimates that of the image.
"""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.streaks import Streak


def recompressed(
    l: Array, image: LinearImage, plate: LinearImage, streak: Streak, count: int
) -> tuple[list[LinearImage], LinearImage]:
    """Images of a line of colors, and the plate, compressed as the image was.

    The plate is compressed once more in the same way, so that it has the same relation to the rendered
    images as before to the image.

    l (3,): unit direction of the line.
    image, plate: the surroundings of the streak, with known noise.
    streak: where the object moved; elsewhere the plate is rendered.
    count: number of images, which differ in their noise. The draws are seeded.
    """
    compression, transfer = image.meta.sharing, image.meta.transfer or SRGB
    assert compression is not None
    light = _rendered(l, image, plate, streak)
    codes, noise = transfer.encode(light), np.sqrt(image.variance) / transfer.slope(light)
    normal = [np.random.default_rng(seed).normal(size=light.shape) for seed in range(count)]
    files = [compression.once(codes + noise * z) for z in normal]
    behind = transfer.encode(np.asarray(plate.rgb, float))
    files.append(compression.expected(behind, float(np.median(noise))))
    *images, behind = (transfer.decode(file).astype(image.rgb.dtype) for file in files)
    return [replace(image, rgb=rgb) for rgb in images], replace(plate, rgb=behind)


def _rendered(l: Array, image: LinearImage, plate: LinearImage, streak: Streak) -> Array:
    """(h, w, 3) light of an object of the line, with alpha and brightness estimated by pixel.

    Both are smoothed, so that the rendering has no noise.
    """
    from scipy.ndimage import gaussian_filter

    sigma = 1.5  # pixels
    C, B = (np.asarray(picture.rgb, float) for picture in (image, plate))
    across = B - (B @ l)[..., None] * l
    length2 = np.einsum("yxc,yxc->yx", across, across)
    lost = length2 - np.einsum("yxc,yxc->yx", C, across)
    alpha = gaussian_filter(lost, sigma) / np.maximum(gaussian_filter(length2, sigma), 1e-12)
    alpha = np.clip(np.where(streak.mask, alpha, 0), 0, 1)
    k = gaussian_filter((C - (1 - alpha)[..., None] * B) @ l, sigma)
    k = np.maximum(np.where(streak.mask, k, 0), 0)
    return np.asarray(k[..., None] * l + (1 - alpha)[..., None] * B)

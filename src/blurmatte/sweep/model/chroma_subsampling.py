"""Chroma subsampling: the light of a picture before its file blurred the colors of neighbors.

Most files store the brightness of each pixel but average the color of several, and compression removes
the fine structure of color. Both act on code values, so that their effect depends on the brightness of
both sides of a rim: in linear light the rim is blurred and also displaced.

In this file luma is the weighted mean of a pixel's three code values (BT.601), and chroma the
difference from it. F is the effect of the file on a picture: the known compression of a JPEG, or a
Gaussian blur of chroma for other files. A model predicts the picture M = P + (1 − α) B before the
file. The plate's colors were blurred by its own file: M' is the same with F B in place of B, and M' −
F M is added to the code values. It is 0 where nothing moved.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Floats
from blurmatte.radiometry import LUMA_WEIGHTS, SRGB, Compression, LinearImage, Transfer


@dataclass(frozen=True)
class ChromaBlur:
    """A file with a Gaussian blur of chroma."""

    spread: float  # standard deviation of the blur, pixels

    def seen(self, codes: Array) -> Array:
        """(h, w, 3) code values after the file."""
        chroma, blurred = self.chroma(codes)
        return codes - chroma + blurred

    def chroma(self, codes: Array) -> tuple[Array, Array]:
        """(h, w, 3) chroma of code values before the file, and after it."""
        chroma = codes - (codes @ LUMA_WEIGHTS)[..., None]
        return chroma, scipy.ndimage.gaussian_filter(chroma, (self.spread, self.spread, 0))


File = ChromaBlur | Compression


def file_of(image: LinearImage) -> Compression | None:
    """The file of an image whose noise is known, if its compression is known."""
    compression, transfer = image.meta.sharing, image.meta.transfer or SRGB
    if compression is None:
        return None
    return compression.in_noise(image.rgb, image.variance, transfer)


def codes_before(
    codes: Array,
    plates: tuple[Array, Array],
    alpha: Array,
    own: Array,
    seen: Callable[[Array], Array],
    transfer: Transfer,
) -> tuple[Array, Array]:
    """(h, w, 3) code values of an image before its file, and those that the model predicts.

    codes (h, w, 3): of the image, 0…1.
    plates (h, w, 3): light of the plate, and `light_after` its own file.
    own (h, w, 3): alpha times the object's color.
    seen: code values after the file, of those before it.
    """
    through = (1 - alpha)[..., None]
    predicted, with_plate = (
        np.asarray(transfer.encode(np.maximum(through * behind + own, 0))) for behind in plates
    )
    return codes + with_plate - seen(predicted), predicted


def light_after(light: Floats, seen: Callable[[Array], Array], transfer: Transfer) -> Array:
    """(h, w, 3) light after a file, of light before it; `seen` is that of `codes_before`."""
    codes = np.asarray(transfer.encode(np.asarray(light, float)))
    return np.asarray(transfer.decode(seen(codes)))


def light_before(
    C: Floats, plates: tuple[Array, Array], alpha: Array, own: Array, file: File, transfer: Transfer
) -> Array:
    """(h, w, 3) light of an image of light C before its file, as `codes_before`."""
    codes = np.asarray(transfer.encode(np.asarray(C, float)))
    before, _ = codes_before(codes, plates, alpha, own, file.seen, transfer)
    return np.asarray(transfer.decode(before))


def image_before(
    image: LinearImage, plate: LinearImage, alpha: Array, basis: Array, file: File
) -> LinearImage:
    """An image of colors `basis` before its file, by `light_before`; clipped pixels as they are."""
    own = light_of_colors(image, plate, alpha, basis, file.spread)
    transfer = image.meta.transfer or SRGB
    plates = np.asarray(plate.rgb, float), light_after(plate.rgb, file.seen, transfer)
    light = light_before(image.rgb, plates, alpha, own, file, transfer)
    kept = np.where(image.valid[..., None], light, image.rgb)
    return replace(image, rgb=kept.astype(image.rgb.dtype))


def light_of_colors(
    image: LinearImage, plate: LinearImage, alpha: Array, basis: Array, std: float
) -> Array:
    """(h, w, 3) light of the object, C − (1 − α) B, with the mean color of its neighborhood.

    The brightness is that of each pixel; the direction within the model is that of a Gaussian
    neighborhood of twice the blur, which the file preserves.

    `basis` (3, rank) are the directions of the model's colors, `std` the blur by the file, pixels.
    """
    axes = np.linalg.qr(basis)[0]
    P = np.asarray(image.rgb, float) - (1 - alpha)[..., None] * plate.rgb
    P = np.where((alpha > 0)[..., None], P @ axes @ axes.T, 0)
    around = scipy.ndimage.gaussian_filter(P, (2 * std, 2 * std, 0))
    around /= np.maximum(np.linalg.norm(around, axis=-1, keepdims=True), 1e-12)
    brightness = (P @ LUMA_WEIGHTS) / np.maximum(around @ LUMA_WEIGHTS, 0.05)
    return np.asarray(np.maximum(brightness, 0)[..., None] * around)

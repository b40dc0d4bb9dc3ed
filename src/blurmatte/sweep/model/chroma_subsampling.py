"""The light of a picture before its file blurred the colors of neighbors.

Most files keep the brightness of each pixel, but the color of several together, and compression leaves
out the fine structure of color. They do so with code values, so that what it comes to depends on how
bright both sides of a rim are: in linear light a rim is not only softer, it seems to lie elsewhere.

In this file luma is the weighted mean of a pixel's three code values, as files weigh them, and chroma
is what remains without it. F is what the file makes of a picture: of a JPEG that is known, and for
other files it is a normal blur of chroma. A model predicts the picture M = P + (1 − α) B before the
file. But the plate's colors were blurred by its own file too: M' is the same with F B in place of B,
and M' − F M is added to the code values. It is 0 where nothing moved.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.radiometry import SRGB, Compression, LinearImage, Transfer

Array = npt.NDArray[np.float64]

LUMA = np.array([0.299, 0.587, 0.114])  # BT.601, as JPEG has it
_AROUND = 2.0  # times the blur, over which colors are averaged
_MIN_LUMA = 0.05  # of a unit color


@dataclass(frozen=True)
class Blur:
    """A file of which no more is known than how much it blurs chroma.

    Parameters
    ----------
    std : float
        Standard deviation of G, pixels.
    """

    std: float

    def seen(self, codes: Array) -> Array:
        """(h, w, 3) code values as the file has them."""
        from scipy.ndimage import gaussian_filter

        chroma = codes - (codes @ LUMA)[..., None]
        return np.asarray(codes - chroma + gaussian_filter(chroma, (self.std, self.std, 0)))


@dataclass(frozen=True)
class Compressed:
    """A file that says how it was compressed.

    Parameters
    ----------
    compression : Compression
    noise : float
        Standard deviation of code values.
    """

    compression: Compression
    noise: float

    @classmethod
    def of(
        cls, compression: Compression, light: Floats, variance: Floats, transfer: Transfer
    ) -> "Compressed":
        """With noise as it is in the picture: what was taken away of it hardly matters."""
        codes = np.sqrt(variance) / transfer.slope(light)
        return cls(compression, float(np.median(codes)))

    @property
    def std(self) -> float:
        """Pixels by which chroma runs."""
        return self.compression.spread

    def seen(self, codes: Array) -> Array:
        """(h, w, 3) code values as the file has them, on average."""
        return self.compression.expected(codes, self.noise)


File = Blur | Compressed


def file_of(image: LinearImage) -> Compressed | None:
    """The file of an image whose noise is known, if that says how it was compressed."""
    compression, transfer = image.meta.sharing, image.meta.transfer or SRGB
    if compression is None:
        return None
    return Compressed.of(compression, image.rgb, image.variance, transfer)


@dataclass(frozen=True, eq=False)
class ChromaBlur:
    """Image and plate, and the file in which the image's colors ran together.

    Parameters
    ----------
    C, B : (h, w, 3) float
        Light of image and plate.
    file : Blur or Compressed
        What became of the image's code values.
    transfer : Transfer
        Of the file.
    """

    C: Floats
    B: Floats
    file: File
    transfer: Transfer

    @cached_property
    def _codes(self) -> Array:
        return np.asarray(self.transfer.encode(np.asarray(self.C, float)))

    @cached_property
    def _plate(self) -> Array:
        """(h, w, 3) light of the plate as it would come out of the file."""
        codes = self.transfer.encode(np.asarray(self.B, float))
        return np.asarray(self.transfer.decode(self.file.seen(codes)))

    def before(self, alpha: Array, own: Array) -> Array:
        """(h, w, 3) light of the image before its file.

        Parameters
        ----------
        alpha : (h, w) float
        own : (h, w, 3) float
            Light of the object: alpha times its color.
        """
        through, encode = (1 - alpha)[..., None], self.transfer.encode
        predicted = np.asarray(encode(np.maximum(through * self.B + own, 0)))
        with_plate = np.asarray(encode(np.maximum(through * self._plate + own, 0)))
        return np.asarray(
            self.transfer.decode(self._codes + with_plate - self.file.seen(predicted))
        )


def image_before(
    image: LinearImage, plate: LinearImage, alpha: Array, own: Array, file: File
) -> LinearImage:
    """An image before its file; clipped pixels as they are.

    The parameters are those of `ChromaBlur` and `ChromaBlur.before`.
    """
    transfer = image.meta.transfer or SRGB
    light = ChromaBlur(image.rgb, plate.rgb, file, transfer).before(alpha, own)
    kept = np.where(image.valid[..., None], light, image.rgb)
    return replace(image, rgb=kept.astype(image.rgb.dtype))


def light_of_colors(
    image: LinearImage, plate: LinearImage, alpha: Array, basis: Array, std: float
) -> Array:
    """(h, w, 3) light that an alpha leaves, with the colors that neighbors have.

    The brightness is that of each pixel; the direction within the model is that of the light around,
    which a file preserves.

    Parameters
    ----------
    image, plate : LinearImage
    alpha : (h, w) float
    basis : (3, rank) float
        Directions of the model's colors.
    std : float
        Pixels by which the file blurs colors.
    """
    from scipy.ndimage import gaussian_filter

    axes = np.linalg.qr(basis)[0]
    P = np.asarray(image.rgb, float) - (1 - alpha)[..., None] * plate.rgb
    P = np.where((alpha > 0)[..., None], P @ axes @ axes.T, 0)
    around = gaussian_filter(P, (_AROUND * std, _AROUND * std, 0))
    around /= np.maximum(np.linalg.norm(around, axis=-1, keepdims=True), 1e-12)
    brightness = (P @ LUMA) / np.maximum(around @ LUMA, _MIN_LUMA)
    return np.asarray(np.maximum(brightness, 0)[..., None] * around)

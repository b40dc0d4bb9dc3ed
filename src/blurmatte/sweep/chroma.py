"""Chroma: the light that a picture had before its file let the colors of neighbors run together.

Most files keep the brightness of each pixel, but the color of several together, and compression leaves
out the fine structure of color. They do so with code values, so that what it comes to depends on how
bright both sides of a rim are: in linear light a rim is not only softer, it seems to lie elsewhere.

In this file luma is the weighted mean of a pixel's three code values, as files weigh them, and chroma
what is left of them without it. F is what the file makes of a picture: of a JPEG that is known, and of
others G, a normal distribution by which they blur chroma, is taken for it. The picture was
M = k l + (1 − α) B, with l the direction of the object's color, in a plane of colors that of what is
around, and k of each pixel such that M has the luma that the file kept; the file made F M of it. But
the plate's colors ran together too before they were known: compared is with M' of the plate F B that
would come out of the file if B went through it, and M' − F M is what is to be added to the code
values. It is 0 where nothing moved.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.radiometry import SRGB, Compression, LinearImage, Transfer
from blurmatte.sweep.path import PathFamily

Array = npt.NDArray[np.float64]

_LUMA = np.array([0.299, 0.587, 0.114])  # BT.601, as JPEG has it
_RIM = 0.06  # of the blur, by which rims were off beyond noise: 36 random balls, JPEG 90 4:2:0
_AROUND, _ALIKE = 2.0, 0.3  # times the blur; cosine with the usual color of what light may be
_POINTS = 33  # of a path
_BRIGHTEST, _HALVES = 4.0, 20  # a bright white's length is 1.7; to a millionth of that


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

        chroma = codes - (codes @ _LUMA)[..., None]
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
class Bled:
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

    def before(self, alpha: Array, within: Array) -> Array:
        """(h, w, 3) light of the image as it was before its colors ran together.

        Parameters
        ----------
        alpha : (h, w) float
        within : (3, rank) float
            Directions that the object's light may have: one, or those of a plane.
        """
        told, before = self._told(alpha, within)
        return np.asarray(self.transfer.decode(self._codes + before - self.file.seen(told)))

    def drawn(self, alpha: Array, within: Array, std: Array, draws: int) -> list[Array]:
        """The same of other pictures, of what alpha and color say, that went through the same file.

        Parameters
        ----------
        alpha, within
            As in `before`.
        std : (h, w, 3) float
            Standard deviation of their noise, light; its draws are always the same.
        draws : int
            How many.
        """
        assert isinstance(self.file, Compressed)
        told, before = self._told(alpha, within)
        rng, after = np.random.default_rng(0), self.file.seen(told)
        noise = std / self.transfer.slope(np.asarray(self.C, float))
        files = [
            self.file.compression.once(told + noise * rng.normal(size=told.shape))
            for _ in range(draws)
        ]
        return [np.asarray(self.transfer.decode(codes + before - after)) for codes in files]

    def _told(self, alpha: Array, within: Array) -> tuple[Array, Array]:
        """(h, w, 3) code values of M, and of M'."""
        through, there = (1 - alpha)[..., None], alpha > 0
        behind, own = through * self.B, np.zeros(self.C.shape)
        light = (self.C - behind) * there[..., None] @ within @ within.T
        color = _own_color(light, self.file.std)[there]
        luma = self._codes[there] @ _LUMA
        own[there] = _brightness(luma, behind[there], color, self.transfer) * color
        encode = self.transfer.encode
        return np.asarray(encode(behind + own)), np.asarray(encode(through * self._plate + own))


def image_before(
    image: LinearImage, plate: LinearImage, alpha: Array, within: Array, file: File
) -> LinearImage:
    """An image as it was before its colors ran together; clipped pixels as they are.

    The parameters are those of `Bled` and `Bled.before`.
    """
    transfer = image.meta.transfer or SRGB
    light = Bled(image.rgb, plate.rgb, file, transfer).before(alpha, within)
    kept = np.where(image.valid[..., None], light, image.rgb)
    return replace(image, rgb=kept.astype(image.rgb.dtype))


def left_untold(family: PathFamily, path: Array, blur: float) -> Array:
    """(n + 1, n + 1) covariance that is left of the path (n,) and a radius where color was blurred.

    Compression leaves of the color of a rim what suits its blocks, and so moves whole rims: those at
    the sides of the path and at its ends.
    """
    t = np.linspace(0, 1, _POINTS)
    xy, D = family.at(path, t)
    out = np.gradient(xy, axis=0) * (2 * t - 1)[:, None]
    out /= max(float(np.linalg.norm(out[[0, -1]], axis=1).max()), 1e-9)
    moves = np.stack([*np.broadcast_to(np.eye(2)[:, None], (2, _POINTS, 2)), out])
    ways = np.linalg.lstsq(D.reshape(2 * _POINTS, -1), moves.reshape(3, -1).T)[0]
    covariance = np.zeros((len(path) + 1,) * 2)
    covariance[:-1, :-1] = ways @ ways.T
    covariance[-1, -1] = 1
    return np.asarray((_RIM * blur) ** 2 * covariance)


def _own_color(P: Array, blur: float) -> Array:
    """(h, w, 3) directions of light P of a model: of what is around, whose color a file leaves."""
    from scipy.ndimage import gaussian_filter

    usual = P.sum(axis=(0, 1)) / max(float(np.linalg.norm(P.sum(axis=(0, 1)))), 1e-12)
    around = gaussian_filter(P, (_AROUND * blur, _AROUND * blur, 0))
    length = np.linalg.norm(around, axis=-1, keepdims=True)
    told = around @ usual > _ALIKE * length[..., 0]
    return np.asarray(np.where(told[..., None], around / np.maximum(length, 1e-12), usual))


def _brightness(luma: Array, behind: Array, color: Array, transfer: Transfer) -> Array:
    """(n, 1) the k of each pixel, by halving intervals: luma rises with it."""
    low, high = np.zeros(len(luma)), np.full(len(luma), _BRIGHTEST)
    for _ in range(_HALVES):
        k = (low + high) / 2
        dark = transfer.encode(behind + k[:, None] * color) @ _LUMA < luma
        low, high = np.where(dark, k, low), np.where(dark, high, k)
    return np.asarray((low + high) / 2)[:, None]

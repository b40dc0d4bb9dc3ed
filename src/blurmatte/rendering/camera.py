"""A camera: exact light → noise → code values → light as a reader of its file gets it."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats, check_light
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel, Transfer, decode
from blurmatte.radiometry.mosaic import demosaic, tiled
from blurmatte.rendering.jpeg import (
    CHROMAS,
    FULL_CHROMA,
    coarsen_chroma,
    compression_of,
    from_jpeg,
    to_jpeg,
)

Rng = int | np.random.Generator
Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_BITS = (8, 10, 12, 16)
_NO_NOISE = NoiseModel()
_BAYER = np.array([[0, 1], [1, 2]])  # red, green over green, blue


@dataclass(frozen=True)
class Camera:
    """What happens to light on its way into a file.

    Parameters
    ----------
    noise : NoiseModel
        Of the sensor; rounding comes on top. `NoiseModel()` for none.
    code_std : float
        Standard deviation of noise added in code values (0…1), e.g. 2 / 255.
    bits : 8, 10, 12, 16 or None
        Bits of the file; None keeps floats, unclipped.
    transfer : Transfer
        Curve of the file's code values.
    jpeg_quality : int, optional
        1…100: the file is a JPEG of this quality. Needs `bits` 8 and the sRGB curve.
    chroma : str
        "4:4:4": every pixel has a color of its own; "4:2:2": two neighbors in a row share theirs;
        "4:2:0": two by two do. Without `jpeg_quality` as in video that is not compressed further.
    bayer : bool
        The sensor sees one channel in each pixel (red, green over green, blue), clips at 1 unless
        `bits` is None, and the other two are interpolated linearly. Noise is then correlated.

    Raises
    ------
    TypeError, ValueError
        For a number outside its range, or a file that does not exist, such as a JPEG of 16 bits.
    """

    noise: NoiseModel = _NO_NOISE
    code_std: float = 0.0
    bits: int | None = 8
    transfer: Transfer = SRGB
    jpeg_quality: int | None = None
    chroma: str = FULL_CHROMA
    bayer: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.noise, NoiseModel):
            raise TypeError(f"noise must be a NoiseModel, got {type(self.noise).__name__}")
        if not (np.isfinite(self.code_std) and self.code_std >= 0):
            raise ValueError(f"code_std must be finite and not negative, got {self.code_std}")
        if self.bits is not None:
            _check_bits(self.bits)
        if self.chroma not in CHROMAS:
            raise ValueError(f"chroma must be one of {', '.join(CHROMAS)}, got {self.chroma!r}")
        if self.bits is None and self.chroma != FULL_CHROMA:
            raise ValueError(
                f"chroma {self.chroma} shares code values, and floats (bits None) have none"
            )
        if self.jpeg_quality is not None:
            self._check_jpeg(self.jpeg_quality)

    def _check_jpeg(self, quality: int) -> None:
        if quality not in range(1, 101):
            raise ValueError(f"jpeg_quality must be a whole number from 1 to 100, got {quality}")
        if self.bits != 8:
            raise ValueError(
                f"a JPEG holds 8 bits, got bits {self.bits} with jpeg_quality {quality}"
            )
        if self.transfer != SRGB:
            raise ValueError(f"a JPEG is read as sRGB, got the curve {self.transfer.name}")

    def expose(self, light: Floats, rng: Rng) -> Codes:
        """The code values of one picture; those of a JPEG before its compression.

        Parameters
        ----------
        light : (H, W, 3) float
            Exact linear light, 1 = sensor white.
        rng : int or Generator
            Seed, or a generator that is used up.

        Returns
        -------
        (H, W, 3) uint8 or uint16
            uint8 for 8 bits; else uint16 whose top is 65535: of 10 bits, every 64th or so occurs.

        Raises
        ------
        TypeError, ValueError
            If `light` is not linear light, `bits` is None, or a mosaic would not be 2x2 pixels.
        """
        if self.bits is None:
            raise ValueError("a camera with bits None has no code values; use photograph")
        values = self.transfer.encode(self._developed(light, rng))
        if self.jpeg_quality is None and self.chroma != FULL_CHROMA:
            values = coarsen_chroma(np.clip(values, 0, 1), self.chroma, 2**self.bits - 1)
        return _rounded(values, self.bits)

    def compress(self, codes: Codes) -> bytes:
        """The JPEG file of (H, W, 3) uint8 `codes`, tagged as sRGB.

        Raises
        ------
        TypeError, ValueError
            If the codes are of another kind, or the camera makes no JPEG.
        """
        if self.jpeg_quality is None:
            raise ValueError("a camera without jpeg_quality makes no JPEG")
        if codes.dtype != np.uint8 or codes.ndim != 3 or codes.shape[2] != 3:
            raise TypeError(f"codes must be (H, W, 3) uint8, got {codes.shape} {codes.dtype}")
        return to_jpeg(codes, self.jpeg_quality, self.chroma)

    def photograph(self, light: Floats, rng: Rng) -> LinearImage:
        """Take a picture of exact light, as it comes out of the camera's file.

        Parameters
        ----------
        light : (H, W, 3) float
            Exact linear light, 1 = sensor white.
        rng : int or Generator
            Seed, or a generator that is used up.

        Returns
        -------
        LinearImage
            float32 with saturated pixels not valid, its noise not measured yet; or, for `bits`
            None, in the dtype of `light` with its noise known, unless a mosaic correlates it.

        Raises
        ------
        TypeError, ValueError
            If `light` is not linear light, or a mosaic would not be 2x2 pixels.
        """
        if self.bits is None:
            return LinearImage(self._developed(light, rng), noise=self._known_noise(light))
        codes = self.expose(light, rng)
        compression = None
        if self.jpeg_quality is not None:
            file = self.compress(codes)
            codes, compression = from_jpeg(file), compression_of(file)
        picture = decode(codes, self.transfer)
        meta = replace(picture.meta, levels=2**self.bits, compression=compression)
        return replace(picture, meta=meta)

    def _developed(self, light: Floats, rng: Rng) -> Floats:
        """Light with all its noise, as the curve meets it; shape and dtype of `light`."""
        check_light("light", light)
        rng = np.random.default_rng(rng)
        seen = _noisy(light, self.noise, rng)
        if self.bayer:
            seen = _demosaic(seen if self.bits is None else np.minimum(seen, 1))
        if self.code_std > 0:
            codes = self.transfer.encode(seen) + self.code_std * rng.standard_normal(light.shape)
            seen = self.transfer.decode(codes)
        return np.asarray(seen, dtype=light.dtype)

    def _known_noise(self, light: Floats) -> NoiseModel | Floats | None:
        """Of unrounded floats. A mosaic's is no function of the light: not known."""
        if self.bayer:
            return None
        if self.code_std == 0:
            return self.noise
        of_codes = (self.code_std * self.transfer.slope(light)) ** 2
        return np.asarray(self.noise.variance(light) + of_codes, dtype=light.dtype)


def add_noise(light: Floats, noise: NoiseModel, rng: Rng) -> Floats:
    """Light with the noise of a sensor; shape and dtype of `light`.

    Photon and read noise are drawn together, from a normal distribution of their variance at the
    exact light: good where a pixel holds more than about 20 electrons (light > 20 · gain). The
    parameters are those of `Camera` and its `photograph`.
    """
    check_light("light", light)
    return np.asarray(_noisy(light, noise, np.random.default_rng(rng)), dtype=light.dtype)


def encode_codes(light: Floats, bits: int, transfer: Transfer = SRGB) -> Codes:
    """Integer code values of linear `light`, any shape: encoded, rounded and clipped.

    They are those of `Camera.expose`: 10 and 12 bits fill the range of uint16.

    Raises
    ------
    ValueError
        If `bits` is neither 8, 10, 12 nor 16.
    """
    _check_bits(bits)
    return _rounded(transfer.encode(light), bits)


def _check_bits(bits: int) -> None:
    if bits not in _BITS:
        raise ValueError(f"bits must be 8, 10, 12 or 16, got {bits}")


def _noisy(light: Floats, noise: NoiseModel, rng: np.random.Generator) -> Floats:
    noisy: Floats = light + np.sqrt(noise.variance(light)) * rng.standard_normal(light.shape)
    return noisy


def _rounded(values: Floats, bits: int) -> Codes:
    """Code values 0…1 to integers: to the steps of `bits` first, then to the range of the dtype."""
    steps = 2**bits - 1
    codes: Floats = np.rint(steps * np.clip(values, 0, 1))
    if bits == 8:
        return codes.astype(np.uint8)
    codes = np.rint(codes * (65535 / steps))
    return codes.astype(np.uint16)


def _demosaic(light: Floats) -> Floats:
    """(H, W, 3): each pixel keeps one channel, and the other two come from its neighbors."""
    if min(light.shape[:2]) < 2:
        height, width = light.shape[:2]
        raise ValueError(f"light must be 2x2 pixels or more for a mosaic, got {width}x{height}")
    seen = tiled(_BAYER, light.shape[:2])[..., None]
    return demosaic(np.take_along_axis(light, seen, axis=2)[..., 0], _BAYER)

"""Camera: exact light → optics → noise → processing → code values → light decoded from the file."""

import io
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Codes, Codes8, Floats, check_kind, check_light, check_not_negative
from blurmatte.jpeg.coding import compression_of
from blurmatte.radiometry import SRGB, YCBCR, LinearImage, NoiseModel, Transfer, decode
from blurmatte.radiometry.sensor import demosaic, tiled, variance_shares
from blurmatte.rendering.coverage import disc_kernel
from blurmatte.rendering.processing import Processing, Rng, check_8_bit_codes, check_bits, rounded

BAYER = np.array([[0, 1], [1, 2]])  # red, green over green, blue
FULL_CHROMA = "4:4:4"
CHROMAS = {FULL_CHROMA: (), "4:2:2": (1,), "4:2:0": (1, 0)}  # axes along which pairs share chroma
_NO_NOISE = NoiseModel()
_NO_PROCESSING = Processing()


@dataclass(frozen=True)
class Camera:
    """The imaging chain from light to a file.

    In this order: blur by the lens (`blur`, `defocus`), noise of the sensor (`noise`, `bayer`,
    `code_std`), encoding (`transfer`), processing as in a phone (`processing`), rounding (`bits`) and
    compression (`chroma`, `jpeg_quality`).

    Parameters
    ----------
    noise : NoiseModel
        Noise of the sensor, without rounding. `NoiseModel()` for none.
    code_std : float
        Standard deviation of noise added in code values (0…1), e.g. 2 / 255.
    bits : 8, 10, 12, 16 or None
        Bit depth of the file; None keeps floats, unclipped.
    transfer : Transfer
        Transfer curve of the file's code values.
    jpeg_quality : int, optional
        1…100: the file is a JPEG of this quality. Needs `bits` 8 and the sRGB curve.
    chroma : str
        Chroma subsampling: "4:4:4" for none; "4:2:2": two neighbors in a row share their chroma;
        "4:2:0": blocks of two by two share it. Without `jpeg_quality`, as in uncompressed video.
    bayer : bool
        The sensor measures one channel per pixel (red, green over green, blue) and clips at 1 unless
        `bits` is None; the other two are interpolated linearly, which correlates the noise.
    blur : float
        Standard deviation of the Gaussian point spread function of the lens, pixels.
    defocus : float
        Radius of the circle of confusion of the whole picture, pixels.
    processing : Processing
        Noise reduction, tone curve and sharpening of the code values, which decoding does not undo.
        Code values are clipped to 0…1 before, unless `bits` is None.

    Raises
    ------
    TypeError, ValueError
        For a number outside its range, or an impossible file format, such as a JPEG of 16 bits.

    Examples
    --------
    >>> phone = bm.rendering.Camera(code_std=1 / 255, jpeg_quality=90, chroma="4:2:0")
    >>> picture = phone.photograph(truth.image.rgb, rng=0)
    """

    noise: NoiseModel = _NO_NOISE
    code_std: float = 0.0
    bits: int | None = 8
    transfer: Transfer = SRGB
    jpeg_quality: int | None = None
    chroma: str = FULL_CHROMA
    bayer: bool = False
    blur: float = 0.0
    defocus: float = 0.0
    processing: Processing = _NO_PROCESSING

    def __post_init__(self) -> None:
        check_kind("noise", self.noise, NoiseModel, "use blurmatte.NoiseModel(gain, read_std)")
        for name in ("code_std", "blur", "defocus"):
            check_not_negative(name, getattr(self, name))
        hint = "use blurmatte.rendering.processing.Processing()"
        check_kind("processing", self.processing, Processing, hint)
        self._check_file()

    def _check_file(self) -> None:
        if self.bits is not None:
            check_bits(self.bits)
        if self.chroma not in CHROMAS:
            raise ValueError(f"chroma must be one of {', '.join(CHROMAS)}, got {self.chroma!r}")
        if self.bits is None and self.chroma != FULL_CHROMA:
            raise ValueError(
                f"chroma {self.chroma} shares code values, and floats (bits None) have none"
            )
        quality = self.jpeg_quality
        if quality is None:
            return
        if quality not in range(1, 101):
            raise ValueError(f"jpeg_quality must be a whole number from 1 to 100, got {quality}")
        if self.bits != 8:
            raise ValueError(
                f"a JPEG holds 8 bits, got bits {self.bits} with jpeg_quality {quality}"
            )
        if self.transfer != SRGB:
            raise ValueError(f"a JPEG is read as sRGB, got the curve {self.transfer.name}")

    def through_optics(self, values: Floats) -> Floats:
        """Apply the point spread function of the lens: a Gaussian, then a disc.

        The operator K is linear and self-adjoint. For image = P + T with the object's premultiplied
        light P and the transmitted light T of the plate, K image = K P + K T holds exactly; K T equals
        (1 - K alpha) · K plate only where the plate is constant over the width of the blur. The picture
        is mirrored at its border, half a pixel outside the last one.

        Parameters
        ----------
        values : (H, W) or (H, W, k) float
            Linear light, alpha, premultiplied light.

        Returns
        -------
        float array
            Shape and dtype of `values`; the same array if the camera has neither blur nor defocus.
            Constants and the sum over the picture are preserved.

        Raises
        ------
        TypeError, ValueError
            If `values` is not such an array.
        """
        if not isinstance(values, np.ndarray) or values.dtype.kind != "f":  # type: ignore[redundant-expr]
            kind = getattr(values, "dtype", type(values).__name__)
            raise TypeError(f"values must be a NumPy array of floats, got {kind}")
        if values.ndim not in (2, 3):
            raise ValueError(f"values must be (H, W) or (H, W, k), got the shape {values.shape}")
        dtype = values.dtype
        if self.blur > 0:  # 6e-7 of a Gaussian lies beyond 5 standard deviations
            values = scipy.ndimage.gaussian_filter(
                values, self.blur, mode="reflect", truncate=5.0, axes=(0, 1)
            )
        if self.defocus > 0:
            disc = disc_kernel(self.defocus)
            values = scipy.ndimage.convolve(
                values, disc.reshape(disc.shape + (1,) * (values.ndim - 2))
            )
        return np.asarray(values, dtype=dtype)

    def expose(self, light: Floats, rng: Rng) -> Codes:
        """Code values of one picture; for a JPEG, those before compression.

        Parameters
        ----------
        light : (H, W, 3) float
            Exact linear light, 1 = sensor white.
        rng : int or Generator
            Seed, or a generator that is advanced.

        Returns
        -------
        (H, W, 3) uint8 or uint16
            uint8 for 8 bits, else uint16 scaled to 65535.

        Raises
        ------
        TypeError, ValueError
            If `light` is not linear light, `bits` is None, or a mosaic has less than 2x2 pixels.
        """
        if self.bits is None:
            raise ValueError("a camera with bits None has no code values; use photograph")
        seen = self._developed(self.through_optics(check_light("light", light)), rng)
        values = self.transfer.encode(seen)
        if self.processing.active:
            values = self._processed(np.clip(values, 0, 1), seen)
        if self.jpeg_quality is None and self.chroma != FULL_CHROMA:
            values = subsample_chroma(np.clip(values, 0, 1), self.chroma, 2**self.bits - 1)
        return rounded(values, self.bits)

    def compress(self, codes: Codes) -> bytes:
        """Encode (H, W, 3) uint8 `codes` as a JPEG file, tagged as sRGB.

        Raises
        ------
        TypeError, ValueError
            If the codes have another type, or the camera does not write JPEG.
        """
        if self.jpeg_quality is None:
            raise ValueError("a camera without jpeg_quality makes no JPEG")
        check_8_bit_codes(codes)
        return to_jpeg(codes, self.jpeg_quality, self.chroma)

    def photograph(self, light: Floats, rng: Rng) -> LinearImage:
        """Take a picture of exact light and decode the camera's file.

        Parameters
        ----------
        light : (H, W, 3) float
            Exact linear light, 1 = sensor white.
        rng : int or Generator
            Seed, or a generator that is advanced.

        Returns
        -------
        LinearImage
            float32 with saturated pixels invalid and noise not yet measured; or, for `bits` None, in
            the dtype of `light` with known noise, unless a mosaic correlates it or processing changes
            it.

        Raises
        ------
        TypeError, ValueError
            If `light` is not linear light, or a mosaic has less than 2x2 pixels.
        """
        light = check_light("light", light)
        if self.bits is None:
            return self._photograph_floats(self.through_optics(light), rng)
        codes = self.expose(light, rng)
        compression = None
        if self.jpeg_quality is not None:
            file = self.compress(codes)
            codes, compression = from_jpeg(file), compression_of(file)
        picture = decode(codes, self.transfer)
        meta = replace(picture.meta, levels=2**self.bits, compression=compression)
        return replace(picture, meta=meta)

    def _photograph_floats(self, light: Floats, rng: Rng) -> LinearImage:
        seen = self._developed(light, rng)
        if not self.processing.active:
            return LinearImage(seen, noise=self._known_noise(light))
        values = self._processed(self.transfer.encode(seen), seen)
        return LinearImage(np.asarray(self.transfer.decode(values), dtype=light.dtype))

    def _developed(self, light: Floats, rng: Rng) -> Floats:
        """Light with all its noise, before encoding; shape and dtype of `light`."""
        rng = np.random.default_rng(rng)
        seen = noisy(light, self.noise, rng)
        if self.bayer:
            seen = through_mosaic(seen if self.bits is None else np.minimum(seen, 1))
        if self.code_std > 0:
            codes = self.transfer.encode(seen) + self.code_std * rng.standard_normal(light.shape)
            seen = self.transfer.decode(codes)
        return np.asarray(seen, dtype=light.dtype)

    def _processed(self, values: Floats, seen: Floats) -> Floats:
        """Code values after processing; `seen` is the encoded light."""
        variance = self.noise.variance(seen)
        if self.bayer:
            variance = variance * variance_shares(BAYER)
        of_codes = variance / self.transfer.slope(seen) ** 2 + self.code_std**2
        return self.processing.apply(values, of_codes)

    def _known_noise(self, light: Floats) -> NoiseModel | Floats | None:
        """Noise of unrounded floats; None for a mosaic, where it is no function of the light."""
        if self.bayer:
            return None
        if self.code_std == 0:
            return self.noise
        of_codes = (self.code_std * self.transfer.slope(light)) ** 2
        return np.asarray(self.noise.variance(light) + of_codes, dtype=light.dtype)


def noisy(light: Floats, noise: NoiseModel, rng: np.random.Generator) -> Floats:
    """Add noise to light that is already checked; float64."""
    with_noise: Floats = light + np.sqrt(noise.variance(light)) * rng.standard_normal(light.shape)
    return with_noise


def through_mosaic(light: Floats) -> Floats:
    """Keep one channel per pixel and interpolate the other two from its neighbors, (H, W, 3)."""
    if min(light.shape[:2]) < 2:
        height, width = light.shape[:2]
        raise ValueError(f"light must be 2x2 pixels or more for a mosaic, got {width}x{height}")
    seen = tiled(BAYER, light.shape[:2])[..., None]
    return demosaic(np.take_along_axis(light, seen, axis=2)[..., 0], BAYER)


def subsample_chroma(values: Floats, chroma: str, steps: int) -> Floats:
    """Code values after chroma subsampling, as in uncompressed video.

    Cb and Cr are averaged over each pair or block, all three components are rounded to `steps` steps,
    and chroma is interpolated linearly between the block centers. The result may leave 0…1 slightly.
    """
    Y, Cb, Cr = np.moveaxis(values @ YCBCR.T, -1, 0)
    parts = _quantized(Y, steps), *(_subsampled(c, chroma, steps) for c in (Cb, Cr))
    return np.asarray(np.stack(parts, axis=-1) @ np.linalg.inv(YCBCR).T)


def _quantized(x: Floats, steps: int) -> Floats:
    return np.asarray(np.rint(steps * x) / steps)


def _subsampled(x: Floats, chroma: str, steps: int) -> Floats:
    """Average over blocks, round, and interpolate between the block centers."""
    shape = x.shape
    for axis in CHROMAS[chroma]:
        x = _halved(x, axis)
    x = _quantized(x, steps)
    for axis in CHROMAS[chroma]:
        x = _doubled(x, axis, shape[axis])
    return x


def _halved(x: Floats, axis: int) -> Floats:
    """Averages of pairs along `axis`; the last value of an odd count has no partner."""
    first, second = np.arange(0, x.shape[axis], 2), np.arange(1, x.shape[axis] + 1, 2)
    pairs = x.take(first, axis) + x.take(second, axis, mode="clip")
    return np.asarray(pairs / 2)


def _doubled(x: Floats, axis: int, count: int) -> Floats:
    """`count` values along `axis`, each a quarter of a step from its pair's center."""
    own = np.arange(count) // 2
    other = own + np.where(np.arange(count) % 2, 1, -1)
    return np.asarray(0.75 * x.take(own, axis) + 0.25 * x.take(other, axis, mode="clip"))


def to_jpeg(codes: Codes, quality: int, chroma: str) -> bytes:
    """Encode (H, W, 3) uint8 sRGB codes as a JPEG file that is tagged as sRGB."""
    from PIL import Image
    from PIL.ExifTags import IFD, Base

    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[Base.ColorSpace] = 1  # sRGB
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=quality, subsampling=chroma, exif=exif)
    return file.getvalue()


def from_jpeg(file: bytes) -> Codes8:
    """Decode a JPEG file to (H, W, 3) codes."""
    from PIL import Image

    with Image.open(io.BytesIO(file)) as picture:
        return np.array(picture)

"""A camera: exact light → noise → code values → light as a file gives it back."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats, check_light
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel, Transfer, decode

Rng = int | np.random.Generator
Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_DTYPES = {8: np.uint8, 16: np.uint16}


def photograph(
    light: Floats,
    noise: NoiseModel,
    rng: Rng,
    bits: int | None = 8,
    transfer: Transfer = SRGB,
    code_std: float = 0.0,
) -> LinearImage:
    """Take a picture of exact light, as it would come out of a file.

    Parameters
    ----------
    light : (H, W, 3) float
        Exact linear light, 1 = sensor white.
    noise : NoiseModel
        Of the sensor; rounding comes on top. `NoiseModel()` for none.
    rng : int or Generator
        Seed, or a generator that is used up.
    bits : 8, 16 or None
        Bits of the file; None keeps floats, unclipped.
    transfer : Transfer
        Curve of the file's code values.
    code_std : float
        Standard deviation of noise added in code values (0…1), e.g. 2 / 255.

    Returns
    -------
    LinearImage
        float32 with saturated pixels not valid, its noise not measured yet; or, for `bits` None, in
        the dtype of `light` with its noise known.

    Raises
    ------
    TypeError, ValueError
        If `light` is not linear light, `bits` something else, or `code_std` negative.
    """
    exposed = add_noise(light, noise, rng, transfer, code_std)
    if bits is not None:
        return decode(encode_codes(exposed, bits, transfer), transfer)
    if code_std == 0:
        return LinearImage(exposed, noise=noise)
    variance = noise.variance(light) + (code_std * transfer.slope(light)) ** 2
    return LinearImage(exposed, noise=np.asarray(variance, dtype=light.dtype))


def add_noise(
    light: Floats,
    noise: NoiseModel,
    rng: Rng,
    transfer: Transfer = SRGB,
    code_std: float = 0.0,
) -> Floats:
    """Light with the noise of a sensor, then noise in code values; shape and dtype of `light`.

    Photon and read noise are drawn together, from a normal distribution of their variance at the
    exact light: good where a pixel holds more than about 20 electrons (light > 20 · gain). The
    parameters are those of `photograph`.
    """
    check_light("light", light)
    if not (np.isfinite(code_std) and code_std >= 0):
        raise ValueError(f"code_std must be finite and not negative, got {code_std}")
    rng = np.random.default_rng(rng)
    noisy = light + np.sqrt(noise.variance(light)) * rng.standard_normal(light.shape)
    if code_std > 0:
        codes = transfer.encode(noisy) + code_std * rng.standard_normal(light.shape)
        noisy = transfer.decode(codes)
    return np.asarray(noisy, dtype=light.dtype)


def encode_codes(light: Floats, bits: int, transfer: Transfer = SRGB) -> Codes:
    """Integer code values of linear `light`, any shape: encoded, rounded and clipped.

    Raises
    ------
    ValueError
        If `bits` is neither 8 nor 16.
    """
    if bits not in _DTYPES:
        raise ValueError(f"bits must be 8 or 16, got {bits}")
    top = 2**bits - 1
    codes: Codes = np.rint(top * np.clip(transfer.encode(light), 0, 1)).astype(_DTYPES[bits])
    return codes

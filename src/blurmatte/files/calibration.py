"""JSON of a camera's calibration: noise and transfer curve."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.checks import MAX_LIGHT, Array
from blurmatte.files.documents import document, numbers, read_json
from blurmatte.radiometry import NoiseModel, Transfer
from blurmatte.radiometry.transfer import TABLE
from blurmatte.statistics import BLOCK_SIZES

MAX_NOISE = 1e3  # gain and standard deviations, of white

_NOISE = "gain", "read_std", "relative_std"
_TRANSFER_HINT = "give a file that blurmatte calibrate response wrote"


def noise_to_mapping(noise: NoiseModel | NoiseFit) -> dict[str, Any]:
    """The content of a file of noise; `read_noise` reads gain, read_std and relative_std."""
    if isinstance(noise, NoiseModel):
        return _noise_fields(noise)
    errors = {f"{name}_std": getattr(noise, f"{name}_std") for name in _NOISE}
    coherence = zip(BLOCK_SIZES, noise.variance_inflation.T, strict=True)
    return {
        **_noise_fields(noise.noise),
        "sensor": {**_noise_fields(noise.sensor), **errors},
        "rounding": _noise_fields(noise.rounding),
        "scale": noise.scale,
        "coherence": {f"{size}x{size}": ratio for size, ratio in coherence},
        "changed": noise.changed,
    }


def read_noise(path: str | Path) -> NoiseModel:
    """Read the noise of a NoiseModel or a NoiseFit that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no noise.

    Examples
    --------
    >>> bm.write("camera.json", bm.calibration.measure_noise_against(image, plate))
    >>> print(bm.read_noise("camera.json"))
    NoiseModel(std 0.0019 at light 0.2)
    """
    hint = "give a file that blurmatte calibrate noise wrote"
    noise: NoiseModel = read_json(path, NOISE, hint, "noise model")
    return noise


def transfer_to_mapping(curve: Transfer | ResponseFit) -> dict[str, Any]:
    """Light at equally spaced code values from 0 to 1; of a fit, its errors and diagnostics too."""
    if isinstance(curve, Transfer):
        return {"name": curve.name, "light": curve.table(TABLE)}
    return {
        "name": curve.transfer.name,
        "exposure_times": curve.exposure_times,
        "noise": curve.noise,
        "agreement": curve.agreement,
        "seen": curve.seen,
        "channel_difference": curve.channel_difference,
        "channels_agree": int(curve.channels_agree),
        "residuals": curve.residuals,
        "std": curve.std,
        "light": curve.transfer.table(TABLE),
    }


def read_transfer(path: str | Path) -> Transfer:
    """Read a transfer curve that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no transfer curve.

    Examples
    --------
    >>> light = np.linspace(0.02, 0.98, 64)[None, :, None] * np.ones((48, 1, 3))
    >>> half, full = (bm.LinearImage(bm.SRGB.encode(light * exposure)) for exposure in (0.5, 1))
    >>> bm.write("mycam.json", bm.calibration.fit_response([half, full], [1 / 120, 1 / 60]))
    >>> image = bm.read("throw.png", bm.read_transfer("mycam.json"))
    """
    curve: Transfer = read_json(path, _TRANSFER, _TRANSFER_HINT, "transfer curve")
    return curve


@document
class _NoiseFields:
    gain: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    read_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    relative_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    # How a fit found them; for people.
    sensor: Any = None
    rounding: Any = None
    scale: Any = None
    coherence: Any = None
    changed: Any = None


NOISE = Annotated[
    _NoiseFields, AfterValidator(lambda f: NoiseModel(f.gain, f.read_std, f.relative_std))
]


@document
class _TransferFields:
    name: str
    light: Annotated[Array, numbers(-MAX_LIGHT, MAX_LIGHT, None)]
    # How a fit found it; for people.
    exposure_times: Any = None
    noise: Any = None
    agreement: Any = None
    seen: Any = None
    channel_difference: Any = None
    channels_agree: Any = None
    residuals: Any = None
    std: Any = None


_TRANSFER = Annotated[
    _TransferFields, AfterValidator(lambda f: Transfer.from_table(f.name, f.light))
]


def _noise_fields(noise: NoiseModel) -> dict[str, Any]:
    return {name: getattr(noise, name) for name in _NOISE}

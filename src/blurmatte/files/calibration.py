"""JSON of a camera's calibration: intrinsics, noise and transfer curve."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, AliasChoices, BeforeValidator, Field

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.errors import FileError
from blurmatte.files.documents import covariance_matrix, numbers, read_json
from blurmatte.intrinsics import Intrinsics
from blurmatte.radiometry import NoiseModel, Transfer
from blurmatte.radiometry.transfer import TABLE
from blurmatte.statistics import BLOCK_SIZES

Array = npt.NDArray[np.float64]

MIN_FOCAL_LENGTH = 1e-3  # pixels
MAX_PX = 1e6  # of places and lengths; distortions are less
MAX_NOISE = 1e3  # gain and standard deviations, of white
MAX_LIGHT = 1e6  # of a code value; white is 1

_PINHOLE = "fx", "fy", "cx", "cy"
_OPENCV_MATRIX = "camera_matrix", "cameraMatrix", "K"
_DISTORTION = "distortion", "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"
_INTRINSICS_HINT = (
    "give {fx, fy, cx, cy, distortion, fisheye, std or covariance, size}, all but the first four "
    "optional, or camera_matrix and distortion_coefficients as OpenCV writes them"
)
_NOISE = "gain", "read_std", "relative_std"
_TRANSFER_HINT = "give a file that blurmatte calibrate response wrote"


def intrinsics_to_mapping(intrinsics: Intrinsics) -> dict[str, Any]:
    """The content of a file of intrinsics; `read_intrinsics` reads all of it."""
    return {
        **{name: getattr(intrinsics, name) for name in _PINHOLE},
        "distortion": intrinsics.distortion,
        "fisheye": intrinsics.fisheye,
        "covariance": intrinsics.covariance,
        "size": intrinsics.size,
    }


def read_intrinsics(path: str | Path) -> Intrinsics:
    """Read a calibrated camera from a JSON file.

    Either `fx`, `fy`, `cx`, `cy` in pixels, and optionally `distortion` (k1, k2, p1, p2, k3 …),
    `fisheye` (true or false) and `std` or `covariance` of all of these in this order; or
    `camera_matrix` and `distortion_coefficients` as OpenCV's FileStorage writes them into JSON, or as
    plain lists. The `size` of its pictures, [width, height], or OpenCV's `image_width` and
    `image_height`, restricts it to pictures of that size.

    Raises
    ------
    FileError
        If the file cannot be read or holds no calibrated camera.
    """
    if Path(path).suffix.lower() in {".yml", ".yaml", ".xml"}:
        raise FileError(
            f"{path}: let OpenCV write the calibration as .json, or {_INTRINSICS_HINT}; "
            "YAML and XML are not supported"
        )
    lens: Intrinsics = read_json(path, _LENS, _INTRINSICS_HINT, "calibrated camera")
    return lens


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
    """
    curve: Transfer = read_json(path, _TRANSFER, _TRANSFER_HINT, "transfer curve")
    return curve


@dataclass
class _NoiseFields:
    gain: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    read_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    relative_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]


NOISE = Annotated[
    _NoiseFields, AfterValidator(lambda f: NoiseModel(f.gain, f.read_std, f.relative_std))
]


@dataclass
class _TransferFields:
    name: str
    light: Annotated[Array, numbers(-MAX_LIGHT, MAX_LIGHT, None)]


_TRANSFER = Annotated[
    _TransferFields, AfterValidator(lambda f: Transfer.from_table(f.name, f.light))
]


def _data(value: Any) -> Any:
    """The numbers in a row, of nested lists or of a matrix as OpenCV writes it."""
    value = value.get("data") if isinstance(value, dict) else value
    while isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        value = [number for row in value for number in row]
    return value


_Matrix = Annotated[
    Array | None,
    numbers(-MAX_PX, MAX_PX, 9),
    BeforeValidator(_data),
    Field(validation_alias=AliasChoices(*_OPENCV_MATRIX)),
]
_Distortion = Annotated[
    Array | None,
    numbers(-MAX_PX, MAX_PX, None),
    BeforeValidator(_data),
    Field(validation_alias=AliasChoices(*_DISTORTION)),
]


@dataclass
class _LensFields:
    fx: Annotated[float, numbers(MIN_FOCAL_LENGTH, MAX_PX)] | None = None
    fy: Annotated[float, numbers(MIN_FOCAL_LENGTH, MAX_PX)] | None = None
    cx: Annotated[float, numbers(-MAX_PX, MAX_PX)] | None = None
    cy: Annotated[float, numbers(-MAX_PX, MAX_PX)] | None = None
    matrix: _Matrix = None
    distortion: _Distortion = None
    fisheye: bool = False
    covariance: Annotated[Array, covariance_matrix(MAX_PX**2, None, None)] | None = None
    std: Annotated[Array, numbers(0, MAX_PX, None)] | None = None
    size: Annotated[Array, numbers(1, MAX_PX, 2, whole=True)] | None = None
    image_width: Annotated[int, numbers(1, MAX_PX, whole=True)] | None = None
    image_height: Annotated[int, numbers(1, MAX_PX, whole=True)] | None = None


def _lens(fields: _LensFields) -> Intrinsics:
    size = fields.image_width, fields.image_height
    width, height = size if fields.size is None else fields.size.tolist()
    errors = np.zeros((0, 0)) if fields.std is None else np.diag(fields.std**2)
    covariance = errors if fields.covariance is None else fields.covariance
    # OpenCV adds trailing zeros for richer models.
    k = np.zeros(0) if fields.distortion is None else fields.distortion
    k = k[:8] if len(k) in (12, 14) and not k[8:].any() else k
    fx, fy, cx, cy = _pinhole(fields)
    return Intrinsics(
        fx, fy, cx, cy, k, fields.fisheye, covariance, (width, height) if width and height else None
    )


def _pinhole(fields: _LensFields) -> Sequence[float]:
    if fields.matrix is not None:
        fx, skew, cx, _, fy, cy = fields.matrix[:6].tolist()
        if skew != 0:
            raise ValueError(f"the matrix must not be skewed, got {skew}")
        return fx, fy, cx, cy
    values = {name: getattr(fields, name) for name in _PINHOLE}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise ValueError(f"{missing[0]} is missing")
    return list(values.values())


_LENS = Annotated[_LensFields, AfterValidator(_lens)]


def _noise_fields(noise: NoiseModel) -> dict[str, Any]:
    return {name: getattr(noise, name) for name in _NOISE}

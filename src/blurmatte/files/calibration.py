"""JSON of a camera's calibration: intrinsics, noise and transfer curve."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.errors import FileError
from blurmatte.files.json_text import parsing, read_json
from blurmatte.intrinsics import Intrinsics
from blurmatte.radiometry import NoiseModel, Transfer
from blurmatte.radiometry.transfer import TABLE
from blurmatte.statistics import BLOCK_SIZES

Array = npt.NDArray[np.float64]

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
    fields = read_json(path, _INTRINSICS_HINT)
    with parsing(path, _INTRINSICS_HINT, "calibrated camera"):
        fisheye, covariance = fields.get("fisheye", False), np.zeros((0, 0))
        if not isinstance(fisheye, bool):
            raise TypeError("fisheye must be true or false")
        if "covariance" in fields:
            covariance = np.array(fields["covariance"], float)
        elif "std" in fields:
            covariance = np.diag(np.array(fields["std"], float) ** 2)
        lens = *_pinhole(fields), _distortion(fields)
        return Intrinsics(*lens, fisheye, covariance, _size(fields))


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
    fields = read_json(path, hint)
    with parsing(path, hint, "noise of a camera"):
        gain, read_std, relative_std = (_three(fields[name]) for name in _NOISE)
        return NoiseModel(gain, read_std, relative_std)


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


def holds_transfer(path: str | Path) -> bool:
    """True if a file holds a transfer curve, valid or not."""
    try:
        return _is_transfer(read_json(path, _TRANSFER_HINT))
    except FileError:
        return False


def read_transfer(path: str | Path) -> Transfer:
    """Read a transfer curve that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no transfer curve.
    """
    fields = read_json(path, _TRANSFER_HINT)
    if not _is_transfer(fields):
        model = isinstance(fields, dict) and "basis" in fields
        found = "holds a color model" if model else "holds no transfer curve"
        raise FileError(f"{path}: {_TRANSFER_HINT}; the file {found}")
    with parsing(path, _TRANSFER_HINT, "valid transfer curve"):
        return Transfer.from_table(fields["name"], fields["light"])


def _pinhole(fields: Any) -> tuple[float, float, float, float]:
    name = next((name for name in _OPENCV_MATRIX if name in fields), None)
    if name is None:
        fx, fy, cx, cy = (float(fields[name]) for name in _PINHOLE)
        return fx, fy, cx, cy
    K = _matrix(fields[name]).reshape(3, 3)
    if K[0, 1] != 0:
        raise ValueError(f"{name} must not be skewed, got {K[0, 1]}")
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _distortion(fields: Any) -> Array:
    """The coefficients, without the trailing zeros that OpenCV adds for richer models."""
    name = next((name for name in _DISTORTION if name in fields), None)
    k = np.zeros(0) if name is None else _matrix(fields[name]).ravel()
    return k[:8] if len(k) in (12, 14) and not k[8:].any() else k


def _size(fields: Any) -> tuple[int, int] | None:
    size = fields.get("size")
    if size is None and {"image_width", "image_height"} <= fields.keys():
        size = [fields["image_width"], fields["image_height"]]
    if size is None:
        return None
    if not (isinstance(size, list) and len(size) == 2):
        raise ValueError(f"size must be [width, height], got {size!r}")
    return int(size[0]), int(size[1])


def _matrix(value: Any) -> Array:
    """Nested lists, or a matrix as OpenCV writes it."""
    return np.array(value["data"] if isinstance(value, dict) else value, dtype=float)


def _noise_fields(noise: NoiseModel) -> dict[str, Any]:
    return {name: getattr(noise, name) for name in _NOISE}


def _three(values: Any) -> tuple[float, float, float]:
    red, green, blue = map(float, values)
    return red, green, blue


def _is_transfer(fields: object) -> bool:
    return (
        isinstance(fields, dict)
        and isinstance(fields.get("name"), str)
        and isinstance(fields.get("light"), list)
    )

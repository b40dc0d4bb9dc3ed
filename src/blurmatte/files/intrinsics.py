"""JSON: a calibrated camera, our own form and that of OpenCV's FileStorage."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.models import read_json_text
from blurmatte.intrinsics import Intrinsics

Array = npt.NDArray[np.float64]

_NAMES = "fx", "fy", "cx", "cy"
_MATRIX = "camera_matrix", "cameraMatrix", "K"
_DISTORTION = "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"
_HINT = (
    "give {fx, fy, cx, cy, distortion, fisheye, std or covariance, size}, all but the first four "
    "optional, or camera_matrix and distortion_coefficients as OpenCV writes them"
)


def intrinsics_to_mapping(intrinsics: Intrinsics) -> dict[str, Any]:
    """What a file of a calibrated camera holds; `read_intrinsics` reads all of it."""
    return {
        **{name: getattr(intrinsics, name) for name in _NAMES},
        "distortion": intrinsics.distortion,
        "fisheye": intrinsics.fisheye,
        "covariance": intrinsics.covariance,
        "size": intrinsics.size,
    }


def read_intrinsics(path: str | Path) -> Intrinsics:
    """Read a calibrated camera from a JSON file.

    Either `fx`, `fy`, `cx`, `cy` in pixels, and if known `distortion` (k1, k2, p1, p2, k3 …),
    `fisheye` (true or false) and `std` or `covariance` of all of these in this order; or a
    `camera_matrix` and `distortion_coefficients` as OpenCV's FileStorage writes them into JSON, or as
    plain lists. The `size` of its pictures, [width, height], or OpenCV's `image_width` and
    `image_height`, keeps it from being used for others.

    Raises
    ------
    FileError
        If the file cannot be read or holds no camera.
    """
    if Path(path).suffix.lower() in {".yml", ".yaml", ".xml"}:
        raise FileError(
            f"{path}: calibrations are read from JSON; let OpenCV write it as .json, or {_HINT}"
        )
    fields = json.loads(read_json_text(path, _HINT))
    try:
        fisheye, covariance = fields.get("fisheye", False), np.zeros((0, 0))
        if not isinstance(fisheye, bool):
            raise TypeError("fisheye must be true or false")
        if "covariance" in fields:
            covariance = np.array(fields["covariance"], float)
        elif "std" in fields:
            covariance = np.diag(np.array(fields["std"], float) ** 2)
        lens = *_pinhole(fields), _distortion(fields)
        return Intrinsics(*lens, fisheye, covariance, _size(fields))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no calibrated camera ({error}); {_HINT}") from error


def _pinhole(fields: Any) -> tuple[float, float, float, float]:
    name = next((name for name in _MATRIX if name in fields), None)
    if name is None:
        fx, fy, cx, cy = (float(fields[name]) for name in _NAMES)
        return fx, fy, cx, cy
    K = _matrix(fields[name]).reshape(3, 3)
    if K[0, 1] != 0:
        raise ValueError(f"{name} must not be skewed, got {K[0, 1]}")
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _distortion(fields: Any) -> Array:
    """The coefficients; zeros at the end that OpenCV added for richer models are left out."""
    name = next((name for name in ("distortion", *_DISTORTION) if name in fields), None)
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
    """Nested lists, or a matrix of OpenCV."""
    return np.array(value["data"] if isinstance(value, dict) else value, dtype=float)

"""JSON of colors, paths, sweeps, noise and transfer curves, with every digit of their numbers."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Json

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.checks import MAX_GAIN, MAX_LIGHT, MAX_PX, Array
from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.documents import (
    MAX_FLOAT,
    covariance_matrix,
    document,
    mapping_to_json,
    numbers,
    parse_json,
    read_json,
    to_json,
    to_mapping,
)
from blurmatte.radiometry import Noise, NoiseModel, Transfer
from blurmatte.radiometry.transfer import TABLE
from blurmatte.statistics import BLOCK_SIZES
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.shape import FlatShape, shape_kind
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.sweep.sweep import Diagnostics, Sweep
from blurmatte.trajectory import Trajectory

MAX_UNIT = 1.001  # of a unit vector's coordinate, and its rounding
# Radians², the square of half a turn: older files may exceed a right angle
MAX_COLOR_VARIANCE = 10.0
MAX_NOISE = 1e3  # gain and standard deviations, of white

# Fields of a fit that a file of its curve has for people.
_OF_RESPONSE = (
    *("exposure_times", "noise", "agreement", "seen"),
    *("channel_difference", "channels_agree", "residuals", "std"),
)
_TRANSFER_HINT = "give a file that blurmatte calibrate response wrote"


def model_to_json(model: ColorModel) -> str:
    """All fields of the model, and its color and axes as hexadecimal for readers.

    JSON has no infinity; infinite evidence becomes null.
    """
    fields: dict[str, Any] = {
        "rank": model.rank,
        "color": model.color,
        "hex": model.hex,
        **vars(model),
    }
    return mapping_to_json({name: value for name, value in fields.items() if value is not None})


def read_color_model(path: str | Path) -> ColorModel:
    """Read a color model that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no color model.

    Examples
    --------
    >>> print(bm.read_color_model("color.json"))
    ColorModel(#ffc046, rank 1, ±0.11°)
    """
    hint = "give a file that blurmatte wrote, e.g. with blurmatte color"
    model: ColorModel = read_json(path, MODEL, hint, "color model")
    return model


def path_to_mapping(path: Trajectory, radius: float | None = None) -> dict[str, Any]:
    """The content of a file of a path; `read_path` reads it from JSON. The radius is in pixels."""
    size = {} if radius is None else {"radius": radius}
    return size | {"t": path.t, "xy": path.xy}


def read_path(path: str | Path) -> tuple[Trajectory, float | None]:
    """Read a path and the object's radius in pixels, None if not given; FileError if there is none."""
    hint = 'give {"xy": [[x, y], …], "t": [0, …, 1]}, in pixels and fractions of the exposure'
    path_and_radius: tuple[Trajectory, float | None] = read_json(path, _PATH, hint, "path")
    return path_and_radius


def sweep_to_json(sweep: Sweep) -> str:
    """All fields of a sweep."""
    fields: dict[str, Any] = {
        "family": sweep.family.name,
        "path": sweep.path,
        "kind": sweep.silhouette.kind,
        **to_mapping(sweep.silhouette),
        "opacity_std": sweep.opacity_std,
        "shape": sweep.shape,
        "model": model_to_json(sweep.model),
        "covariance": sweep.covariance,
        "size": sweep.size,
        "cast": sweep.cast,
        "diagnostics": sweep.diagnostics,
    }
    return to_json(fields)


def sweep_from_json(text: str) -> Sweep:
    """The sweep of `sweep_to_json`.

    Raises FileError if an older version wrote it, without diagnostics, and ValueError if the text is
    something else.
    """
    fields = parse_json(text, dict[str, Any])
    if "bulges" in fields or "stats" in fields:
        raise FileError("solve its picture again; the sweep of an older blurmatte cannot be read")
    known: _SweepFields = parse_json(text, _SweepFields)
    return _sweep(known, parse_json(text, shape_kind(known.kind)))


@document("rank", "color", "hex")  # which follow from the others
class _ModelFields:
    basis: Annotated[Array, numbers(-MAX_UNIT, MAX_UNIT, 3, None)]
    covariance: Annotated[Array, covariance_matrix(MAX_COLOR_VARIANCE, 3, 3)]
    evidence: dict[str, Annotated[float, numbers(0, MAX_FLOAT)] | None]
    to_srgb: Annotated[Array, numbers(-MAX_GAIN, MAX_GAIN, 3, 3)] | None = None
    mean: Annotated[Array, numbers(-MAX_LIGHT, MAX_LIGHT, 3)] | None = None


def _model(fields: _ModelFields) -> ColorModel:
    evidence = {k: math.inf if v is None else v for k, v in fields.evidence.items()}
    rows = fields.to_srgb
    to_srgb = None if rows is None else tuple(map(tuple, rows.tolist()))
    return ColorModel(fields.basis, fields.covariance, evidence, to_srgb, fields.mean)


MODEL = Annotated[_ModelFields, AfterValidator(_model)]


@document()
class _PathFields:
    xy: Annotated[Array, numbers(-MAX_PX, MAX_PX, None, 2)]
    t: Annotated[Array, numbers(0, 1, None)]
    radius: Annotated[float, numbers(0, MAX_PX)] | None = None


_PATH = Annotated[_PathFields, AfterValidator(lambda f: (Trajectory(f.xy, f.t), f.radius))]


@dataclass
class _SweepFields:
    family: str
    path: Annotated[Array, numbers(-MAX_PX, MAX_PX, None)]
    shape: Annotated[Array, numbers(-MAX_PX, MAX_PX, None)]
    model: Json[_ModelFields]
    covariance: Annotated[Array, covariance_matrix(MAX_PX**2, None, None)]
    size: Annotated[Array, numbers(1, MAX_PX, 2, whole=True)]
    diagnostics: Diagnostics
    cast: CastShadow | None = None
    kind: str = Silhouette.kind
    opacity_std: Annotated[float, numbers(0, 1)] = 0.0


def _sweep(fields: _SweepFields, silhouette: FlatShape) -> Sweep:
    family = path_family(fields.family)
    counts = family.size, silhouette.size
    if (len(fields.path), len(fields.shape)) != counts or len(fields.covariance) != sum(counts):
        raise ValueError(f"path and shape must have {counts[0]} and {counts[1]} parameters")
    width, height = fields.size.tolist()
    return Sweep(
        family,
        fields.path,
        silhouette,
        fields.shape,
        _model(fields.model),
        fields.covariance,
        (width, height),
        fields.diagnostics,
        fields.cast,
        fields.opacity_std,
    )


def noise_to_mapping(noise: Noise | NoiseFit) -> dict[str, Any]:
    """The content of a file of noise: its fields, of a fit with their errors and how it found them."""
    if isinstance(noise, Noise):
        return to_mapping(noise)
    sensor = to_mapping(noise.sensor)
    errors = {f"{name}_std": getattr(noise, f"{name}_std") for name in sensor}
    coherence = zip(BLOCK_SIZES, noise.variance_inflation.T, strict=True)
    return {
        **to_mapping(noise.noise),
        "sensor": sensor | errors,
        "rounding": to_mapping(noise.rounding),
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
        **{name: getattr(curve, name) for name in _OF_RESPONSE},
        "channels_agree": int(curve.channels_agree),
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


@document("sensor", "rounding", "scale", "coherence", "changed")  # how a fit found them
class _NoiseFields:
    gain: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    read_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]
    relative_std: Annotated[Array, numbers(0, MAX_NOISE, 3)]


NOISE = Annotated[
    _NoiseFields, AfterValidator(lambda f: NoiseModel(f.gain, f.read_std, f.relative_std))
]


@document(*_OF_RESPONSE)
class _TransferFields:
    name: str
    light: Annotated[Array, numbers(-MAX_LIGHT, MAX_LIGHT, None)]


_TRANSFER = Annotated[
    _TransferFields, AfterValidator(lambda f: Transfer.from_table(f.name, f.light))
]

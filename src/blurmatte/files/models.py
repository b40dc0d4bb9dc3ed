"""JSON of fitted models: color model, path and sweep, with every digit of their numbers."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.json_text import parsing, read_json
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.sweep.sweep import Diagnostics, Sweep
from blurmatte.trajectory import Trajectory

_SILHOUETTE_FLAGS = "turns", "soft", "changes"  # in the order of the fields


def model_to_json(model: ColorModel) -> str:
    """All fields of the model, and its colors as hexadecimal for readers.

    JSON has no infinity; infinite evidence becomes null.
    """
    fields: dict[str, Any] = {
        "rank": model.rank,
        "hex": list(model.hex),
        "basis": model.basis.tolist(),
        "covariance": model.covariance.tolist(),
        "evidence": {k: v if math.isfinite(v) else None for k, v in model.evidence.items()},
    }
    if model.to_srgb is not None:
        fields["to_srgb"] = [list(row) for row in model.to_srgb]
    lines = (f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in fields.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def model_from_json(text: str) -> ColorModel:
    """The model of `model_to_json`.

    Raises
    ------
    AttributeError, KeyError, TypeError, ValueError
        If the text is something else.
    """
    return _model(json.loads(text))


def _model(fields: Any) -> ColorModel:
    evidence = {k: math.inf if v is None else float(v) for k, v in fields["evidence"].items()}
    rows = fields.get("to_srgb")
    to_srgb = None if rows is None else tuple(tuple(map(float, row)) for row in rows)
    return ColorModel(fields["basis"], fields["covariance"], evidence, to_srgb)


def read_color_model(path: str | Path) -> ColorModel:
    """Read a color model that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no color model.
    """
    hint = "give a file that blurmatte wrote, e.g. with blurmatte color"
    fields = read_json(path, hint)
    if isinstance(fields, dict) and "light" in fields:
        raise FileError(f"{path}: {hint}; the file holds a transfer curve")
    with parsing(path, hint, "color model"):
        return _model(fields)


def path_to_mapping(path: Trajectory, radius: float | None = None) -> dict[str, Any]:
    """The content of a file of a path; `read_path` reads it from JSON. The radius is in pixels."""
    size = {} if radius is None else {"radius": radius}
    return size | {"t": path.t, "xy": path.xy}


def read_path(path: str | Path) -> tuple[Trajectory, float | None]:
    """Read a path and the radius of the object in pixels, None if not given.

    Raises
    ------
    FileError
        If the file cannot be read or holds no path.
    """
    hint = 'give {"xy": [[x, y], …], "t": [0, …, 1]}, in pixels and fractions of the exposure'
    fields = read_json(path, hint)
    with parsing(path, hint, "path"):
        radius = fields.get("radius")
        return Trajectory(fields["xy"], fields["t"]), None if radius is None else float(radius)


def sweep_to_json(sweep: Sweep) -> str:
    """All fields of a sweep."""
    fields: dict[str, Any] = {
        "family": sweep.family.name,
        "path": sweep.path.tolist(),
        "order": sweep.silhouette.order,
        "turns": sweep.silhouette.turns,
        "soft": sweep.silhouette.soft,
        "changes": sweep.silhouette.changes,
        "shape": sweep.shape.tolist(),
        "model": model_to_json(sweep.model),
        "covariance": sweep.covariance.tolist(),
        "size": list(sweep.size),
        "cast": None if sweep.cast is None else sweep.cast.numbers,
        "diagnostics": asdict(sweep.diagnostics),
    }
    return json.dumps(fields)


def sweep_from_json(text: str) -> Sweep:
    """The sweep of `sweep_to_json`.

    Raises
    ------
    FileError
        If an older version wrote it, with other shapes and without diagnostics.
    KeyError, TypeError, ValueError
        If the text is something else.
    """
    fields: Any = json.loads(text)
    if "bulges" in fields or "stats" in fields:
        raise FileError("solve its picture again; the sweep of an older blurmatte cannot be read")
    width, height = fields["size"]
    return Sweep(
        path_family(fields["family"]),
        np.array(fields["path"], float),
        Silhouette(int(fields["order"]), *(bool(fields.get(name)) for name in _SILHOUETTE_FLAGS)),
        np.array(fields["shape"], float),
        model_from_json(fields["model"]),
        np.array(fields["covariance"], float),
        (int(width), int(height)),
        Diagnostics(**fields["diagnostics"]),
        _cast_from_json(fields.get("cast")),
    )


def _cast_from_json(fields: Any) -> CastShadow | None:
    if fields is None:
        return None
    offset, strength = (np.array(fields[name], float) for name in ("offset", "strength"))
    return CastShadow(offset, float(fields["softness"]), strength)

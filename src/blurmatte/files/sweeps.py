"""A Sweep as text in the header of a Solution, every digit of it, and back."""

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from blurmatte.errors import FileError
from blurmatte.files.models import model_from_json, model_to_json
from blurmatte.sweep import Diagnostics, Sweep, path_family
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.silhouette import Silhouette

_FLAGS = "turns", "soft", "changes"  # of a silhouette, as its fields are ordered


def sweep_to_json(sweep: Sweep) -> str:
    """All fields; numbers as Python prints them, so that they come back as they were."""
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
        If an older version wrote it, which had other shapes and no diagnostics.
    KeyError, TypeError, ValueError
        If the text is something else.
    """
    fields: Any = json.loads(text)
    if "bulges" in fields or "stats" in fields:
        raise FileError(
            "holds a sweep of an older blurmatte, which cannot be read; solve its picture again"
        )
    width, height = fields["size"]
    return Sweep(
        path_family(fields["family"]),
        np.array(fields["path"], float),
        Silhouette(int(fields["order"]), *(bool(fields.get(name)) for name in _FLAGS)),
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

"""A Solution as one EXR.

R, G, B, A hold the premultiplied picture. Further float32 channels: alpha.raw, alpha.std,
premultiplied.R …, premultiplied_std.R …, quality.flags. Model, solver, statistics and sweep are text
attributes.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import MAX_PIXELS
from blurmatte.errors import FileError
from blurmatte.files.exr import changed_header
from blurmatte.files.models import model_from_json, model_to_json, sweep_from_json, sweep_to_json
from blurmatte.files.raster import Raster, load
from blurmatte.matting.solution import Solution

CHANNELS = (
    *("R", "G", "B", "A", "alpha.raw", "alpha.std"),
    *("premultiplied.R", "premultiplied.G", "premultiplied.B"),
    *("premultiplied_std.R", "premultiplied_std.G", "premultiplied_std.B", "quality.flags"),
)


def solution_parts(solution: Solution) -> tuple[npt.NDArray[Any], ...]:
    """Arrays of the channels `CHANNELS`."""
    layer = solution.layer
    return (
        *(layer.premultiplied, layer.alpha, solution.alpha, solution.alpha_std),
        *(solution.premultiplied, solution.premultiplied_std, solution.quality),
    )


def solution_header(solution: Solution) -> dict[str, str]:
    """Attributes of the EXR."""
    sweep = {} if solution.sweep is None else {"blurmatte:sweep": sweep_to_json(solution.sweep)}
    return {
        "blurmatte:model": model_to_json(solution.model),
        "blurmatte:solver": solution.solver,
        "blurmatte:stats": json.dumps(dict(solution.stats), default=_plain),
        **sweep,
    }


def read_solution(path: str | Path, max_pixels: int = MAX_PIXELS) -> Solution:
    """Read a Solution that `write` wrote.

    Arrays are float32, sequences in `stats` are tuples, and the sweep has all its digits.

    Parameters
    ----------
    path : str or Path
        The EXR.
    max_pixels : int
        Larger pictures are rejected before memory is allocated.

    Returns
    -------
    Solution

    Raises
    ------
    FileError
        If the file cannot be read, holds no Solution, or has the sweep of an older version.
    """
    raster = load(Path(path), max_pixels, CHANNELS[4:])
    try:
        model = model_from_json(str(raster.tags["blurmatte:model"]))
        stats = _frozen(json.loads(str(raster.tags["blurmatte:stats"])))
        text = raster.tags.get("blurmatte:sweep")
        sweep = None if text is None else sweep_from_json(str(text))
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise changed_header(path) from error
    solver = str(raster.tags.get("blurmatte:solver", ""))
    return Solution(**_arrays(raster), model=model, solver=solver, stats=stats, sweep=sweep)


def _arrays(raster: Raster) -> Mapping[str, Any]:
    def light(name: str) -> npt.NDArray[Any]:
        """(H, W, 3) of the channels of one name."""
        return raster.channels(tuple(f"{name}.{color}" for color in "RGB"))

    def single(name: str) -> npt.NDArray[Any]:
        """(H, W) of one channel."""
        return raster.channels((name,))[..., 0]

    return {
        "alpha": single("alpha.raw"),
        "alpha_std": single("alpha.std"),
        "premultiplied": light("premultiplied"),
        "premultiplied_std": light("premultiplied_std"),
        "quality": single("quality.flags").astype(np.uint8),
    }


def _plain(value: Any) -> Any:
    """Lists of NumPy numbers and arrays, for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"stats must hold numbers, text, and lists of them, got {value!r}")


def _frozen(value: Any) -> Any:
    """The value with tuples instead of lists."""
    if isinstance(value, dict):
        return {name: _frozen(part) for name, part in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value

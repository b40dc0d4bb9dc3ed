"""A Solution as one EXR, and back.

R, G, B, A without a name in front are the picture, premultiplied, as every program expects it.
Beside them, untouched: alpha.raw, alpha.std, premultiplied.R …, premultiplied_std.R …,
quality.flags. Model, solver, stats and sweep are text in the header. All channels are float32.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import FileError
from blurmatte.files.models import model_from_json, model_to_json
from blurmatte.files.raster import MAX_PIXELS, Raster, load
from blurmatte.files.sweeps import sweep_from_json, sweep_to_json
from blurmatte.matting import Solution

CHANNELS = (
    *("R", "G", "B", "A", "alpha.raw", "alpha.std"),
    *("premultiplied.R", "premultiplied.G", "premultiplied.B"),
    *("premultiplied_std.R", "premultiplied_std.G", "premultiplied_std.B", "quality.flags"),
)


def solution_parts(solution: Solution) -> tuple[npt.NDArray[Any], ...]:
    """Arrays whose channels are `CHANNELS`."""
    layer = solution.layer
    return (
        *(layer.premultiplied, layer.alpha, solution.alpha, solution.alpha_std),
        *(solution.premultiplied, solution.premultiplied_std, solution.quality),
    )


def solution_header(solution: Solution) -> dict[str, str]:
    """What is no pixel, as text."""
    swept = {} if solution.sweep is None else {"blurmatte:sweep": sweep_to_json(solution.sweep)}
    return {
        "blurmatte:model": model_to_json(solution.model),
        "blurmatte:solver": solution.solver,
        "blurmatte:stats": json.dumps(dict(solution.stats), default=_plain),
        **swept,
    }


def read_solution(path: str | Path, max_pixels: int = MAX_PIXELS) -> Solution:
    """Read a Solution that `write` wrote.

    Arrays come back as float32, sequences in `stats` as tuples, the sweep with every digit.

    Parameters
    ----------
    path : str or Path
        The EXR.
    max_pixels : int
        Larger pictures are refused before memory is taken.

    Returns
    -------
    Solution

    Raises
    ------
    FileError
        If the file cannot be read or holds no Solution, or one of an older version with a sweep.
    """
    raster = load(Path(path), max_pixels, CHANNELS[4:])
    try:
        header = {name: str(raster.tags[f"blurmatte:{name}"]) for name in ("model", "stats")}
        model = model_from_json(header["model"])
        stats = _frozen(json.loads(header["stats"]))
        text = raster.tags.get("blurmatte:sweep")
        sweep = None if text is None else sweep_from_json(str(text))
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(
            f"{path}: another program has changed its header; "
            "give the EXR as blurmatte.write made it"
        ) from error
    solver = str(raster.tags.get("blurmatte:solver", ""))
    return Solution(**_arrays(raster), model=model, solver=solver, stats=stats, sweep=sweep)


def _arrays(raster: Raster) -> Mapping[str, Any]:
    def light(name: str) -> npt.NDArray[Any]:
        return raster.channels(tuple(f"{name}.{color}" for color in "RGB"))

    def single(name: str) -> npt.NDArray[Any]:
        return raster.channels((name,))[..., 0]

    return {
        "alpha": single("alpha.raw"),
        "alpha_std": single("alpha.std"),
        "premultiplied": light("premultiplied"),
        "premultiplied_std": light("premultiplied_std"),
        "quality": single("quality.flags").astype(np.uint8),
    }


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"stats must hold numbers, text, and lists of them, got {value!r}")


def _frozen(value: Any) -> Any:
    """The same with every list a tuple."""
    if isinstance(value, dict):
        return {name: _frozen(part) for name, part in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value

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

from blurmatte.errors import FileError
from blurmatte.files.documents import parse_json, to_mapping
from blurmatte.files.exr import changed_header
from blurmatte.files.models import MODEL, model_to_json, sweep_from_json, sweep_to_json
from blurmatte.files.raster import Raster, load
from blurmatte.formats import MAX_PIXELS
from blurmatte.matting.maps import Quality
from blurmatte.matting.solution import Solution
from blurmatte.matting.stats import SolutionStats

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


def solution_maps(solution: Solution) -> dict[str, npt.NDArray[Any]]:
    """Maps (H, W) of a solution by their names for people; those of light for each channel."""
    maps = {"alpha": solution.alpha, "error of alpha": solution.alpha_std}
    for channel, color in enumerate(("red", "green", "blue")):
        maps[f"{color} light of the object"] = solution.premultiplied[..., channel]
    for channel, color in enumerate(("red", "green", "blue")):
        maps[f"error of {color} light"] = solution.premultiplied_std[..., channel]
    bits = ", ".join(f"{flag.value} {str(flag.name).lower()}" for flag in Quality)
    return maps | {f"flags ({bits.replace('_', ' ')})": solution.quality}


def solution_text(solution: Solution) -> str:
    """What the maps of a solution are, for people."""
    return (
        f"blurmatte: {solution}, {solution.grade}, {solution.solver}. Alpha is the fraction of the "
        "exposure; light is linear, premultiplied, 1 is white; errors are standard deviations."
    )


def solution_header(solution: Solution) -> dict[str, str]:
    """Attributes of the EXR."""
    sweep = {} if solution.sweep is None else {"blurmatte:sweep": sweep_to_json(solution.sweep)}
    return {
        "blurmatte:model": model_to_json(solution.model),
        "blurmatte:solver": solution.solver,
        "blurmatte:stats": json.dumps(stats_to_mapping(solution.stats)),
        **sweep,
    }


def read_solution(path: str | Path, max_pixels: int = MAX_PIXELS) -> Solution:
    """Read a Solution that `write` wrote.

    Arrays are float32; numbers of `stats` and the sweep have all their digits.

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

    Examples
    --------
    >>> print(bm.read_solution("layer.exr"))
    Solution(128x72, alpha up to 0.34, typical std 0.0016, 0.0% of the streak's pixels flagged)
    """
    raster = load(Path(path), max_pixels, CHANNELS[4:])
    try:
        text = raster.tags.get("blurmatte:sweep")
        sweep = None if text is None else sweep_from_json(str(text))
        model = parse_json(str(raster.tags.get("blurmatte:model", "")), MODEL)
        stats = parse_json(str(raster.tags.get("blurmatte:stats", "")), SolutionStats)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    except ValueError as error:
        raise changed_header(path, error) from error
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


_NULL = "exposure_time"  # written even if it is None: every picture has one


def stats_to_mapping(stats: SolutionStats) -> dict[str, Any]:
    """The numbers that apply, by name, in the types of JSON.

    Raises TypeError if a value is no number, text, or list of them.
    """
    fields = to_mapping(stats)
    return {name: part for name, part in fields.items() if part is not None or name == _NULL}

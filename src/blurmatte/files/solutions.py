"""A Solution as one EXR.

R, G, B, A hold the premultiplied picture. Further float32 channels: alpha.raw, alpha.std,
premultiplied.R …, premultiplied_std.R …, quality.flags. Model, solver, statistics and sweep are text
attributes.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import MAX_PIXELS, Direction
from blurmatte.errors import FileError
from blurmatte.files.calibration import NOISE
from blurmatte.files.documents import bounded, numbers, parse_json
from blurmatte.files.exr import changed_header
from blurmatte.files.models import MAX_PX, MODEL, model_to_json, sweep_from_json, sweep_to_json
from blurmatte.files.raster import Raster, load
from blurmatte.matting.alternatives import Alternative
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.sweep.sweep import Diagnostics

MAX_SUM = 1e12  # of alpha or pixels; other statistics are less
MAX_SECONDS = 1e6  # of an exposure

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
        text = raster.tags.get("blurmatte:sweep")
        sweep = None if text is None else sweep_from_json(str(text))
        model = parse_json(str(raster.tags.get("blurmatte:model", "")), MODEL)
        stats = _read_stats(str(raster.tags.get("blurmatte:stats", "")))
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


_Known = Annotated[float, numbers(0, MAX_SUM)]
_Box = Annotated[npt.NDArray[Any], numbers(0, MAX_PX, 4, whole=True)]
_Points = Annotated[npt.NDArray[Any], numbers(-MAX_PX, MAX_PX, None, 2)]


@dataclass
class _Match:
    in_words: str
    agreement: float
    edge_agreement: float


@dataclass
class _Smooth:
    order: int
    converged: bool


@dataclass
class _MedianStd:
    median_std: _Known


@dataclass
class _Shadow:
    offset: Annotated[npt.NDArray[Any], numbers(-MAX_PX, MAX_PX, 2)]
    strength: Annotated[npt.NDArray[Any], numbers(0, 1, 3)]


@dataclass
class _Sweep:
    silhouette: str
    path: str
    xy: _Points
    length: _Known
    radius: _Known
    radius_std: _Known
    outlines: list[_Points]
    diagnostics: Diagnostics
    softness: _Known = 0.0
    opacity: Annotated[float, numbers(0, 1)] = 1.0
    opacity_std: _Known = 0.0
    shadow: _Shadow | None = None


@dataclass
class _Stats:
    """The statistics that other parts of this package use; there may be more."""

    pixels: Annotated[int, numbers(0, MAX_SUM, whole=True)] = 0
    pixels_known: Annotated[int, numbers(0, MAX_SUM, whole=True)] = 0
    sum_alpha: Annotated[float, numbers(-MAX_SUM, MAX_SUM)] | None = None
    sum_alpha_std: _Known = 0.0
    alpha_scale_std: _Known | None = None
    alpha_error: _Known | None = None
    exposure_time: Annotated[float, numbers(0, MAX_SECONDS)] | None = None
    readout: Direction = "down"
    streak_box: _Box | None = None
    other_boxes: tuple[_Box, ...] = ()
    insignificant_others: Annotated[int, numbers(0, MAX_SUM, whole=True)] = 0
    image_noise: NOISE | _MedianStd | None = None
    plate_noise: NOISE | _MedianStd | None = None
    match: _Match | None = None
    smooth: _Smooth | None = None
    may_be_shadow: bool = False
    grade: Grade | None = None
    grade_reasons: tuple[str, ...] = ()
    weights: Annotated[npt.NDArray[Any], numbers(0, 1, None)] | None = None
    alternatives: tuple[Alternative, ...] = ()
    sweep: _Sweep | None = None


def _read_stats(text: str) -> dict[str, Any]:
    parse_json(text, _Stats)
    stats: dict[str, Any] = _frozen(bounded(parse_json(text, dict[str, Any])))
    return stats


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

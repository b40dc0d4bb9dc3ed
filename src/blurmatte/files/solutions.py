"""A Solution as one EXR, and its maps as a stack of TIFF for ImageJ.

R, G, B, A of the EXR hold the premultiplied picture. Further float32 channels: alpha.raw, alpha.std,
premultiplied.R …, premultiplied_std.R …, quality.flags. Model, solver, statistics and sweep are text
attributes.

All pages of a stack are stored one after another, uncompressed, so that ImageJ need not read the
directories. Names of slices are in its own tags, which OpenImageIO cannot write: a count of bytes for
each part (50838), and the parts (50839), which begin with the kinds of what follows [ImageJ,
ij.io.TiffEncoder].
"""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL.TiffTags import ASCII, BYTE, LONG, SHORT

from blurmatte.checks import AnyArray, strips
from blurmatte.errors import FileError
from blurmatte.files.documents import parse_json, to_json, to_mapping
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
_MOST_BYTES = 2**32 - 2**20  # offsets of TIFF have 32 bits


def solution_parts(solution: Solution) -> tuple[AnyArray, ...]:
    """Arrays of the channels `CHANNELS`."""
    layer = solution.layer
    return (
        *(layer.premultiplied, layer.alpha, solution.alpha, solution.alpha_std),
        *(solution.premultiplied, solution.premultiplied_std, solution.quality),
    )


def solution_maps(solution: Solution) -> dict[str, AnyArray]:
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
        "blurmatte:stats": to_json(stats_to_mapping(solution.stats)),
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
    Solution(128x72, alpha up to 0.34, typical std 0.0011, 0.0% of the streak's pixels flagged)
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
    def light(name: str) -> AnyArray:
        """(H, W, 3) of the channels of one name."""
        return raster.channels(tuple(f"{name}.{color}" for color in "RGB"))

    def single(name: str) -> AnyArray:
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


def save_stack(path: Path, maps: Mapping[str, AnyArray], about: str) -> None:
    """Write maps (H, W) of one size as slices, each with its name; a text describes all.

    Raises FileError if they need more than 4 GB, which a TIFF cannot hold.
    """
    height, width = next(iter(maps.values())).shape
    size = 4 * height * width
    if size * len(maps) > _MOST_BYTES:
        raise FileError(
            f"{path}: write .exr; {len(maps)} maps of {width}x{height} need more than 4 GB"
        )
    said = f"ImageJ=1.54f\nimages={len(maps)}\nslices={len(maps)}\nunit=pixel\nmin=0.0\nmax=1.0\n"
    description, (counts, parts) = said.encode() + b"\0", _labels(list(maps), about)
    at = {"description": 8, "counts": 8 + len(description) + len(description) % 2}
    at["parts"] = at["counts"] + len(counts)
    data = at["parts"] + len(parts) + len(parts) % 2
    with path.open("wb") as file:
        file.write(struct.pack("<2sHI", b"II", 42, data + size * len(maps)))
        for start, block in zip(at.values(), (description, counts, parts), strict=True):
            file.write(bytes(start - file.tell()) + block)
        file.write(bytes(data - file.tell()))
        for one in maps.values():
            for strip in strips(height):
                file.write(np.ascontiguousarray(one[strip], "<f4").tobytes())
        for k in range(len(maps)):
            entries = _page(width, height, data + k * size)
            if k == 0:
                entries += [
                    (270, ASCII, len(description), at["description"]),
                    (50838, LONG, len(counts) // 4, at["counts"]),
                    (50839, BYTE, len(parts), at["parts"]),
                ]
            directory = b"".join(struct.pack("<HHII", *entry) for entry in sorted(entries))
            after = 0 if k == len(maps) - 1 else file.tell() + 2 + len(directory) + 4
            file.write(struct.pack("<H", len(entries)) + directory + struct.pack("<I", after))


def _page(width: int, height: int, offset: int) -> list[tuple[int, int, int, int]]:
    """Tag, type, count and value of the entries of a page of floats in one strip."""
    size = 4 * width * height
    numbers = {256: width, 257: height, 273: offset, 278: height, 279: size}
    codes = {
        258: 32,
        259: 1,
        262: 1,
        277: 1,
        339: 3,
    }  # bits, uncompressed, gray, one channel, float
    return [
        *((tag, LONG, 1, value) for tag, value in numbers.items()),
        *((tag, SHORT, 1, value) for tag, value in codes.items()),
    ]


def _labels(names: list[str], about: str) -> tuple[bytes, bytes]:
    """The values of ImageJ's tags for a text about all slices, and the names of the slices."""
    header = b"IJIJ"[::-1] + struct.pack("<4sI4sI", b"ofni", 1, b"lbal", len(names))
    texts = [text.encode("utf-16-le") for text in (about, *names)]
    counts = [len(header), *map(len, texts)]
    return struct.pack(f"<{len(counts)}I", *counts), header + b"".join(texts)

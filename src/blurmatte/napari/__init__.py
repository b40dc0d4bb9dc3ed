"""The reader of napari for layers, solutions and clips; napari.yaml names it, and it needs no napari.

A reader gives tuples of data, options and the kind of layer. Points are (y, x) there.
"""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import blurmatte as bm
from blurmatte.formats import EXR, format_at

LayerData = tuple[Any, dict[str, Any], str]
Reader = Callable[[str | Sequence[str]], list[LayerData]]

_TABLE = "frames.csv"  # of a solved clip
_PLANE = {"scale": (1.0, 1.0), "units": ("pixel", "pixel")}
_TRACK = {
    "track_id": ("track_id", "track", "object"),
    "t": ("t", "frame"),
    "y": ("y",),
    "x": ("x",),
}


def get_reader(path: str | Sequence[str]) -> Reader | None:
    """The function that reads a path, or several; None if one is not of this package."""
    paths = [path] if isinstance(path, str) else list(path)
    return read_paths if paths and all(_is_ours(Path(one)) for one in paths) else None


def read_paths(path: str | Sequence[str]) -> list[LayerData]:
    """The layers of one path or of several."""
    paths = [path] if isinstance(path, str) else path
    return [layer for one in paths for layer in _layers(Path(one))]


def _is_ours(path: Path) -> bool:
    if path.is_dir():
        return (path / _TABLE).is_file()
    if path.suffix.lower() == ".csv":
        return path.is_file() and _columns(path) is not None
    return format_at(path) is EXR


def _layers(path: Path) -> Iterator[LayerData]:
    if path.is_dir():
        for plate in sorted(path.glob("plate*.exr")):
            yield _shown(bm.read(plate), f"{path.name}: {plate.stem}")
        yield _tracks(path / _TABLE, path.name)
    elif path.suffix.lower() == ".csv":
        yield _tracks(path, path.stem)
    else:
        yield from _picture(path)


def _picture(path: Path) -> Iterator[LayerData]:
    """The layers of an EXR: a solution, a layer, or a picture without alpha."""
    try:
        solution = bm.read_solution(path)
    except bm.errors.FileError:
        try:
            yield _object(bm.read_layer(path), path.stem)
        except bm.errors.FileError:
            yield _shown(bm.read(path), path.stem)
        return
    yield from _solution(solution, path.stem)


def _solution(solution: bm.Solution, name: str) -> Iterator[LayerData]:
    """The object, its alpha, its error, the flags, and the path of the shape that explains it."""
    yield _object(solution.layer, name)
    about = {"metadata": {"grade": str(solution.grade), "solver": solution.solver}}
    alpha = {"name": f"{name}: alpha", "colormap": "gray", "contrast_limits": (0.0, 1.0)}
    yield solution.alpha, {**alpha, **about, **_PLANE, "visible": False}, "image"
    std = np.where(np.isfinite(solution.alpha_std), solution.alpha_std, np.nan)
    inside = std[solution.streak & solution.known]
    top = float(np.percentile(inside, 98)) if inside.size else 1.0
    error = {"name": f"{name}: error of alpha", "colormap": "magma", "visible": False}
    yield std, {**error, **_PLANE, "contrast_limits": (0.0, max(top, 1e-6))}, "image"
    yield _flags(solution, name)
    if solution.sweep is not None:
        yield _path(solution, name)


def _flags(solution: bm.Solution, name: str) -> LayerData:
    """The quality flags as labels: each sum of bits with the names of its flags."""
    values = np.unique(solution.quality).tolist()
    texts = [
        ", ".join(str(flag.name).lower() for flag in bm.matting.Quality(value)) or "none"
        for value in values
    ]
    features = {"index": values, "flags": texts}
    options = {"name": f"{name}: flags", "features": features, "opacity": 0.4, "visible": False}
    return solution.quality.astype(np.int32), {**options, **_PLANE}, "labels"


def _path(solution: bm.Solution, name: str) -> LayerData:
    """The path of the center, and the outline at both ends of the exposure."""
    motion = bm.measure_motion(solution)
    shapes = [motion.trajectory.xy, motion.outline_at(0.0), motion.outline_at(1.0)]
    options = {
        "name": f"{name}: path",
        "shape_type": ["path", "polygon", "polygon"],
        "edge_color": "yellow",
        "face_color": "transparent",
        "edge_width": 1,
        "features": {"shape": ["path", "first outline", "last outline"]},
        "metadata": {"length_px": motion.length, "length_std_px": motion.length_std},
    }
    return [np.asarray(xy)[:, ::-1] for xy in shapes], {**options, **_PLANE}, "shapes"


def _object(layer: bm.Layer, name: str) -> LayerData:
    """A layer as napari blends it: code values of the straight color, and alpha."""
    codes = bm.SRGB.encode(np.clip(layer.straight(), 0, 1))
    pixels = np.dstack([codes, np.clip(layer.alpha, 0, 1)]).astype(np.float32)
    return pixels, {"name": name, "rgb": True, **_PLANE}, "image"


def _shown(picture: bm.LinearImage, name: str) -> LayerData:
    """A picture as a screen shows it."""
    codes = bm.SRGB.encode(np.clip(picture.in_srgb().rgb, 0, 1)).astype(np.float32)
    return codes, {"name": name, "rgb": True, **_PLANE}, "image"


def _tracks(path: Path, name: str) -> LayerData:
    """Rows with a place as tracks, over frames; all other numbers are features."""
    columns = _columns(path)
    assert columns is not None
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if all(row[c] for c in columns.values())]
    rows.sort(key=lambda row: (float(row[columns["track_id"]]), float(row[columns["t"]])))
    data = np.array([[float(row[c]) for c in columns.values()] for row in rows]).reshape(-1, 4)
    features = {one: _values([row[one] for row in rows]) for one in (rows[0] if rows else ())}
    options = {"name": f"{name}: tracks", "features": features, "scale": (1.0, 1.0, 1.0)}
    options |= {
        "units": ("dimensionless", "pixel", "pixel"),
        "metadata": {"t": "number of the frame"},
    }
    return data, options, "tracks"


def _columns(path: Path) -> Mapping[str, str] | None:
    """The columns of a table that are track, frame, y and x; None if it has none of them."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            names = next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError):
        return None
    found = {to: next((one for one in of if one in names), "") for to, of in _TRACK.items()}
    ours = "track_id" in names or {"frame", "time", "object"} <= set(names)
    return found if ours and all(found.values()) else None


def _values(texts: Sequence[str]) -> list[Any]:
    """Numbers, NaN where one is missing, if all texts are; else the texts."""
    try:
        return [float(text) if text else float("nan") for text in texts]
    except ValueError:
        return list(texts)

"""What a solution gives: files in one folder, tables of pandas and labeled arrays of xarray.

============  ==========================================================================
alpha.png     alpha of the layer, 16 bit, not encoded: 65535 is 1
color.png     color of the object where alpha is above three sigma, black elsewhere
layer.exr     the Solution: the picture for other programs, and every number (`read_solution`)
layer.png     the layer, straight, 16 bit
model.json    the color model (`read_color_model`)
overview.png  a sheet to look at
report.json   model, evidence, errors, noise, versions
============  ==========================================================================
"""

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.background import ParallaxRegion, PlateFit
from blurmatte.checks import check_kind, check_same_size
from blurmatte.compositing import Exposures
from blurmatte.errors import optional_library
from blurmatte.explain.explain import explain
from blurmatte.explain.solution import alpha_peak, sure_pixels
from blurmatte.figures import draw_exposures, draw_overview, draw_plate
from blurmatte.figures.solution import draw_parallax
from blurmatte.files.documents import flat_rows
from blurmatte.files.solutions import stats_to_mapping
from blurmatte.files.writing import write_together
from blurmatte.layer import Layer
from blurmatte.matting.maps import Quality
from blurmatte.matting.solution import Solution, check_solution
from blurmatte.motion.columns import TableRow
from blurmatte.radiometry import LinearImage, check_picture

RESULT_FILES = (
    *("alpha.png", "color.png", "layer.exr", "layer.png"),
    *("model.json", "overview.png", "report.json"),
)
_PACKAGES = ("blurmatte", "numpy", "scipy", "numba", "OpenImageIO")
_CHANNELS = ["red", "green", "blue"]
_UNIT = {"units": "1"}  # of alpha, and of light: white is 1


def save_results(
    folder: str | Path,
    image: LinearImage,
    plate: LinearImage,
    solution: Solution,
    command: str = "",
    warnings: Sequence[str] = (),
) -> list[Path]:
    """Write a solution as files that other programs open, and a sheet to look at.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there. Files of the same names in it are replaced, but only when all of
        the new ones are whole.
    image, plate : LinearImage
        What was solved.
    solution : Solution
        What was found.
    command : str
        How it was called, for the report.
    warnings : sequence of str
        What there was to warn of, for the report.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError
        If the sizes differ.
    FileError
        If the folder cannot be made or written to. What was there before stays as it was.

    Examples
    --------
    >>> files = bm.save_results("out", image, plate, solution)
    >>> sorted(file.name for file in files)
    ['alpha.png', 'color.png', 'layer.exr', 'layer.png', 'model.json', 'overview.png',
    'report.json']
    """
    check_solution("solution", solution)
    for name, picture in (("image", image), ("plate", plate)):
        check_picture(name, picture)
        check_same_size(name, picture.size, "the solution", solution.size)
    layer = solution.layer
    color, place = layer.straight(), solution.streak_place
    color[place][~sure_pixels(solution.within(place))] = 0
    results = {
        "alpha.png": layer.alpha,
        "color.png": LinearImage(color),
        "layer.exr": solution,
        "layer.png": layer,
        "model.json": solution.model,
        "overview.png": draw_overview(image, plate, solution),
        "report.json": _report(image, plate, solution, command, warnings),
    }
    return write_together(folder, results)


def save_parallax(
    folder: str | Path, picture: LinearImage, regions: Sequence[ParallaxRegion]
) -> list[Path]:
    """Write parallax.png, a picture of where a scene has another depth; without any, remove it.

    Parameters
    ----------
    folder : str or Path
        Of the results.
    picture : LinearImage
    regions : sequence of ParallaxRegion
        In its pixels.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    if regions:
        return write_together(folder, {"parallax.png": draw_parallax(picture, regions)})
    (Path(folder) / "parallax.png").unlink(missing_ok=True)
    return []


def save_plate(path: str | Path, fit: PlateFit) -> list[Path]:
    """Write a plate, and a sheet of it for inspection: both or none.

    Parameters
    ----------
    path : str or Path
        Where the plate goes; as .exr it keeps its variance and which pixels are valid. The sheet is
        called like it, with _overview.png at the end.
    fit : PlateFit
        What `make_plate` made.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    FileError
        If they cannot be written. What was there before stays as it was.

    Examples
    --------
    >>> files = bm.results.save_plate("plate.exr", bm.make_plate(frames))
    >>> plate = bm.read("plate.exr")
    """
    check_kind("fit", fit, PlateFit, "use blurmatte.make_plate(frames)")
    plate, sheet = plate_files(Path(path))
    return write_together(plate.parent, {plate.name: fit.plate, sheet.name: draw_plate(fit)})


def plate_files(path: Path) -> tuple[Path, Path]:
    """The files that `save_plate` writes: the plate, and its sheet."""
    return path, path.with_name(f"{path.stem}_overview.png")


def save_exposures(folder: str | Path, layer: Layer, exposures: Exposures) -> list[Path]:
    """Write how long each paint was there: paint1.png, paint1_std.png, …, and a sheet to look at.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there. Files of the same names in it are replaced: all or none.
    layer : Layer
        The object, for the sheet.
    exposures : Exposures
        What `split_exposure` found. Its maps are 16-bit gray, not encoded: 65535 is the whole
        exposure, and in those of the standard deviation also what is not known.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ValueError
        If sizes differ.
    FileError
        If they cannot be written. What was there before stays as it was.

    Examples
    --------
    >>> paints = bm.compositing.split_exposure(solution, "#ff0000", "#00ff00")
    >>> files = bm.results.save_exposures("paints", layer, paints)
    >>> [file.name for file in files]
    ['paint1.png', 'paint1_std.png', 'paint2.png', 'paint2_std.png', 'overview.png']
    """
    check_kind(
        "exposures",
        exposures,
        Exposures,
        "use blurmatte.compositing.split_exposure(solution, *paints)",
    )
    maps = np.stack([exposures.fraction, exposures.fraction_std], axis=-1)
    maps = maps.reshape(*maps.shape[:2], -1)  # of each paint, then its error
    files = exposure_files(Path(folder), exposures.fraction.shape[-1])
    things = [*np.moveaxis(maps, -1, 0), draw_exposures(layer, exposures)]
    return write_together(folder, {f.name: thing for f, thing in zip(files, things, strict=True)})


def exposure_files(folder: Path, paints: int) -> list[Path]:
    """The files that `save_exposures` writes of so many paints."""
    maps = (f"paint{k + 1}{part}.png" for k in range(paints) for part in ("", "_std"))
    return [folder / name for name in (*maps, "overview.png")]


def _report(
    image: LinearImage,
    plate: LinearImage,
    solution: Solution,
    command: str,
    warnings: Sequence[str],
) -> dict[str, Any]:
    model = solution.model
    inside = solution.quality[solution.streak]
    return {
        "command": command,
        "image": _facts(image),
        "plate": _facts(plate),
        "model": {**model.numbers(), "in_words": explain(model)},
        "grade": solution.stats.grade,
        "solver": solution.solver,
        "alpha_peak": alpha_peak(solution),
        "stats": stats_to_mapping(solution.stats),
        "flagged": {
            flag.name: int(np.count_nonzero(inside & flag))
            for flag in Quality
            if flag != Quality.OUTSIDE
        },
        "in_words": explain(solution),
        "warnings": list(warnings),
        "versions": {"python": platform.python_version(), **_versions()},
    }


def _facts(picture: LinearImage) -> dict[str, Any]:
    meta = picture.meta
    return {
        "file": meta.source,
        "size": picture.size,
        "color_space": meta.color_space,
        "camera": meta.camera,
        "white_balance": meta.white_balance,
        "transfer": meta.transfer.name if meta.transfer else "linear",
        "levels": meta.levels,
        "exposure_time_seconds": meta.exposure_time,
        "readout": meta.readout,
        "valid_share": float(np.mean(picture.valid)),
    }


def _versions() -> dict[str, str]:
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed as a package"
    return found


def to_table(rows: Sequence[TableRow | Mapping[str, Any]]) -> Any:
    """Rows of a clip as a table of pandas.

    Parameters
    ----------
    rows : sequence of FrameMotion, of FrameRecord, or of mappings
        From `measure_clip` or `ClipReport.records`; or rows that are read from a table.

    Returns
    -------
    pandas.DataFrame
        A column for each number, NaN or None where a row has none; `attrs["units"]` has the units of
        columns by their names.

    Raises
    ------
    BlurmatteError
        If pandas is not installed.
    TypeError, ValueError
        If a row is something else, or rows differ in names.

    Examples
    --------
    >>> table = bm.results.to_table(rows)  # doctest: +SKIP
    >>> table.attrs["units"]["x"]  # doctest: +SKIP
    'px'
    """
    pandas = optional_library("pandas", "pip install pandas; to_table makes a table of pandas")
    units: dict[str, str] = {}
    flat = []
    for row in rows:
        if not isinstance(row, Mapping | TableRow):
            raise TypeError(
                f"each of rows must be a FrameMotion, a FrameRecord or a mapping, got "
                f"{type(row).__name__}; use blurmatte.measure_clip(frames)"
            )
        units |= {} if isinstance(row, Mapping) else {one.name: one.unit for one in row.columns}
        flat.append(row if isinstance(row, Mapping) else row.numbers())
    table = pandas.DataFrame.from_records(flat_rows(flat))
    table.attrs["units"] = {name: unit for name, unit in units.items() if unit}
    return table


def to_xarray(thing: LinearImage | Layer | Solution) -> Any:
    """A picture, a layer or a solution as labeled arrays of xarray.

    Parameters
    ----------
    thing : LinearImage, Layer or Solution

    Returns
    -------
    xarray.Dataset
        Arrays with the dimensions y, x and channel, whose coordinates are pixels and names of colors;
        each has its `units`. The arrays are views.

    Raises
    ------
    BlurmatteError
        If xarray is not installed.
    TypeError
        For any other type.

    Examples
    --------
    >>> labeled = bm.results.to_xarray(solution)  # doctest: +SKIP
    >>> labeled["alpha"].dims  # doctest: +SKIP
    ('y', 'x')
    """
    match thing:
        case LinearImage():
            maps = {"rgb": thing.rgb, "valid": thing.valid}
            maps |= {} if thing.noise is None else {"variance": thing.variance}
        case Layer():
            maps = {"alpha": thing.alpha, "premultiplied": thing.premultiplied}
        case Solution():
            names = "alpha", "alpha_std", "premultiplied", "premultiplied_std", "quality"
            maps = {name: getattr(thing, name) for name in names}
        case _:
            raise TypeError(
                f"thing must be a LinearImage, a Layer or a Solution, got {type(thing).__name__}"
            )
    xarray = optional_library(
        "xarray", "pip install xarray; to_xarray makes labeled arrays of xarray"
    )
    width, height = thing.size
    labels = {"y": np.arange(height), "x": np.arange(width), "channel": _CHANNELS}
    arrays = {
        name: (tuple(labels)[: values.ndim], values, _UNIT if values.dtype.kind == "f" else {})
        for name, values in maps.items()
    }
    dataset = xarray.Dataset(arrays, labels)
    for axis in ("y", "x"):
        dataset[axis].attrs["units"] = "px"
    return dataset

"""Tables of pandas and labeled arrays of xarray; neither is needed for anything else."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from blurmatte.errors import BlurmatteError
from blurmatte.files.documents import flat_rows
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.motion.columns import TableRow
from blurmatte.radiometry import LinearImage

_CHANNELS = ["red", "green", "blue"]
_UNIT = {"units": "1"}  # of alpha, and of light: white is 1


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
    pandas = _package("pandas", "to_table makes a table of pandas")
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
    xarray = _package("xarray", "to_xarray makes labeled arrays of xarray")
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


def _package(name: str, reason: str) -> Any:
    """A package that is imported when it is needed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BlurmatteError(f"pip install {name}; {reason}") from error

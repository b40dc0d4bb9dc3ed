"""Pictures, layers, solutions, fitted models and tables to files, atomically.

Light is clipped only for integer formats. The same input gives the same bytes.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.checks import AnyArray, Codes8, Floats, as_array, strips
from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError, optional_library
from blurmatte.files.atomic import ending_of, moved_together, replacing
from blurmatte.files.documents import flat_rows, mapping_to_json, rows_to_csv, rows_to_json
from blurmatte.files.exif import ColorSpace
from blurmatte.files.exr import exr_parts
from blurmatte.files.models import model_to_json, noise_to_mapping, transfer_to_mapping
from blurmatte.files.raster_writing import save_jpeg, save_pixels
from blurmatte.files.solutions import (
    CHANNELS,
    save_stack,
    solution_header,
    solution_maps,
    solution_parts,
    solution_text,
)
from blurmatte.files.trackers import tracker_formats
from blurmatte.intrinsics import Intrinsics
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.noise_model import NoiseModel
from blurmatte.radiometry.transfer import SRGB, Transfer
from blurmatte.trajectory import PointSpread

Writable = (
    LinearImage
    | Layer
    | Solution
    | PointSpread
    | ColorModel
    | Intrinsics
    | NoiseModel
    | NoiseFit
    | Transfer
    | ResponseFit
    | Mapping[str, Any]
    | Sequence[Mapping[str, Any]]
    | str
    | Floats
    | Codes8
)
_Writer = Callable[[Path], None]
Parts = tuple[AnyArray, AnyArray]

_SRGB = {"oiio:ColorSpace": "srgb_rec709_scene"}
_LINEAR = {"oiio:ColorSpace": "lin_rec709_scene"}


def write(
    path: str | Path,
    thing: Writable,
) -> None:
    """Write to a file in the format of its extension.

    ================  ================================================================
    LinearImage       .png .tif (16 bit sRGB), .jpg (8 bit sRGB), .exr (linear float); only
                      the EXR keeps the variance and the valid pixels
    Layer             .png (16 bit, straight), .tif (16 bit, premultiplied), .exr
    Solution          .exr, with all fields; .tif, a stack of 32-bit floats of its maps, with names
                      that ImageJ shows
    PointSpread       .exr .tif (float, channels weight and std), .csv, a row for each pixel
    ColorModel        .json
    Intrinsics        .json; NoiseModel and NoiseFit as well
    Transfer          .json, as a table; of a ResponseFit with errors and diagnostics
    mapping           .json, numbers that are not finite become null; .csv, one row, if it is flat
    mappings          .csv, .json, or .parquet (needs the `tables` extra): rows of one table, all with
                      the same names; rows of a clip also as .napari.csv, .trackmate.xml,
                      .kinovea.txt and .tracker.txt
    str               .toml, unchanged
    (H, W) float      .png (16 bit gray, 0…1, not encoded), e.g. alpha
    (H, W, 3) uint8   .png .jpg, unchanged: code values of sRGB
    ================  ================================================================

    Pictures and layers of a camera RAW are written as sRGB, white balanced as shot; an EXR stores the
    inverse, which `read` applies. The numbers of a Solution stay in camera colors.

    Parameters
    ----------
    path : str or Path
        The target. An existing file is replaced by a complete file only.
    thing
        One of these.

    Raises
    ------
    FileError
        If the extension does not fit, or the file cannot be written.
    TypeError, ValueError
        If the object cannot be written in any format.

    Examples
    --------
    >>> bm.write("over.png", layer.over(plate))
    >>> bm.write("ball.exr", layer)
    """
    target, writers = Path(path), _writers(as_array("thing", thing))
    if (extension := ending_of(target, writers)) is None:
        formats = " or ".join(writers)
        raise FileError(f"{path}: change the extension; {_kind(thing)} is written as {formats}")
    with replacing(target, extension) as temporary:
        writers[extension](temporary)


def write_together(folder: str | Path, things: Mapping[str, Any]) -> list[Path]:
    """Write objects into a folder, all or none of them.

    If the program is stopped while they move, the last one is missing, and a file that is called like
    it, with `.incomplete` at the end, stays until they are written again.

    folder: created if it does not exist.
    things: from file names, which may contain folders, to objects that `write` accepts.

    Raises FileError if one of them cannot be written. Files that existed before do not change then.
    """
    folder = Path(folder)
    with moved_together(folder) as (temporary, names):
        for name, thing in things.items():
            (temporary / name).parent.mkdir(parents=True, exist_ok=True)
            write(temporary / name, thing)
            names.append(name)
    return [folder / name for name in things]


def _kind(thing: object) -> str:
    if isinstance(thing, np.ndarray):
        return f"an array of {thing.dtype}"
    return f"a {type(thing).__name__}"


def _writers(thing: object) -> Mapping[str, _Writer]:
    """The formats of an object, by extension."""
    match thing:
        case LinearImage():
            return _image_writers(thing)
        case Layer():
            return _layer_writers(thing)
        case Solution():
            tags = _LINEAR | solution_header(thing)
            return {
                ".exr": lambda path: save_pixels(path, solution_parts(thing), CHANNELS, tags),
                ".tif": lambda path: save_stack(path, solution_maps(thing), solution_text(thing)),
            }
        case PointSpread():
            return _spread_writers(thing)
        case ColorModel():
            return {".json": lambda path: _save_text(path, model_to_json(thing) + "\n")}
        case Intrinsics():
            return _writers(vars(thing))  # `read_intrinsics` reads all of it
        case NoiseModel() | NoiseFit():
            return _writers(noise_to_mapping(thing))
        case Transfer() | ResponseFit():
            return {".json": _writers(transfer_to_mapping(thing))[".json"]}
        case Mapping():
            return {
                ".json": lambda path: _save_text(path, mapping_to_json(thing) + "\n"),
                ".csv": lambda path: _save_text(path, rows_to_csv([thing])),
            }
        case [Mapping(), *_]:
            rows: Sequence[Mapping[str, Any]] = thing  # type: ignore[assignment]
            return {
                ".csv": lambda path: _save_text(path, rows_to_csv(rows)),
                ".json": lambda path: _save_text(path, rows_to_json(rows) + "\n"),
                ".parquet": lambda path: _save_parquet(path, rows),
                **{end: _text_writer(text) for end, text in tracker_formats(rows).items()},
            }
        case str():
            return {".toml": lambda path: _save_text(path, thing)}
        case np.ndarray() if thing.ndim == 2 and thing.dtype.kind == "f":
            return {".png": lambda path: save_pixels(path, [_stored(thing)], "Y", _LINEAR)}
        case np.ndarray() if thing.ndim == 3 and thing.shape[2] == 3 and thing.dtype == np.uint8:
            return {
                ".png": lambda path: save_pixels(path, [thing], "RGB", _SRGB),
                ".jpg": lambda path: save_jpeg(path, thing),
            }
        case np.ndarray():
            raise TypeError(
                "an array must be (height, width) floats or (height, width, 3) uint8, "
                f"got {thing.shape} {thing.dtype}"
            )
    raise TypeError(f"{_kind(thing)} cannot be written")


def _image_writers(image: LinearImage) -> Mapping[str, _Writer]:
    time = image.meta.exposure_time
    tags = {"ExposureTime": time} if time else {}
    light = image.in_srgb().rgb

    def save_codes(path: Path) -> None:
        """Write 16-bit code values."""
        save_pixels(path, [_encoded(light)], "RGB", _SRGB | tags)

    def save_light(path: Path) -> None:
        """Write linear light."""
        parts, names, attributes = exr_parts(image)
        save_pixels(path, parts, names, {**_LINEAR, **tags, **attributes})

    return {
        ".png": save_codes,
        ".tif": save_codes,
        ".jpg": lambda path: save_jpeg(path, _encoded(light, np.uint8), time),
        ".exr": save_light,
    }


def _layer_writers(layer: Layer) -> Mapping[str, _Writer]:
    straight = {"oiio:UnassociatedAlpha": 1}
    writers = {
        ".png": lambda path: save_pixels(path, _straight(layer), "RGBA", _SRGB | straight),
        ".tif": lambda path: save_pixels(path, _associated(layer), "RGBA", _SRGB),
        ".exr": lambda path: save_pixels(path, [layer.premultiplied, layer.alpha], "RGBA", _LINEAR),
    }
    if layer.only_adds_light:  # code values times an alpha of 0 have no light

        def save_light(path: Path) -> None:
            """The light over black."""
            save_pixels(path, [_encoded(layer.premultiplied)], "RGB", _SRGB)

        writers |= {".png": save_light, ".tif": save_light}
    return writers


def _spread_writers(spread: PointSpread) -> Mapping[str, _Writer]:
    parts = [np.dstack([spread.weight, spread.std]).astype(np.float32)]

    def save_maps(path: Path) -> None:
        """Both maps as channels."""
        tags = {"Exif:ColorSpace": int(ColorSpace.UNCALIBRATED)}
        save_pixels(path, parts, ("weight", "std"), tags)

    rows = spread.rows
    return {
        ".exr": save_maps,
        ".tif": save_maps,
        ".csv": lambda path: _save_text(path, rows_to_csv(rows)),
    }


def _text_writer(text: Callable[[], str]) -> _Writer:
    """What writes a text that is made then."""
    return lambda path: _save_text(path, text())


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def require_parquet() -> None:
    """Raise FileError if pyarrow is not installed, before hours of work."""
    needed = 'pip install "blurmatte[tables]"; .parquet needs pyarrow'
    optional_library("pyarrow.parquet", needed, FileError)


def _save_parquet(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    require_parquet()
    from pyarrow import Table
    from pyarrow.parquet import write_table

    write_table(Table.from_pylist(flat_rows(rows)), path)


def _encoded(light: Floats, dtype: type[np.unsignedinteger[Any]] = np.uint16) -> AnyArray:
    """Integer sRGB code values of linear light; strip by strip, to save memory."""
    codes = np.empty(light.shape, dtype)
    for strip in strips(len(light)):
        black = not light[strip].any()  # most of a layer
        codes[strip] = 0 if black else _stored(SRGB.encode(light[strip]), dtype)
    return codes


def _stored(values: Floats, dtype: type[np.unsignedinteger[Any]] = np.uint16) -> AnyArray:
    """0…1 as integers, clipped and rounded."""
    if np.isnan(values).any():
        raise ValueError("use .exr or replace NaN; an integer file cannot hold it")
    top = np.iinfo(dtype).max
    return np.rint(np.clip(values, 0, 1) * top).astype(dtype)


def _straight(layer: Layer) -> Parts:
    return _encoded(layer.straight()), _stored(layer.alpha)


def _associated(layer: Layer) -> Parts:
    """In a TIFF code values, not light, are multiplied by alpha."""
    straight, alpha = _straight(layer)
    return np.rint(straight * (alpha[..., None] / 65535)).astype(np.uint16), alpha

"""Pictures, layers, solutions, color models and curves to files that other programs open.

Light is encoded once, here, and clipped only for integers. A file is there whole or not at all: it
is written beside its target under another name and then renamed. The same input gives the same
bytes.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.camera import camera_header
from blurmatte.files.intrinsics import intrinsics_to_mapping
from blurmatte.files.models import (
    flat_rows,
    mapping_to_csv,
    mapping_to_json,
    model_to_json,
    rows_to_csv,
    rows_to_json,
)
from blurmatte.files.noise import noise_to_mapping
from blurmatte.files.pixels import save_jpeg, save_pixels
from blurmatte.files.plates import light_parts
from blurmatte.files.replacing import extension_of, replacing
from blurmatte.files.solutions import CHANNELS, solution_header, solution_parts
from blurmatte.files.transfers import transfer_to_json
from blurmatte.intrinsics import Intrinsics
from blurmatte.layer import Layer
from blurmatte.matting import Solution
from blurmatte.radiometry import (
    SRGB,
    LinearImage,
    NoiseFit,
    NoiseModel,
    ResponseFit,
    Transfer,
)

Way = Callable[[Path], None]
Parts = tuple[npt.NDArray[Any], npt.NDArray[Any]]

_SRGB = {"oiio:ColorSpace": "srgb_rec709_scene"}
_LINEAR = {"oiio:ColorSpace": "lin_rec709_scene"}
_TOP = 65535


def write(
    path: str | Path,
    thing: LinearImage
    | Layer
    | Solution
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
    | npt.NDArray[np.uint8],
) -> None:
    """Write to a file whose ending says how.

    ================  ================================================================
    LinearImage       .png .tif (16 bit sRGB), .jpg (8 bit sRGB), .exr (linear float); the
                      EXR alone keeps its variance and which pixels are valid
    Layer             .png (16 bit, straight), .tif (16 bit, premultiplied), .exr
    Solution          .exr, everything in it
    ColorModel        .json
    Intrinsics        .json
    NoiseModel        .json, and so is a NoiseFit
    Transfer          .json, as a table
    ResponseFit       .json: its transfer, the error of it, and what was found
    mapping           .json, numbers that are not finite become null; .csv, one row, if it is flat
    mappings          .csv, .json, or .parquet (needs the `tables` extra): rows of one table, all with
                      the same names
    str               .toml, as is
    (H, W) float      .png (16 bit gray, 0…1, not encoded), e.g. alpha
    (H, W, 3) uint8   .png .jpg, as is: already sRGB
    ================  ================================================================

    Pictures and layers of a camera RAW are written as sRGB, white balanced as shot; an EXR notes how to
    get back to the camera's colors, and `read` does. The numbers of a Solution stay in these.

    Parameters
    ----------
    path : str or Path
        The target. What is there is replaced, but only by a whole file.
    thing
        What to write.

    Raises
    ------
    FileError
        If the ending does not fit, or the file cannot be written.
    TypeError, ValueError
        If there is no way to write such a thing at all.
    """
    target = Path(path)
    ways = _ways(thing)
    extension = extension_of(target)
    if extension not in ways:
        raise FileError(
            f"{path}: {_called(thing)} is written as {' or '.join(ways)}; change the ending"
        )
    with replacing(target, extension) as temporary:
        ways[extension](temporary)


def _ways(thing: object) -> Mapping[str, Way]:
    """What can be made of `thing`, by extension."""
    match thing:
        case LinearImage():
            return _image_ways(thing)
        case Layer():
            return _layer_ways(thing)
        case Solution():
            return {".exr": lambda path: _save_solution(path, thing)}
        case ColorModel():
            return {".json": lambda path: _save_text(path, model_to_json(thing) + "\n")}
        case Intrinsics():
            return _ways(intrinsics_to_mapping(thing))
        case NoiseModel() | NoiseFit():
            return _ways(noise_to_mapping(thing))
        case Transfer() | ResponseFit():
            return {".json": lambda path: _save_text(path, transfer_to_json(thing) + "\n")}
        case Mapping():
            return {
                ".json": lambda path: _save_text(path, mapping_to_json(thing) + "\n"),
                ".csv": lambda path: _save_text(path, mapping_to_csv(thing)),
            }
        case [Mapping(), *_]:
            rows: Sequence[Mapping[str, Any]] = thing  # type: ignore[assignment]
            return {
                ".csv": lambda path: _save_text(path, rows_to_csv(rows)),
                ".json": lambda path: _save_text(path, rows_to_json(rows) + "\n"),
                ".parquet": lambda path: _save_parquet(path, rows),
            }
        case str():
            return {".toml": lambda path: _save_text(path, thing)}
        case np.ndarray() if thing.ndim == 2 and thing.dtype.kind == "f":
            return {".png": lambda path: _save_map(path, thing)}
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
    raise TypeError(f"cannot write a {type(thing).__name__}")


def _called(thing: object) -> str:
    if isinstance(thing, np.ndarray):
        return f"an array of {thing.dtype}"
    return f"a {type(thing).__name__}"


def _image_ways(image: LinearImage) -> Mapping[str, Way]:
    time = image.meta.exposure_time
    tags = {"ExposureTime": time} if time else {}
    seen, camera = image.in_srgb().rgb, camera_header(image.meta)

    def coded(path: Path) -> None:
        save_pixels(path, [_encoded(seen)], "RGB", _SRGB | tags)

    return {
        ".png": coded,
        ".tif": coded,
        ".jpg": lambda path: save_jpeg(path, _encoded(seen, np.uint8), time),
        ".exr": lambda path: _save_light(path, image, _LINEAR | tags | camera),
    }


def _save_light(path: Path, image: LinearImage, tags: Mapping[str, Any]) -> None:
    parts, names, mark = light_parts(image)
    save_pixels(path, parts, names, {**tags, **mark})


def _layer_ways(layer: Layer) -> Mapping[str, Way]:
    straight = {"oiio:UnassociatedAlpha": 1}
    return {
        ".png": lambda path: save_pixels(path, _straight(layer), "RGBA", _SRGB | straight),
        ".tif": lambda path: save_pixels(path, _associated(layer), "RGBA", _SRGB),
        ".exr": lambda path: save_pixels(path, [layer.premultiplied, layer.alpha], "RGBA", _LINEAR),
    }


def _save_solution(path: Path, solution: Solution) -> None:
    tags = _LINEAR | solution_header(solution)
    save_pixels(path, solution_parts(solution), CHANNELS, tags)


def _save_map(path: Path, values: Floats) -> None:
    save_pixels(path, [_stored(values)], "Y", _LINEAR)


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _save_parquet(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    try:
        from pyarrow import Table
        from pyarrow.parquet import write_table
    except ImportError as error:
        raise FileError('.parquet needs pyarrow: pip install "blurmatte[tables]"') from error
    write_table(Table.from_pylist(flat_rows(rows)), path)


def _encoded(light: Floats, dtype: type[np.unsignedinteger[Any]] = np.uint16) -> npt.NDArray[Any]:
    """Integer sRGB codes of linear light; row by row, for the curve needs room for its floats."""
    codes = np.empty(light.shape, dtype)
    for row in range(0, len(light), 64):
        strip = np.s_[row : row + 64]
        codes[strip] = _stored(SRGB.encode(light[strip]), dtype)
    return codes


def _stored(values: Floats, dtype: type[np.unsignedinteger[Any]] = np.uint16) -> npt.NDArray[Any]:
    """0…1 as integers, clipped and rounded."""
    if np.isnan(values).any():
        raise ValueError("NaN cannot be written to an integer file; use .exr or fill it")
    top = np.iinfo(dtype).max
    return np.rint(np.clip(values, 0, 1) * top).astype(dtype)


def _straight(layer: Layer) -> Parts:
    return _encoded(layer.straight()), _stored(layer.alpha)


def _associated(layer: Layer) -> Parts:
    """TIFF multiplies code values, not light, by alpha."""
    straight, alpha = _straight(layer)
    return np.rint(straight * (alpha[..., None] / _TOP)).astype(np.uint16), alpha

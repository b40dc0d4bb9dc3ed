"""Checks of arguments: kinds, shapes, sizes, finite values; types of arrays, and boxes of pixels.

Called by constructors and public functions only; internal functions do not check their input.
Sizes are (width, height); shapes are NumPy's (height, width, ...).
"""

from collections.abc import Iterable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]
Floats32 = npt.NDArray[np.float32]
Ints32 = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]
Codes8 = npt.NDArray[np.uint8]
Codes = Codes8 | npt.NDArray[np.uint16]  # code values of files
Box = tuple[int, int, int, int]  # (x0, y0, x1, y1) pixels; x1 and y1 are one past the last
Direction = Literal["right", "down", "left", "up"]
# Unit vectors (x, y) of the picture
DIRECTIONS: Mapping[Direction, tuple[int, int]] = {
    "right": (1, 0),
    "down": (0, 1),
    "left": (-1, 0),
    "up": (0, -1),
}
MAX_PX = 1e6  # of places and lengths that are read
MAX_LIGHT = 1e6  # 1 is white; its sixth power occurs in errors, and float32 holds 3e38


def rows_columns(box: Sequence[int], whole: Sequence[int] = (0, 0)) -> tuple[slice, slice]:
    """A box as slices of an array, which begins at (x, y, ...) of the picture."""
    (x, y), (x0, y0, x1, y1) = whole[:2], box
    return slice(y0 - y, y1 - y), slice(x0 - x, x1 - x)


def enclosing(boxes: Iterable[Box]) -> Box:
    """The smallest box around one or more boxes."""
    x0, y0, x1, y1 = zip(*boxes, strict=True)
    return int(min(x0)), int(min(y0)), int(max(x1)), int(max(y1))


def as_array(name: str, value: object) -> Any:
    """An array as NumPy's compiled loops take it: this processor's byte order, 32 or 64-bit floats.

    Objects with `__array__`, such as tensors and labeled arrays, are converted; half floats become
    32-bit, and long doubles 64-bit floats. What is no array, such as a list, is returned as it is.

    Raises
    ------
    TypeError
        For masked arrays, whose mask would be lost, and arrays of objects.
    """
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(
            f"{name} must be an array without a mask; give {name}.filled(0), and "
            f"valid=~np.ma.getmaskarray({name}).any(axis=-1) to LinearImage"
        )
    if not isinstance(value, np.ndarray):
        if not hasattr(value, "__array__") or isinstance(value, np.generic):
            return value
        value = np.asarray(value)
    if value.dtype.kind == "O":
        raise TypeError(f"{name} must be an array of numbers, got an array of objects")
    if value.dtype.kind == "f" and value.dtype.itemsize not in (4, 8):
        return value.astype(np.float32 if value.dtype.itemsize < 4 else np.float64)
    if type(value) is not np.ndarray:  # a subclass has operators of its own
        value = np.asarray(value)
    return value if value.dtype.isnative else value.astype(value.dtype.newbyteorder("="))


def check_kind(name: str, value: object, kinds: type | UnionType, hint: str) -> None:
    """Raise TypeError unless `value` is of one of the types; the hint names its constructor."""
    if not isinstance(value, kinds):
        of = kinds.__args__ if isinstance(kinds, UnionType) else (kinds,)
        names = " or ".join(kind.__name__ for kind in of if kind is not NoneType)
        raise TypeError(f"{name} must be a {names}, got {type(value).__name__}; {hint}")


def check_direction(name: str, value: object) -> None:
    """Raise ValueError unless it is the name of a direction in the picture."""
    if value not in get_args(Direction):
        known = ", ".join(get_args(Direction))
        raise ValueError(f"{name} must be one of {known}, got {value!r}")


def check_box(box: Box, size: tuple[int, int]) -> None:
    """Raise unless a box (x0, y0, x1, y1) is not empty and begins in a picture of this size."""
    x0, y0, x1, y1 = box
    if not (0 <= x0 < min(x1, size[0]) and 0 <= y0 < min(y1, size[1])):
        raise ValueError(
            "a box must be (x0, y0, x1, y1) with x0 < x1 and y0 < y1, and begin in the picture of "
            f"{size[0]}x{size[1]} pixels, got {box}"
        )


def check_light(name: str, value: object) -> None:
    """Raise unless `value` is an (H, W, 3) float array."""
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array of linear light, got {type(value).__name__}")
    if value.dtype.kind != "f":
        raise TypeError(
            f"{name} must hold linear light as floats, got {value.dtype}; "
            "decode code values first, e.g. with blurmatte.SRGB.decode(codes / 255)"
        )
    if value.ndim != 3 or value.shape[2] != 3 or value.size == 0:
        raise ValueError(f"{name} must have the shape (height, width, 3), got {value.shape}")


def check_map(name: str, value: object, shape: tuple[int, ...], kinds: str = "f") -> None:
    """Raise unless `value` is an array of `shape` whose dtype kind is one of `kinds`."""
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array, got {type(value).__name__}")
    if value.dtype.kind not in kinds:
        raise TypeError(f"{name} must have a dtype of kind {kinds!r}, got {value.dtype}")
    if value.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, got {value.shape}")


def check_points(name: str, value: npt.ArrayLike, columns: int) -> npt.NDArray[np.float64]:
    """Points as floats; raises ValueError unless the last axis has `columns` coordinates."""
    points = np.asarray(value, dtype=float)
    if points.ndim == 0 or points.shape[-1] != columns:
        raise ValueError(f"{name} must have the shape (..., {columns}), got {points.shape}")
    return points


def check_finite(name: str, value: Floats, limit: float = MAX_LIGHT) -> None:
    """Raise if `value` holds NaN, infinite numbers, or some beyond ± `limit`."""
    least, most = np.min(value), np.max(value)
    if not (np.isfinite(least) and np.isfinite(most)):
        raise ValueError(
            f"{name} must be finite; replace missing values by any number and mark them in `valid`"
        )
    if max(-least, most) > limit:
        raise ValueError(
            f"{name} must not exceed {limit:g} (1 is white), got {max(-least, most):.3g}; scale it, or "
            "replace such values and mark them in `valid`"
        )


def check_positive(name: str, value: float, unit: str = "") -> None:
    """Raise ValueError unless a number is finite and above 0."""
    if not (np.isfinite(value) and value > 0):
        must = f"a positive number of {unit}" if unit else "finite and above 0"
        raise ValueError(f"{name} must be {must}, got {value}")


def check_not_negative(name: str, value: float) -> None:
    """Raise ValueError unless a number is finite and 0 or more."""
    if not (np.isfinite(value) and value >= 0):
        raise ValueError(f"{name} must be finite and not negative, got {value}")


def check_same_size(first: str, a: tuple[int, int], second: str, b: tuple[int, int]) -> None:
    """Raise unless the sizes (width, height) of two named pictures agree."""
    if a != b:
        raise ValueError(
            f"{first} is {a[0]}x{a[1]} pixels and {second} {b[0]}x{b[1]}; "
            "they must show the same scene at the same size"
        )

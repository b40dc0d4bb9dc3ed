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
Ints = npt.NDArray[np.integer[Any]]  # of any size
Ints16 = npt.NDArray[np.int16]
Ints32 = npt.NDArray[np.int32]
Ints64 = npt.NDArray[np.int64]
Indices = npt.NDArray[np.intp]
AnyArray = npt.NDArray[Any]  # of numbers of any type
Bools = npt.NDArray[np.bool_]
Codes8 = npt.NDArray[np.uint8]
Codes16 = npt.NDArray[np.uint16]
Codes32 = npt.NDArray[np.uint32]
Codes = Codes8 | Codes16  # code values of files
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
MAX_GAIN = 1e3  # of a white balance, and from a channel of a camera to one of sRGB
MAX_LIGHT = 1e6  # 1 is white; its sixth power occurs in errors, and float32 holds 3e38
_STRIP_ROWS = 64  # of a picture, that are converted at a time: saves memory
# What an object shows its numbers with; NumPy takes the first.
_ARRAY_DOORS = "__array__", "__array_interface__", "__dlpack__"
_CPU, _PINNED = 1, (3, 11)  # kinds of memory in DLPack; pinned is main memory that GPUs also reach


def rows_columns(box: Sequence[int], whole: Sequence[int] = (0, 0)) -> tuple[slice, slice]:
    """A box as slices of an array, which begins at (x, y, ...) of the picture."""
    (x, y), (x0, y0, x1, y1) = whole[:2], box
    return slice(y0 - y, y1 - y), slice(x0 - x, x1 - x)


def box_of(mask: Bools) -> Box:
    """The bounding box of the True pixels, of which there is one at least."""
    y, x = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return int(x[0]), int(y[0]), int(x[-1]) + 1, int(y[-1]) + 1


def grown(box: Box, margin: int, size: tuple[int, int]) -> Box:
    """A box with a margin on each side, cut at the border of a picture of a size (width, height)."""
    return box_from(np.subtract(box[:2], margin), np.add(box[2:], margin), size)


def box_from(first: Array, end: Array, size: tuple[int, int]) -> Box:
    """A box from (x, y) to another, one past its last pixel, cut at the border of a picture."""
    x0, y0 = np.maximum(first, 0).astype(int).tolist()
    x1, y1 = np.minimum(end, size).astype(int).tolist()
    return x0, y0, x1, y1


def enclosing(boxes: Iterable[Box]) -> Box:
    """The smallest box around one or more boxes."""
    x0, y0, x1, y1 = zip(*boxes, strict=True)
    return int(min(x0)), int(min(y0)), int(max(x1)), int(max(y1))


def strips(rows: int, height: int = _STRIP_ROWS) -> list[slice]:
    """The rows of a picture in strips of a height, which are taken one at a time; the last is lower."""
    return [slice(at, min(at + height, rows)) for at in range(0, rows, height)]


def as_array(name: str, value: object) -> Any:
    """An array as NumPy's compiled loops take it: this processor's byte order, 32 or 64-bit floats.

    All that NumPy can view is taken: arrays of any layout, and objects with `__array__`,
    `__array_interface__` or, in main memory, `__dlpack__`. Half floats become 32-bit, and long doubles
    64-bit floats. What is no array, such as a list, is returned as it is.

    Raises
    ------
    TypeError
        For what would be lost or misread in silence: masks, units, axes whose names say another order
        than (y, x, channel); for arrays on a GPU, and others that NumPy cannot view.
    """
    if isinstance(value, np.ma.MaskedArray):
        filling = False if value.dtype.kind == "b" else 0
        raise TypeError(
            f"{name} must be an array without a mask, which has a meaning only for light and code "
            f"values; give {name}.filled({filling}), and mark such pixels as not valid in LinearImage"
        )
    if isinstance(value, np.generic) or not any(hasattr(value, door) for door in _ARRAY_DOORS):
        return value
    value = _viewed(name, value)
    if value.dtype.kind == "O":
        raise TypeError(f"{name} must be an array of numbers, got an array of objects")
    if value.dtype.kind == "V":
        raise TypeError(
            f"{name} must be an array of numbers as NumPy has them, got {value.dtype}; a bfloat16 has "
            "8 bits, which round light by 0.4 %: give what it was made from, as float32"
        )
    if value.dtype.kind == "f" and value.dtype.itemsize not in (4, 8):
        return value.astype(np.float32 if value.dtype.itemsize < 4 else np.float64)
    return value if value.dtype.isnative else value.astype(value.dtype.newbyteorder("="))


def _viewed(name: str, value: Any) -> AnyArray:
    """What an object shows NumPy; a subclass of arrays has operators of its own, and is none here."""
    if type(value) is np.ndarray:
        return value
    for held in (value, getattr(value, "data", None)):  # a labeled array may hold one with a unit
        _check_unit(name, value, held)
    _check_axes(name, value)
    _check_device(name, value)
    if getattr(value, "requires_grad", False) is True:
        raise TypeError(
            f"{name} is followed by a gradient, which would be lost; give {name}.detach()"
        )
    try:
        if any(hasattr(value, door) for door in _ARRAY_DOORS[:-1]):
            return np.asarray(getattr(value, "magnitude", value))
        return np.from_dlpack(value)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        remedy = f"; give {name}.float()" if "ScalarType" in str(error) else ""  # of torch
        reason = str(error).partition("\n")[0]
        raise TypeError(f"NumPy cannot view {name}: {reason}{remedy}") from None


def _check_unit(name: str, value: Any, held: Any) -> None:
    """Raise TypeError for numbers with a unit, as of pint and astropy."""
    unit = getattr(held, "units", None) or getattr(held, "unit", None)
    if unit is None or str(unit) in ("", "1", "dimensionless"):
        return
    bare = next((at for at in ("magnitude", "value", "values") if hasattr(value, at)), "data")
    raise TypeError(
        f"{name} has the unit {unit}, which would be lost; light is relative, 1 is white: give "
        f"({name} / white).{bare}, or {name}.{bare} if it is so already"
    )


def _check_axes(name: str, value: Any) -> None:
    """Raise TypeError for an array whose named axes are not in the order (y, x, channel)."""
    axes = getattr(value, "dims", None)
    if not isinstance(axes, tuple) or not {"y", "x"} <= set(axes):
        return
    rest = [axis for axis in axes if axis not in ("y", "x")]
    if axes != ("y", "x", *rest):
        order = ", ".join(repr(str(axis)) for axis in ("y", "x", *rest))
        raise TypeError(f"{name} has the axes {axes}; give {name}.transpose({order})")


def _check_device(name: str, value: Any) -> None:
    """Raise TypeError for an array that says that it is not in main memory."""
    try:
        device = value.__dlpack_device__()[0] if hasattr(value, "__dlpack_device__") else _CPU
    except (TypeError, ValueError, RuntimeError, BufferError):  # one that DLPack does not know
        device = None
    if device in (_CPU, *_PINNED):
        return
    copies = {"cpu": f"{name}.cpu()", "get": f"{name}.get()"}  # of torch and CuPy
    copied = next((call for at, call in copies.items() if hasattr(value, at)), None)
    raise TypeError(
        f"{name} is on a GPU or another device, and NumPy works in main memory; give "
        f"{copied or f'jax.device_get({name})'}"
    )


def without_mask(value: object, valid: object = None) -> tuple[Any, Any]:
    """A picture with 0 where it is masked, and where all channels of it are valid.

    What has no mask is returned as it is.
    """
    if not isinstance(value, np.ma.MaskedArray):
        return value, valid
    masked = np.ma.getmaskarray(value)
    seen = ~masked.any(axis=-1) if masked.ndim == 3 else ~masked
    return value.filled(0), seen if valid is None else seen & np.asarray(as_array("valid", valid))


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


def check_light(name: str, value: object) -> Floats:
    """`value` as an (H, W, 3) float array; raises TypeError or ValueError unless it is one."""
    light = as_array(name, value)
    if not isinstance(light, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array of linear light, got {type(light).__name__}")
    if light.dtype.kind != "f":
        raise TypeError(
            f"{name} must hold linear light as floats, got {light.dtype}; "
            "decode code values first, e.g. with blurmatte.SRGB.decode(codes / 255)"
        )
    check_channels(name, light)
    return light


def are_codes(numbers: Floats) -> bool:
    """True if all are whole, with several above 1: code values, not light of which 1 is white.

    One value above 1 may be the clipped light of a lamp.
    """
    middle = numbers[len(numbers) // 2]  # nearly all light is known by one row
    if not (np.array_equal(middle, np.rint(middle)) and np.array_equal(numbers, np.rint(numbers))):
        return False
    above = numbers[numbers > 1]
    return above.size > 0 and bool(above.min() < above.max())


def check_channels(name: str, value: AnyArray) -> None:
    """Raise ValueError unless the shape is (height, width, 3); the usual others have a remedy."""
    shape = value.shape
    if len(shape) == 3 and shape[2] == 3 and value.size:
        return
    remedies = {
        len(shape) == 2: f"of gray, give np.stack(3 * [{name}], axis=-1)",
        shape[:1] in ((3,), (4,)) and len(shape) == 3: (
            f"channels come last, give np.moveaxis({name}, 0, -1)"
        ),
        len(shape) == 3 and shape[2:] == (4,): f"without alpha, give {name}[..., :3]",
        len(shape) == 4: f"of a single picture, give {name}[0]",
    }
    remedy = f"; {remedies[True]}" if True in remedies else ""
    raise ValueError(f"{name} must have the shape (height, width, 3), got {shape}{remedy}")


def check_map(
    name: str, value: object, shape: tuple[int, ...] | None = None, kinds: str = "f"
) -> Any:
    """`value` as an array of `shape`, if one is stated, and of a dtype kind among `kinds`.

    Raises TypeError or ValueError unless it is one.
    """
    values = as_array(name, value)
    if not isinstance(values, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array, got {type(values).__name__}")
    if values.dtype.kind not in kinds:
        what = f"booleans, as {name} > 0" if kinds == "b" else "floats"
        raise TypeError(f"{name} must hold {what}, got {values.dtype}")
    if shape is not None and values.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, got {values.shape}")
    return values


def check_points(name: str, value: npt.ArrayLike, columns: int) -> Array:
    """Points as floats; raises ValueError unless the last axis has `columns` coordinates."""
    points = np.asarray(as_array(name, value), dtype=float)
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

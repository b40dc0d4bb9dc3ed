"""Geometry of video frames: display matrices, the shape of pixels, and fields."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Direction
from blurmatte.errors import FileError

_MAX_TILT = 0.002  # radians off a multiple of 90°: of rounded matrices
_PROGRESSIVE = 1  # FFmpeg's AVFieldOrder; above are interlaced ones, 0 is unknown


@dataclass(frozen=True)
class Orientation:
    """How stored frames become upright: transposed first, then flipped."""

    transposed: bool = False  # true if rows become columns
    # True if the (transposed) frame is flipped along x, along y
    left_right: bool = False
    upside_down: bool = False

    def size(self, frame: Any) -> tuple[int, int]:
        """Width and height of an upright `VideoFrame`."""
        return (frame.height, frame.width) if self.transposed else (frame.width, frame.height)

    @property
    def readout(self) -> Direction:
        """Where the next stored row lies in the upright frame."""
        if self.transposed:
            return "left" if self.left_right else "right"
        return "up" if self.upside_down else "down"

    def upright(self, codes: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """(H, W, …) pixels as they are shown; a view."""
        shown = np.swapaxes(codes, 0, 1) if self.transposed else codes
        return shown[:: -1 if self.upside_down else 1, :: -1 if self.left_right else 1]

    def stored(self, codes: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The inverse of `upright`."""
        codes = codes[:: -1 if self.upside_down else 1, :: -1 if self.left_right else 1]
        return np.swapaxes(codes, 0, 1) if self.transposed else codes


def side_data_of(frame: Any, name: str) -> Any | None:
    """Side data of a `VideoFrame`, by PyAV's name of its type; None if it has none.

    PyAV reads all of a frame and raises ValueError for a type of FFmpeg that it does not know, such as
    EXIF: these types become known, without a name.
    """
    from av.sidedata import sidedata

    types: Any = sidedata.Type
    types._missing_ = classmethod(_unnamed)
    return frame.side_data.get(name)


def _unnamed(kind: Any, value: object) -> Any | None:
    """A member of an enumeration for a number that it does not have; None for other values."""
    if not isinstance(value, int):
        return None
    member = object.__new__(kind)
    member._name_, member._value_ = f"UNKNOWN_{value}", value
    return member


def orientation_of(path: Path, frame: Any) -> Orientation:
    """The orientation that the display matrix of a `VideoFrame` states.

    The matrix (a b u; c d v; x y w) shows the pixel (p, q) at (a p + c q, b p + d q). One of zeros
    states nothing. FFmpeg derives the shape of pixels from its scale.

    Raises FileError if it turns by another angle than a multiple of 90°, shears or distorts.
    """
    stated = side_data_of(frame, "DISPLAYMATRIX")
    if stated is None:
        return Orientation()
    a, b, u, c, d, v, *_ = struct.unpack("9i", bytes(stated)[:36])
    rows = np.array([[a, b], [c, d]], float)
    if not rows.any():
        return Orientation()
    axes = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1)
    signs = np.rint(axes)
    if u or v or np.abs(axes - signs).max() > _MAX_TILT or abs(np.linalg.det(signs)) != 1:
        angle = np.degrees(np.arctan2(b, a))
        raise FileError(
            f"{path}: export it upright; its display matrix turns by {angle:.1f}°, shears or distorts "
            "frames, and only mirroring and multiples of 90° are applied"
        )
    (a, b), (c, d) = signs
    return Orientation(not a, min(a, c) < 0, min(b, d) < 0)


def check_progressive(path: Path, frame: Any, field_order: int) -> None:
    """Raise FileError if a `VideoFrame`, or the order of fields of its stream, is interlaced."""
    if frame.interlaced_frame or field_order > _PROGRESSIVE:
        raise FileError(
            f"{path}: deinterlace it (ffmpeg -i … -vf bwdif), or mark it as progressive if it is (-vf "
            "setfield=prog); its frames are interlaced: two fields, half a frame apart in time"
        )

"""Geometry of video frames: display matrices, shape of pixels, fields, place of subsampled chroma.

Between two materials chroma C is a linear function of luma L, whether the edge is sharp or out of
focus. With C and L averaged alike, and δ the position of a chroma sample from the middle of the luma
samples that share it, C ≈ a + b (L + δ L′). In each window a, b and δ are fitted by least squares;
windows share δ, and its error is that of their scatter (a sandwich estimate). With the chroma of a
plate instead of L, its whole texture determines δ. `background.camera_motion` compares pictures of the
same light; a and b differ between materials.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import Array
from blurmatte.errors import FileError
from blurmatte.radiometry.coded import filter_graph
from blurmatte.radiometry.sensor import Orientation

_MAX_TILT = 0.002  # radians off a multiple of 90°: of rounded matrices
_PROGRESSIVE = 1  # FFmpeg's AVFieldOrder; above are interlaced ones, 0 is unknown

# How certain the position of chroma must be.
_WINDOW = 6  # samples: two materials in most
_MIN_R2 = 0.8  # of chroma as a linear function of luma and its slope, in a window
_CODE_STD = 0.3  # of rounding, added to the residuals of windows
_MIN_WINDOWS = 10.0  # effective number
_MIN_DEVIATION = 4.0  # standard deviations off the other position
_MAX_STD_PX = 0.1  # of luma
_MAX_OFF_PX = 0.25  # half the distance of the positions


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


def siting_of(frame: Any) -> str | None:
    """Where the edges in a `VideoFrame` show that chroma lies, in FFmpeg's words.

    At the first of two columns, "left", or between them, "center"; of two rows at the first, "topleft"
    and "top"; "" if the edges do not show it, None if columns do not share chroma.
    """
    by_two = _shared_by_two(frame)
    if not by_two[1]:
        return None
    luma, chroma = _planes(frame, by_two)
    left, top = (_at_first(_window_sums([luma] * 2, list(chroma), axis, 2)) for axis in (1, 0))
    return _name(left, by_two[0] and top is True)


def siting_against(seen: Sequence[Array], plate: Sequence[Array]) -> str:
    """Where chroma lies by a plate: `seen` (n, H, W) is that of a frame decoded as "left"."""
    left = _at_first(_window_sums(plate, seen, 1, 1), -0.5)
    return _name(left, _at_first(_window_sums(plate, seen, 0, 1)) is True)


def _name(left: bool | None, top: bool) -> str:
    if left is None:
        return ""
    return ("topleft" if left else "top") if top else "left" if left else "center"


def with_siting(frame: Any, siting: str | None) -> Any:
    """The frame, marked as having its chroma there; else as `left_sited`."""
    return _marked(frame, siting) if siting else left_sited(frame)


def _shared_by_two(frame: Any) -> tuple[bool, bool]:
    """True where two rows, and where two columns share chroma, in planes that can be read here."""
    form = frame.format
    if form.is_rgb or not form.is_planar or form.is_big_endian or len(frame.planes) < 3:
        return False, False
    halves = (
        form.chroma_height(frame.height) == -(-frame.height // 2),
        form.chroma_width(frame.width) == -(-frame.width // 2),
    )
    return halves[0], halves[1]


def _planes(frame: Any, by_two: tuple[bool, bool]) -> tuple[Array, Array]:
    """(h, w) luma, averaged over the pixels that share chroma, and (2, h, w) chroma, as 8 bits."""
    bits = frame.format.components[0].bits
    kind, scale = np.uint8 if bits <= 8 else np.uint16, 2.0 ** (8 - bits)
    luma, *chroma = (
        scale * np.frombuffer(plane, kind).reshape(plane.height, -1)[:, : plane.width]
        for plane in frame.planes[:3]
    )
    if by_two[0]:
        luma = (luma[:-1:2] + luma[1::2]) / 2
    luma = (luma[:, :-1:2] + luma[:, 1::2]) / 2
    h, w = luma.shape
    return luma, np.stack(chroma)[:, :h, :w]


def _window_sums(luma: Sequence[Array], chroma: Sequence[Array], axis: int, pixels: int) -> Array:
    """(n, 2) numerators and denominators of δ along an axis, in pixels of luma, of each window.

    `pixels` are those of luma in a sample.
    """
    sums = []
    for known, plane in zip(luma, chroma, strict=True):
        smoothed = _smoothed(known)
        slope = (np.roll(smoothed, -1, axis) - np.roll(smoothed, 1, axis)) / (2 * pixels)
        L, C, D = (_windows(a[1:-1, 1:-1]) for a in (smoothed, _smoothed(plane), slope))
        square = np.maximum(_dot(L, L), 1e-9)
        D = D - _dot(D, L) / square * L
        b = _dot(C, L) / square
        rest = C - b * L
        left = _dot(rest, rest) - _dot(rest, D) ** 2 / np.maximum(_dot(D, D), 1e-9)
        weight = 1 / (_CODE_STD**2 + np.maximum(left, 0) / L.shape[1])
        weight = weight * (left < (1 - _MIN_R2) * _dot(C, C))
        sums.append(np.hstack([weight * b * _dot(rest, D), weight * b**2 * _dot(D, D)]))
    return np.asarray(sum(sums))


def _dot(a: Array, b: Array) -> Array:
    """(n, 1) inner product of each window."""
    return np.asarray((a * b).sum(axis=1, keepdims=True))


def _smoothed(plane: Array) -> Array:
    """Binomial mean over 3 x 3 samples, without the outer ones."""
    plane = (plane[:-2] + 2 * plane[1:-1] + plane[2:]) / 4
    return np.asarray((plane[:, :-2] + 2 * plane[:, 1:-1] + plane[:, 2:]) / 4)


def _windows(plane: Array) -> Array:
    """(n, window²) samples of each window, less their mean."""
    side = _WINDOW
    h, w = (count // side * side for count in plane.shape)
    rows = plane[:h, :w].reshape(h // side, side, w // side, side)
    tiles = rows.swapaxes(1, 2).reshape(-1, side**2)
    return np.asarray(tiles - tiles.mean(axis=1, keepdims=True))


def _at_first(sums: Array, middle: float = 0.0) -> bool | None:
    """True if δ less `middle` is that of the first of two pixels, False if 0, None if uncertain."""
    n, d = sums.T
    if not d.sum() ** 2 > _MIN_WINDOWS * (d**2).sum():
        return None
    offset = n.sum() / d.sum()
    std = np.sqrt(((n - offset * d) ** 2).sum()) / d.sum()
    offset += middle
    here, other = (-0.5, 0.0) if offset < -0.25 else (0.0, -0.5)
    certain = std < _MAX_STD_PX and abs(offset - other) > _MIN_DEVIATION * std
    return here < 0 if certain and abs(offset - here) < _MAX_OFF_PX else None


def left_sited(frame: Any) -> Any:
    """The frame, marked as having its chroma at the left column if it is 4:2:2 [BT.601].

    Decoders of MPEG and JPEG state the position, and FFmpeg uses it. Those of ProRes, DNxHD and
    uncompressed video do not, and FFmpeg would assume a position between the columns. JPEG's chroma,
    of full range, is between them.
    """
    from av.video.reformatter import ColorRange

    width, height = frame.width, frame.height
    half = frame.format.chroma_width(width) < width, frame.format.chroma_height(height) < height
    if half != (True, False) or frame.color_range == ColorRange.JPEG:
        return frame
    return _marked(frame, "left")


def _marked(frame: Any, siting: str) -> Any:
    graph = filter_graph(frame, ("setparams", f"chroma_location={siting}"))
    graph.push(frame)
    return graph.pull()

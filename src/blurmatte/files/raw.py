"""Camera RAW to the light that the sensor saw, in the colors of the camera.

LibRaw decodes the file (rawpy, the extra `raw`); the light is made here. A sensor sees one color in
each pixel. In this file `mosaic` is what it saw, (H, W), and `pattern` the colors, a tile that repeats:
0 red, 1 green, 2 blue. Light is (mosaic − black) / (white − black), nothing else: no gamma, no white
balance, no color matrix, no repair, and noise below black stays negative.

The other two colors of a pixel are interpolated linearly (`demosaic` says why), so a pixel's noise is
known, and a clipped pixel spoils only its neighbors. LibRaw's own development is not used: its linear
interpolation is the same, but it cuts off below black, which makes dark light brighter than it was,
and rounds.
"""

import math
import os
import struct
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.errors import FileError
from blurmatte.files.raster import MAX_PIXELS, upright
from blurmatte.files.refusals import check_size
from blurmatte.radiometry import LinearImage, Matrix3, Meta, NoiseModel
from blurmatte.radiometry.mosaic import Pattern, demosaic, sees_all_colors, tiled, variance_shares

Mosaic = npt.NDArray[np.uint16]
Tags = Mapping[int, Any]

_PHOTOMETRIC, _MAKE, _MODEL, _SUB_FILES, _SAMPLE_FORMAT = 262, 271, 272, 330, 339
_DNG_VERSION, _UNIQUE_MODEL, _BLACK, _NOISE_PROFILE = 50706, 50708, 50714, 51041
_WANTED = (
    *(_PHOTOMETRIC, _MAKE, _MODEL, _SAMPLE_FORMAT),
    *(_DNG_VERSION, _UNIQUE_MODEL, _BLACK, _NOISE_PROFILE),
)
_SENSOR = (32803, 34892)  # photometric: a mosaic, or linear RAW
_FLOATS = (3, (3,), (3, 3, 3))  # sample formats
_MOST_DIRECTORIES = 16  # a RAW and its previews; more are a damaged file
# LibRaw's flip is a sum: 1 mirrored, 2 upside down, 4 rows and columns swapped. What EXIF calls it:
_ORIENTATION = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
# Columns: X, Y and Z (white D65) of the primaries of sRGB [IEC 61966-2-1].
_SRGB_TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_ONE_AT_A_TIME = Lock()  # else the standard error of one thread is restored to another's silence
_CONVERT = "convert it to DNG (e.g. with Adobe's free DNG Converter) or to 16-bit linear TIFF"


def read_raw(path: Path, max_pixels: int = MAX_PIXELS) -> LinearImage:
    """Read camera RAW as linear light in the colors of the camera.

    Mosaics of Bayer, X-Trans and other patterns of red, green and blue; DNGs that hold all
    three; gray sensors.

    Parameters
    ----------
    path : Path
        The file.
    max_pixels : int
        More are refused before memory is taken.

    Returns
    -------
    LinearImage
        float32. `valid` is False where a pixel that went into it was saturated. The noise is that of
        a DNG's NoiseProfile as it is after interpolation, averaged over the pattern; else not known.

    Raises
    ------
    FileError
        If the extra is not installed, or there is no light to be had from the file.
    """
    rawpy = _library(path)
    directories = _directories(path)
    for tags in directories:
        if tags.get(_PHOTOMETRIC) in _SENSOR and tags.get(_SAMPLE_FORMAT) in _FLOATS:
            raise FileError(f"{path}: holds floats, not the sensor's numbers; export it as EXR")
    try:
        with path.open("rb") as file, _silent():
            raw = rawpy.imread(file)
            check_size(path, (raw.sizes.width, raw.sizes.height), max_pixels)
            raw.unpack()
        with raw:
            return _developed(path, raw, directories)
    except rawpy.LibRawFileUnsupportedError as error:
        raise FileError(
            f"{path}: is no camera RAW, or of a camera that LibRaw does not know; {_CONVERT}"
        ) from error
    except rawpy.LibRawError as error:
        raise FileError(
            f"{path}: the RAW is damaged or cut short ({_told(error)}); copy it again, or {_CONVERT}"
        ) from error


def _library(path: Path) -> Any:
    try:
        import rawpy
    except ImportError as error:
        raise FileError(
            f'{path}: camera RAW needs an extra; pip install "blurmatte[raw]"'
        ) from error
    return rawpy


def _told(error: Exception) -> str:
    reason = error.args[0] if error.args else "no reason given"
    return reason.decode() if isinstance(reason, bytes) else str(reason)


@contextmanager
def _silent() -> Iterator[None]:
    """LibRaw prints what it then also raises; only the file descriptor can stop it."""
    with _ONE_AT_A_TIME:
        try:
            kept = os.dup(2)
        except OSError:  # a program without a terminal has none
            yield
            return
        try:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _developed(path: Path, raw: Any, directories: Sequence[Tags]) -> LinearImage:
    """Light, validity, noise and facts of an unpacked file."""
    black, white = _levels(path, raw, directories)
    if raw.raw_type.name == "Stack":
        light, valid, shares = _of_three(path, raw, directories, black, white)
    else:
        light, valid, shares = _of_mosaic(path, raw, black, white)
    turn = _ORIENTATION[raw.sizes.flip & 7]
    noise = _noise(directories, shares)
    meta = _meta(path, raw, directories, round(white - black.max()) + 1)
    return LinearImage(upright(light, turn), noise, upright(valid, turn), meta)


def _levels(path: Path, raw: Any, directories: Sequence[Tags]) -> tuple[Floats, float]:
    """Black of each color of LibRaw's, and white."""
    black = np.array(raw.black_level_per_channel, dtype=np.float32)
    told = _black_fractions(raw, directories)
    black = np.where(np.abs(told - black) < 1, told, black).astype(np.float32)
    white = float(raw.white_level)
    if not white > black.max():
        raise FileError(
            f"{path}: its white level {white:g} is not above its black level; {_CONVERT}"
        )
    return black, white


def _black_fractions(raw: Any, directories: Sequence[Tags]) -> Floats:
    """(4,) black of each color of LibRaw's as a DNG tells it, for LibRaw cuts off fractions; or NaN."""
    told = _numbers(directories, _BLACK)
    black = np.full(4, np.nan, np.float32)
    if told.size == 1:
        black[:] = told
    elif told.size == 4 and raw.raw_pattern is not None and raw.raw_pattern.shape == (2, 2):
        black[raw.raw_colors_visible[:2, :2].ravel()] = told
    return black


def _of_mosaic(path: Path, raw: Any, black: Floats, white: float) -> tuple[Floats, Bools, Floats]:
    """Light of a sensor that sees one color in each pixel; and the shares of its noise."""
    mosaic: Mosaic = raw.raw_image_visible
    if raw.num_colors == 1:
        light = (mosaic - black[0]) / np.float32(white - black[0])
        return light[..., None].repeat(3, axis=2), mosaic < white, np.ones(3)
    colors = _pattern(path, raw)
    scale = np.float32(1 / (white - black.max()))  # one for all [DNG 1.4 ch. 5]
    light = mosaic.astype(np.float32)
    light -= tiled(black[colors], mosaic.shape)
    light *= scale
    clipped = mosaic >= tiled(_clipping(raw, black, white)[colors], mosaic.shape)
    pattern = _with_one_green(colors)
    rgb = demosaic(light, pattern)
    if clipped.any():
        _raise_to_white(rgb, clipped, pattern)
    return rgb, ~_around(clipped), variance_shares(pattern)


def _of_three(
    path: Path, raw: Any, directories: Sequence[Tags], black: Floats, white: float
) -> tuple[Floats, Bools, Floats]:
    """Light of a DNG that was interpolated already."""
    if _first(directories, _DNG_VERSION) is None or raw.num_colors != 3:
        raise FileError(
            f"{path}: holds no plain mosaic of red, green and blue (a Foveon sensor, or a small RAW); "
            "develop it to 16-bit linear TIFF"
        )
    codes = raw.raw_image_visible[..., :3]
    light = (codes - black[:3]) * np.float32(1 / (white - black.max()))
    return light, (codes < white).all(axis=-1), np.ones(3)


def _pattern(path: Path, raw: Any) -> Pattern:
    """The tile of LibRaw's colors, 0 to 3, that the visible mosaic begins with."""
    try:
        period = raw.raw_pattern
    except NotImplementedError:  # patterns of other periods
        period = None
    if period is not None and raw.color_desc == b"RGBG" and raw.sizes.pixel_aspect == 1:
        height, width = period.shape
        colors = np.array(raw.raw_colors_visible[:height, :width])
        if sees_all_colors(_with_one_green(colors)):
            return colors
    raise FileError(
        f"{path}: its pixels form no plain pattern of red, green and blue; "
        "develop it to 16-bit linear TIFF"
    )


def _with_one_green(colors: Pattern) -> Pattern:
    """LibRaw tells the greens beside blue, 3, from those beside red."""
    return np.where(colors == 3, 1, colors)


def _clipping(raw: Any, black: Floats, white: float) -> Floats:
    """(4,) code values from which on a color is saturated: the camera's own word, or white."""
    told = np.array(raw.camera_white_level_per_channel or (0,) * 4, dtype=float)
    return np.where(told > black, np.minimum(told, white), white)


def _raise_to_white(rgb: Floats, clipped: Bools, pattern: Pattern) -> None:
    """Mark what a clipped pixel went into as white at least: the mean of it and others is no light."""
    for c in range(3):
        seen = tiled(pattern == c, clipped.shape)
        spoiled = np.where(seen, clipped, _around(clipped & seen))
        rgb[..., c][spoiled] = np.maximum(rgb[..., c][spoiled], 1)


def _around(pixels: Bools) -> Bools:
    """True in the 3 x 3 around each pixel, which is as far as interpolation reaches."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(pixels, np.ones((3, 3))))


def _noise(directories: Sequence[Tags], shares: Floats) -> NoiseModel | None:
    """Of a DNG's NoiseProfile: variance S · light + O of what was seen [DNG 1.4, tag 51041]."""
    profile = _numbers(directories, _NOISE_PROFILE)
    if profile.size not in (2, 6) or not (np.isfinite(profile) & (profile >= 0)).all():
        return None
    S, O = (np.broadcast_to(column, 3) * shares for column in profile.reshape(-1, 2).T)
    return NoiseModel(tuple(S), tuple(np.sqrt(O)))


def _meta(path: Path, raw: Any, directories: Sequence[Tags], levels: int) -> Meta:
    seconds = float(raw.other.shutter_speed)
    balance = _white_balance(raw)
    return Meta(
        source=path.name,
        levels=levels,
        exposure_time=seconds if math.isfinite(seconds) and seconds > 0 else None,
        gray=raw.num_colors == 1,
        color_space="camera",
        camera=_camera(directories),
        white_balance=balance,
        to_srgb=_to_srgb(raw, balance),
    )


def _camera(directories: Sequence[Tags]) -> str:
    make, model, unique = (
        str(_first(directories, tag) or "").strip("\0 ") for tag in (_MAKE, _MODEL, _UNIQUE_MODEL)
    )
    name = model if model.lower().startswith(make.lower()) else f"{make} {model}"
    return name.strip() or unique


def _white_balance(raw: Any) -> tuple[float, float, float] | None:
    """As shot, green 1; None if the file does not tell."""
    red, green, blue = (float(value) for value in raw.camera_whitebalance[:3])
    told = all(math.isfinite(value) and value > 0 for value in (red, green, blue))
    return (red / green, 1.0, blue / green) if told else None


def _to_srgb(raw: Any, balance: tuple[float, float, float] | None) -> Matrix3 | None:
    """White balance, then what LibRaw knows of the camera's colors, if anything.

    The rows of either matrix add up to 1, so that white stays white.
    """
    if raw.num_colors == 1:
        return None
    matrix = np.array(raw.color_matrix, dtype=float)[:, :3]
    from_xyz = np.array(raw.rgb_xyz_matrix, dtype=float)[:3]
    if not matrix.any() and from_xyz.any():
        of_srgb = from_xyz @ _SRGB_TO_XYZ
        matrix = np.linalg.inv(of_srgb / of_srgb.sum(axis=1, keepdims=True))
    if not (matrix.any() and np.isfinite(matrix).all()):
        matrix = np.eye(3)
    red, green, blue = (matrix * np.array(balance or (1, 1, 1))).T.tolist()
    return tuple(zip(red, green, blue, strict=True))


def _directories(path: Path) -> list[Tags]:
    """The TIFF tags of the file's first directory and of those below it; none if it is no TIFF.

    LibRaw knows them, but rawpy does not pass them on.
    """
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    found: list[Tags] = []
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            head = file.read(8)
            # Olympus and Panasonic put letters of their own after the byte order.
            head = {b"II": b"II*\0", b"MM": b"MM\0*"}.get(head[:2], b"") + head[4:]
            places = [ImageFileDirectory_v2(head).next]
            while places and len(found) < _MOST_DIRECTORIES:
                directory = ImageFileDirectory_v2(head)
                file.seek(places.pop(0))
                directory.load(file)
                found.append({tag: directory[tag] for tag in _WANTED if tag in directory})
                below = directory.get(_SUB_FILES, ())
                places += below if isinstance(below, tuple) else (below,)
    except (OSError, SyntaxError, ValueError, TypeError, KeyError, OverflowError, struct.error):
        return found  # what is damaged, LibRaw will tell
    return found


def _numbers(directories: Sequence[Tags], tag: int) -> npt.NDArray[np.float64]:
    """(n,) the numbers of a tag; none if it is nowhere, or damaged."""
    try:
        return np.ravel(np.array(_first(directories, tag) or (), dtype=float))
    except (TypeError, ValueError):
        return np.zeros(0)


def _first(directories: Sequence[Tags], tag: int) -> Any:
    """The value of a tag where it comes first; None if it is nowhere."""
    return next((tags[tag] for tags in directories if tag in tags), None)

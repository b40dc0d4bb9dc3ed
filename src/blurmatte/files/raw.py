"""Camera RAW to linear light in the colors of the camera.

LibRaw decodes the file (rawpy, the extra `raw`). `mosaic` (H, W) is the sensor's data, one color per
pixel, and `pattern` the repeating tile of colors: 0 red, 1 green, 2 blue. Light is (mosaic − black) /
(white − black), without gamma, white balance, color matrix or repair; noise below black stays negative.

The other two colors of a pixel are interpolated linearly (see `demosaic`), so that the noise of a pixel
is known and a clipped pixel affects only its neighbors. LibRaw's own linear interpolation is not used:
it clips below black, which biases dark light, and rounds.
"""

import math
import struct
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from PIL.ExifTags import Base as TiffTag

from blurmatte.checks import Array, Bools, Codes16, Floats, Ints
from blurmatte.errors import FileError, optional_library
from blurmatte.files.errors import check_size, silent_libraries
from blurmatte.files.icc import BT709, xyz_of
from blurmatte.formats import MAX_PIXELS
from blurmatte.radiometry import sensor
from blurmatte.radiometry.image import LinearImage, Meta
from blurmatte.radiometry.noise_model import NoiseModel
from blurmatte.radiometry.transfer import Matrix3

Tags = Mapping[int, Any]

_USED_TAGS = (
    *(TiffTag.PhotometricInterpretation, TiffTag.Make, TiffTag.Model, TiffTag.SampleFormat),
    *(TiffTag.DNGVersion, TiffTag.UniqueCameraModel, TiffTag.BlackLevel, TiffTag.NoiseProfile),
)
_CONVERT = "convert it to DNG (e.g. with Adobe's free DNG Converter) or to 16-bit linear TIFF"


def read_raw(path: Path, max_pixels: int = MAX_PIXELS) -> LinearImage:
    """Read camera RAW as linear light in the colors of the camera.

    Mosaics of Bayer, X-Trans and other patterns of red, green and blue; DNGs that hold all
    three; gray sensors.

    Pictures of more than `max_pixels` are rejected before memory is allocated. The light is float32;
    `valid` is False where a contributing sensor pixel is saturated. The noise is that of a DNG's
    NoiseProfile after interpolation, averaged over the pattern; None for other files.

    Raises FileError if the extra is not installed, or the file holds no usable light.
    """
    needed = f'{path}: pip install "blurmatte[raw]"; camera RAW needs rawpy'
    rawpy = optional_library("rawpy", needed, FileError)
    directories = _directories(path)
    for tags in directories:
        # A mosaic or linear RAW, whose sample format is floating point.
        if tags.get(TiffTag.PhotometricInterpretation) in (32803, 34892) and (
            tags.get(TiffTag.SampleFormat) in (3, (3,), (3, 3, 3))
        ):
            raise FileError(f"{path}: export it as EXR; it holds floats, not sensor data")
    try:
        with path.open("rb") as file, silent_libraries():
            raw = rawpy.imread(file)
            check_size(path, (raw.sizes.width, raw.sizes.height), max_pixels)
            raw.unpack()
        with raw:
            return _developed(path, raw, directories)
    except rawpy.LibRawFileUnsupportedError as error:
        raise FileError(
            f"{path}: {_CONVERT}; LibRaw does not know its camera, or it is no camera RAW"
        ) from error
    except rawpy.LibRawError as error:
        raise FileError(
            f"{path}: copy it again, or {_CONVERT}; the RAW is damaged or truncated "
            f"({_reason(error)})"
        ) from error


def _reason(error: Exception) -> str:
    reason = error.args[0] if error.args else "no reason given"
    return reason.decode() if isinstance(reason, bytes) else str(reason)


def _developed(path: Path, raw: Any, directories: Sequence[Tags]) -> LinearImage:
    """Light, validity, noise and metadata of an unpacked file."""
    black, white = _levels(path, raw, directories)
    if raw.raw_type.name == "Stack":
        light, valid, shares = _of_three(path, raw, directories, black, white)
    else:
        light, valid, shares = _of_mosaic(path, raw, black, white)
    # LibRaw's flip: 1 mirrored + 2 upside down + 4 transposed after that.
    mirrored, upside_down, transposed = (bool(raw.sizes.flip & bit) for bit in (1, 2, 4))
    flips = (upside_down, mirrored) if transposed else (mirrored, upside_down)
    turn = sensor.Orientation(transposed, *flips)
    noise = _noise(directories, shares)
    meta = _meta(path, raw, directories, round(white - black.max()) + 1)
    meta = replace(meta, readout=turn.readout)
    light, valid = (np.ascontiguousarray(turn.upright(pixels)) for pixels in (light, valid))
    return LinearImage(light, noise, valid, meta)


def _levels(path: Path, raw: Any, directories: Sequence[Tags]) -> tuple[Floats, float]:
    """(4,) black level of each of LibRaw's colors, and the white level."""
    black = np.array(raw.black_level_per_channel, dtype=np.float32)
    exact = _exact_black(raw, directories)
    black = np.where(np.abs(exact - black) < 1, exact, black).astype(np.float32)
    white = float(raw.white_level)
    if not white > black.max():
        raise FileError(
            f"{path}: {_CONVERT}; its white level {white:g} is not above its black level"
        )
    return black, white


def _exact_black(raw: Any, directories: Sequence[Tags]) -> Floats:
    """(4,) black level of each of LibRaw's colors in a DNG, or NaN; LibRaw truncates fractions."""
    stated = _numbers(directories, TiffTag.BlackLevel)
    black = np.full(4, np.nan, np.float32)
    if stated.size == 1:
        black[:] = stated
    elif stated.size == 4 and raw.raw_pattern is not None and raw.raw_pattern.shape == (2, 2):
        black[raw.raw_colors_visible[:2, :2].ravel()] = stated
    return black


def _of_mosaic(path: Path, raw: Any, black: Floats, white: float) -> tuple[Floats, Bools, Floats]:
    """Light and validity of a mosaic, and the factors of its noise variance."""
    mosaic: Codes16 = raw.raw_image_visible
    if raw.num_colors == 1:
        light = (mosaic - black[0]) / np.float32(white - black[0])
        return light[..., None].repeat(3, axis=2), mosaic < white, np.ones(3)
    colors = _pattern(path, raw)
    scale = np.float32(1 / (white - black.max()))  # one for all [DNG 1.4 ch. 5]
    light = mosaic.astype(np.float32)
    light -= sensor.tiled(black[colors], mosaic.shape)
    light *= scale
    clipped = mosaic >= sensor.tiled(_clipping(raw, black, white)[colors], mosaic.shape)
    pattern = _with_one_green(colors)
    rgb = sensor.demosaic(light, pattern)
    if clipped.any():
        _raise_to_white(rgb, clipped, pattern)
    return rgb, ~_around(clipped), sensor.variance_shares(pattern)


def _of_three(
    path: Path, raw: Any, directories: Sequence[Tags], black: Floats, white: float
) -> tuple[Floats, Bools, Floats]:
    """Light and validity of an interpolated DNG, and the factors of its noise variance."""
    if _first(directories, TiffTag.DNGVersion) is None or raw.num_colors != 3:
        raise FileError(
            f"{path}: develop it to 16-bit linear TIFF; it holds no mosaic of red, green and blue "
            "(a Foveon sensor, or a reduced RAW)"
        )
    codes = raw.raw_image_visible[..., :3]
    light = (codes - black[:3]) * np.float32(1 / (white - black.max()))
    return light, (codes < white).all(axis=-1), np.ones(3)


def _pattern(path: Path, raw: Any) -> Ints:
    """The tile of LibRaw's colors, 0 to 3, at the origin of the visible mosaic."""
    try:
        period = raw.raw_pattern
    except NotImplementedError:  # patterns of other periods
        period = None
    if period is not None and raw.color_desc == b"RGBG" and raw.sizes.pixel_aspect == 1:
        height, width = period.shape
        colors = np.array(raw.raw_colors_visible[:height, :width])
        if sensor.sees_all_colors(_with_one_green(colors)):
            return colors
    raise FileError(
        f"{path}: develop it to 16-bit linear TIFF; "
        "its pixels form no plain pattern of red, green and blue"
    )


def _with_one_green(colors: Ints) -> Ints:
    """The pattern with 1 for both greens; LibRaw numbers those in blue rows 3."""
    return np.where(colors == 3, 1, colors)


def _clipping(raw: Any, black: Floats, white: float) -> Floats:
    """(4,) code values at which a color saturates: as the camera states, or white."""
    stated = np.array(raw.camera_white_level_per_channel or (0,) * 4, dtype=float)
    return np.where(stated > black, np.minimum(stated, white), white)


def _raise_to_white(rgb: Floats, clipped: Bools, pattern: Ints) -> None:
    """Raise the values that a clipped pixel contributes to, to white or more."""
    for c in range(3):
        measured = sensor.tiled(pattern == c, clipped.shape)
        affected = np.where(measured, clipped, _around(clipped & measured))
        rgb[..., c][affected] = np.maximum(rgb[..., c][affected], 1)


def _around(pixels: Bools) -> Bools:
    """True in the 3 x 3 neighborhoods of pixels, the reach of the interpolation."""
    return np.asarray(scipy.ndimage.binary_dilation(pixels, np.ones((3, 3))))


def _noise(directories: Sequence[Tags], shares: Floats) -> NoiseModel | None:
    """The noise of a DNG's NoiseProfile: variance S · light + O of a sensor pixel [DNG 1.4]."""
    profile = _numbers(directories, TiffTag.NoiseProfile)
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
        str(_first(directories, tag) or "").strip("\0 ")
        for tag in (TiffTag.Make, TiffTag.Model, TiffTag.UniqueCameraModel)
    )
    name = model if model.lower().startswith(make.lower()) else f"{make} {model}"
    return name.strip() or unique


def _white_balance(raw: Any) -> tuple[float, float, float] | None:
    """Factors as shot, green 1; None if the file states none."""
    red, green, blue = (float(value) for value in raw.camera_whitebalance[:3])
    stated = all(math.isfinite(value) and value > 0 for value in (red, green, blue))
    return (red / green, 1.0, blue / green) if stated else None


def _to_srgb(raw: Any, balance: tuple[float, float, float] | None) -> Matrix3 | None:
    """The white balance followed by LibRaw's matrix of the camera, if there is one.

    The rows of LibRaw's matrices sum to 1, so that white stays white.
    """
    if raw.num_colors == 1:
        return None
    matrix = np.array(raw.color_matrix, dtype=float)[:, :3]
    from_xyz = np.array(raw.rgb_xyz_matrix, dtype=float)[:3]
    if not matrix.any() and np.linalg.matrix_rank(from_xyz) == 3:
        of_srgb = from_xyz @ xyz_of(BT709)
        matrix = np.linalg.inv(of_srgb / of_srgb.sum(axis=1, keepdims=True))
    if not (matrix.any() and np.isfinite(matrix).all()):
        matrix = np.eye(3)
    red, green, blue = (matrix * np.array(balance or (1, 1, 1))).T.tolist()
    return tuple(zip(red, green, blue, strict=True))


def _directories(path: Path) -> list[Tags]:
    """TIFF tags of the first directory and its subdirectories; empty for other files.

    rawpy does not give access to them.
    """
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    found: list[Tags] = []
    try:
        with path.open("rb") as file, warnings.catch_warnings(action="ignore"):
            head = file.read(8)
            # Olympus and Panasonic use other letters after the byte order.
            head = {b"II": b"II*\0", b"MM": b"MM\0*"}.get(head[:2], b"") + head[4:]
            offsets = [ImageFileDirectory_v2(head).next]
            while offsets and len(found) < 16:  # a RAW and its previews; more are damage
                directory = ImageFileDirectory_v2(head)
                file.seek(offsets.pop(0))
                directory.load(file)
                found.append({tag: directory[tag] for tag in _USED_TAGS if tag in directory})
                below = directory.get(TiffTag.SubIFDs, ())
                offsets += below if isinstance(below, tuple) else (below,)
    except (OSError, SyntaxError, ValueError, TypeError, KeyError, OverflowError, struct.error):
        return found  # LibRaw reports the damage
    return found


def _numbers(directories: Sequence[Tags], tag: int) -> Array:
    """(n,) numbers of a tag; empty if it is missing or damaged."""
    try:
        return np.ravel(np.array(_first(directories, tag) or (), dtype=float))
    except (TypeError, ValueError):
        return np.zeros(0)


def _first(directories: Sequence[Tags], tag: int) -> Any:
    """The first value of a tag; None if it is missing."""
    return next((tags[tag] for tags in directories if tag in tags), None)

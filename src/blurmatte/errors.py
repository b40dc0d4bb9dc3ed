"""
Exceptions and warnings of blurmatte.

BlurmatteError            the data do not determine a result
├── FileError             the file cannot be read as linear light, or not written
├── PlateError            the plate does not match the image
├── ColorModelError       the colors do not determine a line or a plane
├── NoiseError            the pictures do not determine their noise
├── ResponseError         the pictures do not determine the camera's response
├── MotionError           nothing moved
└── SpinError             the picture does not determine how a ball spins

BlurmatteWarning          a result rests on an assumption
├── TransferWarning       the transfer curve of a file is unknown
├── PlateWarning          image and plate may be swapped or do not match
└── ConvergenceWarning    an iteration did not converge; the last iterate is used

Wrong arguments (a bad shape, a negative gain) raise ValueError or TypeError.
Bad *pixels* never raise; they are marked in `Solution.quality`.
"""

import sys
import warnings
from collections.abc import Iterable
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

_PACKAGE = str(Path(__file__).parent)


class BlurmatteError(Exception):
    """The data do not determine a result.

    Examples
    --------
    >>> try:
    ...     bm.solve(plate, plate)
    ... except bm.BlurmatteError as error:
    ...     print(error)
    nothing moved: image and plate agree within their noise; check that they are two pictures,
    or give a region (--region, streak=)
    """


class FileError(BlurmatteError):
    """The file cannot be read as linear light, or not written.

    Examples
    --------
    >>> bm.read("color.json")
    Traceback (most recent call last):
        ...
    blurmatte.errors.FileError: color.json: give a picture or a clip; this kind of file (text)
    is not read
    """


class PlateError(BlurmatteError):
    """The plate does not match the image.

    Examples
    --------
    >>> bm.make_plate(frames[:2])
    Traceback (most recent call last):
        ...
    blurmatte.errors.PlateError: a plate needs at least 3 frames, got 2; give more of them
    """


class ColorModelError(BlurmatteError):
    """The colors do not determine a line or a plane.

    Examples
    --------
    >>> bm.ColorModel.from_samples(np.full((5, 3), 0.4), rank=2)
    Traceback (most recent call last):
        ...
    blurmatte.errors.ColorModelError: the 5 samples determine the plane of colors only to 0°;
    rank 2 needs two clearly different colors, and no sample may be black
    """


class NoiseError(BlurmatteError):
    """The pictures do not determine their noise.

    Examples
    --------
    >>> bm.calibration.measure_noise([image, bm.LinearImage(0.5 * image.rgb)])
    Traceback (most recent call last):
        ...
    blurmatte.errors.NoiseError: the brightness of frame 2 differs from the one before by -67%;
    frames must be taken alike, with the same exposure
    """


class ResponseError(BlurmatteError):
    """The pictures do not determine the camera's response.

    Examples
    --------
    >>> same = bm.LinearImage(bm.SRGB.encode(wall))
    >>> bm.calibration.fit_response([same, same], [1 / 60, 1 / 30])
    Traceback (most recent call last):
        ...
    blurmatte.errors.ResponseError: picture 1 and picture 2 are equally bright, or the second
    darker, although it was exposed longer; check the exposure times, and that aperture, ISO and
    light stayed
    """


class MotionError(BlurmatteError):
    """Nothing moved.

    Examples
    --------
    >>> bm.solve(plate, plate)
    Traceback (most recent call last):
        ...
    blurmatte.errors.MotionError: nothing moved: image and plate agree within their noise; check
    that they are two pictures, or give a region (--region, streak=)
    """


class SpinError(BlurmatteError):
    """The picture does not determine how a ball spins. `likeliest` is a `Spin` that is not certain.

    Examples
    --------
    >>> small = sweep.enlarged(0.5, (0, 0), (64, 36))
    >>> bm.deblurring.fit_spin(image.crop((0, 0, 64, 36)), plate.crop((0, 0, 64, 36)), small)
    Traceback (most recent call last):
        ...
    blurmatte.errors.SpinError: the ball's radius is 5.0 px: its texture is visible from 6 px on
    """

    likeliest: Any = None


class BlurmatteWarning(UserWarning):
    """A result rests on an assumption.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", bm.errors.BlurmatteWarning)
    ...     picture = bm.read("throw.png")
    """


class TransferWarning(BlurmatteWarning):
    """The transfer curve of a file is unknown.

    Examples
    --------
    >>> import warnings
    >>> from PIL import Image
    >>> Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save("untagged.png")
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", bm.errors.TransferWarning)
    ...     bm.read("untagged.png")
    Traceback (most recent call last):
        ...
    blurmatte.errors.TransferWarning: untagged.png: the file has no color profile, and its code
    values are taken as sRGB; if that is right, pass transfer=SRGB (--transfer srgb)
    """


class PlateWarning(BlurmatteWarning):
    """Image and plate may be swapped or do not match.

    Examples
    --------
    >>> import warnings
    >>> bright = bm.LinearImage(1.05 * plate.rgb, plate.noise)
    >>> as_it_is = bm.background.Matching.NONE
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", bm.errors.PlateWarning)
    ...     bm.solve(image, bright, solution.model, bm.Pixelwise(), matching=as_it_is)
    Traceback (most recent call last):
        ...
    blurmatte.errors.PlateWarning: around the streak the image's brightness differs from the
    plate's by -4.9% in R, -4.4% in G, -4.3% in B: alpha and its sum will be off by several
    times that; use a plate of the same exposure and light
    """


class ConvergenceWarning(BlurmatteWarning):
    """An iteration did not converge; the last iterate is used.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", bm.errors.ConvergenceWarning)
    ...     answer = bm.solve(image, plate, solution.model, bm.Pixelwise())
    """


def warn(message: str, category: type[Warning] = BlurmatteWarning) -> None:
    """Warn at the line outside of this package from which it was called."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def listed(things: Iterable[object], most: int) -> str:
    """The first of several things with commas between them, and … if there are more."""
    some = [str(one) for one in islice(things, most + 1)]
    return ", ".join(some[:most]) + (" …" if len(some) > most else "")


def optional_library(name: str, needed: str, error: type[BlurmatteError] = BlurmatteError) -> Any:
    """A module of a library that only some users have; the error says what is `needed`."""
    try:
        return import_module(name)
    except ImportError as cause:
        raise error(needed) from cause

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

from typing import Any


class BlurmatteError(Exception):
    """The data do not determine a result."""


class FileError(BlurmatteError):
    """The file cannot be read as linear light, or not written."""


class PlateError(BlurmatteError):
    """The plate does not match the image."""


class ColorModelError(BlurmatteError):
    """The colors do not determine a line or a plane."""


class NoiseError(BlurmatteError):
    """The pictures do not determine their noise."""


class ResponseError(BlurmatteError):
    """The pictures do not determine the camera's response."""


class MotionError(BlurmatteError):
    """Nothing moved."""


class SpinError(BlurmatteError):
    """The picture does not determine how a ball spins. `likeliest` is a `Spin` that is not certain."""

    likeliest: Any = None


class BlurmatteWarning(UserWarning):
    """A result rests on an assumption."""


class TransferWarning(BlurmatteWarning):
    """The transfer curve of a file is unknown."""


class PlateWarning(BlurmatteWarning):
    """Image and plate may be swapped or do not match."""


class ConvergenceWarning(BlurmatteWarning):
    """An iteration did not converge; the last iterate is used."""

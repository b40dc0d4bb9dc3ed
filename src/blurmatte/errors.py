"""
Everything blurmatte raises or warns of on purpose.

BlurmatteError            the data cannot answer; the message says what to do
├── FileError             the file does not hold the light we need, or cannot be written
├── PlateError            the plate does not belong to the image
├── ColorModelError       the colors do not determine a line or a plane
├── NoiseError            the pictures do not tell their noise
├── ResponseError         the pictures do not determine the camera's curve
└── MotionError           nothing moved

BlurmatteWarning          an answer was given, on an assumption
├── TransferWarning       the file does not say how its code values encode light
├── PlateWarning          image and plate look swapped, or do not fit each other
└── ConvergenceWarning    the steps ran out before the answer had settled

Wrong arguments (a bad shape, a negative gain) raise ValueError or TypeError.
Bad *pixels* never raise; they are marked in `Solution.quality`.
"""


class BlurmatteError(Exception):
    """The data cannot answer; the message says what to do."""


class FileError(BlurmatteError):
    """The file does not hold the light we need, or cannot be written."""


class PlateError(BlurmatteError):
    """The plate does not belong to the image."""


class ColorModelError(BlurmatteError):
    """The colors do not determine a line or a plane."""


class NoiseError(BlurmatteError):
    """The pictures do not tell their noise."""


class ResponseError(BlurmatteError):
    """The pictures do not determine the camera's curve."""


class MotionError(BlurmatteError):
    """Nothing moved."""


class BlurmatteWarning(UserWarning):
    """An answer was given, on an assumption."""


class TransferWarning(BlurmatteWarning):
    """The file does not say how its code values encode light."""


class PlateWarning(BlurmatteWarning):
    """Image and plate look swapped, or do not fit each other."""


class ConvergenceWarning(BlurmatteWarning):
    """The steps ran out before the answer had settled; it is the last one."""

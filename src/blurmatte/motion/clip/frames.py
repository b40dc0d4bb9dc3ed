"""Frames of a clip: their noise, and the plate in their light."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from blurmatte.checks import Array, Floats
from blurmatte.radiometry import LinearImage, Noise
from blurmatte.statistics import MAD_TO_STD


@runtime_checkable
class ClipFrames(Protocol):
    """Frames of a clip, or of a sequence with missing pictures."""

    @property
    def frame_numbers(self) -> Sequence[int]:
        """Number of each frame."""
        ...

    def for_plate(self, plate: LinearImage | None) -> Sequence[LinearImage]:
        """The frames, their chroma where it agrees with a plate if one was given."""
        ...


def with_default_noise(frame: LinearImage, noise: Noise | Floats) -> LinearImage:
    """The frame with this noise, unless it has its own."""
    return frame.with_noise(noise) if frame.noise is None else frame


def noise_of(image: LinearImage) -> Noise | Floats:
    """The noise of an image that has one."""
    assert image.noise is not None
    return image.noise


def plate_in_light_of(plate: LinearImage, image: LinearImage) -> LinearImage:
    """The plate times the gain of a frame, if lamp or shutter changed it by more than its error."""
    few = [
        LinearImage(picture.rgb[::5, ::5], valid=picture.valid[::5, ::5])  # enough for a median
        for picture in (plate, image)
    ]
    gain = gain_of(*few)
    return plate if gain is None else times_gain(plate, gain)


def gain_of(plate: LinearImage, image: LinearImage) -> Array | None:
    """(3,) light of a frame over that of the plate; None if it is 1 within its error."""
    B, C = (np.asarray(picture.rgb, float) for picture in (plate, image))
    use = plate.valid & image.valid & (B.min(axis=-1) > 0.01)  # of white: not too dark
    if not use.any():
        return None
    ratio = np.ascontiguousarray((C[use] / B[use]).T)  # medians of rows take a third of the time
    gain = np.median(ratio, axis=1)
    std = MAD_TO_STD * np.median(np.abs(ratio - gain[:, None]), axis=1)
    if np.all(np.abs(gain - 1) < 3.0 * std / np.sqrt(ratio.shape[1])):
        return None
    return np.asarray(gain)


def times_gain(plate: LinearImage, gain: Array) -> LinearImage:
    """The plate in the light of a frame."""
    by = np.tile(gain.astype(np.float32), (plate.size[0], 1))  # a row, as in `NoiseModel.variance`
    return replace(plate, rgb=plate.rgb * by, noise=np.asarray(plate.variance * by**2, np.float32))

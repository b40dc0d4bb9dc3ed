"""StaticScene: the plate of a clip, its gate, and the noise that all frames share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from blurmatte.background.camera_motion import CameraMotionError, looks_alike
from blurmatte.background.parallax import camera_path
from blurmatte.background.plate import (
    FrameShares,
    PlateFit,
    camera_path_after,
    plate_for_clip,
    plate_on_canvas,
)
from blurmatte.background.registration import CameraPath
from blurmatte.background.samples import CutError, max_coded_samples
from blurmatte.calibration import with_noise
from blurmatte.calibration.noise_pair import with_coding_errors
from blurmatte.checks import Array, Bools, Box, Floats, check_map, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.errors import PlateError
from blurmatte.motion.clip.matched_filter import MatchedFilter, moving_parts
from blurmatte.motion.clip.workers import Workers, parts_of, successes, trim_memory
from blurmatte.radiometry import LinearImage, Noise, counted_once
from blurmatte.radiometry.coded import (
    CodedFrame,
    CodedSequence,
    coded_frames,
    each_coded,
    in_codes_of,
)
from blurmatte.radiometry.compression import CodingErrors, FrameCoding
from blurmatte.radiometry.image import with_inflated
from blurmatte.statistics import MAD_TO_STD
from blurmatte.streaks import Gate, Streak

GAIN_EVERY = 5  # pixels in rows and columns; enough for a median
PLATE_FRAMES = 60  # from which the plate of a clip is made at most
GATE_SAMPLES = 16  # frames from which the differences without motion are measured
Part = tuple[LinearImage, LinearImage]  # of a frame, and of the plate in its light


@dataclass(frozen=True, eq=False)
class StaticScene:
    """What the frames of a clip have in common besides the objects.

    Parameters
    ----------
    plate : LinearImage
        Noise known.
    noise : Noise or (H, W, 3) float
        Of frames that have none of their own.
    gate : Gate, optional
        None of a camera that moves: each frame has its own.
    hidden : (H, W) bool, optional
        Where something is in front of the scene.
    coding : CodingErrors, optional
        Of blocks that a codec quantizes anew, as where something moves. Elsewhere frames repeat the
        blocks of the plate, so that the measured noise is less.
    surveyed : mapping of int to tuple of (x0, y0, x1, y1)
        Boxes around what moved in the frames that were compared with the plate, by their indices.
    camera : CameraPath, optional
        Of a camera that moves: the plate is on its canvas, and `at` gives the scene of a frame.
    model : ColorModel
        Of the object, in the colors of the frames; any as long as it is not known.
    color : MatchedFilter, optional
        For its light, if it is of one paint.
    shares : FrameShares, optional
        Of the frames in the plate, if they are few: a part has the plate of the others.
    """

    plate: LinearImage
    noise: Noise | Floats
    gate: Gate | None
    hidden: Bools | None = None
    coding: CodingErrors | None = None
    surveyed: Mapping[int, tuple[Box, ...]] = field(default_factory=dict)
    camera: CameraPath | None = None
    model: ColorModel = field(default_factory=ColorModel.any)
    color: MatchedFilter | None = None
    shares: FrameShares | None = None

    @classmethod
    def of(
        cls,
        frames: Sequence[LinearImage],
        plate: LinearImage,
        hidden: Bools | None = None,
        camera: CameraPath | None = None,
    ) -> StaticScene:
        """The scene of a clip and its plate; unknown noise is measured in the first frame.

        Raises ValueError if what is hidden is not a mask of the size of the frames.
        """
        if hidden is not None:
            size = plate.size if camera is None else camera.size
            hidden = check_map("occluder", hidden, size[::-1], kinds="b")
        k = 0 if camera is None else camera.registered[len(camera.registered) // 2]
        first = frames[k]
        first = replace(first, meta=replace(first.meta, coding=None))  # crops have it by `coding`
        if camera is not None:
            plate = with_noise(first, plate)[1] if plate.noise is None else plate
            first, _ = with_noise(first, camera.plate_at(k, plate))
            return cls(plate, _of_each_channel(first), None, hidden, camera=camera)
        if hidden is not None:
            plate = replace(plate, valid=plate.valid & ~hidden)
        first, plate = with_noise(first, plate)
        coding = frames.coding_errors() if isinstance(frames, CodedSequence) else None
        samples = coded_frames(frames, slice(None, None, max(1, len(frames) // GATE_SAMPLES)))
        gate = Gate.of(in_codes_of(frames, plate), samples, hidden)
        return cls(plate, _of_each_channel(first), gate, hidden, coding)

    def at(self, frames: Sequence[LinearImage], frame: CodedFrame, index: int) -> StaticScene:
        """The scene as the frame with this index shows it; `frames` have its code values.

        Raises PlateError if the frame could not be registered.
        """
        if self.camera is None:
            return self
        plate = self.camera.plate_at(index, self.plate)
        if self.hidden is not None:
            plate = replace(plate, valid=plate.valid & ~self.hidden)
        return replace(self, plate=plate, camera=None)._with_filter(frame)

    def boxes(
        self, frames: Sequence[LinearImage], frame: CodedFrame, index: int
    ) -> tuple[Box, ...]:
        """Around each part that moved in the frame with this index; parameters as of `at`."""
        known = self.surveyed.get(index)
        if known is not None:
            return known
        gate = self.gate or _gate(frames, frame, self.plate, self.hidden)
        return gate.changes(frame)

    def parts(self, frame: CodedFrame, index: int, boxes: Sequence[Box]) -> Iterator[Part]:
        """Image and plate in boxes of the frame with this index, noise known.

        `box_in_frame` is the place of a part.
        """
        gain = gain_of(thinned(self.plate), frame.light(every=GAIN_EVERY)) if boxes else None
        for box in boxes:
            image, plate = frame.light(box), self.plate.crop(box)
            image = self.with_noise(image, box)
            if self.shares is not None:
                plate = self.shares.without(index, image, plate, box)
            yield image, plate if gain is None else times_gain(plate, gain)

    def streaks(self, part: Part) -> list[Streak]:
        """Streaks of the object's color; of an object of several colors those that are no shadows."""
        if self.color is None:
            return moving_parts(*part)
        return self.color.within(box_in_frame(part)).parts(part[0])

    def of_color(self, frames: Sequence[LinearImage], model: ColorModel) -> StaticScene:
        """The scene with the color of the object."""
        k = 0 if self.camera is None else self.camera.registered[0]
        (first,) = coded_frames(frames, slice(k, k + 1))
        model = replace(model, to_srgb=first.light((0, 0, 1, 1)).meta.to_srgb)
        colored = replace(self, model=model)
        return replace(colored, color=colored.at(frames, first, k)._with_filter(first).color)

    def _with_filter(self, frame: CodedFrame) -> StaticScene:
        """With the filter for the object's light in frames with the noise of one."""
        if self.model.rank > 1:
            return self

        def noisy(box: Box) -> LinearImage:
            """The frame in a box, its noise known."""
            return self.with_noise(frame.light(box), box)

        return replace(self, color=MatchedFilter.of(self.plate, noisy, self.model))

    def hidden_in(self, part: Part) -> Bools | None:
        """What is hidden in a part; None for nothing."""
        hidden = None if self.hidden is None else self.hidden[rows_columns(box_in_frame(part))]
        return hidden if hidden is not None and hidden.any() else None

    def with_noise(self, image: LinearImage, box: Box) -> LinearImage:
        """A frame in a box; if its noise is not known, it is that of all frames, of moving blocks.

        That of a codec is known at the light of the plate: few levels of light do not determine how it
        grows. That of gray frames counts once (`Meta.one_channel`).
        """
        coding = FrameCoding(lambda: self.coding, box[:2])
        image = replace(image, meta=replace(image.meta, coding=coding))
        if image.noise is None:
            image = with_coding_errors(image, self._noisy_plate.crop(box))
        return counted_once(image) if self.plate.meta.one_channel else image

    @cached_property
    def _noisy_plate(self) -> LinearImage:
        """The plate with the noise of all frames, of each channel on its own."""
        return self.plate.with_noise(self.noise)


def box_in_frame(part: Part) -> Box:
    """Where a part of a frame lies in it."""
    image, _ = part
    assert image.meta.coding is not None
    (x, y), (width, height) = image.meta.coding.origin, image.size
    return x, y, x + width, y + height


def _of_each_channel(frame: LinearImage) -> Noise | Floats:
    """The known noise of a frame; that of a gray one not counted once, as that of its codec."""
    return noise_of(with_inflated(frame, 1 / 3) if frame.meta.one_channel else frame)


def _gate(
    frames: Sequence[LinearImage], frame: CodedFrame, plate: LinearImage, hidden: Bools | None
) -> Gate:
    """The gate of one frame and the plate that it shows."""
    unknown = ~plate.valid if hidden is None else hidden | ~plate.valid
    return Gate.of_frame(in_codes_of(frames, plate), frame, unknown)


def noise_of(image: LinearImage) -> Noise | Floats:
    """The noise of an image that has one."""
    assert image.noise is not None
    return image.noise


def plate_in_light_of(plate: LinearImage, image: LinearImage) -> LinearImage:
    """The plate times the gain of a frame, if lamp or shutter changed it by more than its error."""
    gain = gain_of(thinned(plate), thinned(image))
    return plate if gain is None else times_gain(plate, gain)


def thinned(picture: LinearImage) -> LinearImage:
    """The light of pixels all over a picture, as `gain_of` needs them."""
    grid = np.s_[::GAIN_EVERY, ::GAIN_EVERY]
    return LinearImage(picture.rgb[grid], valid=picture.valid[grid])


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


def clip_plate(frames: Sequence[LinearImage]) -> PlateFit:
    """The plate of a clip, from frames all over it, with the path of its camera if that moves."""
    most = PLATE_FRAMES
    if len(frames):
        first = next(coded_frames(frames, slice(0, 1)))
        if first.light_bytes:
            most = min(most, max_coded_samples(math.prod(first.size), first.light_bytes))
    every = -(-len(frames) // most) or 1
    try:
        fit = plate_for_clip(frames[::every])
        if len(fit.gain) < len(frames):  # bits would be those of other frames
            fit = replace(fit, shares=None)
    except (CameraMotionError, CutError) as error:
        fit = plate_on_canvas(frames, camera_path_after(frames, error), most)
    trim_memory()  # of the frames
    return fit


def path_before(plate: LinearImage, frames: Sequence[LinearImage]) -> CameraPath | None:
    """Where the frames look on a plate that was given; None if they all look where it does."""
    size = frames[0].size
    if size == plate.size:
        return None if looks_alike(plate, frames) else camera_path(frames, plate)
    larger = all(w <= P for P, w in zip(plate.size, size, strict=True))
    return camera_path(frames, plate) if larger else None


def survey(frames: Sequence[LinearImage], scene: StaticScene, workers: Workers) -> StaticScene:
    """The scene with what moved in each frame of a clip that can be decoded."""
    found = successes(workers.over(frames, partial(_changes, scene), parts_of(frames, workers)))
    return replace(scene, surveyed={k: boxes for part in found for k, boxes in part.items()})


def _changes(
    scene: StaticScene, frames: Sequence[LinearImage], first: int
) -> dict[int, tuple[Box, ...]]:
    """Boxes around what moved in the frames of a task."""
    found = dict[int, tuple[Box, ...]]()
    for k, frame in enumerate(each_coded(frames), first):
        if frame is not None:
            with suppress(PlateError):  # it is not registered
                found[k] = scene.at(frames, frame, k).boxes(frames, frame, k)
    return found

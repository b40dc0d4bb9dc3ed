"""solve_clip: the frames of a clip → a Solution for each in which the object is.

Each frame is measured alone first; what the frames share is a prior of their solutions then.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.background import Matching, make_plate
from blurmatte.checks import Box, check_kind
from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError, BlurmatteWarning
from blurmatte.matting.solution import Solution
from blurmatte.matting.solve import solve
from blurmatte.matting.swept import Swept
from blurmatte.motion.clip.color import clip_color
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.motion.clip.frames import ClipFrames, with_default_noise
from blurmatte.motion.clip.linking import link_objects, link_sightings
from blurmatte.motion.clip.matched_filter import MatchedFilter, moving_parts
from blurmatte.motion.clip.measure import sightings
from blurmatte.motion.clip.pooling import ClipObject
from blurmatte.motion.clip.scene import Crop, StaticScene
from blurmatte.motion.clip.workers import Workers, shared
from blurmatte.radiometry import CodedFrame, LinearImage, coded_frames
from blurmatte.streaks import Streak, dilated
from blurmatte.sweep import SizePrior, Sweep
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC

PLATE_FRAMES = 60  # from which the plate of a clip is made at most


@dataclass(frozen=True, eq=False)
class Wanted:
    """A frame that is solved.

    Parameters
    ----------
    index : int
        Of the frame in the clip.
    row : FrameMotion
        Where the object is.
    size : SizePrior or None
        Its radius from the other frames.
    is_disc : bool
        Its silhouette is a disc, as most frames show: other shapes, and alpha without one, are no
        alternatives then. Errors are multiplied by the scatter of the frames.
    """

    index: int
    row: FrameMotion
    size: SizePrior | None
    is_disc: bool = False


@dataclass(frozen=True, eq=False)
class FrameSolver:
    """Solves frames of a clip; holds what they share."""

    scene: StaticScene
    model: ColorModel
    color: MatchedFilter | None

    @classmethod
    def of(
        cls, frames: Sequence[LinearImage], plate: LinearImage, model: ColorModel
    ) -> FrameSolver:
        """For a clip, its plate and the color of its object."""
        scene, first, color = StaticScene.of(frames, plate), frames[0], None
        model = replace(model, to_srgb=first.meta.to_srgb)
        if model.rank == 1:
            color = MatchedFilter.of(scene.plate, with_default_noise(first, scene.noise), model)
        return cls(scene, model, color)

    def __call__(self, frames: Sequence[LinearImage], wanted: Wanted) -> Solution | str:
        """The solution in the whole picture, or why there is none.

        Parameters
        ----------
        frames : sequence of LinearImage
            The frame alone.
        wanted : Wanted
        """
        (frame,) = coded_frames(frames, slice(None))
        try:
            crop, solution = self.solved(frame, wanted)
        except BlurmatteError as error:
            return str(error)
        return solution.in_picture(crop.box, frame.size)

    def solved(self, frame: CodedFrame, wanted: Wanted) -> tuple[Crop, Solution]:
        """The crop around the object, and its solution there.

        Raises
        ------
        BlurmatteError
            If the object cannot be separated.
        """
        sighting = wanted.row.sighting
        assert sighting is not None
        boxes = self.scene.gate.changes(frame).boxes
        box = _box_of(sighting, boxes, frame.size)
        (crop,) = self.scene.crops(frame, [box])
        start = _start(sighting, crop, self.model, wanted.size)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BlurmatteWarning)
            solution = solve(
                crop.image,
                crop.plate,
                self.model if self.model.rank < 3 else None,
                Swept() if wanted.is_disc and start is not None else None,
                streak=self._streak(crop, sighting),
                matching=Matching.NONE,
                start=start,
                known_size=wanted.size if wanted.is_disc else None,
            )
        scatter = max(wanted.row.place_scatter, wanted.row.radius_scatter)
        return crop, solution.with_errors_times(scatter) if wanted.is_disc else solution

    def _streak(self, crop: Crop, sighting: Sighting) -> Streak | None:
        """The streak in a crop that was measured there; None if it is not found again."""
        if self.color is None:
            parts = moving_parts(crop.image, crop.plate)
        else:
            parts = self.color.within(crop.box).parts(crop.image)
        x0, y0 = crop.box[:2]
        t = np.linspace(0, 1, 9)[:, None]
        ends = np.array([[sighting.first_x, sighting.first_y], [sighting.last_x, sighting.last_y]])
        path = np.rint((1 - t) * ends[0] + t * ends[1] - (x0, y0)).astype(int)
        width, height = crop.image.size
        x, y = path[np.all((path >= 0) & (path < (width, height)), axis=1)].T
        hits = [int(np.count_nonzero(dilated(part.mask, 1)[y, x])) for part in parts]
        return parts[int(np.argmax(hits))] if any(hits) else None


def solve_clip(
    frames: Sequence[LinearImage],
    plate: LinearImage | None = None,
    model: ColorModel | None = None,
    *,
    several: bool = False,
    workers: int | Workers = 1,
) -> Iterator[tuple[int, Solution]]:
    """Separate a moving object from its background in each frame of a clip of a fixed camera.

    Frames are measured alone first (`sightings`). Then each frame with the object is solved in a crop
    around it, with what all frames share as a prior: the color, and the radius that the other frames
    predict. One frame is in memory at a time for each process.

    Parameters
    ----------
    frames : sequence of LinearImage
        From `read_frames`, or a list.
    plate : LinearImage, optional
        The scene without the object; made from up to 60 frames if not given.
    model : ColorModel, optional
        Its color; `clip_color` finds it if not given.
    several : bool
        Solve every object of that color, as `measure_clip` follows them.
    workers : int or Workers
        As in `sightings`.

    Yields
    ------
    index : int
        Of the frame, from 0; of several objects in one frame each is yielded.
    solution : Solution
        In the whole picture. Frames without the object, and those in which it cannot be separated,
        are left out.

    Raises
    ------
    PlateError, ColorModelError, ValueError
        As `measure_clip`.
    """
    check_kind("model", model, ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")')
    if isinstance(frames, ClipFrames):
        frames = frames.for_plate(plate)
    plate = clip_plate(frames) if plate is None else plate
    with shared(workers) as processes:
        model = clip_color(frames, plate, processes) if model is None else model
        numbers = range(len(frames))
        seen = sightings(frames, plate, model, several=several, numbers=numbers, workers=processes)
        rows = link_objects(seen) if several else link_sightings(seen)
        found = wanted_frames(rows, model, numbers)
        solver = FrameSolver.of(frames, plate, model)
        tasks = ((frames[one.index : one.index + 1], one) for one in found)
        for one, solution in zip(found, processes.in_order(solver, tasks), strict=True):
            if isinstance(solution, Solution):
                yield one.index, solution


def clip_plate(frames: Sequence[LinearImage]) -> LinearImage:
    """The plate of a clip, from frames all over it."""
    return make_plate(frames[:: -(-len(frames) // PLATE_FRAMES) or 1]).plate


def wanted_frames(
    rows: Sequence[FrameMotion], model: ColorModel, numbers: Sequence[int]
) -> list[Wanted]:
    """The frames to solve, with what the others say of them.

    Parameters
    ----------
    rows : sequence of FrameMotion
        The table of a clip.
    model : ColorModel
        Of the object.
    numbers : sequence of int
        Of all frames of the clip, as in the table.
    """
    wanted, index_of = [], {number: index for index, number in enumerate(numbers)}
    for number in sorted({row.object or 1 for row in rows if row.sighting is not None}):
        mine = [row for row in rows if row.sighting is not None and (row.object or 1) == number]
        shared_by = ClipObject.of(mine, model)
        wanted += [
            Wanted(index_of[row.frame], row, size, shared_by.is_disc)
            for row, size in zip(mine, shared_by.sizes, strict=True)
        ]
    return sorted(wanted, key=lambda one: (one.index, one.row.object or 1))


def _box_of(sighting: Sighting, boxes: Sequence[Box], size: tuple[int, int]) -> Box:
    """The box of the frame in which the streak was measured, or one around it."""
    x, y = sighting.place
    inside = [box for box in boxes if box[0] <= x < box[2] and box[1] <= y < box[3]]
    if inside:
        return inside[0]
    reach = 2 * sighting.radius + sighting.length / 2 + 32
    corner = np.maximum(np.floor([x - reach, y - reach]), 0).astype(int)
    end = np.minimum(np.ceil([x + reach, y + reach]), size).astype(int)
    return int(corner[0]), int(corner[1]), int(end[0]), int(end[1])


def _start(
    sighting: Sighting, crop: Crop, model: ColorModel, size: SizePrior | None
) -> Sweep | None:
    """Where the fit starts: the path that was measured, and the radius from all frames."""
    if sighting.source != "sweep" and size is None:
        return None
    radius = sighting.radius if size is None else size.radius
    ends = [sighting.first_x, sighting.first_y, sighting.last_x, sighting.last_y]
    path = LINE.shifted(np.array(ends), -np.array(crop.box[:2], float))
    shape, covariance = DISC.start(radius), np.zeros((5, 5))
    return Sweep(LINE, path, DISC, shape, model, covariance, crop.image.size)

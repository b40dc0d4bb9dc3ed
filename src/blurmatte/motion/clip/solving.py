"""FrameSolver: the solution of one frame of a clip, with what the frames share as a prior."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from blurmatte.background import Matching
from blurmatte.background.registration import CameraPath
from blurmatte.checks import Array, Box, box_from, check_kind, enclosing
from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError, BlurmatteWarning
from blurmatte.matting.case import Solver
from blurmatte.matting.hypotheses import Swept
from blurmatte.matting.solution import Solution
from blurmatte.matting.solve import shape_odds, solve
from blurmatte.motion.clip.clip_path import mistake_probability, priors_of
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.motion.clip.matched_filter import moving_parts
from blurmatte.motion.clip.rolling_shutter import RollingShutter, Stretch
from blurmatte.motion.clip.scene import Crop, StaticScene
from blurmatte.motion.clip.workers import Workers, spread_out, successes
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import CodedFrame, coded_frames
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR, pooled_log_odds
from blurmatte.streaks import Streak, dilated, find_streaks
from blurmatte.sweep import MotionPrior, Sweep
from blurmatte.sweep.fit_sweep import fit_stretch
from blurmatte.sweep.model.path import LINE, PARABOLA, PathFamily
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.model.silhouette import DISC

STRETCH_FRAMES = 16  # of which the camera's readout time is measured at most
SILHOUETTE_FRAMES = 8  # in which a disc is compared with other silhouettes at a time
_STARTS = (0.0, 0.5, 0.25)  # of the rounds of frames, of the distance between these
_MIN_PROBABILITY = 1e-3  # that any frame of a clip differs as much from its prior by noise
_CONTRADICTS = "clip"  # reason of a grade: the frame is solved alone
# What a work finds in some frames, each given alone
_Each = Callable[[Callable[..., Any], "Sequence[FrameToSolve]"], Iterator[Any]]


@dataclass(frozen=True, eq=False)
class FrameToSolve:
    """A frame that is solved.

    Parameters
    ----------
    index : int
        Of the frame in the clip.
    row : FrameMotion
        Where the object is.
    prior : MotionPrior or None
        Its radius and path from the other frames. If its silhouette is a disc, other shapes are no
        alternatives.
    has_shape : bool
        Alpha without a shape is no alternative.
    stretch_cost : float
        Of the stretch of a disc that is fitted to the frame, in log odds.
    """

    index: int
    row: FrameMotion
    prior: MotionPrior | None
    has_shape: bool = False
    stretch_cost: float = 0.0

    @property
    def displacement(self) -> Array:
        """(2,) of the object in the exposure, pixels, as the other frames predict it."""
        if self.prior is None or self.prior.path is None:
            return np.zeros(2)
        points = self.prior.path.points
        return np.asarray(points[2] - points[0])

    def seen_by(self, camera: CameraPath) -> FrameToSolve:
        """The same in the pixels of the frame, from those of the canvas of a camera that moves."""
        one = self.row.sighting
        if one is None:
            return self
        points = partial(camera.to_frame, self.index)
        prior = self.prior and self.prior.mapped(points, one.measured.center)
        return replace(self, row=self.row.mapped(points), prior=prior)

    def stretched(self, shutter: RollingShutter, own: Stretch | None) -> FrameToSolve:
        """The same with a camera, and the stretch that the frame alone measures."""
        if self.prior is None:
            return self
        (a, b), cost = shutter.stretch(self.displacement, own)
        prior = replace(self.prior, camera_stretch=(float(a), float(b)))
        return replace(self, prior=prior, stretch_cost=cost)

    def shaped(self, is_disc: bool) -> FrameToSolve:
        """The same of an object that has a shape, perhaps a disc, if there is a prior of it."""
        prior = self.prior
        if prior is None:
            return self
        return replace(self, prior=replace(prior, is_disc=is_disc), has_shape=True)


@dataclass(frozen=True, eq=False)
class FrameSolver:
    """Solves frames of a clip; holds what they share."""

    scene: StaticScene
    frame_count: int  #: of the clip
    solver: Solver | None = None  #: None averages all hypotheses

    @property
    def min_probability(self) -> float:
        """That a frame differs as much from its prior: less is a contradiction."""
        return _MIN_PROBABILITY / self.frame_count

    @property
    def fits_shapes(self) -> bool:
        """Whether path and radius of the other frames are a prior of the solutions.

        They are those of solid discs: others on other paths resemble those that let light through.
        """
        if self.solver is None:
            return True
        return self.solver.needs_sweep and self.solver.opacity is not OpacityPrior.ANY

    def __call__(self, frames: Sequence[LinearImage], wanted: FrameToSolve) -> Solution | str:
        """The solution in the whole picture, or why there is none.

        Parameters
        ----------
        frames : sequence of LinearImage
            The frame alone.
        wanted : FrameToSolve
        """
        try:
            frame, own, wanted = self._of_frame(frames, wanted)
            crop, solution = own.solved(frame, wanted)
        except BlurmatteError as error:
            return str(error)
        return solution.in_picture(crop.box, frame.size)

    def _of_frame(
        self, frames: Sequence[LinearImage], wanted: FrameToSolve
    ) -> tuple[CodedFrame, FrameSolver, FrameToSolve]:
        """A frame given alone, and solver and object in its own pixels if the camera moves.

        Raises PlateError if it could not be registered.
        """
        (frame,) = coded_frames(frames, slice(None))
        camera = self.scene.camera
        if camera is None:
            return frame, self, wanted
        own = replace(self, scene=self.scene.at(frames, frame, wanted.index))
        return frame, own, wanted.seen_by(camera)

    def solved(self, frame: CodedFrame, wanted: FrameToSolve) -> tuple[Crop, Solution]:
        """The crop around the object, and its solution there.

        Raises
        ------
        BlurmatteError
            If the object cannot be separated.
        """
        if wanted.row.sighting is None:
            moved = enclosing(self.scene.boxes(frame, wanted.index))
            (crop,) = self.scene.crops(frame, [moved])
            of_any_color = replace(self.scene, model=ColorModel.any())
            return crop, replace(self, scene=of_any_color)._solution(crop, None, None, None)
        crop, streak, start, prior = self._prepared(frame, wanted)
        own = replace(self, solver=self.solver or (Swept() if wanted.has_shape else None))
        if prior is None:
            return crop, own._solution(crop, streak, start, None)
        with suppress(BlurmatteError):
            solution = own._solution(crop, streak, start, prior)
            assert solution.sweep is not None
            if solution.sweep.diagnostics.prior_probability > self.min_probability:
                return crop, solution
        # It may have bounced; its silhouette is that of all frames.
        silhouette = prior.of_silhouette if prior.is_disc else None
        alone = own._solution(crop, streak, None, silhouette)
        reasons = (_CONTRADICTS, *alone.stats.grade_reasons)
        return crop, replace(alone, stats=replace(alone.stats, grade_reasons=reasons))

    def _prepared(
        self, frame: CodedFrame, wanted: FrameToSolve
    ) -> tuple[Crop, Streak | None, Sweep | None, MotionPrior | None]:
        """The crop around the object; streak, start of the fit and prior in it."""
        sighting, prior = wanted.row.sighting, wanted.prior
        assert sighting is not None
        boxes = self.scene.boxes(frame, wanted.index)
        (crop,) = self.scene.crops(frame, [_box_of(sighting, boxes, frame.size)])
        if prior is not None:
            prior = prior.shifted(-np.array(crop.box[:2], float))
        start = _start(sighting, crop, self.scene.model, prior)
        return crop, self._streak(crop, sighting), start, prior

    def stretch(self, frames: Sequence[LinearImage], wanted: FrameToSolve) -> Stretch | None:
        """Stretch of the disc in a frame given alone, and its covariance; None if it shows none."""
        frame, own, wanted = self._of_frame(frames, wanted)
        crop, streak, start, prior = own._prepared(frame, wanted)
        if streak is None or prior is None:
            return None
        try:
            pixels = crop.image, crop.plate, streak
            stretch, V = fit_stretch(*pixels, self.scene.model, start, prior)
        except BlurmatteError:
            return None
        return (stretch, V) if np.all(np.linalg.eigvalsh(V) > 0) else None  # else it is not in view

    def _solution(
        self, crop: Crop, streak: Streak | None, start: Sweep | None, prior: MotionPrior | None
    ) -> Solution:
        """The solution with a prior, or of the crop alone; a clip reports what all frames show."""
        with warnings.catch_warnings(action="ignore", category=BlurmatteWarning):
            return solve(
                *(crop.image, crop.plate, self._given, self.solver),
                streak=streak,
                matching=Matching.NONE,
                start=start,
                prior=prior,
                occluder=self.scene.hidden_in(crop.box),
            )

    @property
    def _given(self) -> ColorModel | None:
        """The color of the object, unless it may have any."""
        return None if self.scene.model.rank == 3 else self.scene.model

    def silhouette_odds(
        self, frames: Sequence[LinearImage], wanted: FrameToSolve
    ) -> tuple[float, float] | None:
        """Log odds of a disc against an outline, and of a shape against none, in a frame given alone.

        None for a frame that contradicts the others.
        """
        frame, own, wanted = self._of_frame(frames, wanted)
        try:
            crop, streak, start, prior = own._prepared(frame, wanted)
            if prior is None:
                return None
            with warnings.catch_warnings(action="ignore", category=BlurmatteWarning):
                sweep, (disc, shape) = shape_odds(
                    *(crop.image, crop.plate, self._given),
                    streak=streak,
                    start=start,
                    prior=prior,
                    occluder=own.scene.hidden_in(crop.box),
                )
        except BlurmatteError:
            return None
        if sweep.diagnostics.prior_probability <= self.min_probability:
            return None
        return disc - wanted.stretch_cost, shape - wanted.stretch_cost

    def _streak(self, crop: Crop, sighting: Sighting) -> Streak | None:
        """The streak in a crop that was measured there; None if it is not found again."""
        if self.scene.color is None:
            parts = moving_parts(crop.image, crop.plate) or find_streaks(crop.image, crop.plate)
        else:
            parts = self.scene.color.within(crop.box).parts(crop.image)
        x0, y0 = crop.box[:2]
        t = np.linspace(0, 1, 9)[:, None]
        ends = sighting.motion.trajectory.xy[[0, -1]]
        path = np.rint((1 - t) * ends[0] + t * ends[1] - (x0, y0)).astype(int)
        width, height = crop.image.size
        x, y = path[np.all((path >= 0) & (path < (width, height)), axis=1)].T
        hits = [int(np.count_nonzero(dilated(part.mask, 1)[y, x])) for part in parts]
        return parts[int(np.argmax(hits))] if any(hits) else None


def check_clip_solver(solver: Solver | None) -> None:
    """Raise TypeError or ValueError unless frames of a clip can be solved by it."""
    check_kind("solver", solver, Solver | None, "such as blurmatte.Smooth()")
    if solver is not None and solver.refusal_in_clips:
        raise ValueError(solver.refusal_in_clips)


def rows_to_solve(rows: Sequence[FrameMotion], color_found: bool) -> list[FrameMotion]:
    """Rows of the table of a clip with a solution: those of objects, and of frames solved alone.

    A frame is solved as a single picture if something moved there, but no object was measured. Where
    an object is measured in most of the frames in which anything moved, whatever else moves is not the
    object; nor is it if the color was given.
    """
    found = [row for row in rows if row.sighting is not None]
    moved = {row.frame for row in rows if row.something_moved}
    rest = [row for row in rows if row.something_moved and row.sighting is None]
    return [*found, *rest] if color_found and 2 * len(rest) > len(moved) else found


def parts_to_solve(wanted: Iterable[FrameToSolve]) -> Iterator[tuple[slice, FrameToSolve]]:
    """For `Workers.over`: each frame alone, and what is known of it."""
    return ((slice(one.index, one.index + 1), one) for one in wanted)


def wanted_frames(
    frames: Sequence[LinearImage],
    rows: Sequence[FrameMotion],
    solver: FrameSolver,
    numbers: Sequence[int],
    workers: Workers,
    color_found: bool,
) -> list[FrameToSolve]:
    """The frames to solve, with what the others say of them.

    The object has a shape in all frames if that is decisively likelier than alpha without one, and the
    shape is a disc if that is decisively likelier than other outlines, in frames all over the clip
    together: the log Bayes factors of single frames add, until they are decisive. Any frame may
    mislead, where something hides the object or moves next to it, as often as frames contradict path
    and radius of the clip: that bounds what one of them can say. A solver that fits no shapes has no
    use for any of this.

    Parameters
    ----------
    frames : sequence of LinearImage
        Of the clip.
    rows : sequence of FrameMotion
        The table of the clip.
    solver : FrameSolver
        With the color of the object.
    numbers : sequence of int
        Of all frames of the clip, as in the table.
    workers : Workers
    color_found : bool
        The color was found and not given: frames without the object may be solved alone.
    """

    def each(work: Callable[..., Any], some: Sequence[FrameToSolve]) -> Iterator[Any]:
        """What a work finds in some frames, each given alone."""
        return successes(workers.over(frames, work, parts_to_solve(some)))

    index_of = {number: index for index, number in enumerate(numbers)}
    wanted, objects = list[FrameToSolve](), dict[int, list[FrameToSolve]]()
    for row in rows_to_solve(rows, color_found):
        one = FrameToSolve(index_of[row.frame], row, None)
        if row.sighting is None or not solver.fits_shapes:
            wanted.append(one)
        else:
            objects.setdefault(row.object or 1, []).append(one)
    camera = solver.scene.camera
    delay_std = 0.0 if camera is None else camera.delay_std
    for mine in objects.values():
        priors, used = priors_of([one.row for one in mine], delay_std)
        found = [replace(one, prior=prior) for one, prior in zip(mine, priors, strict=True)]
        known = [k for k, one in enumerate(found) if used[k] and one.prior is not None]
        found = _stretched(found, [found[k] for k in known], solver, each)
        mistake = mistake_probability([one.row.sighting for one in mine if one.row.sighting])
        is_disc, has_shape = _decided([found[k] for k in known], mistake, solver, each)
        wanted += [one.shaped(is_disc) for one in found] if has_shape else found
    return sorted(wanted, key=lambda one: (one.index, one.row.object or 1))


def _stretched(
    found: list[FrameToSolve], known: Sequence[FrameToSolve], solver: FrameSolver, each: _Each
) -> list[FrameToSolve]:
    """Frames with the stretch by the camera, if a rolling shutter is decisively likelier than none.

    It is measured in frames that agree with the path, in more of them while it is likelier, and then in
    all.
    """
    pairs, shutter = [], RollingShutter()
    seen = [one.row.sighting for one in known if one.row.sighting is not None]
    readout = seen[0].motion.readout if seen else "down"  # of all frames of a clip
    for some in spread_out(known, STRETCH_FRAMES, _STARTS):
        stretches = zip(each(solver.stretch, some), some, strict=True)
        pairs += [(x, one.displacement) for x, one in stretches if x]
        shutter = RollingShutter.of(pairs, readout)
        if shutter.is_decisive or shutter.log_odds < 0:
            break
    if not shutter.is_decisive:
        return found
    stretches = zip(each(solver.stretch, found), found, strict=True)
    return [one.stretched(shutter, x) for x, one in stretches]


def _decided(
    known: Sequence[FrameToSolve], mistake_probability: float, solver: FrameSolver, each: _Each
) -> tuple[bool, bool]:
    """Whether frames that may mislead are decisive for a disc, and for a shape.

    A sequential test [Wald 1945]: frames all over the clip, then frames between them.
    """
    odds: list[tuple[float, float]] = []
    total = np.zeros(2)
    for some in spread_out(known, SILHOUETTE_FRAMES, _STARTS):
        odds += [one for one in each(solver.silhouette_odds, some) if one is not None]
        total = pooled_log_odds(odds, mistake_probability)
        if np.all(np.abs(total) > DECISIVE_LOG_BAYES_FACTOR):
            break
    disc, shape = (total > DECISIVE_LOG_BAYES_FACTOR).tolist()
    return disc, shape


def _box_of(sighting: Sighting, boxes: Sequence[Box], size: tuple[int, int]) -> Box:
    """The box of the frame in which the streak was measured, or one around it."""
    x, y = center = sighting.motion.center
    inside = [box for box in boxes if box[0] <= x < box[2] and box[1] <= y < box[3]]
    if inside:
        return inside[0]
    reach = 2 * sighting.motion.radius + sighting.motion.length / 2 + 32
    return box_from(np.floor(center - reach), np.ceil(center + reach), size)


def _start(
    sighting: Sighting, crop: Crop, model: ColorModel, prior: MotionPrior | None
) -> Sweep | None:
    """Where the fit starts: the path from all frames, or else the one that was measured."""
    if not sighting.motion.has_shape and prior is None:
        return None
    family: PathFamily = LINE
    path = LINE.shifted(
        sighting.motion.trajectory.xy[[0, -1]].ravel(), -np.array(crop.box[:2], float)
    )
    if prior is not None and prior.path is not None:
        family, path = PARABOLA, prior.path.points.ravel()
    radius = sighting.motion.radius if prior is None else prior.radius
    return swept_disc(family, path, radius, model, crop.image.size)


def swept_disc(
    family: PathFamily, path: Array, radius: float, model: ColorModel, size: tuple[int, int]
) -> Sweep:
    """A disc of a radius on a path, without errors, in a picture of a size."""
    covariance = np.zeros((len(path) + 1, len(path) + 1))
    return Sweep(family, path, DISC, DISC.start(radius), model, covariance, size)

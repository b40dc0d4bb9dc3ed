"""FrameSolver: the solution of one frame of a clip, with what the frames share as a prior.

A frame that was measured is fitted again: path and radius that the other frames predict change the fit,
and are known only when all frames are measured. The stretch by the camera and the odds of silhouettes
come from fits to some frames before, for they are a part of that prior.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from blurmatte.background import Matching
from blurmatte.checks import Array, check_kind, enclosing
from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError, BlurmatteWarning, MotionError
from blurmatte.matting.case import Solver
from blurmatte.matting.hypotheses import Swept
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.matting.solve import shape_odds, solve
from blurmatte.motion.clip.cadence import is_repeat
from blurmatte.motion.clip.clip_path import mistake_probability, with_priors
from blurmatte.motion.clip.detections import FrameMotion, Sighting, by_object
from blurmatte.motion.clip.rolling_shutter import RollingShutter, Stretch
from blurmatte.motion.clip.scene import Part, StaticScene, box_in_frame
from blurmatte.motion.clip.smoothing import MIN_OUTLIER_PROBABILITY
from blurmatte.motion.clip.workers import Workers, spread_out, successes
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import CodedFrame, coded_frames
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR, pooled_log_odds
from blurmatte.streaks import Streak, dilated, find_streaks
from blurmatte.sweep import MotionPrior, Sweep
from blurmatte.sweep.discs import fit_stretch
from blurmatte.sweep.model.path import PARABOLA, PathFamily
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.model.silhouette import DISC

STRETCH_FRAMES = 16  # of which the camera's readout time is measured at most
SILHOUETTE_FRAMES = 4  # in which a disc is compared with other silhouettes at a time
_STARTS = (0.0, 0.5, 0.25)  # of the rounds of frames, of the distance between these
_SILHOUETTE_STARTS = (*_STARTS, 0.75, 0.125, 0.625)
_CONTRADICTS = "clip"  # reason of a grade: the frame is solved alone
_ALONE = "Its path or radius contradicts the other frames, so that it was solved alone."
_Found = Callable[[Sequence[FrameMotion]], Iterator[Any]]  # what is found in frames given alone


@dataclass(frozen=True, eq=False)
class FrameSolver:
    """Solves frames of a clip; holds what they share."""

    scene: StaticScene
    index_of: Mapping[int, int]  #: index of each frame of the clip, by its number
    solver: Solver | None = None  #: None averages all hypotheses
    #: Numbers of the objects of which alpha without a shape is no alternative
    shaped: frozenset[int] = frozenset()

    @property
    def min_probability(self) -> float:
        """That a frame differs as much from its prior: less is a contradiction."""
        return MIN_OUTLIER_PROBABILITY / len(self.index_of)

    @property
    def fits_shapes(self) -> bool:
        """Whether path and radius of the other frames are a prior of the solutions.

        They are those of solid discs: others on other paths resemble those that let light through.
        """
        if self.solver is None:
            return True
        return self.solver.needs_sweep and self.solver.opacity is not OpacityPrior.ANY

    def parts(self, rows: Iterable[FrameMotion]) -> Iterator[tuple[slice, FrameMotion]]:
        """For `Workers.over`: each frame alone, and its row."""
        for row in rows:
            index = self.index_of[row.frame]
            yield slice(index, index + 1), row

    def __call__(self, frames: Sequence[LinearImage], row: FrameMotion) -> Solution | str:
        """The solution in the whole picture, or why there is none.

        Parameters
        ----------
        frames : sequence of LinearImage
            The frame alone.
        row : FrameMotion
        """
        try:
            frame, own, row = self._of_frame(frames, row)
            part, solution = own.solved(frame, row)
        except BlurmatteError as error:
            return str(error)
        return solution.in_picture(box_in_frame(part), frame.size)

    def _of_frame(
        self, frames: Sequence[LinearImage], row: FrameMotion
    ) -> tuple[CodedFrame, FrameSolver, FrameMotion]:
        """A frame given alone, and solver and row in its own pixels if the camera moves.

        Raises PlateError if it could not be registered.
        """
        (frame,) = coded_frames(frames, slice(None))
        camera = self.scene.camera
        if camera is None:
            return frame, self, row
        index = self.index_of[row.frame]
        own = replace(self, scene=self.scene.at(frames, frame, index))
        return frame, own, row.mapped(partial(camera.to_frame, index))

    def solved(self, frame: CodedFrame, row: FrameMotion) -> tuple[Part, Solution]:
        """The part around the object, and its solution there.

        Raises
        ------
        BlurmatteError
            If the object cannot be separated.
        """
        if row.sighting is None:
            index = self.index_of[row.frame]
            moved = enclosing(self.scene.surveyed[index])
            (part,) = self.scene.parts(frame, index, [moved])
            of_any_color = replace(self.scene, model=ColorModel.any())
            return part, replace(self, scene=of_any_color)._solution(part, None, None, None)
        part, streak, start, prior = self._prepared(frame, row)
        if prior is None:
            return part, self._solution(part, streak, start, None)
        has_shape = (row.object or 1) in self.shaped
        own = replace(self, solver=self.solver or (Swept() if has_shape else None))
        with suppress(BlurmatteError):
            solution = own._solution(part, streak, start, prior)
            assert solution.sweep is not None
            if solution.sweep.diagnostics.prior_probability > self.min_probability:
                return part, solution
        # It may have bounced; its silhouette is that of all frames.
        silhouette = prior.of_silhouette if prior.is_disc else None
        alone = own._solution(part, streak, None, silhouette)
        reasons = (_CONTRADICTS, *alone.stats.grade_reasons)
        grade = min(alone.stats.grade or Grade.ASSUMED, Grade.PLAUSIBLE)  # frames disagree
        stats = replace(alone.stats, grade=grade, grade_reasons=reasons)
        return part, replace(alone, stats=stats)

    def _prepared(
        self, frame: CodedFrame, row: FrameMotion
    ) -> tuple[Part, Streak | None, Sweep | None, MotionPrior | None]:
        """The part around the object; streak, start of the fit and prior in it."""
        sighting, prior = row.sighting, row.prior
        assert sighting is not None
        (part,) = self.scene.parts(frame, self.index_of[row.frame], [sighting.box])
        if prior is not None:
            prior = prior.shifted(-np.array(sighting.box[:2], float))
        start = _start(sighting, self.scene.model, prior)
        return part, self._streak(part, sighting), start, prior

    def stretch(self, frames: Sequence[LinearImage], row: FrameMotion) -> Stretch | None:
        """Stretch of the disc in a frame given alone, and its covariance; None if it shows none."""
        frame, own, row = self._of_frame(frames, row)
        part, streak, start, prior = own._prepared(frame, row)
        if streak is None or prior is None:
            return None
        try:
            stretch, V = fit_stretch(*part, streak, self.scene.model, start, prior)
        except BlurmatteError:
            return None
        return (stretch, V) if np.all(np.linalg.eigvalsh(V) > 0) else None  # else it is not in view

    def _solution(
        self, part: Part, streak: Streak | None, start: Sweep | None, prior: MotionPrior | None
    ) -> Solution:
        """The solution with a prior, or of the part alone; a clip reports what all frames show."""
        with warnings.catch_warnings(action="ignore", category=BlurmatteWarning):
            return solve(
                *part,
                self._given,
                self.solver,
                streak=streak,
                matching=Matching.NONE,
                start=start,
                prior=prior,
                occluder=self.scene.hidden_in(part),
            )

    @property
    def _given(self) -> ColorModel | None:
        """The color of the object, unless it may have any."""
        return None if self.scene.model.rank == 3 else self.scene.model

    def silhouette_odds(
        self, frames: Sequence[LinearImage], row: FrameMotion
    ) -> tuple[float, float] | None:
        """Log odds of a disc against an outline, and of a shape against none, in a frame given alone.

        None for a frame that contradicts the others.
        """
        frame, own, row = self._of_frame(frames, row)
        try:
            part, streak, start, prior = own._prepared(frame, row)
            if prior is None:
                return None
            with warnings.catch_warnings(action="ignore", category=BlurmatteWarning):
                sweep, odds = shape_odds(
                    *part,
                    self._given,
                    streak=streak,
                    start=start,
                    prior=prior,
                    occluder=own.scene.hidden_in(part),
                )
        except BlurmatteError:
            return None
        return odds if sweep.diagnostics.prior_probability > self.min_probability else None

    def _streak(self, part: Part, sighting: Sighting) -> Streak | None:
        """The streak in a part that was measured there; None if it is not found again.

        Masks of all frames would fill memory and manifest; to find one takes a fiftieth of a solution.
        """
        streaks = self.scene.streaks(part)
        if not streaks and self.scene.color is None:
            streaks = find_streaks(*part)
        t = np.linspace(0, 1, 9)[:, None]
        ends = sighting.motion.trajectory.xy[[0, -1]]
        path = np.rint((1 - t) * ends[0] + t * ends[1] - box_in_frame(part)[:2])
        x, y = path[np.all((path >= 0) & (path < part[0].size), axis=1)].astype(int).T
        hits = [int(np.count_nonzero(dilated(streak.mask, 1)[y, x])) for streak in streaks]
        return streaks[int(np.argmax(hits))] if any(hits) else None


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


def rows_with_priors(
    frames: Sequence[LinearImage],
    rows: Sequence[FrameMotion],
    solver: FrameSolver,
    workers: Workers,
    color_found: bool,
) -> tuple[FrameSolver, list[FrameMotion]]:
    """The rows to solve, with what the others say of them, and the solver that knows which shapes.

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
    workers : Workers
    color_found : bool
        The color was found and not given: frames without the object may be solved alone.
    """

    def each(work: Callable[..., Any]) -> _Found:
        """What a work finds in some frames, each given alone."""
        return lambda some: successes(workers.over(frames, work, solver.parts(some)))

    wanted = rows_to_solve(rows, color_found)
    objects = by_object(wanted) if solver.fits_shapes else {}
    wanted = [row for row in wanted if row.sighting is None] if objects else wanted
    camera, shaped = solver.scene.camera, set[int]()
    delay_std = 0.0 if camera is None else camera.delay_std
    for number, mine in objects.items():
        found, used = with_priors(mine, delay_std)
        known = [k for k, row in enumerate(found) if used[k] and row.prior is not None]
        found, costs = _stretched(found, known, each(solver.stretch))
        mistake = mistake_probability([row.sighting for row in mine if row.sighting])
        odds = each(solver.silhouette_odds)
        is_disc, has_shape = _decided(found, known, costs, mistake, odds)
        if has_shape:
            shaped.add(number)
            found = [_with_prior(row, is_disc=is_disc) for row in found]
        wanted += found
    wanted.sort(key=lambda row: (solver.index_of[row.frame], row.object or 1))
    return replace(solver, shaped=frozenset(shaped)), wanted


def _with_prior(row: FrameMotion, **changed: Any) -> FrameMotion:
    """The row with a changed prior, if it has one."""
    return replace(row, prior=row.prior and replace(row.prior, **changed))


def _stretched(
    found: list[FrameMotion], known: Sequence[int], stretches_of: _Found
) -> tuple[list[FrameMotion], list[float]]:
    """Rows with the stretch by the camera, if a rolling shutter is decisively likelier than none.

    It is measured in known frames, which agree with the path, in more of them while it is likelier, and
    then in all. Of each row also the cost of its stretch, in log odds.
    """
    pairs, shutter, agreeing = [], RollingShutter(), [found[k] for k in known]
    first = found[0].sighting
    assert first is not None
    readout = first.motion.readout  # of all frames of a clip
    for some in spread_out(agreeing, STRETCH_FRAMES, _STARTS):
        stretches = zip(stretches_of(some), some, strict=True)
        pairs += [(x, _displacement(row)) for x, row in stretches if x]
        shutter = RollingShutter.of(pairs, readout)
        if shutter.is_decisive or shutter.log_odds < 0:
            break
    costs = [0.0 for _ in found]
    if not shutter.is_decisive:
        return found, costs
    rows = list[FrameMotion]()
    for k, (x, row) in enumerate(zip(stretches_of(found), found, strict=True)):
        (a, b), costs[k] = shutter.stretch(_displacement(row), x)
        rows.append(_with_prior(row, camera_stretch=(float(a), float(b))))
    return rows, costs


def _displacement(row: FrameMotion) -> Array:
    """(2,) of the object in the exposure, pixels, as the other frames predict it."""
    if row.prior is None or row.prior.path is None:
        return np.zeros(2)
    points = row.prior.path.points
    return np.asarray(points[2] - points[0])


def _decided(
    rows: Sequence[FrameMotion],
    known: Sequence[int],
    costs: Sequence[float],
    mistake_probability: float,
    odds_of: _Found,
) -> tuple[bool, bool]:
    """Whether known frames, which may mislead, are decisive for a disc, and for a shape.

    A sequential test [Wald 1945]: frames all over the clip, then frames between them.
    """
    odds: list[tuple[float, float]] = []
    total = np.zeros(2)
    for some in spread_out(known, SILHOUETTE_FRAMES, _SILHOUETTE_STARTS):
        found = zip(odds_of([rows[k] for k in some]), some, strict=True)
        pairs = [(one, costs[k]) for one, k in found if one is not None]
        odds += [(disc - cost, shape - cost) for (disc, shape), cost in pairs]
        total = pooled_log_odds(odds, mistake_probability)
        if np.all(np.abs(total) > DECISIVE_LOG_BAYES_FACTOR):
            break
    disc, shape = (total > DECISIVE_LOG_BAYES_FACTOR).tolist()
    return disc, shape


def _start(sighting: Sighting, model: ColorModel, prior: MotionPrior | None) -> Sweep | None:
    """Where the fit in a part starts: the path from all frames, or else the one that was measured."""
    if not sighting.motion.has_shape and prior is None:
        return None
    x0, y0, x1, y1 = sighting.box
    (path,) = PARABOLA.starts(sighting.motion.trajectory.xy - np.array([x0, y0], float))
    if prior is not None and prior.path is not None:
        path = prior.path.points.ravel()
    radius = sighting.motion.radius if prior is None else prior.radius
    return swept_disc(PARABOLA, path, radius, model, (x1 - x0, y1 - y0))


def as_solved(row: FrameMotion, solution: Solution) -> FrameMotion:
    """The row with what its solution in the whole picture measures; with a reason if that is nothing.

    A solution that agrees with the other frames has no doubts of the detection.
    """
    one, sweep = row.sighting, solution.sweep
    try:
        motion = measure_motion(solution)
    except MotionError as error:
        return replace(row, sighting=None, reason=str(error))
    doubts: tuple[str, ...] = ()
    if _CONTRADICTS in solution.stats.grade_reasons:
        doubts = (_ALONE,)
    elif one is not None and (row.prior is None or is_repeat(one)):
        doubts = one.measured.doubts
    box, excess = solution.layer.box, 1.0 if sweep is None else sweep.diagnostics.residual_excess
    solved = Sighting(
        replace(motion, sweep=None, doubts=motion.doubts + doubts),
        *(solution.model.color, 0.0 if one is None else one.evidence),
        *(excess, box if one is None else one.box),
        backward=one is not None and one.backward,
    )
    return replace(row, sighting=solved)


def swept_disc(
    family: PathFamily, path: Array, radius: float, model: ColorModel, size: tuple[int, int]
) -> Sweep:
    """A disc of a radius on a path, without errors, in a picture of a size."""
    covariance = np.zeros((len(path) + 1, len(path) + 1))
    return Sweep(family, path, DISC, DISC.start(radius), model, covariance, size)

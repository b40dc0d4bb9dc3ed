"""The steps from the frames of a clip to the motion of its object, and to a solution for each frame.

`measured` and `solved` are the only way through a clip: `measure_clip`, `solve_clip`, `save_clip` and
the command `track` differ in what they do with the results. Stages, and how far they are, are logged.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol, TypeVar, runtime_checkable

from blurmatte.background import ClipShot
from blurmatte.background.registration import CameraPath, show_one_scene
from blurmatte.background.shots import Thumbnail, find_shots, joined_shots, thumbnail
from blurmatte.checks import Bools, Direction, check_kind
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError
from blurmatte.matting.case import Solver
from blurmatte.matting.solution import Solution
from blurmatte.motion.clip.color import color_in_scene, seen_color
from blurmatte.motion.clip.detections import FrameMotion, FrameSightings, Sighting
from blurmatte.motion.clip.linking import link_objects, link_sightings
from blurmatte.motion.clip.measure import Detector, scene_of
from blurmatte.motion.clip.scene import StaticScene, clip_plate, path_before, survey
from blurmatte.motion.clip.solving import (
    FrameSolver,
    check_clip_solver,
    rows_to_solve,
    rows_with_priors,
)
from blurmatte.motion.clip.workers import LOG, Failure, Workers, logged, parts_of, shared, successes
from blurmatte.motion.columns import Rows
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.coded import coded_frames, each_coded

Result = TypeVar("Result")


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


@dataclass(frozen=True, eq=False)
class ClipInputs:
    """Frames of a camera, at rest or in the hand, and what is known of them.

    Parameters
    ----------
    frames : sequence of LinearImage
    plate : LinearImage, optional
        The scene without the object; made from up to 60 frames if not given.
    model : ColorModel, optional
        Of the object; found if not given.
    several : bool
        Follow every object of that color that is visible in `min_frames` frames or more.
    hidden : (H, W) bool, optional
        Where something is in front of the scene.
    rate : float, optional
        Frames per second; replaces the times of the frames.
    min_frames : int
    any_color : bool
        If no color is found, the object may have any.
    finished : sequence of FrameSightings
        Of the first frames, which are not measured again.
    written : container of (int, int), optional
        Numbers of frame and object of solutions that exist. If those are all, neither the color nor
        what the frames share is found again.
    """

    frames: Sequence[LinearImage]
    plate: LinearImage | None = None
    model: ColorModel | None = None
    several: bool = False
    hidden: Bools | None = None
    rate: float | None = None
    min_frames: int = 3
    any_color: bool = False
    finished: Sequence[FrameSightings] = ()
    written: Container[tuple[int, int]] | None = None

    def __post_init__(self) -> None:
        kind, remedy = ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")'
        check_kind("model", self.model, kind, remedy)

    @property
    def numbers(self) -> Sequence[int]:
        """Of the frames."""
        frames = self.frames
        return frames.frame_numbers if isinstance(frames, ClipFrames) else range(len(frames))

    @cached_property
    def index_of(self) -> dict[int, int]:
        """Index of each frame among all, by its number."""
        return {number: index for index, number in enumerate(self.numbers)}

    def linked(
        self, seen: Sequence[FrameSightings], camera: CameraPath | None
    ) -> list[FrameMotion]:
        """The table of the clip; in pixels of the canvas if the camera moves."""
        if camera is not None:
            seen = [_on_canvas(one, camera, self.index_of[one.frame]) for one in seen]
        return link_objects(seen, self.min_frames) if self.several else link_sightings(seen)


def _on_canvas(one: FrameSightings, camera: CameraPath, index: int) -> FrameSightings:
    """The detections of a frame in pixels of the canvas."""
    return replace(one, found=tuple(_mapped(seen, camera, index) for seen in one.found))


def _mapped(one: Sighting, camera: CameraPath, index: int) -> Sighting:
    """A detection in pixels of the canvas."""
    return one.mapped(partial(camera.to_canvas, index))


@dataclass(frozen=True, eq=False)
class ClipMeasured:
    """Where the object is in each frame, and what was found of the clip.

    Parameters
    ----------
    clip : ClipInputs
    plate : LinearImage
        If the camera moves, on its canvas.
    rows : list of FrameMotion
        Places in pixels of the plate.
    scene : StaticScene or None
        None if all solutions exist.
    model : ColorModel or None
    camera : CameraPath, optional
        Of a camera that moves.
    """

    clip: ClipInputs
    plate: LinearImage
    rows: list[FrameMotion]
    scene: StaticScene | None = None
    model: ColorModel | None = None
    camera: CameraPath | None = None

    @property
    def in_frames(self) -> list[FrameMotion]:
        """The rows with places in pixels of their frames."""
        camera = self.camera
        if camera is None:
            return self.rows
        index_of = self.clip.index_of
        return [row.mapped(partial(camera.to_frame, index_of[row.frame])) for row in self.rows]

    def on_canvas(self, frame: int, one: Sighting) -> Sighting:
        """A detection in a frame in pixels of the plate."""
        return one if self.camera is None else _mapped(one, self.camera, self.clip.index_of[frame])

    @property
    def color(self) -> ColorModel:
        """The color model by which the object was measured."""
        assert self.model is not None  # all solutions exist otherwise
        return self.model

    @property
    def seen_color(self) -> ColorModel:
        """The color of the object in all frames; of objects of any colors there is no mean."""
        several = self.clip.several and self.color.rank == 3
        return self.color if several else seen_color(self.color, self.rows)

    @property
    def is_gray(self) -> bool:
        """Whether the frames are gray: the object's color has no hue."""
        return self.scene is not None and self.scene.plate.meta.one_channel

    def read_out(self, readout: Direction) -> ClipMeasured:
        """The same by a camera whose next row lies in this direction."""
        seen = [(row, row.sighting) for row in self.rows]
        rows = [replace(row, sighting=one and one.read_out(readout)) for row, one in seen]
        return replace(self, rows=rows)


def shots_of(frames: Sequence[LinearImage], workers: Workers) -> list[ClipShot]:
    """The shots of a clip."""
    step, tasks = next(coded_frames(frames, slice(0, 1))).step, list(parts_of(frames, workers))
    parts = successes(workers.over(frames, _thumbnails, tasks))
    found = logged(parts, "finding the shots", len(tasks))
    shots = find_shots((one for part in found for one in part), step)
    return joined_shots(shots, lambda a, b: show_one_scene(frames[a], frames[b]))


def _thumbnails(frames: Sequence[LinearImage], _first: int) -> list[Thumbnail | None]:
    return [None if one is None else thumbnail(one) for one in each_coded(frames)]


def measured(clip: ClipInputs, workers: Workers) -> Iterator[FrameSightings | ClipMeasured]:
    """Find plate, noise, color, the object in each frame alone, and its track.

    Yields
    ------
    FrameSightings
        Of each frame that is not finished, in order.
    ClipMeasured
        At the end.

    Raises
    ------
    BlurmatteError
        If there is no plate, or no color.
    ValueError
        As in `sightings`.
    """
    frames, plate, model, seen = clip.frames, clip.plate, clip.model, list(clip.finished)
    if plate is None:
        LOG.info("making the plate")
        made = clip_plate(frames)
        plate, camera, shares = made.plate, made.camera, made.shares
    else:
        camera, shares = path_before(plate, frames), None
    if clip.written is not None and len(seen) == len(frames):
        rows = clip.linked(seen, camera)
        if all(row.place in clip.written for row in rows_to_solve(rows, model is None)):
            yield ClipMeasured(clip, plate, rows, camera=camera)
            return
    scene = scene_of(frames, plate, model or ColorModel.any(), clip.hidden, clip.rate, camera)
    scene = replace(scene, shares=shares)
    if model is None:
        LOG.info("finding the color")
        scene = survey(frames, scene, workers)
        model = _color(clip, scene, workers)
    scene = scene.of_color(frames, model)
    detector = Detector(scene, clip.numbers, clip.rate, clip.several)
    new = detector.over(frames, workers, len(seen))
    for one in logged(new, "measuring", len(frames) - len(seen)):
        seen.append(one)
        yield one
    rows = clip.linked(seen, camera)
    yield ClipMeasured(clip, plate, rows, scene, model, camera)


def _color(clip: ClipInputs, scene: StaticScene, workers: Workers) -> ColorModel:
    """The color of the object; any if the frames are gray, perhaps if no shape on a path is found."""
    if scene.plate.meta.one_channel:
        return ColorModel.any()
    try:
        return color_in_scene(clip.frames, scene, workers)
    except ColorModelError:
        if clip.any_color:
            return ColorModel.any()
        raise


def solved(
    done: ClipMeasured,
    workers: Workers,
    solver: Solver | None,
    work: Callable[[FrameSolver], Callable[[Sequence[LinearImage], FrameMotion], Result]],
) -> Iterator[tuple[FrameMotion, Result | Failure]]:
    """What a work made of each frame with the object that is not written, in order.

    Parameters
    ----------
    done : ClipMeasured
    workers : Workers
    solver : Pixelwise, Smooth, Swept, Shaded or None
        As in `solve`.
    work : callable
        The work in each process, from the solver of frames that it calls.
    """
    if done.scene is None:
        return
    clip, found = done.clip, done.clip.model is None
    LOG.info("finding what the frames share")
    each = FrameSolver(done.scene, clip.index_of, solver)
    each, rows = rows_with_priors(clip.frames, done.rows, each, workers, found)
    rest = [row for row in rows if row.place not in (clip.written or ())]
    outcomes = workers.over(clip.frames, work(each), each.parts(rest))
    yield from zip(rest, logged(outcomes, "solving", len(rest)), strict=True)


def measure_clip(
    frames: Sequence[LinearImage],
    plate: LinearImage | None = None,
    model: ColorModel | None = None,
    *,
    several: bool = False,
    rate: float | None = None,
    workers: int | Workers = 1,
) -> Rows[FrameMotion]:
    """Measure a moving object, or several, in all frames of a clip of a fixed camera.

    All frames share one plate and one color. Streaks of that color are measured in each frame alone
    (`sightings`), then joined to tracks (`link_sightings`); arms, strings and shadows are ignored. The
    neighboring frames give the direction of time of each motion.

    Parameters
    ----------
    frames : sequence of LinearImage
        From `read_frames`, or a list.
    plate : LinearImage, optional
        The scene without the object; made from up to 60 frames if not given.
    model : ColorModel, optional
        Its color; `clip_color` finds it if not given.
    several : bool
        Track every object of that color that is visible in three frames or more (`link_objects`),
        instead of the strongest one. For objects of different colors use `ColorModel.any()`; they must
        be discs.
    rate, workers
        As in `sightings`.

    Returns
    -------
    list of FrameMotion
        One for each frame, including those without a detection; for several objects one for each in
        the frame. Places are in pixels of the frames.

    Raises
    ------
    PlateError
        If no plate can be made from the frames.
    ColorModelError
        If no color was given and no frame determines it.
    ValueError
        As in `sightings`.

    Examples
    --------
    >>> rows = bm.measure_clip(frames, plate, solution.model, rate=50)
    >>> rows[2].sighting.motion.center.round(1)
    array([51. , 22.9])
    >>> bm.write("rally.csv", [row.numbers() for row in rows])
    """
    clip = ClipInputs(_sited(frames, plate), plate, model, several, rate=rate)
    with shared(workers) as processes:
        return Rows(whole(measured(clip, processes)).in_frames)


def solve_clip(
    frames: Sequence[LinearImage],
    plate: LinearImage | None = None,
    model: ColorModel | None = None,
    *,
    several: bool = False,
    occluder: Bools | None = None,
    solver: Solver | None = None,
    workers: int | Workers = 1,
) -> Iterator[tuple[int, Solution]]:
    """Separate a moving object from its background in each frame of a clip of a fixed camera.

    Frames are measured alone first (`sightings`). Then each is solved in a crop around the object;
    color, path and radius that the other frames predict are a prior. Each process holds one frame.

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
    occluder : (H, W) bool, optional
        Where something is in front of the scene in all frames, such as a score board: changes there are
        no motion. Alpha continues behind it, as in `solve`.
    solver : Solver, optional
        As in `solve`; of `Shaded` with the object's light, not with a plate in shadow.
    workers : int or Workers
        As in `sightings`.

    Yields
    ------
    index : int
        Of the frame, from 0; of several objects in one frame each is yielded.
    solution : Solution
        In the whole picture. Frames in which the object cannot be separated are left out.

    Raises
    ------
    PlateError, ColorModelError, ValueError
        As `measure_clip`; ValueError also for a solver with a plate in shadow.

    Examples
    --------
    >>> solutions = dict(bm.solve_clip(frames[:2], plate, solution.model))
    >>> solutions[1].grade
    <Grade.CONFIRMED: 'confirmed'>
    """
    check_clip_solver(solver)
    clip = ClipInputs(_sited(frames, plate), plate, model, several, occluder, any_color=True)
    with shared(workers) as processes:
        done = whole(measured(clip, processes))
        for row, solution in solved(done, processes, solver, lambda each: each):
            if isinstance(solution, Failure):
                raise solution.error
            if isinstance(solution, Solution):
                yield clip.index_of[row.frame], solution


def whole(events: Iterable[FrameSightings | ClipMeasured]) -> ClipMeasured:
    """The last of the events of `measured`."""
    *_, last = events
    assert isinstance(last, ClipMeasured)
    return last


def _sited(frames: Sequence[LinearImage], plate: LinearImage | None) -> Sequence[LinearImage]:
    """The frames, their chroma where it agrees with the plate."""
    return frames.for_plate(plate) if isinstance(frames, ClipFrames) else frames

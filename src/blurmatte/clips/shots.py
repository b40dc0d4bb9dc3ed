"""Shots of a clip, each with its plate, the object's color, and the frames that are solved."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

from blurmatte.background import Shot, find_shots, thumbnail
from blurmatte.background.shots import Thumbnail
from blurmatte.checks import Bools
from blurmatte.color import ColorModel
from blurmatte.files import Frames
from blurmatte.matting.case import Solver
from blurmatte.motion import (
    FrameMotion,
    FrameSightings,
    Workers,
    link_objects,
    link_sightings,
)
from blurmatte.motion.clip.measure import scene_of, sightings_in_scene
from blurmatte.motion.clip.scene import clip_plate
from blurmatte.motion.clip.solving import (
    FrameSolver,
    Wanted,
    color_or_any,
    frames_alone,
    wanted_frames,
)
from blurmatte.motion.clip.workers import parts_of, successes
from blurmatte.radiometry import LinearImage, coded_frames, each_coded


@dataclass(frozen=True, eq=False)
class SolvableShot:
    """A shot of a still camera, and what its frames share.

    Parameters
    ----------
    number : int
        From 1.
    shot : Shot
    frames : Frames
        Of the shot.
    plate : LinearImage
    solver : FrameSolver or None
        None if nothing is wanted.
    rows : tuple of FrameMotion
        Where the object is in each frame.
    wanted : tuple of Wanted
        The frames to solve.
    """

    number: int
    shot: Shot
    frames: Frames[LinearImage]
    plate: LinearImage
    solver: FrameSolver | None
    rows: tuple[FrameMotion, ...]
    wanted: tuple[Wanted, ...]


def shots_of(frames: Frames[LinearImage], workers: Workers) -> list[Shot]:
    """The shots of a clip."""
    step = next(coded_frames(frames, slice(0, 1))).step
    parts = successes(workers.over(frames, _thumbnails, parts_of(frames, workers)))
    return find_shots((one for part in parts for one in part), step)


def _thumbnails(frames: Sequence[LinearImage], _first: int) -> list[Thumbnail | None]:
    return [None if one is None else thumbnail(one) for one in each_coded(frames)]


@dataclass(frozen=True, eq=False)
class Given:
    """What is given for all shots, as in `ClipRun`."""

    plate: LinearImage | None
    model: ColorModel | None
    several: bool
    hidden: Bools | None
    rate: float | None
    solver: Solver | None


def prepared(
    number: int,
    shot: Shot,
    frames: Frames[LinearImage],
    given: Given,
    finished: Sequence[FrameSightings],
    solved: Container[tuple[int, int]],
    workers: Workers,
) -> Iterator[FrameSightings | SolvableShot]:
    """Detections in each frame of a shot that are not finished, then the shot.

    `solved` are the numbers of frame and object of the layers that are written. If those are all, the
    color and what frames share is not found again.

    Raises
    ------
    BlurmatteError
        If there is no plate, or no color.
    """
    part = frames[shot.start : shot.stop]
    plate = clip_plate(part) if given.plate is None else given.plate
    link = link_objects if given.several else link_sightings
    seen = list(finished)
    if len(seen) == len(part):
        rows = link(seen)
        alone = (
            []
            if given.model is not None
            else [w.row for w in frames_alone(rows, part.frame_numbers)]
        )
        mine = [*(row for row in rows if row.sighting), *alone]
        if all((row.frame, row.object or 1) in solved for row in mine):
            yield SolvableShot(number, shot, part, plate, None, tuple(rows), ())
            return
    scene = scene_of(part, plate, given.model, given.hidden)
    model = color_or_any(part, scene, workers) if given.model is None else given.model
    numbers = part.frame_numbers
    new = sightings_in_scene(
        *(part, scene, model, workers),
        several=given.several,
        numbers=numbers,
        rate=given.rate,
        skip=len(seen),
    )
    for one in new:
        seen.append(one)
        yield one
    rows = link(seen)
    solver = FrameSolver.of(part, scene, model, given.solver)
    wanted = wanted_frames(part, rows, solver, numbers, workers, given.model is None)
    yield SolvableShot(number, shot, part, plate, solver, tuple(rows), tuple(wanted))

"""All frames of a clip together: the rows of its table, sentences, a fall, the scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import blurmatte as bm

Rows: TypeAlias = "Sequence[bm.motion.FrameMotion]"
Places: TypeAlias = "Sequence[bm.motion.BallPlace | None]"
Length = tuple[float, float]  # meters or pixels, and its error
Gravity = tuple[float | list[float], float]


@dataclass(frozen=True)
class KnownQuantities:
    """What is known besides the pictures."""

    # Meters per pixel of an object with this radius and its error in pixels; None if not known
    scale_of: Callable[[float, float], bm.Scale | None]
    by_size: bool  # whether that needs the radius
    # Path length within an exposure, meters, of a ball in space; None without a camera
    moved_in_space: (
        Callable[[bm.motion.BallPlace | None, bm.motion.Sighting | None], Length | None] | None
    )
    gravity: Gravity | None  # a number or a vector, m/s², and the error of its size
    time: Length | None  # exposure time and its error, seconds
    line_time: float  # of a rolling shutter, seconds
    place_std: tuple[float, float] = (0.0, 0.0)  # error in x and y that all places share, pixels
    radius_std: float = 0.0  # of all radii by a transfer curve that is not stated, relative

    def scale(self, rows: Rows) -> bm.Scale | None:
        """Meters per pixel of the object in these rows."""
        from blurmatte.motion.clip.speed import median_radius  # imports all of the library

        if self.moved_in_space is not None:
            return None
        if not self.by_size:
            return self.scale_of(1.0, 0.0)
        radius, std = median_radius(rows)
        return self.scale_of(radius, math.hypot(std, self.radius_std * radius))


@dataclass(frozen=True, eq=False)
class Summary:
    """What all frames of one object say."""

    number: int  # of the object
    words: list[str]
    fall: bm.motion.FreeFall | None
    scale: bm.Scale | None  # of all its frames, if there is one


def summaries(
    rows: Rows, places: Places | None, several: bool, known: KnownQuantities
) -> list[Summary]:
    """Of the one object of a clip, or of each; the scale is that of its own place.

    Raises MotionError if the scale should follow from the radius of the only object, and it was not
    found.
    """
    if not several:
        return [_summary(1, rows, places, known)]
    found = []
    for number in sorted({row.object for row in rows if row.object is not None}):
        of = [k for k, row in enumerate(rows) if row.object == number]
        mine, there = [rows[k] for k in of], None if places is None else [places[k] for k in of]
        try:
            one = _summary(number, mine, there, known)
        except bm.errors.MotionError as error:
            unscaled = replace(known, scale_of=lambda *_: None, by_size=False, gravity=None)
            one = replace(_summary(number, mine, there, unscaled), words=[f"No scale: {error}."])
        frames = f"Object {number}: in {len(mine)} frames, {mine[0].frame} to {mine[-1].frame}."
        found.append(replace(one, words=[frames, *one.words]))
    return found


def _summary(number: int, rows: Rows, places: Places | None, known: KnownQuantities) -> Summary:
    from blurmatte.motion.clip.speed import reliable  # imports all of the library

    scale = known.scale(rows)
    found = reliable(rows)
    words = [_radius(found)] if found and places is None else []
    scatter = bm.motion.frame_scatter(rows)
    words += [] if scatter is None else bm.explain(scatter)
    if known.radius_std and scale is not None:
        words.append(
            "The clip does not state its transfer curve: between Rec. 709, sRGB and gamma 2.2 the "
            f"radius varies by {known.radius_std:.1%}, which is part of the error of the scale; give "
            "--transfer."
        )
    words += [] if places is None else _in_space(rows, places)
    try:
        fall = _fall(rows, places, scale, known)
    except bm.errors.MotionError as error:
        if known.gravity is None:
            return Summary(number, [*words, f"No fall to check: {error}."], None, scale)
        without = _summary(number, rows, places, replace(known, gravity=None))
        return replace(without, words=[*without.words, f"Gravity was not used: {error}."])
    words += bm.explain(fall)
    return Summary(number, words, fall, fall.scale if places is None else None)


def _fall(
    rows: Rows, places: Places | None, scale: bm.Scale | None, known: KnownQuantities
) -> bm.motion.FreeFall:
    """In space if places there are known, else in the picture."""
    gravity, std = known.gravity or (None, 0.0)
    if places is None:
        return bm.motion.fit_fall(rows, scale, gravity, std, known.line_time)
    return bm.motion.fit_fall_in_space(places, None, gravity, std)


def table(
    rows: Rows, places: Places | None, found: Sequence[Summary], known: KnownQuantities
) -> list[dict[str, Any]]:
    """All numbers of each frame, with the speed in the best unit that is known."""
    from blurmatte.motion.clip.speed import mean_speed, path_length  # imports all of the library

    scales = {one.number: one.scale for one in found}
    lines = []
    for k, row in enumerate(rows):
        place: dict[str, Any] = {}
        if places is None or known.moved_in_space is None:
            scale = scales.get(row.object or 1)
            unit, moved = "px" if scale is None else "m", path_length(row.sighting, scale)
        else:
            ball = places[k]
            unit, moved = "m", known.moved_in_space(ball, row.sighting)
            place = dict.fromkeys(bm.motion.BallPlace.names) if ball is None else ball.numbers()
        speed, std = mean_speed(row, moved, known.time, known.line_time) or (None, None)
        unit += "/exposure" if known.time is None else "/s"
        of_speed = {"speed": speed, "speed_std": std, "speed_unit": unit}
        lines.append(_numbers(row, known) | place | of_speed)
    return lines


def drawn(
    lines: Sequence[dict[str, Any]], found: Sequence[Summary], places: Places | None
) -> bm.figures.ClipPhysics:
    """What the sheet shows in meters and seconds, from the rows of the table."""
    metric = any(line["speed_unit"] == "m/s" for line in lines)
    speeds = [
        None if line["speed"] is None else (line["speed"], line["speed_std"]) for line in lines
    ]
    return bm.figures.ClipPhysics(
        {one.number: one.scale for one in found if one.scale is not None},
        {one.number: one.fall for one in found if one.fall is not None},
        speeds if metric else None,
        places,
    )


def _numbers(row: bm.motion.FrameMotion, known: KnownQuantities) -> dict[str, Any]:
    """Those of the row, with the errors that all places share."""
    numbers = row.numbers()
    for name, std in zip(("x_std", "y_std"), known.place_std, strict=True):
        if numbers[name] is not None:
            numbers[name] = math.hypot(numbers[name], std)
    return numbers


def words(rows: Rows, color: str, several: bool) -> list[str]:
    """What was found, in sentences."""
    found = [row.sighting for row in rows if row.sighting is not None]
    frames, of = len({row.frame for row in rows if row.sighting}), len({row.frame for row in rows})
    said = [f"Color: {color}.", f"Found in {frames} of {of} frames"]
    if not found:
        return [said[0], f"{said[1]}."]
    swept = sum(one.motion.source == "sweep" for one in found)
    directed = sum(row.directed for row in rows)
    count = len({row.track for row in rows if row.track is not None})
    tracks = f"{count} {'object' if several else 'track'}{'' if count == 1 else 's'}"
    doubted = sum(bool(one.motion.doubts) for one in found)
    how = (
        f"{swept} measured from a shape on a path, {len(found) - swept} from the moments of alpha; of "
        f"{directed} the direction of time is known, and {doubted} "
        f"{'is' if doubted == 1 else 'are'} doubtful."
    )
    return [said[0], f"{said[1]}, {tracks if several else f'in {tracks}'}: {how}"]


def _radius(found: Sequence[bm.motion.Sighting]) -> str:
    from blurmatte.motion.clip.speed import median_and_scatter

    middle, scatter = median_and_scatter(found)
    return (
        f"Radius {middle:.2f} px in the middle of all; they vary by {scatter / middle:.1%} "
        "(1.48 times the median of the differences)."
    )


def _in_space(rows: Rows, places: Places) -> list[str]:
    """Where it was in space and how fast, in sentences."""
    found = sum(row.sighting is not None for row in rows)
    balls = [ball for ball in places if ball is not None]
    reliable = [ball for ball in balls if not ball.doubted]
    said = [f"In space in {len(balls)} of {found} frames: {_sources(balls)}."]
    if not reliable:
        return said
    first, last = (
        f"({', '.join(f'{value:.4g}' for value in ball.place)}) m"
        for ball in (reliable[0], reliable[-1])
    )
    axes = "x is right, y down, z forward from the camera."
    return [*said, f"From {first} to {last}; {axes} {_errors(reliable)}", _speeds(reliable)]


def _sources(balls: Sequence[bm.motion.BallPlace]) -> str:
    """What places were measured from."""
    fitted = sum(ball.source == "ball" for ball in balls)
    discs = sum(ball.source == "sweep" for ball in balls)
    moments, doubted = len(balls) - fitted - discs, sum(ball.doubted for ball in balls)
    said = [f"{fitted} by a ball that was fitted to the picture"]
    if discs:
        said.append(f"{discs} by a disc")
    if moments:
        said.append(f"{moments} by moments of alpha, whose errors ignore shading and codec")
    if doubted:
        said.append(f"the {doubted} in doubt are not used any further")
    return ", ".join(said)


def _errors(balls: Sequence[bm.motion.BallPlace]) -> str:
    """The error of the distance and its sources."""
    shapes = [ball for ball in balls if ball.source != "moments"]
    if not shapes:
        return "The error of the distance is not known from moments of alpha."
    picture = max(float(ball.picture_covariance[2, 2]) ** 0.5 / ball.distance for ball in shapes)
    shared = max(ball.shared for ball in balls)
    single = f"Single pictures give the distance to {picture:.2%} or better"
    if shared == 0:
        return f"{single}; the errors of radius and camera, which all share, were not given."
    return f"{single}, radius and camera all of them to {shared:.1%}."


def _speeds(balls: Sequence[bm.motion.BallPlace]) -> str:
    fast = sorted((b for b in balls if b.velocity is not None), key=lambda ball: ball.speed)
    if not fast:
        return (
            "How fast in space is not known: that needs three frames of a track, and their times "
            "(--rate, for pictures)."
        )
    low, high = (f"{ball.speed:.3g} ± {ball.speed_std:.2g} m/s" for ball in (fast[0], fast[-1]))
    return f"Its speed in space, from frame to frame, was between {low} and {high}."

"""A clip in sentences: what was found in its frames, of each object, in space, and what was written."""

from collections import Counter
from collections.abc import Mapping, Sequence

from blurmatte.background import ClipShot
from blurmatte.explain.motion import fall_in_words, scatter_in_words
from blurmatte.explain.numbers import with_error
from blurmatte.matting.maps import Grade
from blurmatte.motion.clip.detections import FrameMotion
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.clip.summary import (
    ObjectSummary,
    frame_scatter,
    median_and_scatter,
    reliable,
    speeds_between,
)

_MOST_REASONS = 3  # why frames are empty, that are named


def clip_in_words(rows: Sequence[FrameMotion], color: str, several: bool) -> list[str]:
    """Sentences about what was found in the frames; `color` names that of the object."""
    found = [row.sighting for row in rows if row.sighting is not None]
    frames, of = len({row.frame for row in rows if row.sighting}), len({row.frame for row in rows})
    said = [f"Color: {color}.", f"Found in {frames} of {of} frames"]
    empty = Counter(row.reason for row in rows if row.sighting is None and row.reason)
    reasons = [f"{reason} ({count})" for reason, count in empty.most_common(_MOST_REASONS)]
    why = [f"Frames without it: {', '.join(reasons)}."] if reasons else []
    if not found:
        return [said[0], f"{said[1]}.", *why]
    swept = sum(one.motion.has_shape for one in found)
    directed = sum(row.directed for row in rows)
    count = len({row.track for row in rows if row.track is not None})
    tracks = f"{count} {'object' if several else 'track'}{'' if count == 1 else 's'}"
    doubted = sum(bool(one.doubts) for one in found)
    how = (
        f"{swept} measured from a shape on a path, {len(found) - swept} from the moments of alpha; of "
        f"{directed} the direction of time is known, and {doubted} "
        f"{'is' if doubted == 1 else 'are'} doubtful."
    )
    return [said[0], f"{said[1]}, {tracks if several else f'in {tracks}'}: {how}", *why]


def times_in_words(
    start: float | None, duration: float | None, rate: float | None, rate_varies: bool
) -> str:
    """When a clip was taken, seconds, and its frames per second; None is not known."""
    if start is None or duration is None:
        return "times are not stated"
    frames = "an unknown number" if rate is None else f"{rate:.5g}"
    varies = " on average: the rate varies" if rate_varies else ""
    return f"{duration:.4g} s from {start:.4g} s on, {frames} frames a second{varies}"


def saved_in_words(grades: Mapping[str, int], shots: Sequence[ClipShot], plates: int) -> list[str]:
    """Sentences about layers that were written: how many of each grade; numbers of shots and plates."""
    graded = ", ".join(f"{grades[grade]} {grade}" for grade in map(str, Grade) if grades.get(grade))
    said = [f"{sum(grades.values())} layers: {graded}." if grades else "No layers."]
    if len(shots) > 1:
        said.append(f"{len(shots)} shots: {'; '.join(map(str, shots))}.")
    if plates > 1:
        said.append("The background is the plate of the first shot.")
    return said


def without_layer_in_words(reasons: Sequence[str], frames: int) -> list[str]:
    """How many of the frames have no layer, and the most frequent reason; nothing if all have one."""
    if not reasons:
        return []
    (reason, count), *_ = Counter(reasons).most_common(1)
    why = f"{reason}{f' ({count} of them)' if count < len(reasons) else ''}" or "see above"
    return [f"{len(reasons)} of {frames} frames have no layer: {why}"]


def summary_in_words(one: ObjectSummary, several: bool) -> list[str]:
    """Sentences about one object, or about one of several."""
    rows, said = one.rows, list[str]()
    if several:
        first, last = rows[0].frame, rows[-1].frame
        said = [f"Object {one.number}: in {len(rows)} frames, {first} to {last}."]
    if one.no_scale:
        return [*said, f"No scale: {one.no_scale}."]
    found = reliable(rows)
    if found and one.places is None:
        middle, spread = median_and_scatter(found)
        said.append(
            f"Radius {middle:.2f} px in the middle of all; they vary by {spread / middle:.1%} "
            "(1.48 times the median of the differences)."
        )
    scatter = frame_scatter(rows)
    said += [] if scatter is None else scatter_in_words(scatter)
    if one.known.radius_std and one.places is None:
        said.append(
            "The clip does not state its transfer curve: between Rec. 709, sRGB and gamma 2.2 the "
            f"radius varies by {one.known.radius_std:.1%}, which is part of the error of the scale; "
            "give --transfer."
        )
    if one.scale is not None and one.places is None:
        said += _in_picture(speeds_between(rows, one.scale, one.known.line_time))
    said += [] if one.places is None else _in_space(rows, one.places)
    said += [] if one.fall is None else fall_in_words(one.fall)
    said += [f"No fall to check: {one.no_fall}."] if one.no_fall else []
    said += [f"Gravity was not used: {one.no_gravity}."] if one.no_gravity else []
    return said


def _in_picture(speeds: Sequence[tuple[float, float]]) -> list[str]:
    """How fast an object was parallel to the picture, m/s with errors; nothing if that is not known."""
    if not speeds:
        return []
    low, high = (
        f"{with_error(v, std)} m/s ({with_error(3.6 * v, 3.6 * std)} km/h)"
        for v, std in (min(speeds), max(speeds))
    )
    return [
        f"Its speed parallel to the picture, from frame to frame, was between {low} and {high}."
    ]


def _in_space(rows: Sequence[FrameMotion], places: Sequence[BallPlace | None]) -> list[str]:
    """Where the ball was in space, and how fast."""
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


def _sources(balls: Sequence[BallPlace]) -> str:
    """What places were measured from."""
    fitted = sum(ball.is_fitted for ball in balls)
    moments = sum(not ball.has_shape for ball in balls)
    discs, doubted = len(balls) - fitted - moments, sum(ball.doubted for ball in balls)
    said = [f"{fitted} by a ball that was fitted to the picture"]
    if discs:
        said.append(f"{discs} by a disc")
    if moments:
        said.append(f"{moments} by moments of alpha, whose errors ignore shading and codec")
    if doubted:
        said.append(f"the {doubted} in doubt are not used any further")
    return ", ".join(said)


def _errors(balls: Sequence[BallPlace]) -> str:
    """The error of the distance and its sources."""
    shapes = [ball for ball in balls if ball.has_shape]
    if not shapes:
        return "The error of the distance is not known from moments of alpha."
    picture = max(float(ball.picture_covariance[2, 2]) ** 0.5 / ball.distance for ball in shapes)
    shared = max(ball.shared for ball in balls)
    single = f"Single pictures give the distance to {picture:.2%} or better"
    if shared == 0:
        return f"{single}; the errors of radius and camera, which all share, were not given."
    return f"{single}, radius and camera all of them to {shared:.1%}."


def _speeds(balls: Sequence[BallPlace]) -> str:
    fast = sorted((b for b in balls if b.velocity is not None), key=lambda ball: ball.speed)
    if not fast:
        return (
            "How fast in space is not known: that needs three frames of a track, and their times "
            "(--rate, for pictures)."
        )
    low, high = (f"{ball.speed:.3g} ± {ball.speed_std:.2g} m/s" for ball in (fast[0], fast[-1]))
    return f"Its speed in space, from frame to frame, was between {low} and {high}."

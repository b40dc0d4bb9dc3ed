"""link_sightings, link_objects: detections in single frames → tracks of one object or several."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from blurmatte.checks import check_kind
from blurmatte.motion.clip.cadence import at_captures, doubting_repeats, is_repeat
from blurmatte.motion.clip.clip_path import ClipPath, ClipRadius
from blurmatte.motion.clip.detections import FrameMotion, FrameSightings, Sighting, grouped
from blurmatte.motion.clip.robust_curve import comparable_rows
from blurmatte.motion.clip.tracks import Track, in_time, tracks_of
from blurmatte.motion.columns import Rows

_OFF_TRACK = "the object's track does not go there; {} streak{} of its color ignored"
_NO_TRACK = "{} streak{} of the color ignored: of several objects at once, or in too few frames"


# Which tracks are the object, and which detections are doubtful.
_MIN_EVIDENCE_FRACTION = 0.1  # of the strongest track's: less is another object
_MIN_PEAK_FRACTION = 0.003  # of the strongest streak's evidence: a coding artifact
_MAX_SIZE_RATIO = 2.0  # to the median radius: larger or smaller is doubtful


def link_sightings(frames: Iterable[FrameSightings]) -> Rows[FrameMotion]:
    """Join the detections in single frames to the track of one object, in the direction of time.

    Detections in successive frames are joined to tracks. The object is the track with the most
    evidence, and the next ones in frames without it. The neighboring frames give the direction of each
    motion.

    Parameters
    ----------
    frames : iterable of FrameSightings
        From `sightings`, in order.

    Returns
    -------
    list of FrameMotion
        One for each frame, including those without the object. A detection whose position or radius
        is an outlier among the frames around it gets a doubt. If all scatter by more than their
        errors, the errors are multiplied accordingly.

    Examples
    --------
    >>> rows = bm.motion.link_sightings(found)
    >>> rows[1].directed
    True
    """
    all_frames = _without_artifacts(frames)
    chosen = _chosen(tracks_of(all_frames))
    radius = _median_radius(chosen)
    rows = []
    for index, frame in enumerate(all_frames):
        mine = [(n, t) for n, t in enumerate(chosen, start=1) if index in t.seen]
        others = len(frame.found) - 1 + frame.unmeasured
        rows += [_row(frame, index, t, n, radius, others) for n, t in mine] or [
            _empty_row(frame, _OFF_TRACK)
        ]
    return Rows(_compared(rows))


def link_objects(frames: Iterable[FrameSightings], least: int = 3) -> Rows[FrameMotion]:
    """Join the detections in single frames to tracks of several objects, in the direction of time.

    Each track is an object; an object that was lost for more than five frames gets a new number when it
    returns. Objects that look the same are distinguished by their velocities, and by the direction of
    their streaks.

    Parameters
    ----------
    frames : iterable of FrameSightings
        From `sightings(…, several=True)`, in order.
    least : int
        Minimum number of frames of an object; two detections of anything lie on some track.

    Returns
    -------
    list of FrameMotion
        For each frame one for each object in it, by their numbers; one without a detection for
        frames without any. `object` numbers them in the order of their first frames.

    Raises
    ------
    ValueError
        If least is not at least 1.

    Examples
    --------
    >>> rows = bm.motion.link_objects(found)
    >>> [row.object for row in rows]
    [1, 1, 1, 1, 1, 1]
    """
    if least < 1:
        raise ValueError(f"least must be at least 1, got {least}")
    all_frames = _without_artifacts(frames)
    found = [track for track in tracks_of(all_frames, similar=True) if len(track.seen) >= least]
    radii = [_median_radius([track]) for track in found]
    rows = []
    for index, frame in enumerate(all_frames):
        seen = [n for n, track in enumerate(found) if index in track.seen]
        others = len(frame.found) - len(seen)
        rows += [
            replace(_row(frame, index, found[n], n + 1, radii[n], others), object=n + 1)
            for n in seen
        ] or [_empty_row(frame, _NO_TRACK)]
    return Rows(_compared(rows))


def _without_artifacts(frames: Iterable[FrameSightings]) -> list[FrameSightings]:
    """The frames, without artifacts of video coding where nothing moves."""
    all_frames = list(frames)
    for frame in all_frames:
        check_kind(
            "each of frames", frame, FrameSightings, "use blurmatte.motion.sightings(frames)"
        )
    peak = max((s.evidence for frame in all_frames for s in frame.found), default=0.0)
    least = _MIN_PEAK_FRACTION * peak
    kept = []
    for frame in all_frames:
        found = tuple(s for s in frame.found if not s.evidence < least)
        ignored = frame.unmeasured + len(frame.found) - len(found)
        kept.append(replace(frame, found=found, unmeasured=ignored))
    return kept


def _compared(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows with doubts of outliers, and errors that explain the scatter of each object.

    Errors of position, path and radius are increased by those that explain their scatter about the path
    and the radius of the clip.
    """
    compared = list(rows)
    objects = grouped(rows, lambda row: row.object)
    for of in objects:
        for k, row in zip(of, doubting_repeats([compared[k] for k in of]), strict=True):
            compared[k] = row
    compared = at_captures(compared)
    for of in objects:
        mine = [compared[k] for k in of]
        path = ClipPath.of(mine, comparable_rows(mine))
        _doubt(compared, of, path)
        size = ClipRadius.of([compared[k] for k in of])
        _doubt(compared, of, size)
        for k in of:
            if (sighting := compared[k].sighting) is None:
                continue
            place, move = path.factors(sighting)
            radius = size.factor(sighting)
            sighting = replace(
                sighting, place_scatter=place, path_scatter=move, radius_scatter=radius
            )
            compared[k] = replace(compared[k], sighting=sighting)
    return compared


def _doubt(rows: list[FrameMotion], of: Sequence[int], curve: ClipPath | ClipRadius) -> None:
    """Give the rows of an object that contradict its curve a doubt; repeats keep theirs."""
    for k in np.flatnonzero(curve.contradicts).tolist():
        sighting = rows[of[k]].sighting
        if sighting is not None and not is_repeat(sighting):
            rows[of[k]] = replace(rows[of[k]], sighting=sighting.with_doubts(curve.doubt(k)))


def _row(
    frame: FrameSightings, index: int, track: Track, number: int, radius: float, others: int
) -> FrameMotion:
    """The row of a track in a frame; `radius` is the median of the object."""
    sighting, directed = in_time(index, track)
    sighting = _with_size_doubt(sighting, radius)
    return FrameMotion(frame.frame, frame.time, sighting, number, directed, others, object=1)


def _empty_row(frame: FrameSightings, why: str) -> FrameMotion:
    """The row of a frame without a track."""
    reason, count = frame.reason, len(frame.found) + frame.unmeasured
    if count:
        ignored = why.format(count, "" if count == 1 else "s")
        reason = f"{ignored}; {reason}" if reason else ignored
    return FrameMotion(frame.frame, frame.time, None, others=count, reason=reason)


def _median_radius(tracks: Sequence[Track]) -> float:
    radii = [s.motion.radius for track in tracks for s in track.seen.values()]
    return float(np.median(radii)) if radii else 0.0


def _with_size_doubt(sighting: Sighting, median: float) -> Sighting:
    """The detection, with a doubt if its radius is far from the object's median."""
    ratio, limit = sighting.motion.radius / max(median, 1e-12), _MAX_SIZE_RATIO
    if 1 / limit < ratio < limit:
        return sighting
    doubt = (
        f"Its radius is {ratio:.2g} times that of most frames: it is hidden in part, at the border, or "
        "merged with another object."
    )
    return sighting.with_doubts(*sighting.motion.doubts, doubt)


def _chosen(tracks: Sequence[Track]) -> list[Track]:
    """The strongest track, and of weaker ones the frames without stronger ones; in order of time."""
    chosen: list[Track] = []
    for track in sorted(tracks, key=lambda track: -track.evidence):
        if chosen and _mean_evidence(track) < _MIN_EVIDENCE_FRACTION * _mean_evidence(chosen[0]):
            continue
        taken = set().union(*(other.seen for other in chosen))
        free = {index: s for index, s in track.seen.items() if index not in taken}
        if free:
            chosen.append(replace(track, seen=free))
    return sorted(chosen, key=lambda track: min(track.seen))


def _mean_evidence(track: Track) -> float:
    return track.evidence / len(track.seen)

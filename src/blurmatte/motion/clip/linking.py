"""link_sightings, link_objects: detections in single frames → tracks of one object or several.

A Kalman filter of constant velocity predicts each track, and the detections of a frame are assigned to
tracks with the least sum of costs (`linear_sum_assignment`). In this file the state of a track is s =
(x, y, vx, vy), in pixels and pixels per frame, with the covariance V; z is a measured position, with
the covariance R. The recursion is that of Kalman (1960), with white acceleration. It goes forward only,
since each assignment depends on those before; finished tracks are smoothed by `robust_curve`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from blurmatte.checks import Array, check_kind
from blurmatte.motion.clip.cadence import at_captures, doubting_repeats, is_repeat
from blurmatte.motion.clip.clip_path import ClipPath, ClipRadius
from blurmatte.motion.clip.detections import (
    FrameMotion,
    FrameSightings,
    Sighting,
    grouped,
    in_intervals,
)
from blurmatte.motion.clip.robust_curve import comparable_rows
from blurmatte.motion.columns import Rows
from blurmatte.motion.picture.motion import MIN_DIRECTED_STD

_H = np.eye(2, 4)


# Prediction of tracks, and assignment of detections to them.
_GATE_CHI2 = 13.8  # two degrees of freedom: noise exceeds it in 0.1 % of frames
_MAX_LOST_FRAMES = 5  # after which a track ends
_VELOCITY_CHANGE = 0.5  # of the speed, from frame to frame: an arc, a bounce
_POSITION_STD_PX = 2.0  # of the model, added to that of a detection
_LOG_RADIUS_STD = 0.2  # from frame to frame: perspective and shading
_OCCLUDER_AREA = 0.5  # of an occluded object's area, added to the streak in front of it
_OFF_TRACK = "the object's track does not go there; {} streak{} of its color ignored"
_NO_TRACK = "{} streak{} of the color ignored: of several objects at once, or in too few frames"


# Which tracks are the object, and which detections are doubtful.
_MIN_EVIDENCE_FRACTION = 0.1  # of the strongest track's: less is another object
_MIN_PEAK_FRACTION = 0.003  # of the strongest streak's evidence: a coding artifact
_MAX_SIZE_RATIO = 2.0  # to the median radius: larger or smaller is doubtful


@dataclass
class Track:
    """Detections of an object, and its state.

    Parameters
    ----------
    state, covariance : (4,), (4, 4) float
        s and V in the latest frame, predicted or updated.
    blur : float
        Length and radius of the latest streak together, pixels: scale of the next acceleration.
    seen : dict of int to Sighting
        Detections by index of the frame.
    """

    state: Array
    covariance: Array
    blur: float
    seen: dict[int, Sighting] = field(default_factory=dict)

    @property
    def radius(self) -> float:
        """Median radius, pixels."""
        return float(np.median([s.motion.radius for s in self.seen.values()]))

    @property
    def evidence(self) -> float:
        """Sum of the evidence of its detections."""
        return sum(s.evidence for s in self.seen.values())

    def predict(self, step: float) -> None:
        """Predict the state after some frame intervals; a is the acceleration's standard deviation."""
        F = np.eye(4) + step * np.eye(4, k=2)
        G = np.vstack([step**2 * np.eye(2) / 2, step * np.eye(2)])
        speed = float(np.linalg.norm(self.state[2:]))
        a = self.blur + _VELOCITY_CHANGE * speed
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + a**2 * G @ G.T

    def cost(self, sighting: Sighting) -> float:
        """χ² of the position of a detection."""
        z = sighting.motion.center - self.state[:2]
        return float(z @ np.linalg.solve(self._innovation_covariance(sighting), z))

    def unlikelihood(self, sighting: Sighting) -> float:
        """−2 ln of the likelihood of a detection, position and radius, up to a constant."""
        S = self._innovation_covariance(sighting)
        growth = np.log(max(sighting.motion.radius, 1e-6) / max(self.radius, 1e-6))
        growth /= _LOG_RADIUS_STD
        return self.cost(sighting) + float(np.log(np.linalg.det(S)) + growth**2)

    def take(self, index: int, sighting: Sighting) -> None:
        """Update the state by the detection in a frame."""
        S = self._innovation_covariance(sighting)
        K = np.linalg.solve(S, _H @ self.covariance).T
        self.state = self.state + K @ (sighting.motion.center - self.state[:2])
        self.covariance = (np.eye(4) - K @ _H) @ self.covariance
        self.blur = sighting.motion.length + sighting.motion.radius
        self.seen[index] = sighting

    def _innovation_covariance(self, sighting: Sighting) -> Array:
        """(2, 2) covariance of a measured position minus the predicted one."""
        return np.asarray(self.covariance[:2, :2] + _position_covariance(sighting))


def _position_covariance(sighting: Sighting) -> Array:
    """R, (2, 2)."""
    return np.asarray(sighting.motion.center_covariance + _POSITION_STD_PX**2 * np.eye(2))


def tracks_of(frames: Sequence[FrameSightings], similar: bool = False) -> list[Track]:
    """All tracks of the frames.

    Parameters
    ----------
    frames : sequence of FrameSightings
    similar : bool
        True for several objects that look the same. The streak in the first frame of a track then
        gives the direction in which the next detection is expected.
    """
    places = np.array([s.motion.center for frame in frames for s in frame.found])
    extent = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    tracks: list[Track] = []
    steps = np.diff(in_intervals(frames), prepend=0.0).tolist()
    for index, (frame, step) in enumerate(zip(frames, steps, strict=True)):
        alive = [track for track in tracks if index - max(track.seen) <= _MAX_LOST_FRAMES]
        for track in alive:
            track.predict(step)
        pairs = _pairs(alive, frame.found, similar)
        lost = [t for n, t in enumerate(alive) if n not in pairs and len(t.seen) > 1]
        for n, b in pairs.items():
            if not (similar and _occludes(alive[n], frame.found[b], lost)):
                alive[n].take(index, frame.found[b])
        fresh = (s for b, s in enumerate(frame.found) if b not in pairs.values())
        tracks += [_new_track(index, s, extent, similar) for s in fresh]
    return tracks


def _pairs(tracks: Sequence[Track], found: Sequence[Sighting], similar: bool) -> dict[int, int]:
    """Index of the detection that is assigned to each track, by index."""
    shape = len(tracks), len(found)
    costs = np.array([[track.cost(s) for s in found] for track in tracks]).reshape(shape)
    price = np.minimum(costs, 2 * _GATE_CHI2)
    if similar:
        likely = np.array([[track.unlikelihood(s) for s in found] for track in tracks])
        price = np.where(costs < _GATE_CHI2, likely.reshape(shape), 1e6)  # more than any −2 ln L
    assigned = zip(*scipy.optimize.linear_sum_assignment(price), strict=True)
    return {int(a): int(b) for a, b in assigned if costs[a, b] < _GATE_CHI2}


def _occludes(track: Track, sighting: Sighting, lost: Sequence[Track]) -> bool:
    """True if a streak contains the object of a track and another one that it occludes in part."""
    for other in lost:
        reach = (
            (sighting.motion.length + other.seen[max(other.seen)].motion.length) / 2
            + sighting.motion.radius
            + other.radius
        )
        near = np.linalg.norm(sighting.motion.center - other.state[:2]) < reach
        added = _OCCLUDER_AREA * other.radius**2
        if near and sighting.motion.radius**2 > track.radius**2 + added:
            return True
    return False


def _new_track(index: int, sighting: Sighting, extent: float, directed: bool) -> Track:
    """A new track of unknown velocity, or of one along its streak in an unknown direction."""
    V = np.diag([0.0, 0.0, 1.0, 1.0]) * (extent / 2 + 1) ** 2
    V[:2, :2] = _position_covariance(sighting)
    blur = sighting.motion.length + sighting.motion.radius
    if directed and sighting.moved:
        across = np.array([-np.sin(sighting.motion.angle), np.cos(sighting.motion.angle)])
        V[2:, 2:] -= np.outer(across, across) * max(V[2, 2] - blur**2, 0)
    state = np.array([*sighting.motion.center, 0.0, 0.0])
    return Track(state, V, blur, {index: sighting})


def in_time(index: int, track: Track) -> tuple[Sighting, bool]:
    """A detection in the direction of time, and True if that is known."""
    sighting = track.seen[index]
    before = [i for i in track.seen if i < index]
    after = [i for i in track.seen if i > index]
    a = track.seen[max(before)] if before else sighting
    b = track.seen[min(after)] if after else sighting
    along = np.array([np.cos(sighting.motion.angle), np.sin(sighting.motion.angle)])
    moved = float(along @ (b.motion.center - a.motion.center))
    std = float(np.sqrt(along @ (a.motion.center_covariance + b.motion.center_covariance) @ along))
    # A displacement mostly across the streak does not determine the direction along it.
    least = max(
        MIN_DIRECTED_STD * std, float(np.linalg.norm(b.motion.center - a.motion.center)) / 2
    )
    if not (abs(moved) > least and sighting.moved):
        return sighting, False
    return (sighting if moved > 0 else sighting.reversed), True


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
    radii = [one.motion.radius for track in chosen for one in track.seen.values()]
    usual = [float(np.median(radii))] * len(chosen) if chosen else []
    return _linked(all_frames, chosen, usual, several=False)


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
    return _linked(all_frames, found, [track.radius for track in found], several=True)


def _linked(
    frames: Sequence[FrameSightings], tracks: Sequence[Track], radii: Sequence[float], several: bool
) -> Rows[FrameMotion]:
    """The rows of tracks, each of them an object if there are several; with the median radii."""
    rows = list[FrameMotion]()
    for index, frame in enumerate(frames):
        mine = [n for n, track in enumerate(tracks) if index in track.seen]
        others = len(frame.found) - len(mine) + (0 if several else frame.unmeasured)
        for n in mine:
            sighting, directed = in_time(index, tracks[n])
            known = _with_size_doubt(sighting, radii[n]), n + 1, directed, others
            number = n + 1 if several else 1
            rows.append(FrameMotion(frame.frame, frame.time, *known, object=number))
        if not mine:
            rows.append(_empty_row(frame, _NO_TRACK if several else _OFF_TRACK))
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


def _empty_row(frame: FrameSightings, why: str) -> FrameMotion:
    """The row of a frame without a track."""
    reason, count = frame.reason, len(frame.found) + frame.unmeasured
    if count:
        ignored = why.format(count, "" if count == 1 else "s")
        reason = f"{ignored}; {reason}" if reason else ignored
    return FrameMotion(frame.frame, frame.time, None, others=count, reason=reason)


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

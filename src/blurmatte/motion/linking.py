"""link_sightings: streaks of single frames → the way of one object through a clip.

A Kalman filter of constant velocity predicts each track, and the streaks of a frame are given to
tracks so that the sum of the costs is least (`linear_sum_assignment`). In this file the state of a
track is s = (x, y, vx, vy), in pixels and pixels per frame, with the covariance V; z is a place that
was measured, with the covariance R. The recursion is that of Kalman (1960), with white acceleration.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.motion.sightings import FrameSightings, Sighting

Array = npt.NDArray[np.float64]

_GATE = 13.8  # χ² of two that noise exceeds in one of a thousand
_LOST = 5  # frames after which a track is over
_AGILITY = 0.5  # of its speed, by which a velocity changes from frame to frame: an arc, a bounce
_FAINT = 0.1  # of the strongest track's evidence in a frame: another thing of like color
_SIGMAS = 3.0
_SIZES = 2.0  # times as large or as small as usual: not all of it was seen, or not it alone
_SAME = 2.0  # pixels; a place is not better known than this from frame to frame
_H = np.eye(2, 4)
_ODD_SIZE = (
    "Its radius is {:.2g} times that of most frames: it is hidden in part, at the border, or with "
    "something else."
)
_ASIDE = "the object's track does not go there; {} streak{} of its color ignored"


@dataclass(frozen=True)
class FrameMotion:
    """A row of the table of a clip: the object in one frame, or why it is not there.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds.
    sighting : Sighting or None
        What was measured, in the direction of time if that is known.
    track : int or None
        Which track it belongs to, from 1; a new one begins where the object was lost for long, or
        appeared where nothing predicted it.
    directed : bool
        Whether the neighbors tell which way it went; else it is given as going to the right.
    others : int
        How many more streaks of its color were ignored.
    reason : str
        Why there is no sighting, in words; "" if there is one.
    """

    frame: int
    time: float | None
    sighting: Sighting | None
    track: int | None = None
    directed: bool = False
    others: int = 0
    reason: str = ""

    def numbers(self) -> dict[str, Any]:
        """All by name, flat, for a row of a table; pixels, radians, exposures, seconds."""
        told: dict[str, Any] = {"frame": self.frame, "time": self.time, "track": self.track}
        for name in Sighting.__dataclass_fields__:
            told[name] = None if self.sighting is None else getattr(self.sighting, name)
        directed = None if self.sighting is None else self.directed
        return told | {"directed": directed, "others": self.others, "reason": self.reason}


@dataclass
class _Track:
    """Frames by index, and where it would be in the last one."""

    state: Array
    covariance: Array
    agility: float
    seen: dict[int, Sighting] = field(default_factory=dict)

    @property
    def evidence(self) -> float:
        return sum(s.evidence for s in self.seen.values())

    def predict(self) -> None:
        """One frame on."""
        F = np.eye(4) + np.eye(4, k=2)
        G = np.vstack([np.eye(2) / 2, np.eye(2)])
        a = self.agility + _AGILITY * float(np.linalg.norm(self.state[2:]))
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + a**2 * G @ G.T

    def cost(self, sighting: Sighting) -> float:
        """χ² of a place."""
        z = sighting.place - self.state[:2]
        return float(z @ np.linalg.solve(self.covariance[:2, :2] + _known(sighting), z))

    def take(self, index: int, sighting: Sighting) -> None:
        """The place in a frame."""
        S = self.covariance[:2, :2] + _known(sighting)
        K = np.linalg.solve(S, _H @ self.covariance).T
        self.state = self.state + K @ (sighting.place - self.state[:2])
        self.covariance = (np.eye(4) - K @ _H) @ self.covariance
        self.agility = sighting.length + sighting.radius
        self.seen[index] = sighting


def link_sightings(frames: Iterable[FrameSightings]) -> list[FrameMotion]:
    """Join what single frames show to the way of one object, and tell which way it went.

    Nearby streaks of frames that follow each other are joined to tracks; the one that shows the most
    of the object is it, with those in frames where it is not. Its neighbors tell the
    direction of each motion.

    Parameters
    ----------
    frames : iterable of FrameSightings
        Of `sightings`, in order.

    Returns
    -------
    list of FrameMotion
        One for each frame, those without the object too.
    """
    all_frames = list(frames)
    chosen = _chosen(_tracks(all_frames))
    radii = [s.radius for track in chosen for s in track.seen.values()]
    usual = float(np.median(radii)) if radii else 0.0
    rows = []
    for index, frame in enumerate(all_frames):
        mine = [(n, t) for n, t in enumerate(chosen, start=1) if index in t.seen]
        if not mine:
            reason, count = frame.reason, len(frame.found)
            if count:
                aside = _ASIDE.format(count, "" if count == 1 else "s")
                reason = f"{aside}; {reason}" if reason else aside
            rows.append(FrameMotion(frame.frame, frame.time, None, others=count, reason=reason))
            continue
        number, track = mine[0]
        sighting, directed = _in_time(index, track)
        others = len(frame.found) - 1
        sighting = _of_usual_size(sighting, usual)
        rows.append(FrameMotion(frame.frame, frame.time, sighting, number, directed, others))
    return rows


def _of_usual_size(sighting: Sighting, usual: float) -> Sighting:
    """The sighting, with a doubt if its size is none."""
    if 1 / _SIZES < sighting.radius / max(usual, 1e-12) < _SIZES:
        return sighting
    doubt = _ODD_SIZE.format(sighting.radius / max(usual, 1e-12))
    return replace(sighting, doubts=f"{sighting.doubts} {doubt}".strip())


def _known(sighting: Sighting) -> Array:
    """R: what the center tells of the place in the middle of the exposure."""
    return np.asarray(sighting.covariance + _SAME**2 * np.eye(2))


def _tracks(frames: Sequence[FrameSightings]) -> list[_Track]:
    """All that frames join to."""
    from scipy.optimize import linear_sum_assignment

    places = np.array([s.place for frame in frames for s in frame.found])
    extent = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    tracks: list[_Track] = []
    for index, frame in enumerate(frames):
        alive = [track for track in tracks if index - max(track.seen) <= _LOST]
        for track in alive:
            track.predict()
        costs = np.array([[track.cost(s) for s in frame.found] for track in alive])
        costs = costs.reshape(len(alive), len(frame.found))
        given = set()
        for a, b in zip(*linear_sum_assignment(np.minimum(costs, 2 * _GATE)), strict=True):
            if costs[a, b] < _GATE:
                alive[a].take(index, frame.found[b])
                given.add(b)
        fresh = (s for b, s in enumerate(frame.found) if b not in given)
        tracks += [_begun(index, s, extent) for s in fresh]
    return tracks


def _begun(index: int, sighting: Sighting, extent: float) -> _Track:
    """A track of which only the place is known."""
    V = np.diag([0.0, 0.0, 1.0, 1.0]) * (extent / 2 + 1) ** 2
    V[:2, :2] = _known(sighting)
    state = np.array([sighting.x, sighting.y, 0.0, 0.0])
    agility = sighting.length + sighting.radius
    return _Track(state, V, agility, {index: sighting})


def _chosen(tracks: Sequence[_Track]) -> list[_Track]:
    """The clearest, and of others the part in frames where clearer ones are not; in order of time."""
    chosen: list[_Track] = []
    for track in sorted(tracks, key=lambda track: -track.evidence):
        if chosen and _each(track) < _FAINT * _each(chosen[0]):
            continue
        taken = set().union(*(other.seen for other in chosen))
        free = {index: s for index, s in track.seen.items() if index not in taken}
        if free:
            chosen.append(replace(track, seen=free))
    return sorted(chosen, key=lambda track: min(track.seen))


def _each(track: _Track) -> float:
    return track.evidence / len(track.seen)


def _in_time(index: int, track: _Track) -> tuple[Sighting, bool]:
    """A sighting in the direction of time, and whether that is known."""
    sighting = track.seen[index]
    before = [i for i in track.seen if i < index]
    after = [i for i in track.seen if i > index]
    a = track.seen[max(before)] if before else sighting
    b = track.seen[min(after)] if after else sighting
    along = np.array([np.cos(sighting.angle), np.sin(sighting.angle)])
    went = float(along @ (b.place - a.place))
    unsure = float(np.sqrt(along @ (a.covariance + b.covariance) @ along))
    # Beside its way it may have gone wherever it likes: it tells nothing of the way's direction.
    clear = abs(went) > max(_SIGMAS * unsure, float(np.linalg.norm(b.place - a.place)) / 2)
    if not (clear and sighting.moved):
        return sighting, False
    return (sighting if went > 0 else sighting.reversed), True


def main_track(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows of the track with the most frames."""
    numbers = [row.track for row in rows if row.track is not None]
    longest = max(sorted(set(numbers)), key=numbers.count, default=None)
    return [replace(row) for row in rows if row.track is not None and row.track == longest]

"""Tracks: streaks of single frames that follow each other.

A Kalman filter of constant velocity predicts each track, and the streaks of a frame are given to
tracks so that the sum of the costs is least (`linear_sum_assignment`). In this file the state of a
track is s = (x, y, vx, vy), in pixels and pixels per frame, with the covariance V; z is a place that
was measured, with the covariance R. The recursion is that of Kalman (1960), with white acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from blurmatte.motion.sightings import FrameSightings, Sighting

Array = npt.NDArray[np.float64]

_GATE = 13.8  # χ² of two that noise exceeds in one of a thousand
_LOST = 5  # frames after which a track is over
_AGILITY = 0.5  # of its speed, by which a velocity changes from frame to frame: an arc, a bounce
_SIGMAS = 3.0
_SAME = 2.0  # pixels; a place is not better known than this from frame to frame
_GROWTH = 0.2  # of a radius, from frame to frame: perspective, and shading
_SHOWING = 0.5  # of its area, what of an object behind another one makes the streak larger
_NEVER = 1e6  # more than any likelihood
_TINY = 1e-6
_H = np.eye(2, 4)


@dataclass
class Track:
    """What was seen of something in frames, by index, and where it would be in the last one."""

    state: Array
    covariance: Array
    agility: float
    seen: dict[int, Sighting] = field(default_factory=dict)

    @property
    def last(self) -> Sighting:
        """The latest."""
        return self.seen[max(self.seen)]

    @property
    def radius(self) -> float:
        """As it is mostly, pixels."""
        return float(np.median([s.radius for s in self.seen.values()]))

    @property
    def evidence(self) -> float:
        """How clearly its light shows in all of them."""
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

    def unlikelihood(self, sighting: Sighting) -> float:
        """−2 ln of the likelihood that it looks like that, place and size, but for a constant."""
        S = self.covariance[:2, :2] + _known(sighting)
        growth = np.log(max(sighting.radius, _TINY) / max(self.radius, _TINY)) / _GROWTH
        return self.cost(sighting) + float(np.log(np.linalg.det(S)) + growth**2)

    def take(self, index: int, sighting: Sighting) -> None:
        """The place in a frame."""
        S = self.covariance[:2, :2] + _known(sighting)
        K = np.linalg.solve(S, _H @ self.covariance).T
        self.state = self.state + K @ (sighting.place - self.state[:2])
        self.covariance = (np.eye(4) - K @ _H) @ self.covariance
        self.agility = sighting.length + sighting.radius
        self.seen[index] = sighting


def _known(sighting: Sighting) -> Array:
    """R: what the center tells of the place in the middle of the exposure."""
    return np.asarray(sighting.covariance + _SAME**2 * np.eye(2))


def tracks_of(frames: Sequence[FrameSightings], alike: bool = False) -> list[Track]:
    """All that frames join to.

    Parameters
    ----------
    frames : sequence of FrameSightings
    alike : bool
        Whether there are several objects that are alike. The streak of the first frame then tells
        in which direction the next one is looked for.
    """
    places = np.array([s.place for frame in frames for s in frame.found])
    extent = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    tracks: list[Track] = []
    for index, frame in enumerate(frames):
        alive = [track for track in tracks if index - max(track.seen) <= _LOST]
        for track in alive:
            track.predict()
        pairs = _pairs(alive, frame.found, alike)
        lost = [t for n, t in enumerate(alive) if n not in pairs and len(t.seen) > 1]
        for n, b in pairs.items():
            if not (alike and _together(alive[n], frame.found[b], lost)):
                alive[n].take(index, frame.found[b])
        fresh = (s for b, s in enumerate(frame.found) if b not in pairs.values())
        tracks += [_begun(index, s, extent, alike) for s in fresh]
    return tracks


def _pairs(tracks: Sequence[Track], found: Sequence[Sighting], alike: bool) -> dict[int, int]:
    """Which streak each track goes to, by number."""
    from scipy.optimize import linear_sum_assignment

    shape = len(tracks), len(found)
    costs = np.array([[track.cost(s) for s in found] for track in tracks]).reshape(shape)
    price = np.minimum(costs, 2 * _GATE)
    if alike:
        likely = np.array([[track.unlikelihood(s) for s in found] for track in tracks])
        price = np.where(costs < _GATE, likely.reshape(shape), _NEVER)
    given = zip(*linear_sum_assignment(price), strict=True)
    return {int(a): int(b) for a, b in given if costs[a, b] < _GATE}


def _together(track: Track, sighting: Sighting, lost: Sequence[Track]) -> bool:
    """Whether a streak is that of a track and of one that would else be lost behind it."""
    for other in lost:
        way = (sighting.length + other.last.length) / 2 + sighting.radius + other.radius
        near = np.linalg.norm(sighting.place - other.state[:2]) < way
        if near and sighting.radius**2 > track.radius**2 + _SHOWING * other.radius**2:
            return True
    return False


def _begun(index: int, sighting: Sighting, extent: float, directed: bool) -> Track:
    """A track of which only the place is known, and maybe that it goes on as it went, or back."""
    V = np.diag([0.0, 0.0, 1.0, 1.0]) * (extent / 2 + 1) ** 2
    V[:2, :2] = _known(sighting)
    agility = sighting.length + sighting.radius
    if directed and sighting.moved:
        across = np.array([-np.sin(sighting.angle), np.cos(sighting.angle)])
        V[2:, 2:] -= np.outer(across, across) * max(V[2, 2] - agility**2, 0)
    state = np.array([sighting.x, sighting.y, 0.0, 0.0])
    return Track(state, V, agility, {index: sighting})


def in_time(index: int, track: Track) -> tuple[Sighting, bool]:
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

"""Do the frames of a clip agree? How they scatter about smooth motion, and which contradict it.

A polynomial of fifth order through three frames before and three after one tells where the object is
in it, and how large. What is left is compared with what the stated errors of all seven make of it,
and with what the polynomial errs by: around a circle of radius R, turned by ω from frame to frame, by
R ωⁿ Π|t| / n!, t the n other frames' times. Where that is more than the errors, four or five frames on
each side are taken; where it still is, or eight frames see more than a round, they tell nothing of
each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.motion.sightings import Sighting

Array = npt.NDArray[np.float64]

_BESIDE = 3, 4, 5  # frames on each side: as few as the bend of the way allows
_SPAN = 12  # frames in which all of them are: what is farther apart may have gone anywhere
_TURN = 2 * np.pi / 8  # radians from frame to frame: rounds are no exact circles
_LEAST = 8  # frames whose scatter means anything
_OUTLIER = 3.5  # times the scatter of the others, of a radius [Iglewicz and Hoaglin 1993]
_AS_LIKELY = np.array([1.12, 1.0])  # of that for a place: distances have two degrees of freedom
_MEDIANS = np.sqrt(
    [2 * np.log(2), 0.4549]
)  # of the root of χ² of two, a place, and of one, a radius
_OF_MEDIAN = 1.5  # relative error of the scatter times √n, in trials: neighbors hang together
_DOUBT = "Its {} is {:.2g} px off what the frames around it tell, {:.1f} times as far as is usual."


@dataclass(frozen=True)
class Scatter:
    """By how much frames differ from smooth motion, in units of what their stated errors allow.

    Parameters
    ----------
    place, radius : float
        1 if errors are as stated.
    count : int
        How many frames tell; those with doubts do not.
    unsteady : float
        By how much the radius of a single frame differs from the smooth one, of itself.
    """

    place: float
    radius: float
    count: int
    unsteady: float = 0.0

    @property
    def too_large(self) -> bool:
        """Whether errors are larger than stated, by three standard deviations of the scatter."""
        return self._deviations > 3

    @property
    def _deviations(self) -> float:
        """By how many of its own standard deviations the scatter is above 1."""
        return float((max(self.place, self.radius) - 1) / (_OF_MEDIAN / self.count**0.5))


def scatter_of(frames: Sequence[int], seen: Sequence[Sighting]) -> Scatter | None:
    """The scatter of the sightings of one object, one in each of these frames; None if few tell it."""
    return _scatter(*_off(frames, seen)[1:])


def _scatter(errors: Array, unsteady: Array) -> Scatter | None:
    told = np.isfinite(errors[:, 0])
    if np.count_nonzero(told) < _LEAST:
        return None
    place, radius = np.median(errors[told], axis=0) / _MEDIANS
    steady = float(np.median(unsteady[told])) / float(_MEDIANS[1])
    return Scatter(float(place), float(radius), int(np.count_nonzero(told)), steady)


def doubted(frames: Sequence[int], seen: Sequence[Sighting]) -> list[Sighting]:
    """The same, with a doubt where place or radius contradicts the frames around.

    The worst comes first, and tells nothing of its neighbors any more.
    """
    told = list(seen)
    for _ in seen:
        pixels, errors, unsteady = _off(frames, told)
        scatter = _scatter(errors, unsteady)
        if scatter is None:
            break
        usual = np.maximum([scatter.place, scatter.radius], 1) * _AS_LIKELY
        times = np.nan_to_num(errors / usual)
        k, what = np.unravel_index(np.argmax(times), times.shape)
        if times[k, what] < _OUTLIER:
            break
        name = ("place", "radius")[what]
        told[k] = replace(told[k], doubts=_DOUBT.format(name, pixels[k, what], times[k, what]))
    return told


def with_scatter(sighting: Sighting, place: float, radius: float) -> Sighting:
    """The sighting with so many times the errors of place and way, and of the radius."""
    ways = "x_std", "y_std", "vx_std", "vy_std", "length_std", "angle_std"
    larger = {name: place * getattr(sighting, name) for name in ways}
    return replace(
        sighting,
        **larger,
        xy_covariance=place**2 * sighting.xy_covariance,
        radius_std=radius * sighting.radius_std,
    )


def _off(frames: Sequence[int], seen: Sequence[Sighting]) -> tuple[Array, Array, Array]:
    """How far off place and radius are, NaN if unknown.

    (n, 2) in pixels, (n, 2) in standard deviations, (n,) of a radius alone, as a part of it.
    """
    pixels, errors = np.full((2, len(seen), 2), np.nan)
    unsteady = np.full(len(seen), np.nan)
    sound = [k for k, one in enumerate(seen) if not one.doubts]
    for n, k in enumerate(sound):
        for beside in _BESIDE:
            near = sound[max(n - beside, 0) : n + beside + 1]
            t = np.array([frames[i] - frames[k] for i in near], float)
            if len(near) <= 2 * beside or t[-1] - t[0] > _SPAN:
                break
            told = _beside_it(t, [seen[i] for i in near])
            if told is not None:
                pixels[k], errors[k], unsteady[k] = told
                break
    return pixels, errors, unsteady


def _beside_it(t: Array, near: Sequence[Sighting]) -> tuple[Array, Array, float] | None:
    """The same of the middle one of a few; None if they turn too fast for so few."""
    weights = _weights(t)
    V = np.einsum("k,kij->ij", weights**2, [one.covariance for one in near])
    turn = _turn(t, near)
    bend = _bend(t, near, turn)
    if turn > _TURN or bend**2 > np.trace(V) / 2:
        return None
    place = weights @ [one.place for one in near]
    radii = np.array([one.radius for one in near])
    off, std = abs(weights @ radii), np.sqrt(weights**2 @ [one.radius_std**2 for one in near])
    errors = np.sqrt(place @ np.linalg.solve(V + bend**2 * np.eye(2), place)), off / std
    unsteady = off / (np.linalg.norm(weights) * np.median(radii))
    return np.array([np.linalg.norm(place), off]), np.array(errors), float(unsteady)


def _bend(t: Array, near: Sequence[Sighting], turn: float) -> float:
    """By how much the polynomial errs on an arc as bent as this, pixels."""
    way = np.linalg.norm(np.diff([one.place for one in near], axis=0), axis=1) / np.diff(t)
    others = np.abs(t[t != 0])
    power = turn ** (len(others) - 1)
    return float(np.median(way) * power * np.prod(others / np.arange(1, len(t))))


def _turn(t: Array, seen: Sequence[Sighting]) -> float:
    """By how much streaks turn from frame to frame, radians; forth and back are alike."""
    angles = np.array([one.angle for one in seen if one.moved])
    times = t[[one.moved for one in seen]]
    turns = np.abs((np.diff(angles) + np.pi / 2) % np.pi - np.pi / 2)
    return float(np.mean(turns / np.diff(times))) if len(turns) else 0.0


def _weights(t: Array) -> Array:
    """(n,) weights of values at these times: the middle one, at 0, less the others' polynomial."""
    weights = np.ones(len(t))
    for k in np.flatnonzero(t):
        others = t[(t != 0) & (t != t[k])]
        weights[k] = -np.prod(others / (others - t[k]))
    return weights


def scatter_in_words(scatter: Scatter) -> list[str]:
    """Whether errors are as large as each frame says, in a sentence."""
    verdict = "as they should"
    if scatter.too_large:
        verdict = "the errors given are as much larger"
    elif scatter._deviations > 1:
        verdict = "more than they should, but of so few frames that may be chance"
    return [
        f"From frame to frame places scatter about smooth motion {scatter.place:.1f} times as much as "
        f"each frame's errors say, radii {scatter.radius:.1f} times, by {scatter.unsteady:.1%} "
        f"({scatter.count} frames tell): {verdict}."
    ]

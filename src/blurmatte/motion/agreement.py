"""Do the frames of a clip agree? How they scatter about smooth motion, and which contradict it.

A polynomial of fifth order through three frames before and three after one tells where the object is
in it, and how large. What is left is compared with what the stated errors of all seven make of it.
Around a circle of fourteen frames the polynomial is off by 0.0004 of its radius; where streaks turn
faster, so few frames tell nothing of each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.motion.sightings import Sighting

Array = npt.NDArray[np.float64]

_BESIDE = 3  # frames on each side
_SPAN = 12  # frames in which all seven are: what is farther apart may have gone anywhere
_TURN = 2 * np.pi / 14  # radians from frame to frame, the most that is followed
_LEAST = 8  # frames whose scatter means anything
_OUTLIER = 3.5  # times the scatter of the others [Iglewicz and Hoaglin 1993]
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
    """

    place: float
    radius: float
    count: int

    @property
    def too_large(self) -> bool:
        """Whether errors are larger than stated, by three standard deviations of the scatter."""
        return bool(max(self.place, self.radius) > 1 + 3 * _OF_MEDIAN / self.count**0.5)


def scatter_of(frames: Sequence[int], seen: Sequence[Sighting]) -> Scatter | None:
    """The scatter of the sightings of one object, one in each of these frames; None if few tell it."""
    _, errors = _off(frames, seen)
    told = errors[np.isfinite(errors[:, 0])]
    if len(told) < _LEAST:
        return None
    place, radius = np.median(told, axis=0) / _MEDIANS
    return Scatter(float(place), float(radius), len(told))


def doubted(frames: Sequence[int], seen: Sequence[Sighting]) -> list[Sighting]:
    """The same, with a doubt where place or radius contradicts the frames around.

    The worst comes first, and tells nothing of its neighbors any more.
    """
    told = list(seen)
    for _ in seen:
        scatter = scatter_of(frames, told)
        if scatter is None:
            break
        pixels, errors = _off(frames, told)
        usual = np.maximum([scatter.place, scatter.radius], 1) * _MEDIANS / _MEDIANS[1]
        times = np.nan_to_num(errors / usual)
        k, what = np.unravel_index(np.argmax(times), times.shape)
        if times[k, what] < _OUTLIER:
            break
        name = ("place", "radius")[what]
        told[k] = replace(told[k], doubts=_DOUBT.format(name, pixels[k, what], times[k, what]))
    return told


def _off(frames: Sequence[int], seen: Sequence[Sighting]) -> tuple[Array, Array]:
    """(n, 2) how far place and radius are off, pixels, and in standard deviations; NaN if unknown."""
    pixels, errors = np.full((2, len(seen), 2), np.nan)
    sound = [k for k, one in enumerate(seen) if not one.doubts]
    for n in range(_BESIDE, len(sound) - _BESIDE):
        near = sound[n - _BESIDE : n + _BESIDE + 1]
        t = np.array([frames[k] - frames[sound[n]] for k in near], float)
        if t[-1] - t[0] > _SPAN or _turn(t, [seen[k] for k in near]) > _TURN:
            continue
        weights = _beside(t)
        place = weights @ [seen[k].place for k in near]
        V = np.einsum("k,kij->ij", weights**2, [seen[k].covariance for k in near])
        radius = weights @ [seen[k].radius for k in near]
        std = np.sqrt(weights**2 @ [seen[k].radius_std ** 2 for k in near])
        pixels[sound[n]] = np.linalg.norm(place), abs(radius)
        errors[sound[n]] = np.sqrt(place @ np.linalg.solve(V, place)), abs(radius) / std
    return pixels, errors


def _turn(t: Array, seen: Sequence[Sighting]) -> float:
    """By how much streaks turn from frame to frame, radians; forth and back are alike."""
    angles = np.array([one.angle for one in seen if one.moved])
    times = t[[one.moved for one in seen]]
    turns = np.abs((np.diff(angles) + np.pi / 2) % np.pi - np.pi / 2)
    return float(np.median(turns / np.diff(times))) if len(turns) else 0.0


def _beside(t: Array) -> Array:
    """(7,) weights of values at these times: the middle one, at 0, less the others' polynomial."""
    weights = np.ones(len(t))
    for k in np.flatnonzero(t):
        others = t[(t != 0) & (t != t[k])]
        weights[k] = -np.prod(others / (others - t[k]))
    return weights


def scatter_in_words(scatter: Scatter) -> list[str]:
    """Whether errors are as large as stated, in a sentence."""
    verdict = "as they should"
    if scatter.too_large:
        verdict = "errors are larger than stated by about as much"
    return [
        f"From frame to frame places scatter about smooth motion {scatter.place:.1f} times as much as "
        f"their errors say, radii {scatter.radius:.1f} times ({scatter.count} frames tell): {verdict}."
    ]

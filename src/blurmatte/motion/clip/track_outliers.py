"""Scatter of the frames of a clip about a smooth motion, and outliers of the radius among them.

A polynomial of fifth order through three frames before and three after a frame predicts position and
radius in it. The residual is compared with the errors of all seven frames, and with the truncation
error of the polynomial: on a circle of radius R with the angle ω from frame to frame it is
R ωⁿ Π|t| / n!, t the times of the n other frames. If that exceeds the errors, four or five frames on
each side are used; if it still does, or the path turns by more than an eighth of a circle from frame to
frame, the frame is not compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.motion.clip.detections import Sighting

Array = npt.NDArray[np.float64]

# Medians of √χ² of two degrees of freedom, a position, and of one, a radius.
_MEDIANS = np.sqrt([2 * np.log(2), 0.4549])


@dataclass(frozen=True)
class OutlierSettings:
    """Neighbors with which a frame is compared, and thresholds."""

    neighbors: tuple[int, ...] = (3, 4, 5)  # frames on each side: the fewest that the bend allows
    max_span: int = 12  # frames, from the first neighbor to the last
    max_turn: float = 2 * np.pi / 8  # radians from frame to frame: paths are no exact circles
    min_frames: int = 8  # for a scatter
    max_deviation: float = 3.5  # of a radius, times the scatter [Iglewicz and Hoaglin 1993]
    relative_std: float = 1.5  # of the scatter, times √n: residuals of neighbors are correlated


@dataclass(frozen=True)
class Scatter:
    """Residuals of frames from a smooth motion, in units of their stated errors.

    Parameters
    ----------
    place, radius : float
        1 if errors are as stated.
    count : int
        Number of frames that were compared; those with doubts were not.
    unsteady : float
        Relative standard deviation of the radius of a single frame.
    """

    place: float
    radius: float
    count: int
    unsteady: float = 0.0

    @property
    def too_large(self) -> bool:
        """True if the scatter is above 1 by more than three of its standard deviations."""
        return self.excess_std > 3

    @property
    def excess_std(self) -> float:
        """Excess of the scatter over 1, in its own standard deviations."""
        std = OutlierSettings.relative_std / self.count**0.5
        return float((max(self.place, self.radius) - 1) / std)


def scatter_of(frames: Sequence[float], seen: Sequence[Sighting]) -> Scatter | None:
    """The scatter of detections of one object, one in each frame; None for too few frames.

    `frames` are the times of the frames, in usual intervals between them.
    """
    return _scatter(*_residuals(frames, seen)[1:])


def _scatter(errors: Array, unsteady: Array) -> Scatter | None:
    known = np.isfinite(errors[:, 0])
    if np.count_nonzero(known) < OutlierSettings.min_frames:
        return None
    place, radius = np.median(errors[known], axis=0) / _MEDIANS
    relative = float(np.median(unsteady[known])) / float(_MEDIANS[1])
    return Scatter(float(place), float(radius), int(np.count_nonzero(known)), relative)


def with_radius_doubts(frames: Sequence[float], seen: Sequence[Sighting]) -> list[Sighting]:
    """The detections, with doubts for outliers of the radius.

    The largest outlier is found first, and then excluded from the others' neighbors.
    """
    checked = list(seen)
    for _ in seen:
        pixels, errors, unsteady = _residuals(frames, checked)
        scatter = _scatter(errors, unsteady)
        if scatter is None:
            break
        times = np.nan_to_num(errors[:, 1]) / max(scatter.radius, 1)
        k = int(np.argmax(times))
        if times[k] < OutlierSettings.max_deviation:
            break
        doubt = (
            f"Its radius is {pixels[k]:.2g} px off a smooth change through the frames around it, "
            f"{times[k]:.1f} times the usual residual."
        )
        checked[k] = replace(checked[k], doubts=doubt)
    return checked


def _residuals(frames: Sequence[float], seen: Sequence[Sighting]) -> tuple[Array, Array, Array]:
    """Residuals, NaN if unknown.

    (n,) of the radius, pixels; (n, 2) of position and radius, standard deviations; (n,) of a single
    radius, relative.
    """
    pixels, unsteady = np.full((2, len(seen)), np.nan)
    errors = np.full((len(seen), 2), np.nan)
    sound = [k for k, one in enumerate(seen) if not one.doubts]
    for n, k in enumerate(sound):
        for side in OutlierSettings.neighbors:
            near = sound[max(n - side, 0) : n + side + 1]
            t = np.array([frames[i] - frames[k] for i in near], float)
            if len(near) <= 2 * side or t[-1] - t[0] > OutlierSettings.max_span:
                break
            residual = _residual(t, [seen[i] for i in near])
            if residual is not None:
                pixels[k], errors[k], unsteady[k] = residual
                break
    return pixels, errors, unsteady


def _residual(t: Array, near: Sequence[Sighting]) -> tuple[float, Array, float] | None:
    """Residual of the detection at t = 0; None if the path turns too fast for its neighbors."""
    weights = _weights(t)
    V = np.einsum("k,kij->ij", weights**2, [one.covariance for one in near])
    turn = _turn(t, near)
    bend = _truncation_error(t, near, turn)
    if turn > OutlierSettings.max_turn or bend**2 > np.trace(V) / 2:
        return None
    place = weights @ [one.place for one in near]
    radii = np.array([one.radius for one in near])
    off, std = abs(weights @ radii), np.sqrt(weights**2 @ [one.radius_std**2 for one in near])
    errors = np.sqrt(place @ np.linalg.solve(V + bend**2 * np.eye(2), place)), off / std
    unsteady = off / (np.linalg.norm(weights) * np.median(radii))
    return float(off), np.array(errors), float(unsteady)


def _truncation_error(t: Array, near: Sequence[Sighting], turn: float) -> float:
    """Error of the polynomial on a circle with this turn from frame to frame, pixels."""
    speed = np.linalg.norm(np.diff([one.place for one in near], axis=0), axis=1) / np.diff(t)
    others = np.abs(t[t != 0])
    power = turn ** (len(others) - 1)
    return float(np.median(speed) * power * np.prod(others / np.arange(1, len(t))))


def _turn(t: Array, seen: Sequence[Sighting]) -> float:
    """Mean change of the streaks' direction from frame to frame, radians, modulo half turns."""
    angles = np.array([one.angle for one in seen if one.moved])
    times = t[[one.moved for one in seen]]
    turns = np.abs((np.diff(angles) + np.pi / 2) % np.pi - np.pi / 2)
    return float(np.mean(turns / np.diff(times))) if len(turns) else 0.0


def _weights(t: Array) -> Array:
    """(n,) weights of values at these times: the one at 0 minus the polynomial through the others."""
    weights = np.ones(len(t))
    for k in np.flatnonzero(t):
        others = t[(t != 0) & (t != t[k])]
        weights[k] = -np.prod(others / (others - t[k]))
    return weights

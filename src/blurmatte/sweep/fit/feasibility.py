"""Whether a sweep is physically possible: its path, its light, and what of it is visible."""

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.model.state import State

Array = npt.NDArray[np.float64]

MAX_LIGHT = 1.2  # mean light of an object, where the sensor's white is 1
_MIN_LIGHT = -0.1  # of the brightest channel: noise of a dark one
_MIN_VISIBLE_FRACTION = 0.5  # of the total alpha, on valid pixels
_TIMES, _MAX_OUTSIDE_FRACTION = 129, 0.01  # of the path, outside the mask
_MAX_TURN_RAD = 3.5  # within the object's own width: half a circle, and rounding


def is_admissible(state: State) -> bool:
    """Whether nothing physical rules it out."""
    return not rejection(state)


def rejection(state: State) -> str:
    """Why it is physically impossible, to follow "the fit"; empty if it is not."""
    light = state.mean_color
    if light.max() > MAX_LIGHT:
        return "needs more light than white"
    if light.min() < _MIN_LIGHT * light.max():
        return "needs negative light"
    if not inside_mask(state):
        return "leaves the streak"
    if self_overlaps(state):
        return "doubles back within its own width"
    alpha = state.swept.alpha
    if alpha[~state.observation.valid].sum() >= (1 - _MIN_VISIBLE_FRACTION) * alpha.sum():
        return "lies mostly where the pictures are clipped or hidden"
    return ""


def inside_mask(state: State) -> bool:
    """Whether the path stays near the streak wherever it is within the picture."""
    observation = state.observation
    xy, _ = state.family.at(state.path, np.linspace(0, 1, _TIMES))
    visible = np.all((xy > -0.5) & (xy < np.array(observation.size) - 0.5), axis=1)
    at = (xy[visible] - observation.origin) / observation.scale
    h, w = observation.near.shape
    x, y = np.clip(np.rint(at), 0, (w - 1, h - 1)).astype(int).T
    # Large pixels may end before the picture does: one of them beyond is still within.
    beyond = np.any((at < -1) | (at > (w, h)), axis=1)
    outside = np.count_nonzero(beyond | ~observation.near[y, x])
    return bool(outside <= _MAX_OUTSIDE_FRACTION * _TIMES)


def self_overlaps(state: State) -> bool:
    """Whether the path turns back twice, or all around, within the object's own width.

    Nor does it bounce where it goes no further than its radius before and after: a line leaves the
    same picture.
    """
    steps = np.diff(state.curve, axis=0) @ np.array([1, 1j])
    turned = float(np.abs(np.angle(steps[1:] * steps[:-1].conj())).sum())
    kink = state.family.kink(state.path)
    if kink is not None:
        xy, _ = state.family.at(state.path, np.array([0, kink, 1]))
        if np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < state.shape[0]:
            return True
    return turned > _MAX_TURN_RAD and float(np.abs(steps).sum()) < 2 * state.shape[0] * turned

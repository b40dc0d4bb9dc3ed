"""Physical admissibility of a sweep: its path, its light, and its visible fraction."""

import numpy as np

from blurmatte.sweep.model.state import State

# Limits of a sweep that is physically possible.
MAX_LIGHT = 1.2  # mean light of the object, where the sensor's white is 1
# Of a channel, of the brightest one; noise may make a dark channel negative
MIN_LIGHT = -0.1
_MIN_VISIBLE_FRACTION = 0.5  # of the total alpha, on valid pixels
_MAX_OUTSIDE_FRACTION = 0.01  # of the path, outside the mask
# Turn of the path within the object's own width: half a circle, and rounding
_MAX_TURN_RAD = 3.5


def rejection(state: State) -> str:
    """Reason why the sweep is physically impossible, to follow "the fit"; empty if it is possible."""
    light = state.mean_color
    if light.max() > MAX_LIGHT:
        return "needs more light than white"
    if light.min() < MIN_LIGHT * light.max():
        return "needs negative light"
    if not inside_mask(state):
        return "leaves the streak"
    if self_overlaps(state):
        return "doubles back within its own width"
    alpha = state.swept.alpha
    hidden = alpha[~state.observation.valid].sum()
    if hidden >= (1 - _MIN_VISIBLE_FRACTION) * alpha.sum():
        return "lies mostly where the pictures are clipped or hidden"
    return ""


def inside_mask(state: State) -> bool:
    """True if the path stays near the streak where it is within the picture."""
    observation = state.observation
    xy, _ = state.family.at(state.path, np.linspace(0, 1, 129))
    visible = np.all((xy > -0.5) & (xy < np.array(observation.size) - 0.5), axis=1)
    at = (xy[visible] - observation.origin) / observation.scale
    h, w = observation.near.shape
    x, y = np.clip(np.rint(at), 0, (w - 1, h - 1)).astype(int).T
    # Blocks may cover less than the picture: one block beyond counts as within.
    beyond = np.any((at < -1) | (at > (w, h)), axis=1)
    outside = np.count_nonzero(beyond | ~observation.near[y, x])
    return bool(outside <= _MAX_OUTSIDE_FRACTION * len(xy))


def self_overlaps(state: State) -> bool:
    """True if the path reverses twice, or circles, within the object's own width.

    Also if it bounces and both pieces are shorter than the radius: a line gives the same picture.
    """
    steps = np.diff(state.curve, axis=0) @ np.array([1, 1j])
    turned = float(np.abs(np.angle(steps[1:] * steps[:-1].conj())).sum())
    kink = state.family.kink(state.path)
    if kink is not None:
        xy, _ = state.family.at(state.path, np.array([0, kink, 1]))
        if np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < state.shape[0]:
            return True
    return turned > _MAX_TURN_RAD and float(np.abs(steps).sum()) < 2 * state.shape[0] * turned

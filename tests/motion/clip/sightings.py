"""Sightings as a disc on a straight path would give them, of chosen numbers and errors."""

import numpy as np

from blurmatte.motion import Motion, Sighting
from blurmatte.motion.picture.motion import QUANTITIES
from blurmatte.trajectory import Trajectory


def sighted(
    place, velocity=(9.0, 0.0), std=0.1, length_std=0.1, angle_std=0.01, radius=5.0, radius_std=0.1,
    color="#ffffff", evidence=1.0, source="sweep", doubts=(), readout="down", length=None, ends=None,
):  # fmt: skip
    """A detection around `place`; to the left if its velocity says so. std: one for x and y, pixels."""
    place, velocity = np.array(place, float), np.array(velocity, float)
    backward = bool(velocity[0] < 0)
    to_right = -velocity if backward else velocity
    first_last = place + np.outer((-0.5, 0.5), to_right) if ends is None else np.array(ends, float)
    speed = float(np.hypot(*velocity)) if length is None else length
    numbers = {
        **{"x": (place[0], std), "y": (place[1], std), "length": (speed, length_std)},
        **{"angle": (np.arctan2(to_right[1], to_right[0]), angle_std)},
        **{"width": (2 * radius, radius_std), "radius": (radius, radius_std)},
        **{"area": (np.pi * radius**2, 1.0), "top_speed": (speed, length_std)},
    }
    values, stds = np.array([numbers[name] for name in QUANTITIES], float).T
    path = Trajectory(first_last[::-1] if backward and ends is not None else first_last, [0, 1])
    motion = Motion(
        path, values, np.diag(stds**2), np.array([speed]), np.array([length_std]), source,
        "parabola" if source == "sweep" else "line", "disc" if source == "sweep" else "",
        (1000, 1000), doubts=tuple(doubts), readout=readout,
    )  # fmt: skip
    return Sighting(motion, color, evidence, 1.0, (0, 0, 1000, 1000), backward)

"""Errors of an estimated path."""

import numpy as np

from blurmatte.checks import Array
from blurmatte.trajectory import Trajectory


def trajectory_iou(
    estimated: Trajectory | None, true: Trajectory, radius: float, samples: int = 100
) -> float:
    """Trajectory intersection over union (TIoU) of fast moving objects.

    At each of `samples` times, equally spaced from the first moment of the exposure to the last, a
    disc of the true radius is placed at the true and one at the estimated position, and the area of
    their intersection is divided by that of their union. The score is the mean over time (Kotera et
    al., "Intra-frame object tracking by deblatting", ICCV workshops 2019), for the better of the two
    directions of time, as a single picture does not determine it (the benchmark of Rozumnyi et al.,
    "DeFMO", CVPR 2021). For two paths of n points at equally spaced times, and `samples` = n, it is
    the benchmark's number.

    Parameters
    ----------
    estimated : Trajectory or None
        None for a method without a result: a miss, which scores 0.
    true : Trajectory
    radius : float
        True radius of the object, pixels, > 0.
    samples : int
        Number of times, 2 or more.

    Returns
    -------
    float
        0…1; 1 is perfect.

    Raises
    ------
    TypeError, ValueError
        If a path is not a Trajectory, or a number out of its range.
    """
    for name, path in (("estimated", estimated), ("true", true)):
        if not (isinstance(path, Trajectory) or (path is None and name == "estimated")):
            raise TypeError(f"{name} must be a Trajectory, got {type(path).__name__}")
    if not (np.isfinite(radius) and radius > 0):
        raise ValueError(f"radius must be finite and above 0 pixels, got {radius}")
    if samples < 2:
        raise ValueError(f"samples must be 2 or more, got {samples}")
    if estimated is None:
        return 0.0
    t = np.linspace(0, 1, samples)
    there = true.at(t)
    forth, back = (_disc_iou(estimated.at(times) - there, radius) for times in (t, t[::-1]))
    return float(max(forth.mean(), back.mean()))


def _disc_iou(shift: Array, radius: float) -> Array:
    """(n,) intersection over union of two discs of one radius, `shift` (n, 2) apart.

    The common chord has the central angle θ, cos(θ/2) = d / 2r, and cuts a segment of the area
    (θ − sin θ) r²/2 from each disc; the two segments are the intersection.
    """
    half = np.arccos(np.minimum(np.linalg.norm(shift, axis=1) / (2 * radius), 1))
    shared = 2 * half - np.sin(2 * half)  # in units of r²
    return np.asarray(shared / (2 * np.pi - shared))

"""Scatter: residuals of frames about the path and radius of their clip, in units of their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.motion.clip.clip_path import ClipPath, ClipRadius
from blurmatte.motion.clip.detections import FrameMotion, check_rows

_MIN_FRAMES = 8  # for a scatter
_RELATIVE_STD = 1.0  # of the scatter, times √n: residuals of neighbors are correlated


@dataclass(frozen=True)
class Scatter:
    """Residuals of frames from a smooth motion, in units of their stated errors.

    Parameters
    ----------
    place, radius : float
        Root of the reduced χ² of frames, each predicted from the others by stated errors: 1 if they are
        right, and the factor of all errors if they have one in common.
    count : int
        Number of frames that were compared: those that a disc explains, without doubts.
    unsteady : float
        Relative standard deviation of the radius of a single frame.

    Examples
    --------
    >>> scatter = bm.motion.Scatter(place=1.2, radius=2.0, count=30, unsteady=False)
    >>> scatter.too_large
    True
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
        std = _RELATIVE_STD / self.count**0.5
        return float((max(self.place, self.radius) - 1) / std)


def frame_scatter(rows: Sequence[FrameMotion]) -> Scatter | None:
    """Scatter of positions and radii of one object about its path and the change of its radius.

    Parameters
    ----------
    rows : sequence of FrameMotion
        From `measure_clip` or `link_sightings`; for several objects the rows of one.

    Returns
    -------
    Scatter or None
        None for fewer than eight frames that a disc explains and that others predict.

    Examples
    --------
    >>> scatter = bm.motion.frame_scatter(rows)
    >>> print(scatter)
    None
    """
    check_rows(rows)
    seen = [row for row in rows if row.sighting is not None]
    path, size = ClipPath.of(seen).as_stated, ClipRadius.of(seen).as_stated
    places, radii = path.chi2[path.used, 0], size.chi2[size.used, 0]
    places, radii = places[np.isfinite(places)], radii[np.isfinite(radii)]
    if min(len(places), len(radii)) < _MIN_FRAMES:
        return None
    place, radius = np.sqrt([places.mean() / 2, radii.mean()]).tolist()
    median = float(np.median(size.states.mean[size.used & size.states.known, 0]))
    return Scatter(place, radius, min(len(places), len(radii)), size.common_std / median)

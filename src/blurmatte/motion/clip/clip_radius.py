"""ClipRadius: the radius of an object as a curve over time, each frame predicted from the others.

The curve (`robust_curve`) has white noise as its second derivative: it is a line for an object that
comes nearer at a constant speed. Two other frames of a track determine it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.motion.clip.detections import FrameMotion, Sighting, in_intervals, parts_of_tracks
from blurmatte.motion.clip.robust_curve import RobustCurve, whole_rows
from blurmatte.motion.clip.smoothing import MIN_STD_PX, Measurements, student_inflation

_ORDER = 2  # value and slope


@dataclass(frozen=True, eq=False)
class ClipRadius(RobustCurve):
    """Radius of an object in the frames of a clip, each predicted from the others."""

    @classmethod
    def of(cls, frames: Sequence[FrameMotion]) -> ClipRadius:
        """The radius in the rows of one object, in order of time."""
        n = len(frames)
        radii, weights = np.zeros((n, 1)), np.zeros((n, 1, 1))
        for k, row in enumerate(frames):
            if (one := row.stated) is not None:
                radii[k] = one.motion.radius
                weights[k] = 1 / (one.motion.radius_std**2 + MIN_STD_PX**2)
        H = np.tile(np.eye(1, _ORDER), (n, 1, 1))
        rows = Measurements(np.array(in_intervals(frames), float), H, radii, weights, 1)
        used = whole_rows(frames)
        return cls(tuple(frames), rows, parts_of_tracks(frames), used, (0.0,)).fitted()

    @property
    def common_std(self) -> float:
        """Error of one frame, pixels, which all may have in common.

        Compression and lens may shift all radii alike.
        """
        variances = 1 / self.rows.weights[self.used, 0, 0] + self.added_to_discs[0] ** 2
        return float(np.sqrt(np.median(variances))) if variances.size else np.inf

    def factor(self, sighting: Sighting) -> float:
        """By which the error of the radius of a detection becomes that here."""
        return self.factors_of(sighting, [sighting.motion.radius_std**2])[0]

    def doubt(self, row: int) -> str:
        """Why the radius of a row that contradicts the others may be wrong."""
        return (
            f"Its radius is {self.residuals[row, 0]:.2g} px off a smooth change through the other "
            "frames: more than noise explains."
        )

    def predicted(self, row: int) -> tuple[float, float] | None:
        """The radius in a row and its error, pixels, as the other rows predict them."""
        radius, variance = self.states.mean[row, 0], self.states.covariance[row, 0, 0]
        std = float(np.sqrt(student_inflation(1) * variance + self.common_std**2))
        return (float(radius), std) if radius > 0 and np.isfinite(std) else None

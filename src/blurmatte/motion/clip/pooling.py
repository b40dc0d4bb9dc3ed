"""What the frames of a clip say together of one object: color, and radius as it changes in time.

The radius in a frame is predicted from the other frames around it, by weighted least squares of a line
in time; the frame itself does not count, so that the prediction is a prior for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.color.model import ColorModel
from blurmatte.motion.clip.clip_path import ClipPath, is_whole
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.sweep import MotionPrior


@dataclass(frozen=True)
class PoolingSettings:
    """Frames that predict the radius in another one."""

    max_neighbors: int = 12
    max_distance_frames: int = 15
    min_neighbors: int = 4  # for a line and its scatter


@dataclass(frozen=True, eq=False)
class ClipObject:
    """One object of a clip: what `track` lists and `solve_clip` separates.

    Parameters
    ----------
    model : ColorModel
        Its color, fused from the frames.
    rows : tuple of FrameMotion
        Of all frames, or of those in which it is.
    path : ClipPath
        One curve in time.
    priors : tuple of MotionPrior or None
        For each row, the radius and the path that the other frames predict; None if too few do.
    """

    model: ColorModel
    rows: tuple[FrameMotion, ...]
    path: ClipPath
    priors: tuple[MotionPrior | None, ...]

    @classmethod
    def of(cls, rows: Sequence[FrameMotion], model: ColorModel) -> ClipObject:
        """The object of the rows of a table."""
        path = ClipPath.of(rows)
        scatter = path.birge_ratio
        priors = [
            None if size is None else replace(size, path=path.prior(k), scatter=scatter)
            for k, size in enumerate(predicted_sizes(rows))
        ]
        return cls(model, tuple(rows), path, tuple(priors))


def predicted_sizes(rows: Sequence[FrameMotion]) -> list[MotionPrior | None]:
    """The radius in each row from the other rows around it, with its error."""
    frames = np.array([row.frame for row in rows])
    usable = np.array([row.sighting is not None and is_whole(row.sighting) for row in rows], bool)
    sizes: list[MotionPrior | None] = []
    for k in range(len(rows)):
        distance = np.abs(frames - frames[k])
        other = usable & (distance > 0) & (distance <= PoolingSettings.max_distance_frames)
        nearest = np.argsort(distance + np.where(other, 0, np.inf), kind="stable")
        near = nearest[: min(int(other.sum()), PoolingSettings.max_neighbors)]
        seen = [one for i in near if (one := rows[i].stated) is not None]
        sizes.append(_predicted(frames[near] - frames[k], seen))
    return sizes


def _predicted(t: np.ndarray, seen: Sequence[Sighting]) -> MotionPrior | None:
    """The radius at time 0 by a line through those of other times."""
    if len(seen) < PoolingSettings.min_neighbors:
        return None
    radius = np.array([one.radius for one in seen])
    std = np.array([max(one.radius_std, 1e-6) for one in seen])
    one_sided = t.min() > 0 or t.max() < 0  # a line that is extrapolated adds noise
    A = np.stack([np.ones(len(t)), np.zeros(len(t)) if one_sided else t], axis=1) / std[:, None]
    covariance = np.linalg.pinv(A.T @ A)
    fitted = covariance @ A.T @ (radius / std)
    left = len(t) - (1 if one_sided else 2)
    chi2 = float(np.sum((radius / std - A @ fitted) ** 2)) / left
    error = float(np.sqrt(covariance[0, 0] * max(chi2, 1.0)))
    # Of one frame: compression and lens may shift all alike, and then a mean is no better.
    common = float(np.sqrt(max(chi2, 1.0)) * np.median(std))
    if not fitted[0] > 0:
        return None
    return MotionPrior(float(fitted[0]), float(np.hypot(error, common)))

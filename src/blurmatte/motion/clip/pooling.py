"""ClipObject: what the frames of a clip say together of one object: color, path and radius.

Path and radius in a frame are predicted from the other frames; the frame itself does not count, so that
the prediction is a prior for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from blurmatte.color.model import ColorModel
from blurmatte.motion.clip.clip_path import ClipPath, ClipRadius
from blurmatte.motion.clip.detections import FrameMotion
from blurmatte.sweep import MotionPrior


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
        path, size = ClipPath.of(rows), ClipRadius.of(rows)
        priors = []
        for k in range(len(rows)):
            radius = size.predicted(k)
            prior = None if radius is None else MotionPrior(*radius, path.prior(k))
            priors.append(prior and replace(prior, scatter=path.birge_ratio))
        return cls(model, tuple(rows), path, tuple(priors))

    @property
    def mistake_probability(self) -> float:
        """That a frame that seems to show a whole disc misleads: as often as they have doubts.

        By the rule of succession, so that it is neither 0 nor 1.
        """
        seen = [one for row in self.rows if (one := row.sighting) is not None]
        discs = [one for one in seen if one.motion.source == "sweep" and not one.motion.at_border]
        return (sum(bool(one.motion.doubts) for one in discs) + 1) / (len(discs) + 2)

"""fit_balls: a ball that flies through space, fitted to each frame of a clip."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, groupby

import numpy as np

from blurmatte.checks import check_kind
from blurmatte.color import ColorModel
from blurmatte.errors import BlurmatteError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.ball import fit_ball
from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.linking import FrameMotion, check_rows
from blurmatte.motion.sightings import Noise, Sighting, as_bright, noise_of, with_its
from blurmatte.motion.sources import check_number
from blurmatte.motion.workers import Workers, shared
from blurmatte.radiometry import LinearImage, check_picture, with_noise
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC


def fit_balls(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    model: ColorModel,
    intrinsics: Intrinsics,
    radius: float,
    radius_std: float = 0.0,
    *,
    workers: int | Workers = 1,
) -> Iterator[BallMotion | None]:
    """Fit a ball that flies through space to what was found in each frame of a clip.

    As `fit_ball` has it, from where the sighting was. It knows that a ball is no disc beside the
    middle of the picture, and grows as it comes nearer.

    Parameters
    ----------
    frames : sequence of LinearImage
        Those that were measured.
    plate : LinearImage
        The same scene without it.
    rows : sequence of FrameMotion
        Of `measure_clip`; of several objects one or more for each frame.
    model : ColorModel
        The ball's color; `clip_color` finds it. Of any colors (rank 3) nothing is fitted.
    intrinsics : Intrinsics
        Of the camera.
    radius, radius_std : float
        Of the ball, meters.
    workers
        As for `sightings`.

    Yields
    ------
    BallMotion or None
        One for each row, in the direction of time as far as the row knows it; None where nothing was
        found, or no ball explains it.

    Raises
    ------
    ValueError
        If radius is not above 0, its error is negative, or the camera is one of other pictures.
    """
    check_picture("plate", plate)
    check_rows(rows)
    check_kind("model", model, ColorModel, "use blurmatte.clip_color(frames, plate)")
    check_intrinsics("intrinsics", intrinsics)
    check_number("radius", radius, radius_std)
    intrinsics.check_size(plate.size)
    if not frames:
        raise ValueError("frames must be one or more, got none")
    first, plate = with_noise(frames[0], plate)
    fit = _Fit(plate, model, noise_of(first), intrinsics, (radius, radius_std))
    by_frame = (
        tuple(row.sighting for row in group) for _, group in groupby(rows, lambda row: row.frame)
    )
    with shared(workers) as processes:
        tasks = zip(frames, by_frame, strict=False)
        yield from chain.from_iterable(processes.in_order(fit, tasks))


@dataclass(frozen=True, eq=False)
class _Fit:
    """What is known before a frame is looked at; radius and its error, meters."""

    plate: LinearImage
    model: ColorModel
    noise: Noise
    intrinsics: Intrinsics
    radius: tuple[float, float]

    def __call__(
        self, frame: LinearImage, found: Sequence[Sighting | None]
    ) -> list[BallMotion | None]:
        if self.model.rank == 3 or not any(map(_may_be_ball, found)):
            return [None] * len(found)
        image = with_its(self.noise, frame)
        plate = as_bright(self.plate, image)
        return [self._fitted(image, plate, one) for one in found]

    def _fitted(
        self, image: LinearImage, plate: LinearImage, one: Sighting | None
    ) -> BallMotion | None:
        if one is None or not _may_be_ball(one):
            return None
        radius, std = self.radius
        begun = Sweep(
            LINE,
            np.array([one.first_x, one.first_y, one.last_x, one.last_y]),
            DISC,
            np.array([one.radius]),
            self.model,
            np.zeros((5, 5)),
            image.size,
        )
        try:
            return fit_ball(image, plate, self.intrinsics, radius, radius_std=std, sweep=begun)
        except BlurmatteError:
            return None


def _may_be_ball(one: Sighting | None) -> bool:
    """Whether a disc on a path explains it, at least roughly: a ball looks about like one."""
    return one is not None and one.source == "sweep"

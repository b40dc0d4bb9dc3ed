"""fit_balls: a ball in three dimensions, fitted to each frame of a clip."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from operator import attrgetter

from blurmatte.calibration import with_noise
from blurmatte.checks import Floats, check_kind
from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError
from blurmatte.intrinsics import Intrinsics, check_intrinsics
from blurmatte.motion.clip.detections import FrameMotion, Sighting, check_rows
from blurmatte.motion.clip.positions_3d import places_in_space
from blurmatte.motion.clip.scene import noise_of, plate_in_light_of
from blurmatte.motion.clip.solving import swept_disc
from blurmatte.motion.clip.summary import KnownQuantities, Places
from blurmatte.motion.clip.workers import Workers, logged, shared
from blurmatte.motion.picture.error_budget import check_with_std
from blurmatte.motion.space.ball import fit_ball
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.radiometry import LinearImage, Noise, check_picture
from blurmatte.radiometry.coded import each_coded
from blurmatte.sweep.model.path import LINE


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
    """Fit a ball in three dimensions to the detection in each frame of a clip.

    As `fit_ball`, started at the detection.

    Parameters
    ----------
    frames, plate : sequence of LinearImage, and LinearImage
        The measured frames, and the same scene without it.
    rows : sequence of FrameMotion
        From `measure_clip`; for several objects one or more for each frame.
    model : ColorModel
        The ball's color; `clip_color` finds it. Nothing is fitted with a model of any colors (rank 3).
    intrinsics, radius, radius_std
        As in `measure_ball`.
    workers
        As in `sightings`.

    Yields
    ------
    BallMotion or None
        One for each row, in its direction; None without a detection, or if no ball explains it.

    Raises
    ------
    ValueError
        If radius is not above 0, its error is negative, or the intrinsics are of another picture size.

    Examples
    --------
    >>> lens = bm.Intrinsics.from_focal_length(28, image.size, sensor_width=36)
    >>> balls = list(bm.motion.fit_balls(frames, plate, rows, solution.model, lens, radius=0.02))
    >>> print(balls[3])
    BallMotion(0.3373 ± 0.00031 m away, 0.03107 ± 0.00015 m on a parabola)
    """
    check_picture("plate", plate)
    check_rows(rows)
    check_kind("model", model, ColorModel, "use blurmatte.motion.clip_color(frames, plate)")
    check_intrinsics("intrinsics", intrinsics)
    check_with_std("radius", radius, radius_std)
    intrinsics.check_size(plate.size)
    if not frames:
        raise ValueError("frames must be one or more, got none")
    first, plate = with_noise(frames[0], plate)
    fit = _BallFitter(plate, model, noise_of(first), intrinsics, (radius, radius_std))
    by_frame = (tuple(map(_disc_in, group)) for _, group in groupby(rows, attrgetter("frame")))
    with shared(workers) as processes:
        lights = (frame and frame.light() for frame in each_coded(frames))
        tasks = zip(lights, by_frame, strict=False)
        yield from chain.from_iterable(processes.in_order(fit, tasks))


def balls_in_space(
    known: KnownQuantities,
    frames: Sequence[LinearImage],
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    model: ColorModel,
    workers: Workers,
) -> Places | None:
    """Where the ball was in space in each row; None unless its radius and the camera are known."""
    if known.lens is None or known.radius is None:
        return None
    fits = fit_balls(frames, plate, rows, model, known.lens, *known.radius, workers=workers)
    balls = list(logged(fits, "fitting the ball in space", len(rows)))
    return places_in_space(rows, known.lens, *known.radius, balls, known.line_time)


@dataclass(frozen=True, eq=False)
class _BallFitter:
    """Fits balls in a frame; holds the data common to all frames. Radius and its error in meters."""

    plate: LinearImage
    model: ColorModel
    noise: Noise | Floats
    intrinsics: Intrinsics
    radius: tuple[float, float]

    def __call__(
        self, frame: LinearImage | None, found: Sequence[Sighting | None]
    ) -> list[BallMotion | None]:
        if frame is None or self.model.rank == 3 or not any(found):
            return [None] * len(found)
        image = frame.with_noise(self.noise) if frame.noise is None else frame
        plate = plate_in_light_of(self.plate, image)
        return [None if one is None else self._fitted(image, plate, one) for one in found]

    def _fitted(self, image: LinearImage, plate: LinearImage, one: Sighting) -> BallMotion | None:
        radius, std = self.radius
        ends = one.motion.trajectory.xy[[0, -1]].ravel()
        start = swept_disc(LINE, ends, one.motion.radius, self.model, image.size)
        try:
            return fit_ball(image, plate, self.intrinsics, radius, radius_std=std, sweep=start)
        except BlurmatteError:
            return None


def _disc_in(row: FrameMotion) -> Sighting | None:
    """The detection if a disc explains it: the image of a ball is nearly a disc."""
    return row.sighting if row.sighting is not None and row.sighting.motion.has_shape else None

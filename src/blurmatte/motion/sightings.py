"""sightings: what of an object each frame of a clip shows, each frame by itself.

Frames know nothing of each other here, so that they can be measured in any order, and a clip that was
interrupted goes on where it stopped. `link_sightings` joins them.
"""

import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import numpy.typing as npt

from blurmatte.background import Matching
from blurmatte.checks import check_kind, check_same_size
from blurmatte.color import ColorModel
from blurmatte.errors import BlurmatteError, BlurmatteWarning, MotionError
from blurmatte.matting import Pixelwise, solve
from blurmatte.motion.candidates import ObjectLight, moving_parts
from blurmatte.motion.from_sweep import motion_of_sweep
from blurmatte.motion.moments import motion_of_alpha
from blurmatte.motion.motion import Motion
from blurmatte.motion.workers import Workers, shared
from blurmatte.radiometry import LinearImage, NoiseModel, check_picture, with_noise
from blurmatte.streaks import Streak
from blurmatte.sweep import Sweep, fit_disc
from blurmatte.sweep.shadow_mask import shadow_around
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Noise = NoiseModel | npt.NDArray[np.floating]

_MARGIN = 24  # pixels around a streak that is solved
_GRID = 5  # pixels between those whose light is compared
_KNOWN = 0.5  # of a streak, where the plate is known; no disc explained one of which less was
_SIGMAS = 3.0
_LEAST_LIGHT = 0.01  # of a plate's pixel that tells how bright a frame is
_NO_COLOR = (
    "nothing of the object's color moved: it is out of the picture, at rest in the plate too, or "
    "hidden"
)


@dataclass(frozen=True)
class Sighting:
    """One streak that may be the object's, in pixels, exposures and radians.

    Which way it went is not known; it is given as going to the right.

    Parameters
    ----------
    x, y, x_std, y_std, xy_covariance : float
        Mean place of the center, and how well it is known.
    vx, vy, vx_std, vy_std : float
        Mean velocity within the exposure, pixels per exposure.
    length, length_std, angle, angle_std, radius, radius_std : float
        As in `Motion`.
    first_x, first_y, last_x, last_y : float
        The ends of the way.
    color : str
        sRGB-coded.
    evidence : float
        How clearly the object's light shows.
    source, path, silhouette : str
        As in `Motion`.
    residual_excess : float
        Of the disc on a path, whether or not the numbers come from it; as in `Diagnostics`.
    at_border, moved : bool
        As in `Motion`.
    doubts : str
        Why the numbers may mean something else.
    """

    x: float
    y: float
    x_std: float
    y_std: float
    xy_covariance: float
    vx: float
    vy: float
    vx_std: float
    vy_std: float
    length: float
    length_std: float
    angle: float
    angle_std: float
    radius: float
    radius_std: float
    first_x: float
    first_y: float
    last_x: float
    last_y: float
    color: str
    evidence: float
    source: str
    path: str
    silhouette: str
    residual_excess: float
    at_border: bool
    moved: bool
    doubts: str

    @property
    def place(self) -> Array:
        """(2,) the center."""
        return np.array([self.x, self.y])

    @property
    def covariance(self) -> Array:
        """(2, 2) of the center."""
        off = self.xy_covariance
        return np.array([[self.x_std**2, off], [off, self.y_std**2]])

    @property
    def reversed(self) -> "Sighting":
        """The same with time run backwards."""
        return replace(
            self,
            vx=-self.vx,
            vy=-self.vy,
            angle=self.angle + (-np.pi if self.angle > 0 else np.pi),
            first_x=self.last_x,
            first_y=self.last_y,
            last_x=self.first_x,
            last_y=self.first_y,
        )


@dataclass(frozen=True)
class FrameSightings:
    """What one frame shows.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds.
    found : tuple of Sighting
        None, one or several.
    reason : str
        Why there is none, or what was refused; "" if nothing was.
    unmeasured : int
        How many more streaks there are, fainter than one that a disc explains.
    """

    frame: int
    time: float | None
    found: tuple[Sighting, ...]
    reason: str = ""
    unmeasured: int = 0


def sightings(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    model: ColorModel,
    *,
    several: bool = False,
    numbers: Iterable[int] | None = None,
    rate: float | None = None,
    skip: int = 0,
    workers: int | Workers = 1,
) -> Iterator[FrameSightings]:
    """Look for an object in each frame of a clip.

    Of an object of one paint, the parts of a frame in which light of its color shows are its
    streaks; of others, whatever moved and is not only darker. Each is measured from a disc on a
    throw if that explains it, else from the moments of alpha; of one object of one paint no
    fainter streak is looked at beside one that a disc explains. Nothing is taken from other frames but
    the noise, which the first frame tells, if nobody did.

    Parameters
    ----------
    frames : sequence of LinearImage
        `read_frames`, or a list.
    plate : LinearImage
        The same scene without it, of the same size.
    model : ColorModel
        Its color; `clip_color` finds it.
    several : bool
        Whether there is more than one object of the color: up to 16 streaks of a frame are looked at
        instead of 3. What has less than a tenth of the strongest one's light is still ignored.
    numbers : iterable of int, optional
        The frames' numbers; 0, 1, … if not given.
    rate : float, optional
        Frames per second, by their numbers, if the frames do not tell their time, or not well.
    skip : int
        How many frames were done before.
    workers : int or Workers
        How many processes share the work, or which; what they find does not depend on it. Programs
        that ask for more than one need the usual `if __name__ == "__main__":`.

    Yields
    ------
    FrameSightings
        One for each frame, in order.

    Raises
    ------
    ValueError
        If a frame and the plate differ in size, or rate or workers are not positive.
    """
    check_picture("plate", plate)
    check_kind("model", model, ColorModel, "use blurmatte.clip_color(frames, plate)")
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be frames per second, above 0, got {rate}")
    if not frames:
        raise ValueError("frames must be one or more, got none")
    first = frames[0]
    check_picture("a frame", first)
    check_same_size("a frame", first.size, "plate", plate.size)
    first, plate = with_noise(first, plate)
    model = replace(model, to_srgb=first.meta.to_srgb)
    light = ObjectLight.before(plate, first, model) if model.rank == 1 else None
    look = _Look(plate, model, light, noise_of(first), rate, several)
    where = list(numbers)[skip:] if numbers is not None else count(skip)
    with shared(workers) as processes:
        yield from processes.in_order(look, zip(where, frames[skip:], strict=False))


@dataclass(frozen=True, eq=False)
class _Look:
    """What is known before a frame is looked at."""

    plate: LinearImage
    model: ColorModel
    light: ObjectLight | None
    noise: Noise
    rate: float | None
    several: bool

    def __call__(self, number: int, frame: LinearImage) -> FrameSightings:
        check_picture("a frame", frame)
        check_same_size("a frame", frame.size, "plate", self.plate.size)
        image = with_its(self.noise, frame)
        time = frame.meta.time if self.rate is None else number / self.rate
        plate = as_bright(self.plate, image)
        if self.light is None:
            streaks, coherence = moving_parts(image, plate, self.several), 1.0
        else:
            streaks, coherence = self.light.parts(image, self.several)
        found, reasons, rest = [], [], deque(streaks)
        alone = self.light is not None and not self.several  # the one object of its color
        while rest:
            try:
                found.append(_measured(image, plate, rest.popleft(), self.model, coherence))
            except BlurmatteError as error:
                reasons.append(str(error))
            if alone and found and found[-1].source == "sweep":
                break
        if not streaks:
            reasons = ["nothing moved" if self.light is None else _NO_COLOR]
        return FrameSightings(number, time, tuple(found), "; ".join(reasons), len(rest))


def with_its(noise: Noise, frame: LinearImage) -> LinearImage:
    """A frame with this noise, if it has none of its own."""
    return frame.with_noise(noise) if frame.noise is None else frame


def noise_of(image: LinearImage) -> Noise:
    """The noise of a picture that has some."""
    assert image.noise is not None
    return image.noise


def as_bright(plate: LinearImage, image: LinearImage) -> LinearImage:
    """The plate in the light of a frame, if lamp or shutter made that another one."""
    grid = np.s_[::_GRID, ::_GRID]
    B, C = (np.asarray(picture.rgb[grid], float) for picture in (plate, image))
    use = (plate.valid & image.valid)[grid] & (B.min(axis=-1) > _LEAST_LIGHT)
    if not use.any():
        return plate
    ratio = np.ascontiguousarray((C[use] / B[use]).T)  # medians of rows take a third of the time
    gain = np.median(ratio, axis=1)
    spread = 1.4826 * np.median(np.abs(ratio - gain[:, None]), axis=1)
    if np.all(np.abs(gain - 1) < _SIGMAS * spread / np.sqrt(ratio.shape[1])):
        return plate
    by = np.tile(
        gain.astype(np.float32), (plate.size[0], 1)
    )  # for a row, as in `NoiseModel.variance`
    return replace(plate, rgb=plate.rgb * by, noise=np.asarray(plate.variance * by**2, np.float32))


def _measured(
    image: LinearImage, plate: LinearImage, streak: Streak, model: ColorModel, coherence: float
) -> Sighting:
    """From a disc on a path, or from moments."""
    if np.mean(plate.valid[streak.rows_columns][streak.mask[streak.rows_columns]]) < _KNOWN:
        raise MotionError("most of the streak lies where the plate is not known")
    if model.rank == 1:
        shadow = shadow_around(image, plate, streak, model.pole)
        image = replace(image, valid=image.valid & ~shadow)
        streak = replace(streak, mask=streak.mask & ~shadow)
    sweep = fit_disc(image, plate, streak, model)
    if not sweep.rejection:
        return _told(motion_of_sweep(sweep, image.meta.exposure_time), streak, model, sweep)
    if model.rank == 3:
        raise MotionError(
            "no disc on a path explains the streak, and of any colors nothing else does"
        )
    x0, y0, x1, y1 = box = streak.around(_MARGIN)
    inside = Streak(streak.mask[y0:y1, x0:x1])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", BlurmatteWarning)
        solution = solve(
            image.crop(box),
            plate.crop(box),
            model,
            Pixelwise(),
            streak=inside,
            matching=Matching.NONE,
        )
    motion = _moved_by(motion_of_alpha(solution), np.array([x0, y0], float), image.size)
    doubts = motion.doubts + tuple(str(one.message) for one in said)
    motion = replace(motion, covariance=coherence**2 * motion.covariance, doubts=doubts)
    return _told(motion, streak, model, sweep)


def _moved_by(motion: Motion, corner: Array, size: tuple[int, int]) -> Motion:
    """A motion of a part of a picture in all of it."""
    path, values = motion.trajectory, motion.values.copy()
    values[:2] += corner
    xy = path.xy + corner
    return replace(motion, trajectory=Trajectory(xy, path.t), values=values, size=size)


def _told(motion: Motion, streak: Streak, model: ColorModel, sweep: Sweep) -> Sighting:
    if abs(motion.angle) > np.pi / 2:
        motion = motion.reversed
    c, s, L = np.cos(motion.angle), np.sin(motion.angle), motion.length
    J = np.array([[c, -L * s], [s, L * c]])
    names = ("length", "angle")
    V = J @ np.array([[motion.covariance_of(a, b) for b in names] for a in names]) @ J.T
    (x, y), (x_std, y_std) = motion.center.tolist(), motion.center_std.tolist()
    vx_std, vy_std = np.sqrt(np.maximum(np.diag(V), 0)).tolist()
    (first_x, first_y), (last_x, last_y) = motion.trajectory.xy[[0, -1]].tolist()
    return Sighting(
        x=x,
        y=y,
        x_std=x_std,
        y_std=y_std,
        xy_covariance=motion.covariance_of("x", "y"),
        vx=float(L * c),
        vy=float(L * s),
        vx_std=vx_std,
        vy_std=vy_std,
        length=L,
        length_std=motion.length_std,
        angle=motion.angle,
        angle_std=motion.angle_std,
        radius=motion.radius,
        radius_std=motion.radius_std,
        first_x=first_x,
        first_y=first_y,
        last_x=last_x,
        last_y=last_y,
        color="" if model.rank == 3 else " + ".join(model.hex),
        evidence=float(streak.evidence),
        source=motion.source,
        path=motion.path,
        silhouette=motion.silhouette,
        residual_excess=sweep.diagnostics.residual_excess,
        at_border=motion.at_border,
        moved=motion.moved,
        doubts=" ".join(motion.doubts),
    )

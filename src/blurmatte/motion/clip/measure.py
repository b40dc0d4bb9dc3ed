"""sightings: frames → detections of an object, or of several, in each of them.

Each frame is measured alone, so that frames can be measured in any order, and an interrupted clip can
be resumed. `link_sightings` joins the detections to tracks.

The radius depends on the transfer curve, which a clip may not state. A rim is where half of the light
is the object's. With another curve this half is elsewhere, so all radii shift alike. A few frames that
are measured with each curve give that shift, which no scatter of frames shows.
"""

import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.background import Matching
from blurmatte.background.registration import CameraPath
from blurmatte.checks import Bools, box_from, check_kind, check_same_size
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import shadow_around
from blurmatte.color.streak import check_not_gray
from blurmatte.errors import BlurmatteError, BlurmatteWarning, MotionError, PlateError
from blurmatte.matting.pixelwise import Pixelwise
from blurmatte.matting.solve import solve
from blurmatte.motion.clip.detections import (
    NO_COLOR,
    NOTHING_MOVED,
    FrameMotion,
    FrameSightings,
    Sighting,
)
from blurmatte.motion.clip.scene import Part, StaticScene, box_in_frame
from blurmatte.motion.clip.workers import Workers, parts_of, shared, successes
from blurmatte.motion.picture.measure import motion_of_added_light, motion_of_alpha, motion_of_sweep
from blurmatte.motion.picture.motion import Motion
from blurmatte.radiometry import LinearImage, Transfer, check_picture
from blurmatte.radiometry.coded import CodedFrame, CodedSequence, each_coded
from blurmatte.statistics import chi_square_quantile
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.discs import fit_disc
from blurmatte.sweep.fit.ranking import MAX_LIGHT
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.transfer_fit import UNSTATED_CURVES, with_curve

_MIN_ENERGY_FRACTION = 0.1  # of a frame's strongest part: less is not the object
_MAX_PARTS = 3  # of a frame, for one object
_MAX_PARTS_OF_SEVERAL = 16  # the same for several objects
_MARGIN = 24  # pixels around a streak whose alpha is solved
_MIN_PLATE_FRACTION = 0.5  # of a streak's pixels; a disc is not determined by fewer
_MIN_KNOWN_FRACTION = 0.5  # of a streak's pixels, whose alpha the moments are of
_AGREEMENT = 0.999  # probability of a smaller distance of two measured places of one object
_FRAMES = 3  # measured with each curve; their shifts differ by a tenth
_NO_DISC = "no disc on a path explains the streak"


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
    """Detect an object in each frame of a clip.

    For an object of one paint, the streaks are the parts of a frame in which light of its color shows;
    for others, all parts that changed and did not only become darker. Each is measured by a fit of a
    disc on a parabola if that explains it, else by the moments of alpha. For a single object of one
    paint, streaks fainter than one that a disc explains are not measured. Frames share the noise.

    Parameters
    ----------
    frames : sequence of LinearImage
        From `read_frames`, or a list.
    plate : LinearImage
        The same scene without it, of the same size.
    model : ColorModel
        Its color; `clip_color` finds it.
    several : bool
        True if several objects have the color: up to 16 streaks of a frame are measured instead of 3.
        Streaks with less than a tenth of the strongest one's light are always ignored.
    numbers : iterable of int, optional
        The frames' numbers; 0, 1, … if not given.
    rate : float, optional
        Frames per second; replaces the times in the frames.
    skip : int
        Number of frames that were done before.
    workers : int or Workers
        Number of processes, or the processes; the results do not depend on it (see `Workers`).

    Yields
    ------
    FrameSightings
        One for each frame, in order.

    Raises
    ------
    ValueError
        If a frame and the plate differ in size, or rate or workers are not positive.

    Examples
    --------
    >>> found = list(bm.motion.sightings(frames[:3], plate, solution.model))
    >>> [frame.found[0].motion.center.round(1).tolist() for frame in found]
    [[16.3, 44.6], [33.7, 32.5], [51.0, 22.9]]
    """
    scene = scene_of(frames, plate, model, rate=rate)
    of_frames = range(len(frames)) if numbers is None else tuple(numbers)
    with shared(workers) as processes:
        detector = Detector(scene.of_color(frames, model), of_frames, rate, several)
        yield from detector.over(frames, processes, skip)


def scene_of(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    model: ColorModel,
    hidden: Bools | None = None,
    rate: float | None = None,
    camera: CameraPath | None = None,
) -> StaticScene:
    """The scene of a clip, after a check of what was given."""
    check_picture("plate", plate)
    check_kind("model", model, ColorModel, "use blurmatte.motion.clip_color(frames, plate)")
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be frames per second, above 0, got {rate}")
    if not frames:
        raise ValueError("frames must be one or more, got none")
    check_picture("a frame", frames[0])
    if camera is None:
        check_same_size("a frame", frames[0].size, "plate", plate.size)
    if model.rank < 3:
        check_not_gray(frames[0], plate)
    return StaticScene.of(frames, plate, hidden, camera)


@dataclass(frozen=True, eq=False)
class Detector:
    """Detects and measures the object in frames; holds the data common to all frames."""

    scene: StaticScene
    numbers: Sequence[int]
    rate: float | None
    several: bool

    def over(
        self, frames: Sequence[LinearImage], workers: Workers, skip: int
    ) -> Iterator[FrameSightings]:
        """The detections in each of the frames, but for some at the beginning."""
        for found in successes(workers.over(frames, self, parts_of(frames, workers, skip))):
            yield from found

    def __call__(self, frames: Sequence[LinearImage], first: int) -> list[FrameSightings]:
        """The detections in some frames, of which the first has this index."""
        found = []
        for index, frame in enumerate(each_coded(frames), first):
            number = self.numbers[index]
            time = _time_in(frames, index - first) if frame is None else frame.time
            time = time if self.rate is None else number / self.rate
            one = FrameSightings(number, time, (), "it cannot be decoded")
            found.append(one if frame is None else self._found(frames, frame, index, one))
        return found

    def _found(
        self, frames: Sequence[LinearImage], frame: CodedFrame, index: int, empty: FrameSightings
    ) -> FrameSightings:
        """The frame with its detections, from one without any."""
        try:
            scene = self.scene.at(frames, frame, index)
        except PlateError as error:  # it is not registered
            return replace(empty, reason=str(error))
        own = replace(self, scene=scene)
        boxes = scene.boxes(frames, frame, index)
        return own._detected(empty, list(scene.parts(frame, index, boxes)))

    def _detected(self, empty: FrameSightings, parts: Sequence[Part]) -> FrameSightings:
        streaks = self._streaks(parts)
        found, reasons, rest = [], [], deque(streaks)
        color = self.scene.color
        single = color is not None and not self.several
        inflation = 1.0 if color is None else color.inflation
        while rest:
            part, streak = rest.popleft()
            try:
                one = _measured(part, streak, self.scene.model, inflation)
                in_frame = one.measured.shifted(*one.box[:2])
                found.append(replace(one, measured=replace(in_frame, size=self.scene.plate.size)))
            except BlurmatteError as error:
                reasons.append(str(error))
            if single and found and found[-1].measured.has_shape:
                break
        if not streaks:
            reasons = [NOTHING_MOVED if color is None or not parts else NO_COLOR]
        why = "; ".join(dict.fromkeys(reasons))
        return replace(empty, found=tuple(found), reason=why, unmeasured=len(rest))

    def _streaks(self, parts: Sequence[Part]) -> list[tuple[Part, Streak]]:
        """The strongest streaks of all parts that may be the object's, the strongest first."""
        scene, least = self.scene, -np.inf
        found = [(part, streak) for part in parts for streak in scene.streaks(part)]
        if scene.color is not None:
            strongest = max((streak.evidence for _, streak in found), default=0.0)
            least = _MIN_ENERGY_FRACTION * max(strongest, 0.0)
        elif not found and scene.plate.meta.one_channel:  # perhaps black; no hue shows a shadow
            found = [(part, streak) for part in parts for streak in find_streaks(*part)]
        found = [one for one in found if one[1].evidence > least]
        most = _MAX_PARTS_OF_SEVERAL if self.several else _MAX_PARTS
        return sorted(found, key=lambda one: -one[1].evidence)[:most]


def _time_in(frames: Sequence[LinearImage], at: int) -> float | None:
    """The time that the file states for one of the frames, seconds."""
    if not isinstance(frames, CodedSequence) or frames.times is None:
        return None
    return frames.times[frames.numbers[at]]


def _measured(part: Part, streak: Streak, model: ColorModel, inflation: float) -> Sighting:
    """Detection from a fitted disc, or from moments, whose errors are multiplied by `inflation`."""
    image, plate = part
    known = plate.valid[streak.rows_columns][streak.mask[streak.rows_columns]]
    if np.mean(known) < _MIN_PLATE_FRACTION:
        raise MotionError("most of the streak lies where the plate is not known")
    if model.rank == 1:
        shadow = shadow_around(image, plate, streak, model.pole)
        image = replace(image, valid=image.valid & ~shadow)
        streak = replace(streak, mask=streak.mask & ~shadow)
    sweep = fit_disc(image, plate, streak, model)
    light = _motion_of_source(sweep, (image, plate), streak, model)
    if not sweep.rejection and light is None:
        motion = motion_of_sweep(sweep, image.meta.exposure_time, image.meta.readout)
        return _sighting(motion, part, streak, replace(model, mean=sweep.model.mean), sweep)
    if model.rank == 3:
        raise MotionError(f"{_NO_DISC}, and without a color nothing else can be measured")
    if light is not None:
        return _sighting(light, part, streak, model, sweep)
    motion, model = _motion_of_pixels((image, plate), streak, model)
    motion = replace(motion, covariance=inflation**2 * motion.covariance)
    return _sighting(motion, part, streak, model, sweep)


def _motion_of_source(sweep: Sweep, part: Part, streak: Streak, model: ColorModel) -> Motion | None:
    """Motion from the moments of added light, of a source of light that a sweep does not explain.

    Nor does it if it is elsewhere than the light: a change of its speed looks like one of brightness.
    The light of a source is far above that of the plate, so that the plate need not be even.
    """
    mean = sweep.model.mean
    if model.rank > 1 or mean is None or mean.max() <= MAX_LIGHT:
        return None
    try:
        light = motion_of_added_light(*part, streak.mask, model.basis[:, 0])
    except MotionError:
        return None
    if sweep.rejection:
        return light
    of_sweep = motion_of_sweep(sweep, None)
    off = light.center - of_sweep.center
    variance = light.covariance[:2, :2] + of_sweep.covariance[:2, :2]
    apart = off @ np.linalg.solve(variance, off)
    return light if apart > chi_square_quantile(_AGREEMENT, 2) else None


def _motion_of_pixels(part: Part, streak: Streak, model: ColorModel) -> tuple[Motion, ColorModel]:
    """Motion from the moments of alpha around a streak, in the whole picture; the colors seen.

    From those of the added light if alpha is not determined in most of the streak.
    """
    x0, y0, x1, y1 = box = streak.around(_MARGIN)
    image, plate = (picture.crop(box) for picture in part)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", BlurmatteWarning)
        solution = solve(
            *(image, plate, model, Pixelwise()),
            streak=Streak(streak.mask[y0:y1, x0:x1]),
            matching=Matching.NONE,
        )
    known = np.mean(solution.known[solution.streak])
    color = model.basis[:, 0] if model.rank == 1 else model.mean
    if color is not None and known < _MIN_KNOWN_FRACTION:
        motion = motion_of_added_light(image, plate, solution.streak, color / np.linalg.norm(color))
    else:
        motion = motion_of_alpha(solution)
    doubts = motion.doubts + tuple(str(warning.message) for warning in caught)
    motion = replace(motion.shifted(x0, y0), size=part[0].size, doubts=doubts)
    return motion, solution.model


def _sighting(
    motion: Motion, part: Part, streak: Streak, model: ColorModel, sweep: Sweep
) -> Sighting:
    """The detection going to the right; the sweep is left out, which would be kept for each frame."""
    motion = motion.reversed if abs(motion.angle) > np.pi / 2 else motion
    return Sighting(
        replace(motion, sweep=None),
        model.color,
        float(streak.evidence),
        sweep.diagnostics.residual_excess,
        box_in_frame(part),
    )


def radius_spread(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    numbers: Iterable[int] | None = None,
    camera: CameraPath | None = None,
) -> float:
    """Relative standard deviation of the radius over the curves; 0 if no frame shows it.

    frames, plate: decoded with the curve that was assumed.
    rows: places in pixels of the frames.
    numbers: of the frames, 0, 1, … if not given.
    camera: of one that moves, on whose canvas the plate is.
    """
    places = {k: i for i, k in enumerate(range(len(frames)) if numbers is None else numbers)}
    whole = [(r.frame, r.sighting) for r in rows if r.sighting is not None and r.sighting.is_whole]
    if not whole:
        return 0.0
    inner = (np.arange(_FRAMES) + 0.5) * len(whole) / _FRAMES  # off the ends, which may be cut
    some = [whole[k] for k in inner.astype(int)]

    def behind(k: int) -> LinearImage:
        """The plate of a frame."""
        return plate if camera is None else camera.plate_at(k, plate)

    at = ((places[k], one) for k, one in dict(some).items())
    found = [_log_radii(frames[k], behind(k), one) for k, one in at]
    known = [radii for radii in found if radii is not None]
    return float(np.sqrt(np.mean(np.mean(known, axis=0) ** 2))) if known else 0.0


def explaining_curve(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    numbers: Iterable[int] | None = None,
    camera: CameraPath | None = None,
) -> Transfer | None:
    """The curve with which a disc explains what none does with the assumed one, in most frames tried.

    None if no curve does, or if no frame was refused for want of a disc. Parameters as for
    `radius_spread`.
    """
    places = {k: i for i, k in enumerate(range(len(frames)) if numbers is None else numbers)}
    refused = [row.frame for row in rows if row.sighting is None and _NO_DISC in row.reason]
    if not refused:
        return None
    inner = (np.arange(_FRAMES) + 0.5) * len(refused) / _FRAMES
    some = list(dict.fromkeys(refused[k] for k in inner.astype(int)))
    explained: Counter[str] = Counter()
    for k in some:
        frame = frames[places[k]]
        behind = plate if camera is None else camera.plate_at(places[k], plate)
        explained.update(curve.name for curve in UNSTATED_CURVES if _explains(curve, frame, behind))
    name, count = max(explained.items(), key=lambda one: one[1], default=("", 0))
    if 2 * count <= len(some):
        return None
    return next(curve for curve in UNSTATED_CURVES if curve.name == name)


def _explains(curve: Transfer, frame: LinearImage, plate: LinearImage) -> bool:
    """Whether a disc explains the strongest streak with another curve than that of the frame."""
    assumed = frame.meta.transfer
    if assumed is None or assumed.name == curve.name:
        return False
    try:
        pair = with_curve(frame, plate, curve)
        return not fit_disc(*pair, find_streaks(*pair)[0]).rejection
    except (BlurmatteError, IndexError):
        return False


def _log_radii(
    frame: LinearImage, plate: LinearImage, seen: Sighting
) -> np.typing.NDArray[np.float64] | None:
    """(curves,) log of the radius with each curve over that with the assumed one; None if unknown.

    Each is fitted here in the same way, so that they differ by the curve alone.
    """
    assumed = frame.meta.transfer
    if assumed is None:
        return None
    ends, reach = seen.motion.trajectory.xy[[0, -1]], seen.motion.radius + _MARGIN
    box = box_from(ends.min(axis=0) - reach, ends.max(axis=0) + reach + 1, frame.size)
    image, behind = frame.crop(box), plate.crop(box)
    radii = []
    try:
        for curve in (assumed, *UNSTATED_CURVES):
            pair = with_curve(image, behind, curve)
            radii.append(fit_disc(*pair, find_streaks(*pair)[0]).radius)
    except (BlurmatteError, IndexError):
        return None
    return np.asarray(np.log(np.array(radii[1:]) / radii[0]))

"""clip_color: the color of the moving object in a clip, fused from some of its frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.color.model import ColorModel, fuse_colors
from blurmatte.color.streak import check_not_gray
from blurmatte.errors import BlurmatteError, ColorModelError, MotionError
from blurmatte.motion.clip.scene import Crop, StaticScene, survey
from blurmatte.motion.clip.workers import Workers, shared, successes
from blurmatte.radiometry import LinearImage, coded_frames
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.fit_sweep import fit_disc, fit_sweep
from blurmatte.sweep.sweep import Sweep

Vote = tuple[ColorModel, float, int]  # a color, its weight, and the number of the frame


@dataclass(frozen=True)
class ColorSettings:
    """Frames and streaks that vote for the color, and when the vote ends."""

    frames_per_round: int = 6
    round_starts: tuple[int, ...] = (2, 0, 1, 3)  # quarters of the distance between frames
    streaks_per_frame: int = 3  # the strongest
    min_agreeing_frames: int = 4
    min_lead: float = 2.0  # times the weight of all other colors
    max_color_angle: float = 0.15  # radians, between shades of one paint in changing light
    relative_radius_std: float = 0.05  # at which the weight of a vote is halved


# Fits in the order in which they are tried until a color is found, each with True for streaks that
# do not reach the border of the picture, and the number of rounds: arms enter from outside, and a hand
# is in many frames clearer than the ball.
_TRIALS = (fit_disc, True, 4), (fit_disc, False, 1), (fit_sweep, True, 1), (fit_sweep, False, 1)


def clip_color(
    frames: Sequence[LinearImage], plate: LinearImage, workers: int | Workers = 1
) -> ColorModel:
    """The color of the moving object in a clip, from some of its frames together.

    Every streak that a shape on a path explains votes for its color, in 4 to 24 frames all over the
    clip, until enough frames agree. The weight of a vote is the evidence of the streak times the square
    of its length in radii: a fist that holds a string may be as bright as the ball on it, but hardly
    moves. The largest sum of similar colors wins. Streaks at the border of the picture vote only if no
    other streak is explained.

    Parameters
    ----------
    frames : sequence of LinearImage
    plate : LinearImage
        The same scene without it.
    workers : int or Workers
        As in `sightings`.

    Returns
    -------
    ColorModel
        Of one paint if any frame shows one.

    Raises
    ------
    ColorModelError
        If no frame determines it, or the pictures are gray.
    """
    if len(frames):
        check_not_gray(frames[0], plate)
    with shared(workers) as processes:
        return color_in_scene(frames, StaticScene.of(frames, plate), processes)


def color_in_scene(
    frames: Sequence[LinearImage], scene: StaticScene, workers: Workers
) -> ColorModel:
    """As `clip_color`."""
    votes: list[Vote] = []
    busy = [change.number for change in survey(frames, scene, workers) if change.boxes]
    for fit, inside, rounds in _TRIALS:
        voter = _Voter(scene, fit, inside)
        parts = ((slice(k, k + 1),) for k in _spread(busy, rounds))
        found = successes(workers.over(frames, voter, parts, 1))
        for number, colors in enumerate(found):
            votes += [(model, weight, number) for model, weight in colors]
            if _decided(votes):
                break
        if votes:
            break
    votes = [vote for vote in votes if vote[0].rank == 1] or votes[:1]
    if not votes:
        raise ColorModelError(
            f"no color was found in {ColorSettings.frames_per_round} or more frames: no shape on a "
            "path explains their streaks; give the color (--color, model=)"
        )
    return fuse_colors([model for model, _, _ in _largest_group(votes)])


def _spread(numbers: Sequence[int], rounds: int) -> Iterator[int]:
    """Frames all over the clip, each round in order and between the frames of the others."""
    step = -(-len(numbers) // ColorSettings.frames_per_round)
    for first in dict.fromkeys(step * n // 4 for n in ColorSettings.round_starts[:rounds]):
        yield from numbers[first::step] if step else ()


def _largest_group(votes: Sequence[Vote]) -> list[Vote]:
    """The votes for similar colors with the largest sum of weights."""
    limit = ColorSettings.max_color_angle
    groups = [[b for b in votes if _angle(a[0], b[0]) < limit] for a in votes]
    return max(groups, key=lambda group: sum(weight for _, weight, _ in group))


def _decided(votes: Sequence[Vote]) -> bool:
    """True if more frames are unlikely to change the color."""
    single = [vote for vote in votes if vote[0].rank == 1]
    best = _largest_group(single) if single else []
    weight, total = (sum(weight for _, weight, _ in some) for some in (best, single))
    enough = len({number for _, _, number in best}) >= ColorSettings.min_agreeing_frames
    return enough and weight >= ColorSettings.min_lead * (total - weight)


def _angle(a: ColorModel, b: ColorModel) -> float:
    return float(np.arccos(np.clip(abs(a.pole @ b.pole), 0, 1)))


@dataclass(frozen=True, eq=False)
class _Voter:
    """Votes of a frame: the colors of the streaks that a sweep explains, with their weights.

    Limbs and their shadows may fit a disc too, but with an uncertain radius; and they reach the border:
    either only streaks `inside` the picture vote, or only the others.
    """

    scene: StaticScene
    fit: Callable[..., Sweep]
    inside: bool

    def __call__(self, frames: Sequence[LinearImage]) -> list[tuple[ColorModel, float]]:
        (frame,) = coded_frames(frames, slice(None))
        boxes = self.scene.gate.changes(frame).boxes
        found = [
            (streak, crop) for crop in self.scene.crops(frame, boxes) for streak in _streaks(crop)
        ]
        found.sort(key=lambda one: -one[0].evidence)
        votes = (self._vote(*one, frame.size) for one in found[: ColorSettings.streaks_per_frame])
        return [vote for vote in votes if vote is not None]

    def _vote(
        self, streak: Streak, crop: Crop, size: tuple[int, int]
    ) -> tuple[ColorModel, float] | None:
        """Color and weight of a streak in a picture of a size; None if no sweep explains it."""
        x, y = crop.box[:2]
        x0, y0, x1, y1 = streak.box
        if self.inside != (min(x + x0, y + y0, size[0] - x - x1, size[1] - y - y1) > 0):
            return None
        try:
            sweep = self.fit(crop.image, crop.plate, streak)
        except (ColorModelError, MotionError):
            return None
        if sweep.rejection:
            return None
        uncertainty = sweep.radius_std / (ColorSettings.relative_radius_std * sweep.radius)
        moved = streak.evidence * (sweep.length / sweep.radius) ** 2
        return sweep.model, moved / (1 + uncertainty**2)


def _streaks(crop: Crop) -> list[Streak]:
    try:
        return find_streaks(crop.image, crop.plate)
    except BlurmatteError:
        return []

"""clip_color: the color of what moves in a clip, which some of its frames tell together."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.errors import BlurmatteError, ColorModelError, MotionError
from blurmatte.motion.sightings import Noise, noise_of, with_its
from blurmatte.motion.workers import Workers, shared
from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.streaks import require_streaks
from blurmatte.sweep import Sweep, fit_disc, fit_sweep, fuse_colors

_Told = tuple[ColorModel, float, int]  # a color, how much of it moved, and which frame tells it

_ASKED = 6  # frames that are asked for the color in a round
_QUARTERS = 2, 0, 1, 3  # of the frames between two of them, where the rounds begin
_AGREEING, _LEAD = 4, 2.0  # frames of one color, with so many times the light of others, are enough
_ASKED_STREAKS = 3  # of each, the strongest
_SURE_RADIUS = 0.05  # of itself, how well a radius is known that speaks for a color
_SAME_COLOR = (
    0.15  # radians: shades of one paint in changing light; things that move differ by more
)
# What asks for the color as long as nothing is told, whether of streaks that are seen whole, and in
# how many rounds: arms come from beyond the border, and many a frame shows a hand more clearly.
_ASKING = (fit_disc, True, 4), (fit_disc, False, 1), (fit_sweep, True, 1), (fit_sweep, False, 1)


def clip_color(
    frames: Sequence[LinearImage], plate: LinearImage, workers: int | Workers = 1
) -> ColorModel:
    """The color that what moves in a clip has, from some of its frames together.

    Frames all over the clip are asked for everything in them that a shape on a path explains, 4 to
    24 of them, until enough agree. Colors that agree count together, by the evidence of their streaks
    times the square of how many radii each went, a kind of energy of motion; the most wins. A fist
    that holds a string may be as bright as the ball on it, but hardly moves. What reaches the border
    of the picture counts only if nothing else tells.

    Parameters
    ----------
    frames : sequence of LinearImage
    plate : LinearImage
        The same scene without it.
    workers : int or Workers
        As for `sightings`.

    Returns
    -------
    ColorModel
        Of one paint if any frame shows one.

    Raises
    ------
    ColorModelError
        If no frame tells it.
    """
    first, plate = with_noise(next(_all_over(frames, 1)), plate)
    told: list[_Told] = []
    with shared(workers) as processes:
        for fit, whole, rounds in _ASKING:
            ask = _Ask(plate, noise_of(first), fit, whole)
            tasks = ((frame,) for frame in _all_over(frames, rounds))
            for number, colors in enumerate(processes.in_order(ask, tasks, 1)):
                told += [(model, weight, number) for model, weight in colors]
                if _agreed(told):
                    break
            if told:
                break
    told = [one for one in told if one[0].rank == 1] or told[:1]
    if not told:
        raise ColorModelError(
            f"none of {_ASKED} frames or more tells the object's color: no shape on a path explains "
            "what moves; give its color (--color, model=)"
        )
    return fuse_colors([model for model, _, _ in _clearest(told)])


def _all_over(frames: Sequence[LinearImage], rounds: int) -> Iterator[LinearImage]:
    """Frames all over a clip, each round in order and between those of the others."""
    step = -(-len(frames) // _ASKED)
    for first in dict.fromkeys(step * part // 4 for part in _QUARTERS[:rounds]):
        yield from frames[first::step]


def _clearest(told: Sequence[_Told]) -> list[_Told]:
    """The colors that agree, and that most of the light that moved stands for."""
    together = [[b for b in told if _angle(a[0], b[0]) < _SAME_COLOR] for a in told]
    return max(together, key=lambda group: sum(weight for _, weight, _ in group))


def _agreed(told: Sequence[_Told]) -> bool:
    """Whether more frames would hardly tell another color."""
    lines = [one for one in told if one[0].rank == 1]
    best = _clearest(lines) if lines else []
    light, all_light = (sum(weight for _, weight, _ in some) for some in (best, lines))
    enough = len({number for _, _, number in best}) >= _AGREEING
    return enough and light >= _LEAD * (all_light - light)


def _angle(a: ColorModel, b: ColorModel) -> float:
    return float(np.arccos(np.clip(abs(a.pole @ b.pole), 0, 1)))


@dataclass(frozen=True, eq=False)
class _Ask:
    """Asks a frame for the colors of what a sweep explains in it, and how much of each moved.

    Limbs and their shadows may look like a disc too, but of no certain size; and they come from
    beyond the border: either what is seen `whole` is asked, or the others.
    """

    plate: LinearImage
    noise: Noise
    fit: Callable[..., Sweep]
    whole: bool

    def __call__(self, frame: LinearImage) -> list[tuple[ColorModel, float]]:
        image, told = with_its(self.noise, frame), []
        try:
            found = require_streaks(image, self.plate)
        except BlurmatteError:
            return []
        for streak in found[:_ASKED_STREAKS]:
            x0, y0, x1, y1 = streak.box
            if self.whole != (min(x0, y0, image.size[0] - x1, image.size[1] - y1) > 0):
                continue
            try:
                sweep = self.fit(image, self.plate, streak)
            except (ColorModelError, MotionError):
                continue
            if not sweep.rejection:
                unsure = sweep.radius_std / (_SURE_RADIUS * sweep.radius)
                moved = streak.evidence * (sweep.length / sweep.radius) ** 2
                told.append((sweep.model, moved / (1 + unsure**2)))
        return told

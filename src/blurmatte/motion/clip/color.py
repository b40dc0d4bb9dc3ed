"""clip_color: the color of the moving object in a clip, fused from some of its frames.

These frames are fitted again when the object is measured: the parts that have its color are not all
that changed, and the color of all frames is a prior of each fit.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from blurmatte.checks import Array
from blurmatte.color.model import ColorModel, fuse_colors
from blurmatte.color.streak import check_not_gray
from blurmatte.errors import BlurmatteError, ColorModelError, MotionError
from blurmatte.motion.clip.detections import NOTHING_MOVED, FrameMotion
from blurmatte.motion.clip.scene import Part, StaticScene, box_in_frame, survey
from blurmatte.motion.clip.workers import Workers, shared, spread_out, successes
from blurmatte.radiometry import LinearImage, light_of_hex
from blurmatte.radiometry.coded import coded_frames
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR, pooled_log_odds
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep.discs import DiscColors, fit_disc_colors
from blurmatte.sweep.fit_sweep import fit_sweep

Vote = tuple[DiscColors, float, int]  # colors, their weight, and the number of the frame


# Frames and streaks that vote for the color, and when the vote ends.
_FRAMES_PER_ROUND = 6
_ROUND_STARTS = (0.5, 0.0, 0.25, 0.75)  # of the distance between frames
_STREAKS_PER_FRAME = 3  # the strongest
_MIN_AGREEING_FRAMES = 4
_MIN_LEAD = 2.0  # times the weight of all other colors
_MAX_COLOR_ANGLE = 0.15  # radians, between shades of one paint in changing light
_RELATIVE_RADIUS_STD = 0.05  # at which the weight of a vote is halved


def _sweep_colors(image: LinearImage, plate: LinearImage, streak: Streak) -> DiscColors:
    """The colors of the likeliest sweep, whose rank is decisive in its frame."""
    sweep = fit_sweep(image, plate, streak)
    if sweep.model.rank == 3:
        raise ColorModelError("a sweep of any colors has no mean color")
    certain = 2 * DECISIVE_LOG_BAYES_FACTOR
    axes = np.linalg.svd(sweep.model.basis)[0]
    axes[:, : sweep.model.rank] = sweep.model.basis
    mean = replace(sweep.model, basis=axes[:, :1])
    return DiscColors(sweep, mean, axes, (certain if sweep.model.rank == 2 else -certain, 0.0))


# Fits in the order in which they are tried until a color is found, each with True for streaks that
# do not reach the border of the picture, and the number of rounds: arms enter from outside, and a hand
# is in many frames clearer than the ball.
_TRIALS = (
    (fit_disc_colors, True, 4),
    (fit_disc_colors, False, 1),
    (_sweep_colors, True, 1),
    (_sweep_colors, False, 1),
)


def clip_color(
    frames: Sequence[LinearImage], plate: LinearImage, workers: int | Workers = 1
) -> ColorModel:
    """The color of the moving object in a clip, from some of its frames together.

    Every streak that a shape on a path explains votes for its color, in 4 to 24 frames all over the
    clip, until enough frames agree. Each frame has one vote, so that none decides alone, however bright
    something is in it. Its streaks share the vote by their evidence times the square of their length in
    radii: a fist that holds a string may be as bright as the ball on it, but hardly moves; alone in a
    frame it has a small part of a vote. The largest sum of similar colors wins. Streaks at the border
    of the picture vote only if no other streak is explained. The log Bayes factors of these votes for
    more than one paint are added; any of them may mislead, as often as votes are for other colors.

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
        Of one paint, unless all votes together are decisive for two, or for any colors.

    Raises
    ------
    ColorModelError
        If no frame determines it, or the pictures are gray.

    Examples
    --------
    >>> print(bm.motion.clip_color(frames, plate))
    ColorModel(#ffc047, rank 1, ±0.029°)
    """
    if len(frames):
        check_not_gray(frames[0], plate)
    with shared(workers) as processes:
        scene = survey(frames, StaticScene.of(frames, plate), processes)
        return color_in_scene(frames, scene, processes)


def color_in_scene(
    frames: Sequence[LinearImage], scene: StaticScene, workers: Workers
) -> ColorModel:
    """As `clip_color`, in a scene whose frames were surveyed."""
    votes: list[Vote] = []
    busy = [k for k, boxes in scene.surveyed.items() if boxes]
    if not busy:
        raise MotionError(f"{NOTHING_MOVED}: all frames agree with the plate; choose other frames")
    for fit, inside, rounds in _TRIALS:
        voter = _Voter(scene, fit, inside)
        some = chain.from_iterable(spread_out(busy, _FRAMES_PER_ROUND, _ROUND_STARTS[:rounds]))
        parts = ((slice(k, k + 1), k) for k in some)
        found = successes(workers.over(frames, voter, parts, 1))
        for number, colors in enumerate(found):
            votes += [(one, weight, number) for one, weight in colors]
            if _decided(votes):
                break
        if votes:
            break
    if not votes:
        raise ColorModelError(
            f"no color was found in {_FRAMES_PER_ROUND} or more frames: no shape on a "
            "path explains their streaks; give the color (--color, model=)"
        )
    group = _largest_group(votes)
    two, more = _log_odds(votes, group) > DECISIVE_LOG_BAYES_FACTOR
    if two and more:
        return ColorModel.any()
    return fuse_colors([colors.plane if two else colors.mean for colors, _, _ in group])


def _largest_group(votes: Sequence[Vote]) -> list[Vote]:
    """The votes for similar colors with the largest sum of weights."""
    groups = [[b for b in votes if _angle(a[0], b[0]) < _MAX_COLOR_ANGLE] for a in votes]
    return max(groups, key=lambda group: sum(weight for _, weight, _ in group))


def _log_odds(votes: Sequence[Vote], group: Sequence[Vote]) -> Array:
    """(2,) sums of the log Bayes factors of a group, as `DiscColors` has them.

    Few frames do not say how often votes mislead; any of them may be decisive then.
    """
    mistakes = (len(votes) - len(group) + 1) / (len(votes) + 2)  # rule of succession
    if len(votes) < _MIN_AGREEING_FRAMES:
        mistakes = float(np.exp(-2 * DECISIVE_LOG_BAYES_FACTOR))
    return pooled_log_odds([colors.log_odds for colors, _, _ in group], mistakes)


def _decided(votes: Sequence[Vote]) -> bool:
    """True if more frames are unlikely to change the color.

    More frames are asked if any is decisive for two paints and their sum is not.
    """
    best = _largest_group(votes) if votes else []
    weight, total = (sum(weight for _, weight, _ in some) for some in (best, votes))
    enough = len({number for _, _, number in best}) >= _MIN_AGREEING_FRAMES
    if not enough or weight < _MIN_LEAD * (total - weight):
        return False
    most, decisive = max(colors.log_odds[0] for colors, _, _ in best), DECISIVE_LOG_BAYES_FACTOR
    return most <= decisive or bool(_log_odds(votes, best)[0] > decisive)


def _angle(a: DiscColors, b: DiscColors) -> float:
    """Largest angle of the mean color of one with the possible colors of the other, radians.

    Of several paints another one may be in front in each frame.
    """
    away = [float(np.linalg.norm(x.mean.pole @ y.normals)) for x, y in ((a, b), (b, a))]
    return float(np.arcsin(min(max(away), 1.0)))


def seen_color(model: ColorModel, rows: Sequence[FrameMotion]) -> ColorModel:
    """The color model of a clip, its mean light the median over the frames that show the object whole.

    Unchanged if no frame does, or if it has one paint.
    """
    if model.rank == 1:
        return model
    found = [row.sighting for row in rows if row.sighting is not None and row.sighting.color]
    colors = [one.color for one in found if one.is_sound] or [one.color for one in found]
    if not colors:
        return model
    mean = np.median(light_of_hex(*colors), axis=0)
    if model.to_srgb is not None:
        mean = np.linalg.solve(np.array(model.to_srgb), mean)
    return replace(model, mean=mean)


@dataclass(frozen=True, eq=False)
class _Voter:
    """Votes of a frame: the colors of the streaks that a sweep explains, with their weights.

    Limbs and their shadows may fit a disc too, but with an uncertain radius; and they reach the border:
    either only streaks `inside` the picture vote, or only the others.
    """

    scene: StaticScene
    fit: Callable[..., DiscColors]
    inside: bool

    def __call__(self, frames: Sequence[LinearImage], index: int) -> list[tuple[DiscColors, float]]:
        (frame,) = coded_frames(frames, slice(None))
        scene = self.scene.at(frames, frame, index)
        found = list[tuple[Part, Streak]]()
        for part in scene.parts(frame, index, scene.boxes(frames, frame, index)):
            with suppress(BlurmatteError):
                found += [(part, streak) for streak in find_streaks(*part)]
        found.sort(key=lambda one: -one[1].evidence)
        several = (self._vote(*one, frame.size) for one in found[:_STREAKS_PER_FRAME])
        votes = [vote for vote in several if vote is not None]
        total = sum(strength for _, strength, _ in votes) or 1.0
        return [(colors, trust * strength / total) for colors, strength, trust in votes]

    def _vote(
        self, part: Part, streak: Streak, size: tuple[int, int]
    ) -> tuple[DiscColors, float, float] | None:
        """Colors of a streak in a picture of a size; None if no sweep explains it.

        Also its strength among others in the frame, and from 0 to 1 how clearly it moved.
        """
        x, y = box_in_frame(part)[:2]
        x0, y0, x1, y1 = streak.box
        if self.inside != (min(x + x0, y + y0, size[0] - x - x1, size[1] - y - y1) > 0):
            return None
        try:
            colors = self.fit(*part, streak)
        except (ColorModelError, MotionError):
            return None
        sweep = colors.sweep
        if sweep.rejection:
            return None
        uncertainty = sweep.radius_std / (_RELATIVE_RADIUS_STD * sweep.radius)
        moved, sure = (sweep.length / sweep.radius) ** 2, 1 / (1 + uncertainty**2)
        return colors, sure * moved * streak.evidence, sure * moved / (1 + moved)

"""Cadence: frames of a clip that repeat the one before, and places where frames may be missing.

A clip that was converted to another rate, or whose recorder skipped captures, has a displacement of
zero between two frames, or a multiple of the usual one, while the motion before and after is steady.
In a frame that repeats another the object moves as long as usual while it is exposed; an object at rest
does not.

A conversion to a higher rate shows some captures in two frames or more. The time stamp of a frame is
then up to one interval later than the capture, while captures are equally spaced. A recorder that
stops for a moment stores one frame again in place of the next captures: the displacement after it is a
multiple of the usual one, and time stamps are right.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array
from blurmatte.errors import listed
from blurmatte.motion.clip.detections import FrameMotion, Sighting, grouped, in_intervals
from blurmatte.motion.clip.smoothing import MIN_STD_PX
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR

_REPEATS = "It repeats the frame before."
_NEIGHBORS = 4  # rows before and after a step, from which it is predicted
_MIN_STEP_STD = 0.25  # of the predicted step, relative: its speed changes
_MIN_STEPS = 3.0  # the predicted step over its error: less is no steady motion
_MIN_CAPTURES = 3  # that determine a line and show that it is one
_MAX_LISTED = 3  # frames in a sentence
# Of a step to its prediction: of larger ones the track is lost
_FACTORS = {2: "twice", 3: "three times", 4: "four times", 5: "five times", 6: "six times"}


@dataclass(frozen=True)
class Cadence:
    """Repeated and missing frames of a clip.

    Parameters
    ----------
    repeated : tuple of int
        Frames that repeat the one before.
    jumps : tuple of (int, int, int)
        Two frames in succession, and the ratio of the step between them to the predicted step.
    """

    repeated: tuple[int, ...]
    jumps: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, rows: Sequence[FrameMotion]) -> Cadence:
        """Of the rows of one object, in order."""
        times, repeated, jumps = in_intervals(rows), [], []
        for of in grouped(rows, lambda row: row.track):
            mine = [rows[k] for k in of]
            steps = _steps(mine, np.array([times[k] for k in of]))
            for (before, after), factor in zip(pairwise(mine), steps, strict=True):
                if factor == 0:
                    repeated.append(after.frame)
                elif factor > 1:
                    jumps.append((before.frame, after.frame, factor))
        return cls(tuple(sorted(repeated)), tuple(sorted(jumps)))

    @classmethod
    def stated(cls, rows: Iterable[FrameMotion]) -> Cadence:
        """As the rows from `link_sightings` or `link_objects` say: repeated frames have a doubt."""
        rows = list(rows)
        parts = [cls.of([rows[k] for k in of]) for of in grouped(rows, lambda row: row.object)]
        repeated = {row.frame for row in rows if row.sighting and is_repeat(row.sighting)}
        jumps = {jump for part in parts for jump in part.jumps}
        return cls(tuple(sorted(repeated)), tuple(sorted(jumps)))

    @property
    def is_converted(self) -> bool:
        """Whether frames repeat others without being in the place of missing ones."""
        return bool(set(self.repeated) - {before for before, _, _ in self.jumps})

    def captures(self, frames: npt.ArrayLike) -> Array:
        """Number of the capture that each frame shows, counted from any one."""
        numbers = np.asarray(frames, float)
        lost = [(after, n - 1) for before, after, n in self.jumps if before in self.repeated]
        added = [(frame, -1) for frame in self.repeated] + lost
        return np.asarray(numbers + sum(n * (numbers >= frame) for frame, n in added))

    @property
    def words(self) -> list[str]:
        """Sentences."""
        said = []
        if self.repeated:
            frames, verb = ("Frame", "repeats") if len(self.repeated) == 1 else ("Frames", "repeat")
            spaced = "; the others are taken as equally spaced in time" * self.is_converted
            said.append(
                f"{frames} {listed(self.repeated, _MAX_LISTED)} {verb} the one before "
                f"({len(self.repeated)} in all): not used for the motion{spaced}."
            )
        for before, after, factor in self.jumps[:_MAX_LISTED]:
            said.append(
                f"From {before} to {after} it moved {_FACTORS[factor]} as far: frames may be missing."
            )
        return said


def is_repeat(sighting: Sighting) -> bool:
    """Whether a detection is that of a frame that repeats the one before."""
    return _REPEATS in sighting.motion.doubts


def doubting_repeats(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows of one object, with a doubt for those that repeat the frame before."""
    repeated = set(Cadence.of(rows).repeated)
    return [
        row
        if row.frame not in repeated or row.sighting is None
        else replace(row, sighting=row.sighting.with_doubts(*row.sighting.motion.doubts, _REPEATS))
        for row in rows
    ]


def at_captures(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows with times of captures, if frames repeat others because the rate was converted.

    These are equally spaced: a line through the time stamps of the frames that are no repeats.
    """
    cadence = Cadence.stated(rows)
    seen = {row.frame: row.time for row in rows if row.sighting and row.time is not None}
    kept = {frame: time for frame, time in seen.items() if frame not in cadence.repeated}
    if not cadence.is_converted or len(kept) < _MIN_CAPTURES:
        return list(rows)
    interval, start = _line(cadence.captures(list(kept)), np.array(list(kept.values())))
    times = {frame: float(start + interval * cadence.captures(frame)) for frame in seen}
    return [replace(row, time=times.get(row.frame, row.time)) for row in rows]


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and intercept of the line with the least largest distance from points (n,).

    Time stamps are late by any part of an interval, in a pattern: the largest distance is bounded, and
    a mean would depend on where the pattern ends.
    """
    y0, scale = float(y[0]), float(np.ptp(y)) or 1.0
    one = np.ones(len(x))
    A = np.block([[np.stack([x, one, -one], 1)], [np.stack([-x, -one, -one], 1)]])
    b = np.concatenate([y - y0, y0 - y]) / scale
    found = scipy.optimize.linprog((0, 0, 1), A, b, bounds=((None, None), (None, None), (0, None)))
    slope, intercept, _ = found.x * scale
    return float(slope), float(intercept + y0)


def _steps(rows: Sequence[FrameMotion], times: Array) -> list[int]:
    """From each row to the next: how many times the predicted step it is; 1 if that is not decided."""
    seen = [row.stated for row in rows]
    places = np.array([one.motion.center for one in seen if one is not None]).reshape(-1, 2)
    errors = [one.motion.center_covariance for one in seen if one is not None]
    lengths = np.array([(one.motion.length, one.motion.length_std) for one in seen if one])
    found, least = [], MIN_STD_PX**2 * np.eye(2)
    for k in range(1, len(rows)):
        before, after = slice(max(k - _NEIGHBORS, 0), k), slice(k, k + _NEIGHBORS)
        predicted = _predicted(places, times, before, after)
        factor = 1
        if predicted is not None:
            step, std = predicted
            span = times[k] - times[k - 1]
            S = errors[k] + errors[k - 1] + least
            factor = _factor(places[k] - places[k - 1], S, span * step, span * std)
        found.append(1 if factor == 0 and _rests(lengths, k) else factor)
    return found


def _rests(lengths: Array, k: int) -> bool:
    """Whether an object is at rest at row k or before it: its path is not half as long as usual.

    lengths (n, 2): of the paths in all rows, and their errors.
    """
    first = max(k - _NEIGHBORS, 0)
    others = np.concatenate([lengths[first : k - 1, 0], lengths[k + 1 : k + _NEIGHBORS, 0]])
    if not len(others):
        return False
    usual, (length, std) = np.median(others), lengths[k - 1 : k + 1].T
    return bool(np.any((length < usual / 2) & (usual - length > _MIN_STEPS * std)))


def _predicted(
    places: Array, times: Array, before: slice, after: slice
) -> tuple[Array, float] | None:
    """Velocity at a step from the rows on both sides, per interval, and its error in each axis."""
    sides = []
    for side in (before, after):
        steps, spans = np.diff(places[side], axis=0), np.diff(times[side])
        if np.any(spans > 0):
            # The median of the steps: one of them may be a repeat or a jump.
            sides.append(np.median(steps[spans > 0] / spans[spans > 0, None], axis=0))
    if not sides:
        return None
    velocity = (sides[0] + sides[-1]) / 2
    half = float(np.linalg.norm(sides[-1] - sides[0])) / 2
    return velocity, float(np.hypot(half, _MIN_STEP_STD * np.linalg.norm(velocity)))


def _factor(moved: Array, S: Array, step: Array, std: float) -> int:
    """The number of steps that is decisively likelier than one, else 1; S is the error of `moved`."""
    size = float(np.linalg.norm(step))
    if not size > _MIN_STEPS * std:
        return 1
    factor = round(float(moved @ step) / size**2)
    if factor not in (0, *_FACTORS):
        return 1
    one = _log_density(moved - step, S + std**2 * np.eye(2))
    several = _log_density(moved - factor * step, S + factor**2 * std**2 * np.eye(2))
    return factor if several - one > DECISIVE_LOG_BAYES_FACTOR else 1


def _log_density(x: Array, V: Array) -> float:
    """Of a normal distribution in the plane."""
    return -float(x @ np.linalg.solve(V, x)) / 2 - float(
        np.log(2 * np.pi * np.linalg.det(V) ** 0.5)
    )

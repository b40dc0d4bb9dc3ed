"""Shots of a clip: where it is cut, where the camera moves, and where the light changes.

Frames are compared as thumbnails, means of code values over squares. Between two frames of one shot
only the thumbnails' noise and what moves differ; a cut changes most of the picture at once, a pan goes
on doing so.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Floats32
from blurmatte.radiometry.coded import CodedFrame

Thumbnail = Floats32


# When frames belong to one shot.
_SIDE = 16  # pixels of a square
_MIN_CHANGE_CODES = 6.0  # of a square's mean: more than noise and coding
_CUT_FRACTION = 0.4  # of the squares, changed at once
_PAN_FRACTION = 0.2  # of the squares, changed in each of several frames
_MIN_PAN_FRAMES = 3
_MIN_SHOT_FRAMES = 3  # of which a plate can be made
MIN_STILL_FRAMES = 25  # of a camera at rest, of which a plate alone is better than with a pan
_MAX_GAIN = 1.5  # of the light within a shot, one way or the other


@dataclass(frozen=True)
class ClipShot:
    """Frames of one scene from one place.

    Parameters
    ----------
    start, stop : int
        Indices of its first frame, and of the first one after it.
    begins_with : str
        "cut", "light" (a lasting change), or "start" of the clip.
    moving : bool
        The camera moves: frames have to be registered.
    """

    start: int
    stop: int
    begins_with: str = "start"
    moving: bool = False

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def is_still(self) -> bool:
        """Whether the camera is at rest for long enough for a plate of its own."""
        return not self.moving and len(self) >= MIN_STILL_FRAMES

    def numbered(self, numbers: Sequence[int]) -> "ClipShot":
        """The same in the numbers of the frames instead of their indices."""
        return replace(self, start=numbers[self.start], stop=numbers[self.stop - 1] + 1)

    def __str__(self) -> str:
        reason = {"start": "", "cut": ", after a cut", "light": ", after a change of light"}
        camera = ": the camera moves" if self.moving else ""
        return f"frames {self.start} to {self.stop - 1}{reason[self.begins_with]}{camera}"


def thumbnail(frame: CodedFrame) -> Thumbnail:
    """(h, w) means of the first plane over squares, minus its zero; incomplete squares are dropped."""
    side = min(_SIDE, *frame.planes[0].shape)
    h, w = (n // side for n in frame.planes[0].shape)
    luma = frame.planes[0][: h * side, : w * side]
    rows = luma.reshape(h, side, -1).sum(axis=1, dtype=np.float32)  # fast, for rows are contiguous
    means = rows.reshape(h, w, side).sum(axis=2) / np.float32(side**2)
    return np.asarray(means - np.float32(frame.zero[0]))


def find_shots(thumbnails: Iterable[Thumbnail | None], step: float) -> list[ClipShot]:
    """The shots of a clip, in order; together they are all frames.

    Parameters
    ----------
    thumbnails : iterable of (h, w) float
        Of each frame, from `thumbnail`; None for one that cannot be decoded.
    step : float
        Difference of two code values; 0 for light, in which white is 1.
    """
    least = _MIN_CHANGE_CODES * (step if step > 0 else 1 / 255)
    shots: list[ClipShot] = []
    begun, changes = 0, list[float]()
    reason, first, before = "start", None, None
    index = -1
    for index, now in enumerate(thumbnails):
        if now is None or first is None or before is None:
            first = before = now if before is None else before
            changes.append(0.0)
            continue
        changed = _changed(before, now, least)
        gain = _gain(first, now)
        if changed > _CUT_FRACTION or abs(np.log(gain)) > np.log(_MAX_GAIN):
            new = "cut" if changed > _CUT_FRACTION else "light"
            shots += _with_pans(ClipShot(begun, index, reason), changes)
            begun, reason, first, changes = index, new, now, []
            changed = 0.0
        changes.append(changed)
        before = now
    if index >= 0:
        shots += _with_pans(ClipShot(begun, index + 1, reason), changes)
    return _without_flashes(shots)


def joined_shots(
    shots: Iterable[ClipShot], same_scene: Callable[[int, int], bool]
) -> list[ClipShot]:
    """The shots without cuts that were motions of the camera.

    same_scene: whether two frames, by their indices, can be registered to one another. The last frames
    of a shot may be flashes, or dropped.
    """
    joined: list[ClipShot] = []
    for shot in shots:
        begun = joined[-1].start if joined else shot.start
        still = joined and (joined[-1].is_still or shot.is_still)
        first = shot.start
        before = range(first - 1, max(first - 1 - _MIN_SHOT_FRAMES, begun - 1), -1)
        cut = shot.begins_with == "cut" and not still
        if cut and any(same_scene(k, first) for k in before):
            joined[-1] = replace(joined[-1], stop=shot.stop, moving=True)
        else:
            joined.append(shot)
    return joined


def _changed(a: Thumbnail, b: Thumbnail, least: float) -> float:
    """Fraction of the squares that differ by more than noise, after the change of the whole light."""
    return float(np.mean(np.abs(b - _gain(a, b) * a) > least))


def _gain(a: Thumbnail, b: Thumbnail) -> float:
    """Median ratio of two thumbnails, where both are bright enough; 1 if nowhere."""
    bright = np.minimum(a, b) > 0.1 * max(float(a.max()), 1e-6)
    return float(np.median(b[bright] / a[bright])) if bright.any() else 1.0


def _with_pans(shot: ClipShot, changes: list[float]) -> Iterator[ClipShot]:
    """A shot without cuts, divided where the camera begins to move, and where it stops."""
    moving = np.array(changes) > _PAN_FRACTION
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    pans = [
        (int(a), int(b))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if b - a >= _MIN_PAN_FRAMES
    ]
    at, reason = 0, shot.begins_with
    for a, b in pans:
        if a > at:
            yield ClipShot(shot.start + at, shot.start + a, reason)
            reason = "cut"
        yield ClipShot(shot.start + a, shot.start + b, reason, moving=True)
        at, reason = b, "cut"
    if at < len(changes):
        yield ClipShot(shot.start + at, shot.stop, reason)


def _without_flashes(shots: list[ClipShot]) -> list[ClipShot]:
    """Shots too short for a plate belong to the one before: a flash, or a dropped frame."""
    kept: list[ClipShot] = []
    for shot in shots:
        if kept and len(shot) < _MIN_SHOT_FRAMES:
            kept[-1] = replace(kept[-1], stop=shot.stop)
        else:
            kept.append(shot)
    return kept

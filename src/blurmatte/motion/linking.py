"""link_sightings, link_objects: streaks of single frames → the way of one object or several."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blurmatte.checks import check_kind
from blurmatte.motion.agreement import Scatter, doubted, scatter_of, with_scatter
from blurmatte.motion.sightings import FrameSightings, Sighting
from blurmatte.motion.tracks import Track, in_time, tracks_of

_FAINT = 0.1  # of the strongest track's evidence in a frame: another thing of like color
_SPECK = 0.003  # of the clearest streak's evidence: an eighteenth of its width, or as much fainter
_SIZES = 2.0  # times as large or as small as usual: not all of it was seen, or not it alone
_ODD_SIZE = (
    "Its radius is {:.2g} times that of most frames: it is hidden in part, at the border, or with "
    "something else."
)
_LEAST = 3  # frames of an object: two streaks of anything lie on some track
_ASIDE = "the object's track does not go there; {} streak{} of its color ignored"
_TOGETHER = "{} streak{} of the color ignored: of several objects at once, or seen too seldom"


@dataclass(frozen=True)
class FrameMotion:
    """A row of the table of a clip: an object in one frame, or why none is there.

    Parameters
    ----------
    frame : int
        Its number.
    time : float or None
        Seconds.
    sighting : Sighting or None
        What was measured, in the direction of time if that is known.
    track : int or None
        Which track it belongs to, from 1; a new one begins where the object was lost for long, or
        appeared where nothing predicted it.
    directed : bool
        Whether the neighbors tell which way it went; else it is given as going to the right.
    others : int
        How many more streaks of its color were ignored.
    reason : str
        Why there is no sighting, in words; "" if there is one.
    object : int or None
        Which object it is, from 1.
    place_scatter, radius_scatter : float
        How many times larger than the frame by itself tells the errors of place and way, and of the
        radius, are here, for so much the object's frames scatter (`frame_scatter`).
    """

    frame: int
    time: float | None
    sighting: Sighting | None
    track: int | None = None
    directed: bool = False
    others: int = 0
    reason: str = ""
    object: int | None = None
    place_scatter: float = 1.0
    radius_scatter: float = 1.0

    def numbers(self) -> dict[str, Any]:
        """All by name, flat, for a row of a table; pixels, radians, exposures, seconds."""
        told: dict[str, Any] = {"frame": self.frame, "time": self.time}
        told |= {"object": self.object, "track": self.track}
        for name in Sighting.__dataclass_fields__:
            told[name] = None if self.sighting is None else getattr(self.sighting, name)
        for name in ("directed", "place_scatter", "radius_scatter"):
            told[name] = None if self.sighting is None else getattr(self, name)
        return told | {"others": self.others, "reason": self.reason}


def link_sightings(frames: Iterable[FrameSightings]) -> list[FrameMotion]:
    """Join what single frames show to the way of one object, and tell which way it went.

    Nearby streaks of frames that follow each other are joined to tracks; the one that shows the most
    of the object is it, with those in frames where it is not. Its neighbors tell the
    direction of each motion.

    Parameters
    ----------
    frames : iterable of FrameSightings
        Of `sightings`, in order.

    Returns
    -------
    list of FrameMotion
        One for each frame, those without the object too. Where place or radius contradicts the frames
        around, the doubts of the sighting say so; where all scatter by more than their errors, these
        are made as much larger.
    """
    all_frames = _without_specks(frames)
    chosen = _chosen(tracks_of(all_frames))
    usual = _usual_radius(chosen)
    rows = []
    for index, frame in enumerate(all_frames):
        mine = [(n, t) for n, t in enumerate(chosen, start=1) if index in t.seen]
        others = len(frame.found) - 1 + frame.unmeasured
        rows += [_row(frame, index, t, n, usual, others) for n, t in mine] or [
            _nothing(frame, _ASIDE)
        ]
    return _compared(rows)


def link_objects(frames: Iterable[FrameSightings], least: int = _LEAST) -> list[FrameMotion]:
    """Join what single frames show to the ways of several objects, and tell which way they went.

    Each track is an object; one that was lost for more than five frames is another one when it comes
    again. Which of several that are alike is which, their velocities tell, and where a streak goes
    in its own exposure.

    Parameters
    ----------
    frames : iterable of FrameSightings
        Of `sightings(…, several=True)`, in order.
    least : int
        In how many frames an object is seen at least; what is seen in fewer is dropped.

    Returns
    -------
    list of FrameMotion
        For each frame one for each object in it, by their numbers; one without a sighting for
        frames without any. `object` counts them in the order in which they appear.

    Raises
    ------
    ValueError
        If least is not at least 1.
    """
    if least < 1:
        raise ValueError(f"least must be at least 1, got {least}")
    all_frames = _without_specks(frames)
    found = [track for track in tracks_of(all_frames, alike=True) if len(track.seen) >= least]
    usual = [_usual_radius([track]) for track in found]
    rows = []
    for index, frame in enumerate(all_frames):
        seen = [n for n, track in enumerate(found) if index in track.seen]
        others = len(frame.found) - len(seen)
        rows += [
            replace(_row(frame, index, found[n], n + 1, usual[n], others), object=n + 1)
            for n in seen
        ] or [_nothing(frame, _TOGETHER)]
    return _compared(rows)


def frame_scatter(rows: Sequence[FrameMotion]) -> Scatter | None:
    """By how much places and radii of one object scatter about smooth motion.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of `measure_clip` or `link_sightings`; of several objects those of one.

    Returns
    -------
    Scatter or None
        None if too few frames tell: fewer than 14 in a row, or it turns too fast: about a sixth of a
        circle from frame to frame.
    """
    check_rows(rows)
    seen = [(row, row.sighting) for row in rows if row.sighting is not None]
    own = [with_scatter(s, 1 / row.place_scatter, 1 / row.radius_scatter) for row, s in seen]
    return scatter_of([row.frame for row, _ in seen], own)


def _without_specks(frames: Iterable[FrameSightings]) -> list[FrameSightings]:
    """The frames, without what codecs leave behind where nothing moves."""
    all_frames = list(frames)
    for frame in all_frames:
        check_kind("each of frames", frame, FrameSightings, "use blurmatte.sightings(frames)")
    least = _SPECK * max((s.evidence for frame in all_frames for s in frame.found), default=0.0)
    told = []
    for frame in all_frames:
        found = tuple(s for s in frame.found if not s.evidence < least)
        ignored = frame.unmeasured + len(frame.found) - len(found)
        told.append(replace(frame, found=found, unmeasured=ignored))
    return told


def _compared(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows, with what each object's frames say of each other: doubts, and how large errors are."""
    told = list(rows)
    for number in {row.object for row in rows}:
        of = [k for k, row in enumerate(rows) if row.object == number and row.sighting]
        frames = [rows[k].frame for k in of]
        seen = doubted(frames, [one for k in of if (one := rows[k].sighting) is not None])
        place, radius = _larger(scatter_of(frames, seen))
        for k, sighting in zip(of, seen, strict=True):
            told[k] = replace(
                rows[k],
                sighting=with_scatter(sighting, place, radius),
                place_scatter=place,
                radius_scatter=radius,
            )
    return told


def _larger(scatter: Scatter | None) -> tuple[float, float]:
    """How many times larger errors of places and of radii are than stated, 1 if not clearly so."""
    if scatter is None or not scatter.too_large:
        return 1.0, 1.0
    return max(scatter.place, 1.0), max(scatter.radius, 1.0)


def _row(
    frame: FrameSightings, index: int, track: Track, number: int, usual: float, others: int
) -> FrameMotion:
    """Of the object's track in a frame."""
    sighting, directed = in_time(index, track)
    sighting = _of_usual_size(sighting, usual)
    return FrameMotion(frame.frame, frame.time, sighting, number, directed, others, object=1)


def _nothing(frame: FrameSightings, why: str) -> FrameMotion:
    """Of a frame to which no object's track goes."""
    reason, count = frame.reason, len(frame.found) + frame.unmeasured
    if count:
        aside = why.format(count, "" if count == 1 else "s")
        reason = f"{aside}; {reason}" if reason else aside
    return FrameMotion(frame.frame, frame.time, None, others=count, reason=reason)


def _usual_radius(tracks: Sequence[Track]) -> float:
    radii = [s.radius for track in tracks for s in track.seen.values()]
    return float(np.median(radii)) if radii else 0.0


def _of_usual_size(sighting: Sighting, usual: float) -> Sighting:
    """The sighting, with a doubt if its size is none."""
    if 1 / _SIZES < sighting.radius / max(usual, 1e-12) < _SIZES:
        return sighting
    doubt = _ODD_SIZE.format(sighting.radius / max(usual, 1e-12))
    return replace(sighting, doubts=f"{sighting.doubts} {doubt}".strip())


def _chosen(tracks: Sequence[Track]) -> list[Track]:
    """The clearest, and of others the part in frames where clearer ones are not; in order of time."""
    chosen: list[Track] = []
    for track in sorted(tracks, key=lambda track: -track.evidence):
        if chosen and _each(track) < _FAINT * _each(chosen[0]):
            continue
        taken = set().union(*(other.seen for other in chosen))
        free = {index: s for index, s in track.seen.items() if index not in taken}
        if free:
            chosen.append(replace(track, seen=free))
    return sorted(chosen, key=lambda track: min(track.seen))


def _each(track: Track) -> float:
    return track.evidence / len(track.seen)


def main_track(rows: Sequence[FrameMotion]) -> list[FrameMotion]:
    """The rows of the track with the most frames."""
    numbers = [row.track for row in rows if row.track is not None]
    longest = max(sorted(set(numbers)), key=numbers.count, default=None)
    return [replace(row) for row in rows if row.track is not None and row.track == longest]


def check_rows(rows: Iterable[object]) -> None:
    """Raise TypeError unless each is a FrameMotion."""
    for row in rows:
        check_kind("each of rows", row, FrameMotion, "use blurmatte.measure_clip(frames)")

"""What the frames of a clip say together: the rows of its table, words, a fall, meters."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import blurmatte as bm
from blurmatte.cli.flights import KnownBall, Places, in_space_words
from blurmatte.cli.printing import in_degrees
from blurmatte.cli.quantities import acceleration

Rows = Sequence[bm.FrameMotion]
Scaling = Callable[[Rows], bm.Scale]
Gravity = tuple[float | list[float], float]


def gravity_of(text: str | None, in_space: bool) -> Gravity | None:
    """Of one number, straight down or in space wherever it points, of more a vector; and its error."""
    if text is None:
        return None
    vector, std = acceleration("--gravity", text)
    if in_space and len(vector) == 2:
        raise ValueError(
            "--gravity with --camera must be its size, 9.81, or x,y,z as the camera sees it (right, "
            f"down, away from it), like 0,9.81,0; got two numbers, {text!r}"
        )
    if not any(vector) or (len(vector) == 1 and vector[0] < 0):
        raise ValueError(
            "--gravity must be above 0, or a vector like 0,9.81,0 (right, down, away from the camera), "
            f"got {text!r}"
        )
    return (vector if len(vector) > 1 else vector[0]), std


@dataclass(frozen=True)
class Given:
    """What is known beside the pictures.

    Parameters
    ----------
    scaled : callable or None
        How meters per pixel follow from the frames of an object.
    ball : KnownBall or None
        Then they follow from how far away it was, in each frame by itself.
    gravity : tuple or None
        A number or a vector, m/s², and the error of its size.
    time : (float, float) or None
        Exposure time and its error, seconds.
    line_time : float
        Of a rolling shutter, seconds.
    """

    scaled: Scaling | None
    ball: KnownBall | None
    gravity: Gravity | None
    time: tuple[float, float] | None
    line_time: float


@dataclass(frozen=True, eq=False)
class Told:
    """What the frames of one object say of it, together.

    Parameters
    ----------
    number : int
        Of the object.
    words : list of str
    fall : FreeFall or None
    scale : Scale or None
        Of all its frames, if there is one.
    """

    number: int
    words: list[str]
    fall: bm.FreeFall | None
    scale: bm.Scale | None


def told_of(rows: Rows, places: Places | None, several: bool, given: Given) -> list[Told]:
    """Of the one object of a clip, or of each that was found; the scale is that of its own place.

    Raises
    ------
    MotionError
        If there is one object alone, and its size, that is to give the scale, does not.
    """
    if not several:
        return [_told(1, rows, places, given)]
    told = []
    for number in sorted({row.object for row in rows if row.object is not None}):
        of = [k for k, row in enumerate(rows) if row.object == number]
        mine, there = [rows[k] for k in of], None if places is None else [places[k] for k in of]
        try:
            one = _told(number, mine, there, given)
        except bm.MotionError as error:
            unscaled = replace(given, scaled=None, gravity=None)
            one = replace(_told(number, mine, there, unscaled), words=[f"No scale: {error}."])
        frames = f"Object {number}: in {len(mine)} frames, {mine[0].frame} to {mine[-1].frame}."
        told.append(replace(one, words=[frames, *one.words]))
    return told


def _told(number: int, rows: Rows, places: Places | None, given: Given) -> Told:
    scale = None if given.scaled is None else given.scaled(rows)
    found = _sound(rows)
    words = [_radius(found)] if found and places is None else []
    scatter = bm.frame_scatter(rows)
    words += [] if scatter is None else bm.explain(scatter)
    words += [] if places is None else in_space_words(rows, places)
    try:
        fall = _fall(rows, places, scale, given)
    except bm.MotionError as error:
        if given.gravity is None:
            return Told(number, [*words, f"No fall to check: {error}."], None, scale)
        without = _told(number, rows, places, replace(given, gravity=None))
        return replace(without, words=[*without.words, f"Gravity was not used: {error}."])
    words += bm.explain(fall)
    return Told(number, words, fall, fall.scale if places is None else None)


def _fall(rows: Rows, places: Places | None, scale: bm.Scale | None, given: Given) -> bm.FreeFall:
    """In space if places there are known, else in the picture."""
    gravity, std = given.gravity or (None, 0.0)
    if places is None:
        return bm.fit_fall(rows, scale, gravity, std, given.line_time)
    return bm.fit_fall_in_space(places, None, gravity, std)


def table(
    rows: Rows, places: Places | None, told: Sequence[Told], given: Given
) -> list[dict[str, Any]]:
    """All numbers of each frame, with the speed as well as it is known."""
    scales = {one.number: one.scale for one in told}
    if given.ball is None or places is None:
        lines = []
        for row in rows:
            scale = scales.get(row.object or 1)
            unit = "px" if scale is None else "m"
            lines.append(row.numbers() | _speed(_moved(row.sighting, scale), unit, given, row))
        return lines
    lines = []
    for row, ball in zip(rows, places, strict=True):
        there = dict.fromkeys(bm.BallPlace.names) if ball is None else ball.numbers()
        moved = given.ball.moved(ball, row.sighting)
        lines.append(row.numbers() | there | _speed(moved, "m", given, row))
    return lines


def words(rows: Rows, model: bm.ColorModel, several: bool) -> list[str]:
    """What was found, in sentences."""
    found = [row.sighting for row in rows if row.sighting is not None]
    frames, of = len({row.frame for row in rows if row.sighting}), len({row.frame for row in rows})
    told = [f"Color: {in_degrees(model)}.", f"Found in {frames} of {of} frames"]
    if not found:
        return [told[0], f"{told[1]}."]
    swept = sum(one.source == "sweep" for one in found)
    directed = sum(row.directed for row in rows)
    count = len({row.track for row in rows if row.track is not None})
    tracks = f"{count} {'object' if several else 'track'}{'' if count == 1 else 's'}"
    doubted = sum(bool(one.doubts) for one in found)
    how = (
        f"{swept} measured from a shape on a path, {len(found) - swept} from the moments of alpha; of "
        f"{directed} the direction of time is known, and {doubted} "
        f"{'is' if doubted == 1 else 'are'} doubtful."
    )
    return [told[0], f"{told[1]}, {tracks if several else f'in {tracks}'}: {how}"]


def usual_radius(rows: Rows) -> tuple[float, float]:
    """Median of the radii, pixels, and its error, from how they scatter."""
    found = _sound(rows)
    if not found:
        raise bm.MotionError("the object was found in no frame, so that its size gives no scale")
    middle, scatter = _middle(found)
    # Of normal numbers a median scatters by √(π/2) times as much as a mean.
    return middle, max(1.2533 * scatter / len(found) ** 0.5, min(one.radius_std for one in found))


def _sound(rows: Rows) -> list[bm.Sighting]:
    """What was found without doubts, or all if there is nothing else."""
    found = [row.sighting for row in rows if row.sighting is not None]
    return [one for one in found if not one.doubts] or found


def _radius(found: Sequence[bm.Sighting]) -> str:
    middle, scatter = _middle(found)
    return (
        f"Radius {middle:.2f} px in the middle of all; they vary by {scatter / middle:.1%} "
        "(1.48 times the median of the differences)."
    )


def _middle(found: Sequence[bm.Sighting]) -> tuple[float, float]:
    """Median of the radii, and how they scatter about it: the standard deviation of normal numbers."""
    radii = sorted(one.radius for one in found)
    middle = radii[len(radii) // 2]
    return middle, 1.4826 * sorted(abs(radius - middle) for radius in radii)[len(radii) // 2]


def _speed(
    moved: tuple[float, float] | None, unit: str, given: Given, row: bm.FrameMotion
) -> dict[str, Any]:
    """Mean speed within the exposure, and its error, of how far it moved.

    A rolling shutter shows what moves down for longer than the exposure, what moves up for less; where
    it is not known which way it went, half of the difference is an error.
    """
    unit += "/exposure" if given.time is None else "/s"
    T, T_std = given.time or (1.0, 0.0)
    shares = [T / D for D in _durations(row, given) if D > 0]
    if moved is None or not shares:
        return {"speed": None, "speed_std": None, "speed_unit": unit}
    length, std = moved
    share, apart = (max(shares) + min(shares)) / 2, (max(shares) - min(shares)) / 2
    error = math.hypot(std * share, length * share * T_std / T, length * apart)
    return {"speed": length * share / T, "speed_std": error / T, "speed_unit": unit}


def _durations(row: bm.FrameMotion, given: Given) -> list[float]:
    """How long it may have been seen for, in seconds, or exposures if their time is not known."""
    if given.time is None or row.sighting is None:
        return [1.0]
    later = given.line_time * (row.sighting.last_y - row.sighting.first_y)
    return [given.time[0] + way * later for way in ((1,) if row.directed else (1, -1))]


def _moved(one: bm.Sighting | None, scale: bm.Scale | None) -> tuple[float, float] | None:
    """How far within the exposure, pixels or meters, and its error."""
    if one is None:
        return None
    if scale is None:
        return one.length, one.length_std
    by = scale.meters_per_pixel
    return by * one.length, math.hypot(by * one.length_std, scale.std * one.length)

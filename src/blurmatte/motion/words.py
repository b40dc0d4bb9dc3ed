"""A Motion and a Speed in plain words."""

from collections.abc import Iterator

import numpy as np

from blurmatte.motion.figures import with_error as _with
from blurmatte.motion.motion import Motion
from blurmatte.motion.units import READOUT, Speed

_PATHS = {
    "line": "a straight line at constant speed",
    "arc": "an arc at constant speed",
    "bounce": "two straight pieces",
    "from rest": "a straight line, at rest for a while",
    "parabola": "a curve of constant acceleration",
    "cubic": "a curve of changing acceleration",
}
_SIGMAS = 3.0  # by which something is there
_NOTABLE = 0.002  # of a speed: less from a rolling shutter is not worth a word
_SHUTTER = 0.5  # of a speed: with more nobody knows


def motion_in_words(motion: Motion) -> list[str]:
    """Sentences about where something was, how far it went, how large it is, and what is not known."""
    return [*motion.doubts, *_place(motion), *_way(motion), *_changes(motion), *_unknown(motion)]


def speed_in_words(speed: Speed) -> list[str]:
    """Sentences about a speed, its error, what most of that comes from, and what is missing."""
    return [*_speed(speed), *_shutter(speed)]


def _place(motion: Motion) -> Iterator[str]:
    (x, y), (dx, dy) = motion.center, motion.center_std
    what = {"sweep": f"a {motion.silhouette}", "moments": "something of any shape"}[motion.source]
    if motion.silhouette.startswith(("ellipse", "outline")):
        what = f"an {motion.silhouette}"
    basis = {
        "sweep": "the shape on a path that explains the streak",
        "moments": "the sum, mean and spread of alpha, as if it had gone straight and evenly",
    }[motion.source]
    yield f"Measured from {basis}: {what} on {_PATHS[motion.path]}."
    yield f"Mean place of its center: x {_with(x, dx)}, y {_with(y, dy)} px."
    yield (
        f"Size: radius {_with(motion.radius, motion.radius_std)} px (of a disc of its area, "
        f"{_with(motion.area, motion.area_std)} px), {_with(motion.width, motion.width_std)} px wide "
        "across its way."
    )


def _way(motion: Motion) -> Iterator[str]:
    length = f"{_with(motion.length, motion.length_std)} px"
    if not motion.moved:
        yield (
            f"It moved {length}: no more than the error, it may have been at rest; nothing is known of "
            "its direction."
        )
        return
    least = "at least " if motion.at_border else ""
    degrees, std = np.degrees([motion.angle, motion.angle_std])
    yield (
        f"It went {least}{length} in the direction {_with(degrees, std)}° (from right towards down), "
        "or the opposite one: a single picture cannot tell which."
    )
    if motion.at_border:
        yield (
            "It reaches the border of the picture: what lies beyond is not known, and the length is a "
            "lower bound."
        )


def _changes(motion: Motion) -> Iterator[str]:
    if motion.resting > max(_SIGMAS * motion.resting_std, 0):
        yield (
            f"It was at rest for {motion.resting:.0%} ± {motion.resting_std:.1%} of the exposure, at "
            "one end of its way."
        )
    if motion.path in ("line", "arc") or not motion.moved:
        return
    slowest = int(np.argmin(motion.speeds))
    low = _with(float(motion.speeds[slowest]), float(motion.speeds_std[slowest]))
    top = _with(motion.top_speed, motion.top_speed_std)
    yield f"Its speed was between {low} and {top} px per exposure."
    if motion.acceleration is not None and motion.acceleration_covariance is not None:
        std = np.sqrt(np.diag(motion.acceleration_covariance))
        x, y = (_with(a, s) for a, s in zip(motion.acceleration, std, strict=True))
        yield f"Its velocity changed by x {x}, y {y} px per exposure from the first moment to the last."


def _unknown(motion: Motion) -> Iterator[str]:
    if motion.source == "moments":
        yield (
            "Speed over time and outline are not known without a shape; if it was longer than wide, "
            "the length is too large by that."
        )


def _speed(speed: Speed) -> Iterator[str]:
    if speed.unit == "m/s":
        kmh, mph = speed.in_unit("km/h"), speed.in_unit("mph")
        yield (
            f"Mean speed {_with(speed.mean, speed.mean_std)} m/s, "
            f"{_with(kmh.mean, kmh.mean_std)} km/h, "
            f"{_with(mph.mean, mph.mean_std)} mph; at most {_with(speed.top, speed.top_std)} m/s."
        )
    else:
        missing = [what for what, lacking in (("the scale", "px"), ("the exposure time", "exposure"))
                   if lacking in speed.unit]  # fmt: skip
        yield (
            f"Mean speed {_with(speed.mean, speed.mean_std)} {speed.unit}; "
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing for meters per "
            "second."
        )
    parts = sorted(speed.parts.items(), key=lambda part: -part[1])
    told = ", ".join(f"{name} {100 * share:.2g} %" for name, share in parts if share > 0)
    yield f"What its error comes from, most first: {told}."


def _shutter(speed: Speed) -> Iterator[str]:
    if speed.unknown is None or speed.unknown < _NOTABLE:
        return
    if speed.unknown > _SHUTTER:
        yield (
            "If the camera has a rolling shutter, the speed may be quite another; give the time from "
            "line to line."
        )
        return
    yield (
        f"If the camera has a rolling shutter that takes {1000 * READOUT:.0f} ms from the first row to "
        f"the last, the speed is off by up to {speed.unknown:.1%}: too large of what moved down, too "
        "small of what moved up. Give the time from line to line to correct it."
    )

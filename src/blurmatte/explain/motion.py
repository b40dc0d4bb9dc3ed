"""A Motion, a Speed and a Scatter in sentences."""

from collections.abc import Iterator

import numpy as np

from blurmatte.checks import Direction
from blurmatte.explain.numbers import direction, with_error
from blurmatte.motion.clip.scatter import Scatter
from blurmatte.motion.picture.motion import USUAL_READOUT_S, Motion, Speed

# The direction of readout, and the opposite one
_TOWARDS: dict[Direction, tuple[str, str]] = {
    "down": ("down", "up"),
    "up": ("up", "down"),
    "left": ("to the left", "to the right"),
    "right": ("to the right", "to the left"),
}
_PATHS = {
    "line": "a straight line at constant speed",
    "arc": "an arc at constant speed",
    "bounce": "two straight pieces",
    "from rest": "a straight line, at rest for a while",
    "parabola": "a curve of constant acceleration",
    "cubic": "a curve of changing acceleration",
}


def motion_in_words(motion: Motion) -> Iterator[str]:
    """Sentences about position, path length and size, their errors, and what is unknown."""
    yield from motion.doubts
    yield from _position(motion)
    yield from _path(motion)
    yield from _changes(motion)
    if motion.source == "moments":
        yield (
            "Speed over time and outline are not known without a shape; if the object is longer than "
            "wide, the length is too large by the difference."
        )


def scatter_in_words(scatter: Scatter) -> list[str]:
    """A sentence about the scatter of frames, in units of their errors."""
    verdict = "as they should"
    if scatter.too_large:
        verdict = "the given errors were increased accordingly"
    elif scatter.excess_std > 1:
        verdict = "of so few frames that may be chance, but the given errors were increased by it"
    return [
        f"From frame to frame positions scatter about a smooth motion {scatter.place:.1f} times as "
        f"much as the errors of each frame, radii {scatter.radius:.1f} times, by "
        f"{scatter.unsteady:.1%} ({scatter.count} frames were compared): {verdict}."
    ]


def _position(motion: Motion) -> Iterator[str]:
    (x, y), (dx, dy) = motion.center, motion.center_std
    what = {"sweep": f"a {motion.silhouette}", "moments": "an object of any shape"}[motion.source]
    if motion.silhouette.startswith(("ellipse", "outline")):
        what = f"an {motion.silhouette}"
    basis = {
        "sweep": "the shape on a path that explains the streak",
        "moments": "sum, mean and covariance of alpha, assuming a straight path and constant speed",
    }[motion.source]
    yield f"Measured from {basis}: {what} on {_PATHS[motion.path]}."
    yield f"Mean position of its center: x {with_error(x, dx)}, y {with_error(y, dy)} px."
    yield (
        f"Size: radius {with_error(motion.radius, motion.radius_std)} px (of a disc of its area, "
        f"{with_error(motion.area, motion.area_std)} px), "
        f"{with_error(motion.width, motion.width_std)} px wide across its path."
    )


def _path(motion: Motion) -> Iterator[str]:
    length = f"{with_error(motion.length, motion.length_std)} px"
    if not motion.moved and motion.doubts:
        yield (
            f"Its path of {length} is not significant; for the reason above this does not mean that it "
            "was at rest, and its direction is unknown."
        )
        return
    if not motion.moved:
        yield (
            f"It moved {length}: noise alone may look like that, so that it may have been at rest; its "
            "direction is unknown."
        )
        return
    least = "at least " if motion.at_border else ""
    degrees, std = np.degrees([motion.angle, motion.angle_std])
    yield (
        f"It went {least}{length} in the direction {direction(degrees, std)}, or the opposite one: "
        "one picture does not determine which."
    )
    if motion.at_border:
        yield (
            "It reaches the border of the picture: the part beyond is unknown, and the length is a "
            "lower bound."
        )


def _changes(motion: Motion) -> Iterator[str]:
    if motion.resting > max(3.0 * motion.resting_std, 0):
        yield (
            f"It was at rest for {motion.resting:.0%} ± {motion.resting_std:.1%} of the exposure, at "
            "one end of its path."
        )
    if motion.path in ("line", "arc") or not motion.moved:
        return
    slowest = int(np.argmin(motion.speeds))
    low = with_error(float(motion.speeds[slowest]), float(motion.speeds_std[slowest]))
    top = with_error(motion.top_speed, motion.top_speed_std)
    yield f"Its speed was between {low} and {top} px per exposure."
    if motion.acceleration is not None and motion.acceleration_covariance is not None:
        std = np.sqrt(np.diag(motion.acceleration_covariance))
        x, y = (with_error(a, s) for a, s in zip(motion.acceleration, std, strict=True))
        yield f"Its velocity changed by x {x}, y {y} px per exposure from the first moment to the last."


def speed_in_words(speed: Speed) -> Iterator[str]:
    """Sentences about a speed, the sources of its error, and what is missing."""
    if speed.unit == "m/s":
        kmh, mph = speed.in_unit("km/h"), speed.in_unit("mph")
        yield (
            f"Mean speed {with_error(speed.mean, speed.mean_std)} m/s, "
            f"{with_error(kmh.mean, kmh.mean_std)} km/h, "
            f"{with_error(mph.mean, mph.mean_std)} mph; "
            f"at most {with_error(speed.top, speed.top_std)} m/s."
        )
    else:
        missing = [f"the {name}" for name in speed.missing()]
        yield (
            f"Mean speed {with_error(speed.mean, speed.mean_std)} {speed.unit}; "
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing for meters per "
            "second."
        )
    parts = sorted(speed.parts.items(), key=lambda part: -part[1])
    shares = ", ".join(f"{name} {100 * share:.2g} %" for name, share in parts if share > 0)
    yield f"Sources of its error, largest first: {shares}."
    if speed.unknown is None or speed.unknown < 0.002:  # of the speed: negligible
        return
    if speed.unknown > 0.5:
        yield (
            "If the camera has a rolling shutter, the speed may be entirely different; give the time "
            "from line to line."
        )
        return
    later, earlier = _TOWARDS[speed.readout]
    yield (
        f"If the camera has a rolling shutter that takes {1000 * USUAL_READOUT_S:.0f} ms from the "
        f"first row to the last, the error of the speed is up to {speed.unknown:.1%}: too large for a "
        f"motion {later} in the picture, too small for one {earlier}. Give the time from line to line "
        "to correct it."
    )

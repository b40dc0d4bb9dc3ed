"""Motion in space, on a plane and about a point, and depth from blur, in sentences."""

from collections.abc import Mapping

import numpy as np

from blurmatte.explain.numbers import with_error
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.motion.space.depth import BlurDepth
from blurmatte.motion.space.plane import PlaneMotion
from blurmatte.motion.space.rotation import Rotation

_NO_TIME = "The speed is not known without the exposure time."
_EITHER_END = (
    "The picture does not determine which end came first: the reverse motion looks the same."
)
_SOURCES = {
    "picture": "the noise of the pictures",
    "radius": "the radius that was given",
    "camera": "the camera's calibration",
    "plane": "the calibration of the plane",
    "height": "the height that was given",
    "speed": "the speed that was given",
    "exposure time": "the exposure time",
}
_PATHS = {
    "line": "on a straight line through space",
    "parabola": "through space with constant acceleration",
    "disc": "at a distance from the camera that is assumed constant: a disc of one radius says "
    "nothing of speed along the line of sight",
}


def ball_in_words(motion: BallMotion) -> list[str]:
    """Sentences about the measurement, its error and the source of it, and what is unknown."""
    start, end = (", ".join(f"{v:.4g}" for v in motion.positions[i]) for i in (0, 2))
    return [
        f"It was {with_error(motion.depth, motion.depth_std)} m away along the optical axis, and went "
        f"{with_error(motion.length, motion.length_std)} m {_PATHS[motion.path]}.",
        *_speed(motion),
        f"From ({start}) m to ({end}) m, or the reverse: the picture does not determine the direction "
        "of time. x is right, y down, z forward.",
        _largest_source("distance", motion.depth_parts),
        _largest_source("speed", motion.parts),
    ]


def plane_motion_in_words(motion: PlaneMotion) -> list[str]:
    """Sentences, as of a ball."""
    lines = [f"It went {with_error(motion.length, motion.length_std)} m on the plane."]
    return [*lines, *_speed(motion), _largest_source("speed", motion.parts), _EITHER_END]


def _speed(motion: BallMotion | PlaneMotion) -> list[str]:
    if motion.exposure_time is None:
        return [_NO_TIME]
    kmh = 3.6 * motion.speed, 3.6 * motion.speed_std
    return [f"Speed: {with_error(motion.speed, motion.speed_std)} m/s, {with_error(*kmh)} km/h."]


def depth_in_words(motion: BlurDepth) -> list[str]:
    """Sentences about the distance, and its assumption."""
    lines = [f"It was {with_error(motion.depth, motion.depth_std)} m away along the optical axis."]
    if motion.start == motion.end:
        lines.append(
            "This assumes a motion parallel to the picture; otherwise it was mostly nearer."
        )
    else:
        lines.append(
            f"From {motion.start:.4g} m at the one end to {motion.end:.4g} m at the other."
        )
        lines.append(
            f"The direction that was given lies {np.degrees(motion.off):.1f}° off the plane through "
            "the streak and the camera."
        )
    return [*lines, _largest_source("distance", motion.parts)]


def rotation_in_words(motion: Rotation) -> list[str]:
    """Sentences about the angle and its speed."""
    x, y = motion.center
    degrees, std = np.degrees([motion.angle, motion.angle_std])
    lines = [f"It turned by {with_error(degrees, std)}° about ({x:.1f}, {y:.1f})."]
    if motion.exposure_time is None:
        lines.append(_NO_TIME)
    else:
        per_minute = 60 / (2 * np.pi)
        rpm = per_minute * motion.speed, per_minute * motion.speed_std
        lines.append(
            f"Speed: {with_error(motion.speed, motion.speed_std)} rad/s, {with_error(*rpm)} turns a "
            "minute."
        )
    return [*lines, "The picture does not determine the sense of rotation."]


def _largest_source(what: str, parts: Mapping[str, float]) -> str:
    name = max(parts, key=lambda part: parts[part])
    if parts[name] == 0:
        return f"No error of the {what} is known."
    return f"The error of the {what} comes mostly from {_SOURCES[name]} ({parts[name]:.1%} alone)."

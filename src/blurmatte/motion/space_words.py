"""Motion in space, on a plane and around a point, and depth, in plain words."""

from collections.abc import Mapping

import numpy as np

from blurmatte.motion.ball_motion import BallMotion
from blurmatte.motion.depth import BlurDepth
from blurmatte.motion.figures import with_error as _with
from blurmatte.motion.plane_motion import PlaneMotion
from blurmatte.motion.rotation import Rotation

SpaceMotion = BallMotion | PlaneMotion | BlurDepth | Rotation

_KMH = 3.6
_SOURCES = {
    "picture": "the noise of the pictures",
    "radius": "the radius that was given",
    "camera": "the camera's calibration",
    "plane": "where the plane lies",
    "height": "the height that was given",
    "speed": "the speed that was given",
    "exposure time": "the exposure time",
}
_WAYS = {
    "line": "on a straight line through space",
    "parabola": "through space with constant acceleration",
    "disc": "at constant distance from the camera, which is taken for granted: a disc of one radius "
    "says nothing of speed along the line of sight",
}


def space_motion_in_words(motion: SpaceMotion) -> list[str]:
    """Sentences about what was measured, its error, where that comes from, and what is not known."""
    match motion:
        case BallMotion():
            return _ball(motion)
        case PlaneMotion():
            lines = [f"It went {_with(motion.length, motion.length_std)} m on the plane."]
            return [*lines, *_speed(motion), _mostly("speed", motion.parts), _EITHER_WAY]
        case BlurDepth():
            return _depth(motion)
        case Rotation():
            return _rotation(motion)


_EITHER_WAY = "Which end came first the picture does not tell: backwards it would be the same."


def _ball(motion: BallMotion) -> list[str]:
    start, end = (", ".join(f"{v:.4g}" for v in motion.positions[i]) for i in (0, 2))
    return [
        f"It was {_with(motion.depth, motion.depth_std)} m away along the optical axis, and went "
        f"{_with(motion.length, motion.length_std)} m {_WAYS[motion.path]}.",
        *_speed(motion),
        f"From ({start}) m to ({end}) m, or from there to here: the picture does not tell the "
        "direction of time. x is right, y down, z forward.",
        _mostly("distance", motion.depth_parts),
        _mostly("speed", motion.parts),
    ]


def _speed(motion: BallMotion | PlaneMotion) -> list[str]:
    if motion.exposure_time is None:
        return ["How fast is not known without the exposure time."]
    speed, std = motion.speed, motion.speed_std
    return [f"Speed: {_with(speed, std)} m/s, {_with(_KMH * speed, _KMH * std)} km/h."]


def _depth(motion: BlurDepth) -> list[str]:
    lines = [f"It was {_with(motion.depth, motion.depth_std)} m away along the optical axis."]
    if motion.start == motion.end:
        lines.append("That is so if it moved parallel to the picture; else it was nearer, mostly.")
    else:
        lines.append(
            f"From {motion.start:.4g} m at the one end to {motion.end:.4g} m at the other."
        )
        lines.append(
            f"The direction that was given lies {np.degrees(motion.off):.1f}° off the plane in which "
            "the streak is seen."
        )
    return [*lines, _mostly("distance", motion.parts)]


def _rotation(motion: Rotation) -> list[str]:
    x, y = motion.center
    degrees, std = np.degrees([motion.angle, motion.angle_std])
    lines = [f"It turned by {_with(degrees, std)}° about ({x:.1f}, {y:.1f})."]
    if motion.exposure_time is None:
        lines.append("How fast is not known without the exposure time.")
    else:
        rate = 60 / (2 * np.pi)
        speed, error = motion.speed, motion.speed_std
        lines.append(
            f"Speed: {_with(speed, error)} rad/s, {_with(rate * speed, rate * error)} turns a minute."
        )
    return [*lines, "Which way round the picture does not tell."]


def _mostly(what: str, parts: Mapping[str, float]) -> str:
    name = max(parts, key=lambda part: parts[part])
    if parts[name] == 0:
        return f"No error of the {what} is known."
    return f"The error of the {what} comes mostly from {_SOURCES[name]} ({parts[name]:.1%} alone)."

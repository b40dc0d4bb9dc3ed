"""Motion in sentences: in the picture, in space, on a plane, about a point, and in free fall."""

from collections.abc import Iterator, Mapping

import numpy as np

from blurmatte.checks import Direction
from blurmatte.deblurring.spin import Spin
from blurmatte.explain.numbers import direction, with_article, with_error
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.summary import Scatter
from blurmatte.motion.picture.error_budget import OverExposure
from blurmatte.motion.picture.motion import USUAL_READOUT_S, Motion, Speed
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.motion.space.depth import BlurDepth
from blurmatte.motion.space.plane import PlaneMotion
from blurmatte.motion.space.rotation import Rotation
from blurmatte.sweep.model.path import path_family

# The direction of readout, and the opposite one
_TOWARDS: dict[Direction, tuple[str, str]] = {
    "down": ("down", "up"),
    "up": ("up", "down"),
    "left": ("to the left", "to the right"),
    "right": ("to the right", "to the left"),
}
_STANDARD_GRAVITY = 9.80665  # m/s²
_MAX_NAMED = 4  # frames in a sentence
_NO_TIME = "The speed is not known without the exposure time: give it, like --exposure 1/250."
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
_PATHS_IN_SPACE = {
    "line": "on a straight line through space",
    "parabola": "through space with constant acceleration",
    "disc": "at a distance from the camera that is assumed constant: a disc of one radius says "
    "nothing of speed along the line of sight",
}


def motion_in_words(motion: Motion) -> Iterator[str]:
    """Sentences about position, path length and size, their errors, and what is unknown."""
    yield from motion.doubts
    yield from _position(motion)
    yield from _path(motion)
    yield from _changes(motion)
    if not motion.has_shape:
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
    what = with_article(motion.silhouette) if motion.silhouette else "an object of any shape"
    basis = "sum, mean and covariance of alpha, assuming a straight path and constant speed"
    if motion.has_shape:
        verb = "fits the streak best" if motion.doubts else "explains the streak"
        basis = f"the shape on a path that {verb}"
    yield f"Measured from {basis}: {what} on {path_family(motion.path).motion_in_words}."
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
            f"It moved {length}: noise or the blur of the lens may look like that, so that it may have "
            "been at rest; its direction is unknown."
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
    if path_family(motion.path).at_constant_speed or not motion.moved:
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
    shares = ", ".join(
        f"{name} {100 * share:{'.0f' if share >= 0.1 else '.2g'}} %"
        for name, share in parts
        if share > 0
    )
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


def fall_in_words(fall: FreeFall) -> list[str]:
    """Sentences about the agreement with a free fall, and the lengths that follow from it."""
    if fall.rejection and (fall.gravity is None or not fall.fits):
        return [f"It does not agree with a free fall: {fall.rejection}.", *_off(fall)]
    noise = "as noise does"
    if fall.overscatter > 1:
        noise = (
            "without a bend; they exceed the stated errors, and the errors used are their scatter"
        )
    ratio = fall.chi2 / fall.freedom
    said = [
        f"It agrees with a free fall: the residuals of a parabola in time have "
        f"{f'{ratio:.2g}' if ratio < 100 else f'{ratio:.0f}'} times the variance of its positions, "
        f"{noise}. Its acceleration is {fall.size:.4g} ± {fall.size_std:.2g} {fall.unit}/s², "
        f"{_direction(fall)}.",
        *_off(fall),
    ]
    if fall.scale is None:
        return said
    return said + (_compared(fall) if fall.gravity is None else _in_gravity(fall))


def _off(fall: FreeFall) -> list[str]:
    """The frames that were not used because they disagree."""
    if not fall.off:
        return []
    named = [str(frame) for frame in fall.off[:_MAX_NAMED]]
    more = len(fall.off) - len(named)
    what = f"{', '.join(named)} and {more} more" if more else " and ".join(named[-2:])
    if not more and len(named) > 2:
        what = f"{', '.join(named[:-2])}, {what}"
    frames, have = ("Frame", "has") if len(fall.off) == 1 else ("Frames", "have")
    return [f"{frames} {what} {have} no weight: off the parabola of the others by more than noise."]


def _direction(fall: FreeFall) -> str:
    if fall.in_picture:
        degrees = np.degrees(np.arctan2(fall.acceleration[1], fall.acceleration[0]))
        return direction(float(degrees), float(np.degrees(fall.angle_std)))
    off, std = np.degrees(fall.off_gravity)
    x, y, z = fall.acceleration
    what = "straight down in the picture; if it is gravity, the camera is tilted by that"
    if fall.directed:
        what = "the gravity that was given"
    return f"({x:.3g}, {y:.3g}, {z:.3g}), {with_error(off, std)}° off {what}"


def _compared(fall: FreeFall) -> list[str]:
    """Comparison with standard gravity."""
    assert fall.scale is not None
    g, std = fall.in_meters(fall.scale)
    share, meters = g / _STANDARD_GRAVITY, _in_meters(fall)
    said = [f"That is {meters}, {share:.3f} of standard gravity."]
    if not fall.in_picture and not fall.rejection:  # a picture may show only a part of gravity
        said += _remedies(share, std / g)
    return said


def _in_meters(fall: FreeFall) -> str:
    """The acceleration with all its errors."""
    assert fall.scale is not None
    basis = "the scale" if fall.in_picture else "radius and camera"
    known = f"the errors of {basis} included"
    if fall.scale.std == 0:
        known = f"without errors of {basis}"
    return f"{with_error(*fall.in_meters(fall.scale))} m/s², {known}"


def _remedies(share: float, relative: float) -> list[str]:
    """Wrong options that would explain a significant difference from gravity.

    Differences up to 10 % may be caused by air or by the error of a radius.
    """
    if abs(share - 1) < max(3.0 * relative, 0.1):
        return []
    return [
        f"It would be gravity if lengths were {1 / share:.3g} times as large (is it the radius that "
        f"was given, not the diameter?), or if frames came {share**-0.5:.3g} times as fast (is it slow "
        "motion?)."
    ]


def _in_gravity(fall: FreeFall) -> list[str]:
    """Comparison with the gravity that was given, or the scale from it."""
    assert fall.scale is not None
    assert fall.gravity is not None
    known = float(np.linalg.norm(fall.gravity))
    g, std = fall.in_meters(fall.scale)
    remedies = _remedies(g / known, float(np.hypot(std / g, fall.gravity_std / known)))
    if fall.rejection:
        return [f"It is no fall in the gravity that was given: {fall.rejection}.", *remedies]
    if fall.scaled_by_gravity:
        mm, std = 1000 * fall.scale.meters_per_pixel, 1000 * fall.scale.std
        return [f"With a gravity of {known:.4g} m/s² a pixel is {mm:.4g} ± {std:.2g} mm there."]
    apart = abs(g - known) / max(float(np.hypot(std, fall.gravity_std)), 1e-12)
    ratio, ratio_std = fall.lengths
    basis = "the scale" if fall.in_picture else "the ball's radius"
    return [
        f"That is {_in_meters(fall)}, where gravity is {known:.4g}: {apart:.1f} standard deviations "
        "apart.",
        f"By the fall, all lengths are {with_error(ratio, ratio_std)} times those from {basis}.",
        *remedies,
    ]


def ball_in_words(motion: BallMotion) -> list[str]:
    """Sentences about the measurement, its error and the source of it, and what is unknown."""
    start, end = (", ".join(f"{v:.4g}" for v in motion.positions[i]) for i in (0, 2))
    return [
        f"It was {with_error(motion.depth, motion.depth_std)} m away along the optical axis, and went "
        f"{with_error(motion.length, motion.length_std)} m {_PATHS_IN_SPACE[motion.path]}.",
        _speed(motion),
        f"From ({start}) m to ({end}) m, or the reverse: the picture does not determine the direction "
        "of time. x is right, y down, z forward.",
        _largest_source("distance", motion.depth_parts),
        _largest_source("speed", motion.parts),
    ]


def plane_motion_in_words(motion: PlaneMotion) -> list[str]:
    """Sentences, as of a ball."""
    lines = [f"It went {with_error(motion.length, motion.length_std)} m on the plane."]
    return [*lines, _speed(motion), _largest_source("speed", motion.parts), _EITHER_END]


def _speed(
    motion: OverExposure, unit: str = "m/s", factor: float = 3.6, other: str = "km/h"
) -> str:
    """The speed in its unit, and in another one that is `factor` times as small."""
    if motion.exposure_time is None:
        return _NO_TIME
    more = with_error(factor * motion.speed, factor * motion.speed_std)
    return f"Speed: {with_error(motion.speed, motion.speed_std)} {unit}, {more} {other}."


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
    return [
        f"It turned by {with_error(degrees, std)}° about ({x:.1f}, {y:.1f}).",
        _speed(motion, "rad/s", 60 / (2 * np.pi), "turns a minute"),
        "The picture does not determine the sense of rotation.",
    ]


def spin_in_words(spin: Spin, exposure_time: float | None = None) -> str:
    """A line about rate and axis; revolutions per second if the exposure time, seconds, is known."""
    x, y, z = spin.axis
    text = f"spin {spin.rate_deg:.1f} ± {spin.rate_std_deg:.1f}° per exposure"
    if exposure_time:
        per_second = (rate / 360 / exposure_time for rate in (spin.rate_deg, spin.rate_std_deg))
        text += ", {:.2f} ± {:.2f} revolutions per second,".format(*per_second)
    text += f" about the axis ({x:.2f} right, {y:.2f} down, {z:.2f} towards the camera)"
    return f"{text} ± {spin.axis_std_deg:.1f}°; {spin.ambiguity}"


def sharp_in_words(frames: int, color_std: float, length: float, misfit: float | None) -> str:
    """A line about sharp moments: errors of colors, length of the path, pixels, and misfit if known."""
    line = f"{frames} sharp, color ± {color_std:.3f} of white, path {length:.1f} px"
    return line if misfit is None else f"{line}, misfit {misfit:.2f} (1 is noise)"


def _largest_source(what: str, parts: Mapping[str, float]) -> str:
    name = max(parts, key=lambda part: parts[part])
    if parts[name] == 0:
        return f"No error of the {what} is known."
    return f"The error of the {what} comes mostly from {_SOURCES[name]} ({parts[name]:.1%} alone)."

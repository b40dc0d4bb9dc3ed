"""A FreeFall in sentences."""

import numpy as np

from blurmatte.explain.numbers import direction, with_error
from blurmatte.motion.clip.fall import FreeFall

_MAX_NAMED = 4  # frames in a sentence
STANDARD_GRAVITY = 9.80665  # m/s² [3rd CGPM, 1901]


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
    if fall.unit == "px":
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
    share, meters = g / STANDARD_GRAVITY, _in_meters(fall)
    said = [f"That is {meters}, {share:.3f} of standard gravity."]
    if fall.unit == "m" and not fall.rejection:  # a picture may show only a part of gravity
        said += _remedies(share, std / g)
    return said


def _in_meters(fall: FreeFall) -> str:
    """The acceleration with all its errors."""
    assert fall.scale is not None
    basis = "the scale" if fall.unit == "px" else "radius and camera"
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
    basis = "the scale" if fall.unit == "px" else "the ball's radius"
    return [
        f"That is {_in_meters(fall)}, where gravity is {known:.4g}: {apart:.1f} standard deviations "
        "apart.",
        f"By the fall, all lengths are {with_error(ratio, ratio_std)} times those from {basis}.",
        *remedies,
    ]

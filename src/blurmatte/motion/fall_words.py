"""A FreeFall in plain words."""

import numpy as np

from blurmatte.motion.fall import FreeFall
from blurmatte.motion.figures import with_error as _with

STANDARD_GRAVITY = 9.80665  # m/s² [3rd CGPM, 1901]
_SIGMAS = 3.0
_MISTAKE = (
    0.1  # of gravity: no air and no error of a radius does that to a fall; a wrong option does
)


def fall_in_words(fall: FreeFall) -> list[str]:
    """Whether it was a free fall, what it says of lengths, in sentences."""
    if not fall.fits:
        return [f"It is not as a free fall would be: {fall.objection}."]
    noise = "as noise does"
    if fall.overscatter > 1:
        noise = "but no bend: they err by more than stated, and errors are those of their scatter"
    told = [
        f"It is as a free fall would be: a parabola in time through its places leaves {_left(fall)} "
        f"times their variance, {noise}. Its acceleration is {fall.size:.4g} ± "
        f"{fall.size_std:.2g} {fall.unit}/s², {_direction(fall)}."
    ]
    if fall.scale is None:
        return told
    return told + (_compared(fall) if fall.gravity is None else _in_gravity(fall))


def _left(fall: FreeFall) -> str:
    times = fall.chi2 / fall.freedom
    return f"{times:.2g}" if times < 100 else f"{times:.0f}"


def _direction(fall: FreeFall) -> str:
    if fall.unit == "px":
        angle = np.degrees(np.arctan2(fall.acceleration[1], fall.acceleration[0]))
        return f"at {angle:.1f}° (from right towards down)"
    off, std = np.degrees(fall.off_gravity)
    x, y, z = fall.acceleration
    what = "straight down in the picture; if it is gravity, the camera is tilted by that"
    if fall.directed:
        what = "the gravity that was given"
    return f"({x:.3g}, {y:.3g}, {z:.3g}), {_with(off, std)}° off {what}"


def _compared(fall: FreeFall) -> list[str]:
    """With standard gravity."""
    assert fall.scale is not None
    g, std = fall.in_meters(fall.scale)
    share, meters = g / STANDARD_GRAVITY, _in_meters(fall)
    told = [f"That is {meters}, {share:.3f} of standard gravity."]
    if fall.unit == "m" and not fall.objection:  # in a picture gravity may be seen aslant
        told += _remedies(share, std / g)
    return told


def _in_meters(fall: FreeFall) -> str:
    """The acceleration with all its errors."""
    assert fall.scale is not None
    basis = "the scale" if fall.unit == "px" else "radius and camera"
    known = f"the errors of {basis} included" if fall.scale.std > 0 else f"if {basis} do not err"
    return f"{_with(*fall.in_meters(fall.scale))} m/s², {known}"


def _remedies(share: float, relative: float) -> list[str]:
    """What would have to be otherwise for it to be gravity, where no noise explains the difference."""
    if abs(share - 1) < max(_SIGMAS * relative, _MISTAKE):
        return []
    return [
        f"It would be gravity if lengths were {1 / share:.3g} times as large (is it the radius that "
        f"was given, not the diameter?), or if frames came {share**-0.5:.3g} times as fast (is it slow "
        "motion?)."
    ]


def _in_gravity(fall: FreeFall) -> list[str]:
    assert fall.scale is not None
    assert fall.gravity is not None
    known = float(np.linalg.norm(fall.gravity))
    g, std = fall.in_meters(fall.scale)
    remedies = _remedies(g / known, float(np.hypot(std / g, fall.gravity_std / known)))
    if fall.objection:
        return [f"It is no fall in the gravity that was given: {fall.objection}.", *remedies]
    if fall.scaled_by_gravity:
        mm, std = 1000 * fall.scale.meters_per_pixel, 1000 * fall.scale.std
        return [f"With a gravity of {known:.4g} m/s² a pixel is {mm:.4g} ± {std:.2g} mm there."]
    apart = abs(g - known) / max(float(np.hypot(std, fall.gravity_std)), 1e-12)
    ratio, ratio_std = fall.lengths
    basis = "the scale" if fall.unit == "px" else "the ball's radius"
    return [
        f"That is {_in_meters(fall)}, where gravity is {known:.4g}: {apart:.1f} standard deviations "
        "apart.",
        f"By the fall, all lengths are {_with(ratio, ratio_std)} times what {basis} makes them.",
        *remedies,
    ]

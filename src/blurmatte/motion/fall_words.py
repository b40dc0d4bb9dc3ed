"""A FreeFall in plain words."""

import numpy as np

from blurmatte.motion.fall import FreeFall

STANDARD_GRAVITY = 9.80665  # m/s² [3rd CGPM, 1901]


def fall_in_words(fall: FreeFall) -> list[str]:
    """Whether it was a free fall, what it says of lengths, in sentences."""
    if not fall.fits:
        return [f"It is not as a free fall would be: {fall.objection}."]
    noise = "as noise does"
    if fall.overscatter > 1:
        noise = "but no bend: they err by more than stated, and errors are those of their scatter"
    way = "" if fall.unit == "m" else f", at {_degrees(fall):.1f}° (from right towards down)"
    told = [
        f"It is as a free fall would be: a parabola in time through its places leaves {_left(fall)} "
        f"times their variance, {noise}. Its acceleration is {fall.size:.4g} ± "
        f"{fall.size_std:.2g} {fall.unit}/s²{way}."
    ]
    if fall.scale is None:
        return told
    return told + (_compared(fall) if fall.gravity is None else _in_gravity(fall))


def _left(fall: FreeFall) -> str:
    times = fall.chi2 / fall.freedom
    return f"{times:.2g}" if times < 100 else f"{times:.0f}"


def _degrees(fall: FreeFall) -> float:
    return float(np.degrees(np.arctan2(fall.acceleration[1], fall.acceleration[0])))


def _compared(fall: FreeFall) -> list[str]:
    assert fall.scale is not None
    g, std = fall.in_meters(fall.scale)
    share = g / STANDARD_GRAVITY
    return [f"That is {g:.3g} ± {std:.2g} m/s², {share:.2f} of standard gravity."]


def _in_gravity(fall: FreeFall) -> list[str]:
    assert fall.scale is not None
    assert fall.gravity is not None
    known = float(np.linalg.norm(fall.gravity))
    if fall.objection:
        return [f"It is no fall in the gravity that was given: {fall.objection}."]
    if fall.scaled_by_gravity:
        mm, std = 1000 * fall.scale.meters_per_pixel, 1000 * fall.scale.std
        return [f"With a gravity of {known:.4g} m/s² a pixel is {mm:.4g} ± {std:.2g} mm there."]
    g, std = fall.in_meters(fall.scale)
    apart = abs(g - known) / max(float(np.hypot(std, fall.gravity_std)), 1e-12)
    ratio, ratio_std = fall.lengths
    basis = "the scale" if fall.unit == "px" else "the ball's radius"
    return [
        f"That is {g:.3g} ± {std:.2g} m/s², where gravity is {known:.4g}: {apart:.1f} standard "
        "deviations apart.",
        f"By the fall, all lengths are {ratio:.4g} ± {ratio_std:.2g} times what {basis} makes them.",
    ]

"""measure_rotation: the rotation of a fan, a wheel with few spokes, or a stick.

In polar coordinates (ρ, φ) around the center, the rotation of a rigid object by ω blurs its silhouette
along φ by a box of width ω. Where an edge passed, alpha is a ramp, for any outline: that gives the
starts. The fit gives the most likely center, ω and edges, in the ring in which the whole object is
visible (`rotation_fit`).
"""

from __future__ import annotations

from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array
from blurmatte.descent import distinct
from blurmatte.errors import MotionError
from blurmatte.matting.solution import Solution
from blurmatte.motion.picture.error_budget import OverExposure, by_axis, check_exposure
from blurmatte.motion.space.rotation_fit import (
    NO_VARIATION,
    AlphaMap,
    Blades,
    blades_of,
    ring_around,
    starts,
)
from blurmatte.statistics import variance_inflation
from blurmatte.sweep.sweep import MAX_RESIDUAL_EXCESS, Sweep

# When a fitted rotation is accepted.
_MIN_ALPHA_FRACTION = 0.5  # of alpha, in the ring
_MIN_ANGLE_STD = 5.0  # standard deviations of an angle that is known
_MAX_ROUNDS = 3  # fits, each in the ring around the center of the last
_CENTER_TOLERANCE_PX = 0.5
_PIXELS_PER_TRIAL = 3000  # with which starts are compared
_UNAMBIGUOUS_TURN = 0.85  # angles between blades: beyond, paths of blades may overlap
_CHANCE_STD = 4.0  # standard deviations by which misfits of such trials may differ by chance
_AMBIGUOUS_CHI2 = 14.0  # difference of two angles that both explain alpha, at 0.1 %
_MAX_MISFIT = 12.0  # mean squared residual over blocks, of a rigid object
_MAX_OVERLAP_MISFIT = 2.5  # the same if paths overlap: other angles fit nearly as well


@dataclass(frozen=True, eq=False)
class Rotation(OverExposure):
    """Angle by which an object turned about a point; its sign is not determined by the picture.

    Parameters
    ----------
    center : (2,) float
        Of the rotation (x, y), pixels; of an object that also moved along a path, its center in the
        middle of the exposure.
    angle : float
        Radians during the exposure.
    covariance : (3, 3) float
        Of center and angle, pixels and radians.
    blades : int
        Number of blades on a circle around the center; 0 if unknown.
    exposure_time, exposure_std : float or None, float
        Seconds.

    Examples
    --------
    >>> turn = bm.motion.Rotation((64, 36), np.radians(40), 1e-4 * np.eye(3), exposure_time=1 / 60)
    >>> print(turn)
    Rotation(40.00° ± 0.57° about (64.0, 36.0), 41.89 ± 0.6 rad/s)
    """

    center: Array
    angle: float
    covariance: Array
    blades: int = 0
    exposure_time: float | None = None
    exposure_std: float = 0.0

    def __repr__(self) -> str:
        x, y = self.center
        speed = self._speed_in_words("rad/s")
        return (
            f"Rotation({np.degrees(self.angle):.2f}° ± {np.degrees(self.angle_std):.2g}° about "
            f"({x:.1f}, {y:.1f}){speed})"
        )

    @property
    def center_std(self) -> Array:
        """(2,) standard deviations of the center, pixels."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:2]))

    @property
    def angle_std(self) -> float:
        """Standard deviation of the angle, radians."""
        return float(np.sqrt(self.covariance[2, 2]))

    def numbers(self) -> dict[str, float]:
        """All numbers by name, flat, for a row of a table: pixels, radians, rad/s."""
        row = by_axis("rotation_center", self.center, self.center_std)
        row |= {"rotation": self.angle, "rotation_std": self.angle_std, "blades": self.blades}
        if self.exposure_time is not None:
            row |= {"rotation_speed": self.speed, "rotation_speed_std": self.speed_std}
        return row

    @property
    def _moved(self) -> tuple[float, float]:
        return self.angle, self.angle_std


def measure_rotation(
    thing: Solution | Sweep,
    center: npt.ArrayLike | None = None,
    exposure_time: float | None = None,
    exposure_std: float = 0.0,
) -> Rotation:
    """Angle by which an object turned during the exposure, and the center of the rotation.

    Parameters
    ----------
    thing : Solution or Sweep
        For an object that turns about a fixed point, the solution, best one of `Pixelwise`, in which
        the errors of pixels are independent. For an object that moves and turns, its sweep.
    center : (2,) float, optional
        Of the rotation, if it is known, pixels.
    exposure_time : float, optional
        Seconds; without it there is no speed.
    exposure_std : float
        Its standard deviation.

    Raises
    ------
    TypeError, ValueError
        For something else, or a number out of its range.
    MotionError
        If alpha does not vary along circles (full turns, half turns of a stick, 1/n turns of n blades,
        a disc, no rotation), if no rigid rotation about one point explains it, or if two angles do;
        the message then names both.

    Examples
    --------
    >>> from blurmatte.rendering.flat_bodies import Sheet
    >>> from blurmatte.rendering.pose import Change
    >>> still = bm.Trajectory.line((64, 36), (64, 36))
    >>> turn = Change(spin=(0, 0, 0.7))  # radians
    >>> fan = bm.rendering.Scene(wall, still, Sheet(50, 12, orange), change=turn)
    >>> turned = bm.rendering.render(fan, 100)
    >>> blurred = camera.photograph(turned.image.rgb, 0)
    >>> answer = bm.solve(blurred, plate, turned.model, bm.Pixelwise())
    >>> turn = bm.motion.measure_rotation(answer)
    >>> print(f"{np.degrees(turn.angle):.1f}° ± {np.degrees(turn.angle_std):.1f}°")
    40.2° ± 0.1°
    """
    check_exposure(exposure_time, exposure_std)
    known = None if center is None else np.asarray(center, dtype=float)
    if known is not None and (known.shape != (2,) or not np.all(np.isfinite(known))):
        raise ValueError(f"center must be a point (x, y), got {known}")
    if isinstance(thing, Sweep):
        found = _of_sweep(thing)
    elif isinstance(thing, Solution):
        found = _of_solution(thing, known)
    else:
        raise TypeError(f"thing must be a Solution or a Sweep, got {type(thing).__name__}")
    if not found.angle > _MIN_ANGLE_STD * found.angle_std:
        raise MotionError(
            f"the angle, {np.degrees(found.angle):.2g}° ± {np.degrees(found.angle_std):.2g}°, is not "
            "known: alpha hardly varies along circles, as after full turns or a very small turn"
        )
    return replace(found, exposure_time=exposure_time, exposure_std=exposure_std)


def _of_sweep(sweep: Sweep) -> Rotation:
    if not sweep.silhouette.has("turn"):
        raise MotionError(
            f"the sweep is of a {sweep.silhouette.name} without rotation; give the solution"
        )
    middle, D = sweep.family.at(sweep.path, np.array([0.5]))
    n = len(sweep.path)
    J = np.zeros((3, len(sweep.covariance)))
    turn = sweep.silhouette.turn(sweep.shape)
    J[:2, :n], J[2, n:] = D[0], np.copysign(sweep.silhouette.turn_slope(), turn)
    return Rotation(middle[0], abs(turn), J @ sweep.covariance @ J.T)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A rotation fitted from a start.

    misfit is the mean squared residual, inflated by its correlation; residuals (H, W) are in standard
    deviations, NaN where they were not fitted.
    """

    misfit: float
    rotation: Rotation
    residuals: Array

    def gain_over(self, other: _Trial) -> float:
        """Decrease of χ² from that of another, over the pixels of both."""
        return float(np.nansum(other.residuals**2 - self.residuals**2))


def _of_solution(solution: Solution, center: Array | None) -> Rotation:
    """The best fit from all starts; MotionError if it is not acceptable or not the only one."""
    use = np.asarray(solution.known & (solution.alpha_std > 0))
    alpha = np.where(use, solution.alpha, 0).astype(float)
    seen = AlphaMap(alpha, np.where(use, solution.alpha_std, 1).astype(float), use)
    trials, error = [], None
    for c, omega, spacings in starts(replace(seen, use=use & solution.streak), center):
        try:
            trials.append(_fitted(seen, c, omega, center, _PIXELS_PER_TRIAL, spacings))
        except MotionError as raised:
            error = error or raised
            continue
        found = trials[-1].rotation
        turned = found.angle * found.blades
        if trials[-1].misfit < MAX_RESIDUAL_EXCESS and turned < _UNAMBIGUOUS_TURN * 2 * np.pi:
            break
    if not trials:
        raise error or MotionError("alpha is nowhere known; solve with another color")
    trials.sort(key=lambda trial: trial.misfit)
    # Trials use different pixels, so that their misfits differ by chance.
    most = trials[0].misfit * (1 + _CHANCE_STD * np.sqrt(2 / _PIXELS_PER_TRIAL))
    rough = distinct([trial.rotation for trial in trials if trial.misfit <= most], _agree)
    fits = list[_Trial]()
    for one in rough:
        with suppress(MotionError) if fits else nullcontext():
            fits.append(_fitted(seen, one.center, one.angle, center, alpha.size, None))
    best = fits[0]
    for other in fits[1:]:
        best = other if other.gain_over(best) > 0 else best
    misfit, rotation = best.misfit, best.rotation
    overlaps = rotation.angle * rotation.blades > _UNAMBIGUOUS_TURN * 2 * np.pi
    limit = _MAX_OVERLAP_MISFIT if overlaps else _MAX_MISFIT
    if misfit > limit:
        if error is not None and str(error) == NO_VARIATION:
            raise error
        raise MotionError(
            f"no rigid rotation about one point explains alpha: the residuals are {misfit:.0f} times "
            "the noise; choose a region that contains only this object, or give its center"
        )
    for other in fits:
        if other is not best and best.gain_over(other) < _AMBIGUOUS_CHI2 * max(misfit, 1.0):
            _check_same(rotation, other.rotation)
    return rotation


def _agree(a: Rotation, b: Rotation) -> bool:
    """Whether two angles are the same within their errors."""
    return abs(a.angle - b.angle) < _MIN_ANGLE_STD * float(np.hypot(a.angle_std, b.angle_std))


def _check_same(rotation: Rotation, other: Rotation) -> None:
    """Raise MotionError if two equally good fits have different angles."""
    if _agree(rotation, other):
        return
    angles = sorted(np.degrees([rotation.angle, other.angle]))
    raise MotionError(
        f"it turned by {angles[0]:.1f}° or by {angles[1]:.1f}°: both explain alpha equally well, "
        "because the last orientation looks like the first; use a shorter exposure"
    )


def _fitted(
    seen: AlphaMap, c: Array, omega: float, center: Array | None, most: int, spacings: float | None
) -> _Trial:
    """The rotation fitted from a start.

    Uses at most so many pixels, evenly spread. With `spacings`, the angle starts at that many angles
    between blades.
    """
    alpha = seen.alpha
    for _ in range(_MAX_ROUNDS):  # another center has other circles
        ring, mask = ring_around(seen, c)
        every = -(-np.count_nonzero(mask) // most)
        y, x = np.nonzero(mask)
        blades = blades_of(seen.at(y, x), c, ring)
        y, x = y[::every], x[::every]
        pixels = seen.at(y, x)
        apart = 2 * np.pi / len(blades)
        if spacings is not None:
            omega, spacings = spacings * apart, None
        # A blade that passes the next one's start overlaps its path: alpha is largest between them.
        shift = apart / 2 * np.floor(omega / apart)
        model = Blades(center, ring, [(middle + shift, width) for middle, width in blades])
        p, H, e = model.fit(pixels, c, omega)
        moved = float(np.hypot(*(p[:2] - c)))
        c, omega = p[:2], float(p[2])
        if moved < _CENTER_TOLERANCE_PX:
            break
    if alpha[mask].sum() < _MIN_ALPHA_FRACTION * alpha[seen.use].sum():
        raise MotionError(
            "most of the moved object lies outside the ring in which all of it is visible: it does not "
            "turn about one point alone; choose a region that contains only this object, or give its "
            "center"
        )
    residuals = np.full(alpha.shape, np.nan)
    residuals[y, x] = e
    known = np.nan_to_num(residuals)[..., None]
    inflation = float(variance_inflation(known, mask).max()) if every == 1 else 1.0
    misfit = max(inflation, 1.0) * float(np.mean(e**2))
    covariance = np.linalg.pinv(H, hermitian=True) * max(misfit, 1.0)
    at = [0, 1, 2] if center is None else [0]
    total = np.zeros((3, 3))
    total[3 - len(at) :, 3 - len(at) :] = covariance[np.ix_(at, at)]
    return _Trial(misfit, Rotation(c, omega, total, len(model.blades)), residuals)

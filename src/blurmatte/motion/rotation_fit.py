"""measure_rotation: a fan, a wheel with few spokes, a stick that turns.

In polar coordinates (ρ, φ) around the center a rigid thing that turns by ω during the exposure leaves
its silhouette blurred along φ by a box of width ω. Where an edge passed, alpha is a ramp, whatever the
outline: that tells where to begin (`rotation_start`). The fit ends with the most likely center, ω and
edges (`rotation_blades`), of the circles that show the whole thing (`rotation_ring`).
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import MotionError
from blurmatte.matting import Solution
from blurmatte.motion.rotation import Rotation
from blurmatte.motion.rotation_blades import Blades
from blurmatte.motion.rotation_ring import ALIKE, blades_of, pixels_at, ring_around
from blurmatte.motion.rotation_start import starts
from blurmatte.motion.sources import check_exposure
from blurmatte.radiometry import coherence
from blurmatte.sweep import Sweep
from blurmatte.sweep.sweep import MAX_RESIDUAL_EXCESS

Array = npt.NDArray[np.float64]

_MOST_OF_IT = 0.5  # of alpha, what lies on circles that show the whole thing
_SURE = 5.0  # times its error, an angle that is known
_ROUNDS, _STILL = 3, 0.5  # fits around a center that still moves by so many pixels
_FEW = 3000  # pixels, with which starts are compared
_AGAIN = 0.85  # of the angle between blades: beyond, their ways may overlap, and others look alike
_DIFFERENT = 14.0  # of χ²: chance makes so much in one of a thousand
_MISFIT = 12.0  # times as much as noise, over blocks, what a rigid thing that turns leaves at most
_MISFIT_OVERLAPPING = (
    2.5  # the same where blades go on to where others were: much looks alike there
)


def measure_rotation(
    thing: Solution | Sweep,
    center: npt.ArrayLike | None = None,
    exposure_time: float | None = None,
    exposure_std: float = 0.0,
) -> Rotation:
    """How far something turned during the exposure, and about which point.

    Parameters
    ----------
    thing : Solution or Sweep
        Of something that turns about a point that stands still, the solution, best one of
        `Pixelwise`, in which every pixel errs alone. Of something that flies and turns, its sweep.
    center : (2,) float, optional
        About which point, if that is known, pixels.
    exposure_time : float, optional
        Seconds; without it there is no speed.
    exposure_std : float
        Its standard deviation.

    Returns
    -------
    Rotation

    Raises
    ------
    TypeError, ValueError
        For something else, or a number out of its range.
    MotionError
        If alpha does not change along circles (full turns, half turns of a stick, nths of n blades, a
        disc, nothing that turns), nothing rigid that turned about one point explains it, or two
        angles do as well: both are named then.
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
    if not found.angle > _SURE * found.angle_std:
        raise MotionError(
            f"the angle, {np.degrees(found.angle):.2g}° ± {np.degrees(found.angle_std):.2g}°, is not "
            "known: alpha hardly changes along circles, as after full turns, or it hardly turned"
        )
    return replace(found, exposure_time=exposure_time, exposure_std=exposure_std)


def _of_sweep(sweep: Sweep) -> Rotation:
    if not sweep.silhouette.turns:
        raise MotionError(
            f"the sweep is of a {sweep.silhouette.name}, and says nothing of a turn; give the solution"
        )
    middle, D = sweep.family.at(sweep.path, np.array([0.5]))
    n = len(sweep.path)
    J = np.zeros((3, len(sweep.covariance)))
    turn = sweep.silhouette.turn(sweep.shape)
    J[:2, :n], J[2, -1] = D[0], 1 if turn >= 0 else -1
    return Rotation(middle[0], abs(turn), J @ sweep.covariance @ J.T)


def _of_solution(solution: Solution, center: Array | None) -> Rotation:
    use = np.asarray(solution.known & (solution.alpha_std > 0))
    alpha = np.where(use, solution.alpha, 0).astype(float)
    std = np.where(use, solution.alpha_std, 1).astype(float)
    tried, refusal = [], None
    for c, omega, spacings in starts(alpha, std, use & solution.streak, center):
        try:
            tried.append(_fitted(alpha, std, use, c, omega, center, _FEW, spacings))
            left, found = tried[-1]
            if left < MAX_RESIDUAL_EXCESS and found.angle * found.blades < _AGAIN * 2 * np.pi:
                break
        except MotionError as error:
            refusal = refusal or error
    if not tried:
        raise refusal or MotionError("alpha is nowhere known; solve with another color")
    tried.sort(key=lambda pair: pair[0])
    left, rotation = _whole(alpha, std, use, center, tried[0])
    overlap = rotation.angle * rotation.blades > _AGAIN * 2 * np.pi
    if left > (_MISFIT_OVERLAPPING if overlap else _MISFIT):
        if refusal is not None and str(refusal) == ALIKE:
            raise refusal
        raise MotionError(
            f"nothing rigid that turned about one point explains alpha: it leaves {left:.0f} times as "
            "much as noise; choose a region that holds it alone, or give its center"
        )
    for other in tried[1:]:
        if _FEW * (other[0] / tried[0][0] - 1) < _DIFFERENT:
            _check_same(rotation, other[1])
    return rotation


def _whole(
    alpha: Array, std: Array, use: Bools, center: Array | None, rough: tuple[float, Rotation]
) -> tuple[float, Rotation]:
    """What is left, and the rotation, from all pixels."""
    return _fitted(alpha, std, use, rough[1].center, rough[1].angle, center, alpha.size)


def _check_same(rotation: Rotation, other: Rotation) -> None:
    """MotionError if two explanations that are as good differ."""
    unsure = float(np.hypot(rotation.angle_std, other.angle_std))
    if abs(rotation.angle - other.angle) < _SURE * unsure:
        return
    angles = sorted(np.degrees([rotation.angle, other.angle]))
    raise MotionError(
        f"it turned by {angles[0]:.1f}° or by {angles[1]:.1f}°: both explain alpha as well, for it has "
        "come near to where it looks the same again; expose shorter"
    )


def _fitted(
    alpha: Array,
    std: Array,
    use: Bools,
    c: Array,
    omega: float,
    center: Array | None,
    most: int,
    spacings: float | None = None,
) -> tuple[float, Rotation]:
    """How many times as much as noise is left, and the rotation near a start that leaves it.

    Of no more than `most` pixels, spread evenly. The angle starts at so many times that between
    blades, if `spacings` says how many.
    """
    for _ in range(_ROUNDS):  # circles around another center are others
        ring, mask = ring_around(alpha, use, c)
        every = -(-np.count_nonzero(mask) // most)
        y, x = np.nonzero(mask)
        blades = blades_of(pixels_at(alpha, std, y, x), c, ring)
        y, x = y[::every], x[::every]
        pixels = pixels_at(alpha, std, y, x)
        apart = 2 * np.pi / len(blades)
        if spacings is not None:
            omega, spacings = spacings * apart, None
        # What goes on to where the next blade was overlaps with that: most is between them then.
        shift = apart / 2 * np.floor(omega / apart)
        model = Blades(center, ring, [(middle + shift, width) for middle, width in blades])
        p, H, e = model.fit(pixels, c, omega)
        moved = float(np.hypot(*(p[:2] - c)))
        c, omega = p[:2], float(p[2])
        if moved < _STILL:
            break
    residuals = np.zeros(alpha.shape)
    residuals[y, x] = e
    if alpha[mask].sum() < _MOST_OF_IT * alpha[use].sum():
        raise MotionError(
            "most of what moved lies on circles around the center that do not show all of it: it does "
            "not turn about one point alone; choose a region that holds it alone, or give its center"
        )
    together = float(coherence(residuals[..., None], mask).max()) if every == 1 else 1.0
    left = max(together, 1.0) * float(np.mean(e**2))
    covariance = np.linalg.pinv(H, hermitian=True) * max(left, 1.0)
    at = [0, 1, 2] if center is None else [0]
    total = np.zeros((3, 3))
    total[3 - len(at) :, 3 - len(at) :] = covariance[np.ix_(at, at)]
    return left, Rotation(c, omega, total, len(model.blades))

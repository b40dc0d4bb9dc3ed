"""Rotation about a point: a fan, a wheel with few spokes, a stick that turns.

In polar coordinates (ρ, φ) around the center a rigid thing that turns by ω during the exposure leaves
its silhouette blurred along φ by a box of width ω. Where an edge passed, alpha is a ramp of slope
1/ω, whatever the outline, and the same at all ρ:

    (x − c) × ∇α = ± 1/ω ,                                                                    (1)

which is linear in the center c and in 1/ω, and where the fit begins. It ends with the most likely c, ω
and edges: each blade of the thing lies between two curves φ(ρ), sums of a few powers of ρ, and alpha
of a pixel is the difference of two ramps, both averaged over its width 1/ρ.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import MotionError
from blurmatte.matting import Solution
from blurmatte.motion.sources import check_exposure, named_axes
from blurmatte.radiometry import coherence
from blurmatte.sweep import Sweep

Array = npt.NDArray[np.float64]

_SMOOTH = 2.0  # pixels, over which gradients are taken
_TRIALS = 400  # starts from three pixels each
_AGREE = 0.25  # of 1/ω, by which (1) may fail in a pixel that counts as a ramp
_STEEP = 4.0  # times its error, the gradient of a pixel on a ramp
_NEAREST = 4.0  # pixels from the center: nearer ones see all angles at once
_PRESENT = 0.4  # of its usual width along a circle, where the thing is still there
_MOST_OF_IT = 0.5  # of alpha, what lies on circles that show the whole thing
_TIP = 2.5  # pixels at both ends of it that are left out
_GRID = 720  # angles
_POWERS = (
    -3.0,
    -1.0,
    0.0,
    1.0,
    2.0,
)  # of ρ: −1 and −3 for straight edges beside the center, 2 for bent ones
_MOST_BLADES = 12
_SURE = 5.0  # times its error, an angle that is known
_ROUNDS, _STILL = 3, 0.5  # fits around a center that still moves by so many pixels
_RAMP, _FAR = 0.5, 5.0  # of ω, and pixels of the center: the largest step
_FEW = 3000  # pixels, with which starts are compared
_SPACINGS = 0.85, 1.15, 1.7, 2.2  # times the angle between blades, where their ways overlap
_CLEAR = 16.0  # times its error, what alpha varies by around the center: noise then makes no parts
_COARSEST = 32.0  # of 720 angles: smoother than that, blades would be lost
_UNEVEN = 0.1  # of its largest, what it varies by at least
_AGAIN = 0.85  # of the angle between blades: beyond, their ways may overlap, and others look alike
_DIFFERENT = 14.0  # of χ²: chance makes so much in one of a thousand
_STEPS, _ENOUGH = 60, 1e-2  # units of log likelihood: no step gains more
_LEAST = 1e-12  # of the largest curvature, what a parameter without any is given
_DOUBT = 3.0  # residuals, from which on they count less
_NOISE = 1.2  # times as much as noise, what needs no better start
_MISFIT = 12.0  # times as much as noise, over blocks, what a rigid thing that turns leaves at most
_MISFIT_OVERLAPPING = (
    2.5  # the same where blades go on to where others were: much looks alike there
)
_ALIKE = (
    "alpha is the same all around the center. So it is of something round, and after any number of "
    "full turns, of a stick with two ends also of half turns, of n blades of nths of a turn: all of "
    "them look alike, and which it was the picture does not tell. Expose shorter"
)


@dataclass(frozen=True, eq=False)
class Rotation:
    """How far something turned about a point; which way round, the picture does not tell.

    Parameters
    ----------
    center : (2,) float
        The point (x, y) about which it turned, pixels; of something that also moved along, where its
        middle was in the middle of the exposure.
    angle : float
        Radians during the exposure.
    covariance : (3, 3) float
        Of center and angle.
    blades : int
        How many parts were seen on a circle around the center; 0 if nobody counted.
    exposure_time, exposure_std : float or None, float
        Seconds.
    """

    center: Array
    angle: float
    covariance: Array
    blades: int = 0
    exposure_time: float | None = None
    exposure_std: float = 0.0

    def __repr__(self) -> str:
        x, y = self.center
        speed = ""
        if self.exposure_time is not None:
            speed = f", {self.speed:.4g} ± {self.speed_std:.2g} rad/s"
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

    @property
    def speed(self) -> float:
        """Angular speed, rad/s."""
        return self.angle / self._seconds

    @property
    def speed_std(self) -> float:
        """Standard deviation of the speed, rad/s."""
        relative = np.hypot(self.angle_std / self.angle, self.exposure_std / self._seconds)
        return float(self.speed * relative)

    def numbers(self) -> dict[str, float]:
        """All numbers by name, flat, for a row of a table: pixels, radians, rad/s."""
        told = named_axes("rotation_center", self.center, self.center_std)
        told |= {"rotation": self.angle, "rotation_std": self.angle_std, "blades": self.blades}
        if self.exposure_time is not None:
            told |= {"rotation_speed": self.speed, "rotation_speed_std": self.speed_std}
        return told

    @property
    def _seconds(self) -> float:
        if self.exposure_time is None:
            raise MotionError("an angular speed needs the exposure_time, in seconds; give it")
        return self.exposure_time


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


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Alpha of some pixels (n,) at x, y."""

    x: Array
    y: Array
    alpha: Array
    std: Array


def _pixels(alpha: Array, std: Array, y: npt.NDArray[np.intp], x: npt.NDArray[np.intp]) -> _Pixels:
    return _Pixels(x.astype(float), y.astype(float), alpha[y, x], std[y, x])


def _of_solution(solution: Solution, center: Array | None) -> Rotation:
    use = np.asarray(solution.known & (solution.alpha_std > 0))
    alpha = np.where(use, solution.alpha, 0).astype(float)
    std = np.where(use, solution.alpha_std, 1).astype(float)
    tried, refusal = [], None
    for c, omega, spacings in _starts(alpha, std, use & solution.streak, center):
        try:
            tried.append(_fitted(alpha, std, use, c, omega, center, _FEW, spacings))
            left, found = tried[-1]
            if left < _NOISE and found.angle * found.blades < _AGAIN * 2 * np.pi:
                break
        except MotionError as error:
            refusal = refusal or error
    if not tried:
        raise refusal or MotionError("alpha is nowhere known; solve with another color")
    tried.sort(key=lambda pair: pair[0])
    left, rotation = _whole(alpha, std, use, center, tried[0])
    overlap = rotation.angle * rotation.blades > _AGAIN * 2 * np.pi
    if left > (_MISFIT_OVERLAPPING if overlap else _MISFIT):
        if refusal is not None and str(refusal) == _ALIKE:
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
        ring, mask = _ring(alpha, use, c)
        every = -(-np.count_nonzero(mask) // most)
        y, x = np.nonzero(mask)
        blades = _blades(_pixels(alpha, std, y, x), c, ring)
        y, x = y[::every], x[::every]
        pixels = _pixels(alpha, std, y, x)
        apart = 2 * np.pi / len(blades)
        if spacings is not None:
            omega, spacings = spacings * apart, None
        # What goes on to where the next blade was overlaps with that: most is between them then.
        shift = apart / 2 * np.floor(omega / apart)
        model = _Blades(center, ring, [(middle + shift, width) for middle, width in blades])
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


def _starts(
    alpha: Array, std: Array, use: Bools, center: Array | None
) -> Iterator[tuple[Array, float, float | None]]:
    """Centers and angles to begin with, or these in times the angle between blades.

    The middle of alpha, right for most fans, and what (1) says. Where the ways of blades overlap (1)
    holds nowhere, and angles around those after which all looks alike are tried.
    """
    c, slope = _start(alpha, std, use, center)
    if center is None:
        y, x = np.nonzero(use)
        middle = np.array([x, y]) @ alpha[use] / max(float(alpha[use].sum()), 1.0)
        yield middle, min(1 / _start(alpha, std, use, middle)[1], 2 * np.pi), None
    else:
        middle = center
    yield c, min(1 / slope, 2 * np.pi), None
    for spacings in _SPACINGS:
        yield middle, 0.0, spacings


def _start(alpha: Array, std: Array, use: Bools, center: Array | None) -> tuple[Array, float]:
    """A center, and 1/ω, for which (1) holds in the most pixels."""
    from scipy.ndimage import gaussian_filter

    gy, gx = (gaussian_filter(alpha, _SMOOTH, order=o) for o in ((1, 0), (0, 1)))
    # Noise of one pixel in a Gaussian's derivative: σ / (√(8π) s²).
    noise = float(np.median(std[use])) / (np.sqrt(8 * np.pi) * _SMOOTH**2) if use.any() else 1.0
    steep = use & (np.hypot(gx, gy) > _STEEP * noise)
    y, x = np.nonzero(steep)
    if len(x) < 3:
        raise MotionError(
            "alpha hardly changes anywhere; nothing turned, or by full turns: expose shorter"
        )
    gx, gy = gx[steep], gy[steep]
    # c_x g_y − c_y g_x + s/ω = x g_y − y g_x, s = ±1
    A, b = np.column_stack([gy, -gx]), x * gy - y * gx
    best, score = (np.zeros(2), 0.0), -1.0
    for c, slope in _candidates(A, b, center):
        d = np.abs(b - A @ c)
        agree = np.abs(d / slope - 1) < _AGREE
        if agree.sum() > score:
            best, score = (c, slope), float(agree.sum())
    c, slope = best
    for _ in range(10):
        d = b - A @ c
        ramp = np.abs(np.abs(d) / slope - 1) < _AGREE
        if ramp.sum() < 3:
            break
        signs = np.sign(d[ramp])
        if center is not None:
            slope = float(np.abs(d[ramp]).mean())
            continue
        rows = np.column_stack([A[ramp], signs])
        solved, *_ = np.linalg.lstsq(rows, b[ramp], rcond=None)
        if not solved[2] > 0:
            break
        c, slope = solved[:2], float(solved[2])
    return c, slope


def _candidates(A: Array, b: Array, center: Array | None) -> Iterator[tuple[Array, float]]:
    """Centers and 1/ω > 0 that three pixels say, or one if the center is known; always the same."""
    rng = np.random.default_rng(0)
    for _ in range(_TRIALS):
        if center is not None:
            i = int(rng.integers(len(b)))
            slope = abs(float(b[i] - A[i] @ center))
            if slope > 0:
                yield center, slope
            continue
        three = rng.integers(len(b), size=3)
        for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)):
            rows = np.column_stack([A[three], signs])
            if abs(np.linalg.det(rows)) > 1e-12:
                cx, cy, slope = np.linalg.solve(rows, b[three])
                if slope != 0:
                    yield np.array([cx, cy]), abs(float(slope))


def _ring(alpha: Array, use: Bools, c: Array) -> tuple[tuple[float, float], Bools]:
    """Between which distances from the center the whole of something turns; the pixels there."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    rho = np.hypot(x - c[0], y - c[1])
    widths = np.bincount(np.rint(rho).astype(int).ravel(), weights=alpha.ravel())
    present = widths > _PRESENT * np.median(widths[widths > _PRESENT * widths.max()])
    present[: int(_NEAREST)] = False
    first, last = _longest(present)
    low, high = first + _TIP, last - _TIP
    mask = use & (rho >= low) & (rho <= high)
    if high - low < 2 * _TIP or not mask.any():
        raise MotionError(
            "no circle around the center of the turn shows all of the thing: it is too small, or does "
            "not turn about one point; give its center"
        )
    return (low, high), mask


def _longest(present: Bools) -> tuple[int, int]:
    """First and last index of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(int), [0]])))
    if len(edges) == 0:
        return 0, 0
    runs = edges.reshape(-1, 2)
    first, end = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(first), int(end) - 1


def _blades(pixels: _Pixels, c: Array, ring: tuple[float, float]) -> list[tuple[float, float]]:
    """Middle and width, radians, of what turns, as the mean over the ring has it."""
    profile = _profile(pixels, c, ring)
    level = (profile.max() + max(profile.min(), 0)) / 2
    inside = profile > level
    turned = int(np.flatnonzero(~inside)[0])
    inside, profile = np.roll(inside, -turned), np.roll(profile, -turned)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]]))).reshape(-1, 2)
    if len(edges) > _MOST_BLADES:
        raise MotionError(f"{len(edges)} parts on a circle are too many to tell from noise")
    found, step = [], 2 * np.pi / _GRID
    for k, (a, b) in enumerate(edges):
        before = (edges[k - 1][1] + a) // 2 if k else 0
        after = (b + edges[k + 1][0]) // 2 if k + 1 < len(edges) else _GRID
        width = float(profile[before:after].sum()) * step
        found.append(((a + b) / 2 * step + turned * step, max(width, step)))
    return found


def _profile(pixels: _Pixels, c: Array, ring: tuple[float, float]) -> Array:
    """(720,) alpha around the center, the mean over the ring; as smooth as makes it clear of noise.

    Raises
    ------
    MotionError
        If it is even.
    """
    from scipy.ndimage import gaussian_filter1d

    rho = np.hypot(pixels.x - c[0], pixels.y - c[1])
    phi = np.arctan2(pixels.y - c[1], pixels.x - c[0])
    which = np.floor((phi / (2 * np.pi)) * _GRID).astype(int) % _GRID
    weight = 1 / rho
    # Circles differ by far more than angles: which pixels of which circle a bin has must not show.
    uneven, usual = (
        pixels.alpha - _around(rho, pixels.alpha),
        np.average(pixels.alpha, weights=weight),
    )
    sums = [
        np.bincount(which, weights=w, minlength=_GRID)
        for w in (weight * uneven, weight, (weight * pixels.std) ** 2)
    ]
    smooth = max(1.5 * _GRID / (2 * np.pi * ring[1]), 2)  # 1.5 pixels at the outer rim
    while smooth < _COARSEST:
        above, below = (gaussian_filter1d(s, smooth, mode="wrap") for s in sums[:2])
        profile = np.asarray(usual + above / np.maximum(below, 1e-12))
        # The sum of squared Gaussian weights is 1 / (2 √π s).
        variance = sums[2].mean() / (2 * np.sqrt(np.pi) * smooth)
        error = float(np.sqrt(variance)) / max(float(below.mean()), 1e-12)
        varies = float(np.ptp(profile))
        if varies > max(_UNEVEN * float(profile.max()), _CLEAR * error):
            return profile
        smooth *= 2
    raise MotionError(_ALIKE)


def _around(rho: Array, alpha: Array) -> Array:
    """(n,) the mean of alpha over the circle that each pixel lies on."""
    ring = np.rint(rho).astype(int)
    count = np.maximum(np.bincount(ring), 1)
    where, mean = (np.bincount(ring, weights=v) / count for v in (rho, alpha))
    some = where > 0
    return np.interp(rho, where[some], mean[some])


@dataclass(frozen=True, eq=False)
class _Blades:
    """Parameters: the center unless it is known, ω, and for both edges of each blade its powers."""

    center: Array | None
    ring: tuple[float, float]
    blades: list[tuple[float, float]]

    def fit(self, pixels: _Pixels, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """Center and ω (3,); curvature (m, m) of the cost, those first; and residuals (n,).

        The center follows when the rest is nearly right: before, it would go anywhere.
        """
        one = np.linalg.solve(self._basis, np.eye(len(_POWERS))[_POWERS.index(0)])
        sides = [middle + half * width for middle, width in self.blades for half in (-0.5, 0.5)]
        start = np.concatenate([[omega], *(side * one for side in sides)])
        p, e, J = replace(self, center=c)._descended(start, pixels)
        if self.center is None:
            p, e, J = self._descended(np.concatenate([c, p]), pixels)
        at = p if self.center is None else np.concatenate([self.center, p])
        return at[:3], J.T @ J, e

    def _descended(self, p: Array, pixels: _Pixels) -> tuple[Array, Array, Array]:
        """Parameters, residuals and their derivatives after Levenberg–Marquardt steps.

        Large residuals count less (Huber's loss).
        """
        caution = 1e-3
        e, J = self._residuals(p, pixels)
        for _ in range(_STEPS):
            weight = 1 / np.maximum(np.abs(e) / _DOUBT, 1)
            H, g = (J * weight[:, None]).T @ J, J.T @ (weight * e)
            damped = H + caution * np.diag(np.diag(H)) + _LEAST * np.diag(H).max() * np.eye(len(p))
            step = np.linalg.solve(damped, g)
            tried = p - step / max(self._too_far(p, step), 1)
            e_tried, J_tried = self._residuals(tried, pixels)
            gain = float(_huber(e) - _huber(e_tried))
            if gain <= 0:
                caution *= 5
                continue
            p, e, J, caution = tried, e_tried, J_tried, max(caution / 5, 1e-8)
            if gain < _ENOUGH:
                break
        return p, e, J

    def _too_far(self, p: Array, step: Array) -> float:
        """By how much a step leaves the range of the linear: a ramp, or some pixels of the center."""
        free = 2 if self.center is None else 0
        turn, center = abs(step[free]) / (_RAMP * p[free]), np.abs(step[:free]).max(initial=0)
        edges = np.abs(step[free + 1 :]).max(initial=0) / (_RAMP * p[free])
        return float(max(turn, center / _FAR, edges))

    def _residuals(self, p: Array, pixels: _Pixels) -> tuple[Array, Array]:
        alpha, J = self._alpha(p, pixels)
        return (alpha - pixels.alpha) / pixels.std, J / pixels.std[:, None]

    @property
    def _basis(self) -> Array:
        """(k, k) sums of the powers of ρ that differ from each other as much as can be in the ring."""
        rho = np.linspace(*self.ring, _GRID) / np.mean(self.ring)
        triangle = np.linalg.qr(rho[:, None] ** np.array(_POWERS, float))[1]
        return np.asarray(np.linalg.inv(triangle) * np.sqrt(_GRID))

    def _alpha(self, p: Array, pixels: _Pixels) -> tuple[Array, Array]:
        """Alpha (n,) and its derivatives (n, m)."""
        free = 2 if self.center is None else 0
        c, omega = (p[:2] if free else self.center), max(float(p[free]), 1e-6)
        assert c is not None
        dx, dy = pixels.x - c[0], pixels.y - c[1]
        rho, phi = np.hypot(dx, dy), np.arctan2(dy, dx)
        unit = sum(self.ring) / 2
        powers = np.stack([(rho / unit) ** k for k in _POWERS], axis=1) @ self._basis
        by_rho = np.stack([k * (rho / unit) ** (k - 1) / unit for k in _POWERS], axis=1)
        by_rho = by_rho @ self._basis
        alpha, J = np.zeros(len(rho)), np.zeros((len(rho), len(p)))
        m = len(_POWERS)
        for i, (middle, _) in enumerate(self.blades):
            near = middle + np.angle(np.exp(1j * (phi - middle)))
            for side, sign in ((0, 1), (1, -1)):
                first = free + 1 + (2 * i + side) * m
                edge = p[first : first + m]
                u = near - powers @ edge
                F, by_u, by_omega = _ramp(u, omega, 1 / rho)
                alpha += sign * F
                J[:, first : first + m] -= sign * by_u[:, None] * powers
                J[:, free] += sign * by_omega
                if free:
                    bend = by_rho @ edge
                    J[:, 0] += sign * by_u * (dy / rho**2 + bend * dx / rho)
                    J[:, 1] += sign * by_u * (-dx / rho**2 + bend * dy / rho)
        return alpha, J


def _huber(e: Array) -> float:
    """Half the sum of squares, but for what is beyond doubt."""
    far = np.maximum(np.abs(e) - _DOUBT, 0)
    return float(np.sum(e**2 - far**2)) / 2


def _ramp(u: Array, omega: float, pixel: Array) -> tuple[Array, Array, Array]:
    """How much of the exposure, in the mean over a pixel, an edge had passed that is u behind.

    The integral of a box of width ω blurred by one of the pixel's width, over all turns: 0 long
    before the edge, 1 after it, and derivatives by u and ω. The silhouette comes round again with every
    full turn, so that a blade, the difference of two of these, wraps around.
    """
    F, by_u, by_omega = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)
    reach = (omega + pixel.max()) / 2
    turns = int(np.ceil((reach + np.pi) / (2 * np.pi)))
    for k in range(-turns, turns + 1):
        v = u + 2 * np.pi * k
        corners = [v + (a * omega + b * pixel) / 2 for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        q = [np.maximum(corner, 0) for corner in corners]
        box = omega * pixel
        part = (q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2) / (2 * box)
        F += part
        by_u += (q[0] - q[1] - q[2] + q[3]) / box
        by_omega += (q[0] - q[1] + q[2] - q[3]) / (2 * box) - part / omega
    return F, by_u, by_omega

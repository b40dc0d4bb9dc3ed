"""The fit of a rotation: the ring in which the whole object is visible, starts, and its blades.

Where an edge passed, alpha is a ramp of slope 1/ω along circles, for any outline and at all distances
from the center c:

    (x − c) × ∇α = ± 1/ω ,                                                                    (1)

which is linear in c and in 1/ω.

Each blade of a rigid object lies between two curves φ(ρ), sums of a few powers of ρ. Alpha of a pixel
is the difference of two ramps of width ω, both averaged over the pixel's angular width 1/ρ.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Indices
from blurmatte.descent import descended
from blurmatte.errors import MotionError

GRID = 720  # angles of a full turn
NO_VARIATION = (
    "alpha does not vary along circles around the center. The object may be round, or have turned by a "
    "multiple of 360°, of 180° if it is a stick with two ends, or of 360°/n if it has n blades; the "
    "picture does not show which. Expose shorter"
)


# Where the whole object is visible, and when alpha varies around the center.
_MIN_RADIUS_PX = 4.0  # smaller circles have too few pixels to resolve angles
_MIN_WIDTH = 0.4  # of the median sum of alpha along a circle: the object is still there
_END_MARGIN_PX = 2.5  # left out at both ends of the object
_MAX_BLADES = 12
_MIN_VARIATION_STD = 16.0  # standard deviations of alpha around the center
_MIN_VARIATION = 0.1  # of the largest alpha around the center
_MAX_SMOOTHING = 32.0  # of `GRID` angles: a wider Gaussian would hide blades
# The random sample consensus that solves (1).
_SMOOTHING_PX = 2.0  # standard deviation of the Gaussian for gradients
_SAMPLES = 400  # of three pixels each
_TOLERANCE = 0.25  # of 1/ω, for (1) in a pixel that agrees
_MIN_GRADIENT_STD = 4.0  # standard deviations of the gradient of a pixel on a ramp
_SPACINGS = (0.85, 1.15, 1.7, 2.2)  # angles between blades: paths overlap
# Of ρ: −1 and −3 describe straight edges that miss the center, 2 describes curved edges.
_POWERS = (-3.0, -1.0, 0.0, 1.0, 2.0)


# The descent of a fit of blades.
_MAX_STEPS = 60
_MIN_GAIN = 1e-2  # log likelihood: the fit has converged
_MAX_TURN_STEP = 0.5  # of ω, for ω and the edges: the range of the linearization
_MAX_CENTER_STEP_PX = 5.0
_HUBER_RESIDUAL = 3.0  # standard deviations: larger residuals have the linear loss


@dataclass(frozen=True, eq=False)
class RingPixels:
    """Alpha of pixels (n,) at x, y, and its standard deviation."""

    x: Array
    y: Array
    alpha: Array
    std: Array


@dataclass(frozen=True, eq=False)
class AlphaMap:
    """Alpha of a picture (H, W), its standard deviation, and where both are known."""

    alpha: Array
    std: Array
    use: Bools

    def at(self, y: Indices, x: Indices) -> RingPixels:
        """The pixels at indices y and x, (n,) both."""
        return RingPixels(x.astype(float), y.astype(float), self.alpha[y, x], self.std[y, x])


def ring_around(seen: AlphaMap, c: Array) -> tuple[tuple[float, float], Bools]:
    """Inner and outer radius between which the whole object is visible, and the mask of the ring."""
    alpha = seen.alpha
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    rho = np.hypot(x - c[0], y - c[1])
    widths = np.bincount(np.rint(rho).astype(int).ravel(), weights=alpha.ravel())
    present = widths > _MIN_WIDTH * np.median(widths[widths > _MIN_WIDTH * widths.max()])
    present[: int(_MIN_RADIUS_PX)] = False
    first, last = _longest(present)
    low, high = first + _END_MARGIN_PX, last - _END_MARGIN_PX
    mask = seen.use & (rho >= low) & (rho <= high)
    if high - low < 2 * _END_MARGIN_PX or not mask.any():
        raise MotionError(
            "no circle around the center of rotation shows the whole object: it is too small, or does "
            "not turn about one point; give its center"
        )
    return (low, high), mask


def _longest(present: Bools) -> tuple[int, int]:
    """First and last index of the longest run of True."""
    runs = _runs(present)
    if len(runs) == 0:
        return 0, 0
    first, end = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(first), int(end) - 1


def _runs(present: Bools) -> Indices:
    """(k, 2) beginnings and ends of the runs of True."""
    return np.flatnonzero(np.diff(present.astype(int), prepend=0, append=0)).reshape(-1, 2)


def blades_of(pixels: RingPixels, c: Array, ring: tuple[float, float]) -> list[tuple[float, float]]:
    """Middle and width, radians, of each blade in the mean over the ring."""
    profile = _profile(pixels, c, ring)
    level = (profile.max() + max(profile.min(), 0)) / 2
    inside = profile > level
    turned = int(np.flatnonzero(~inside)[0])
    inside, profile = np.roll(inside, -turned), np.roll(profile, -turned)
    edges = _runs(inside)
    if len(edges) > _MAX_BLADES:
        raise MotionError(f"{len(edges)} blades on a circle cannot be distinguished from noise")
    found, step = [], 2 * np.pi / GRID
    for k, (a, b) in enumerate(edges):
        before = (edges[k - 1][1] + a) // 2 if k else 0
        after = (b + edges[k + 1][0]) // 2 if k + 1 < len(edges) else GRID
        width = float(profile[before:after].sum()) * step
        found.append(((a + b) / 2 * step + turned * step, max(width, step)))
    return found


def _profile(pixels: RingPixels, c: Array, ring: tuple[float, float]) -> Array:
    """(720,) mean of alpha over the ring at each angle, with the least smoothing that is significant.

    Raises MotionError if alpha does not vary.
    """
    rho = np.hypot(pixels.x - c[0], pixels.y - c[1])
    phi = np.arctan2(pixels.y - c[1], pixels.x - c[0])
    which = np.floor((phi / (2 * np.pi)) * GRID).astype(int) % GRID
    weight = 1 / rho
    # Alpha varies more between circles than along them: subtract the mean of each circle.
    relative = pixels.alpha - _circle_means(rho, pixels.alpha)
    mean = np.average(pixels.alpha, weights=weight)
    sums = [
        np.bincount(which, weights=w, minlength=GRID)
        for w in (weight * relative, weight, (weight * pixels.std) ** 2)
    ]
    smooth = max(1.5 * GRID / (2 * np.pi * ring[1]), 2)  # 1.5 pixels at the outer radius
    while smooth < _MAX_SMOOTHING:
        above, below = (scipy.ndimage.gaussian_filter1d(s, smooth, mode="wrap") for s in sums[:2])
        profile = np.asarray(mean + above / np.maximum(below, 1e-12))
        # The sum of squared Gaussian weights is 1 / (2 √π s).
        variance = sums[2].mean() / (2 * np.sqrt(np.pi) * smooth)
        error = float(np.sqrt(variance)) / max(float(below.mean()), 1e-12)
        least = max(_MIN_VARIATION * float(profile.max()), _MIN_VARIATION_STD * error)
        if float(np.ptp(profile)) > least:
            return profile
        smooth *= 2
    raise MotionError(NO_VARIATION)


def _circle_means(rho: Array, alpha: Array) -> Array:
    """(n,) mean of alpha over the circle of each pixel."""
    ring = np.rint(rho).astype(int)
    count = np.maximum(np.bincount(ring), 1)
    where, mean = (np.bincount(ring, weights=v) / count for v in (rho, alpha))
    some = where > 0
    return np.interp(rho, where[some], mean[some])


def starts(seen: AlphaMap, center: Array | None) -> Iterator[tuple[Array, float, float | None]]:
    """Centers, angles in radians, and None or the angle in units of the angle between blades.

    The centroid of alpha, which is right for most fans, and the solution of (1). Where the paths of
    blades overlap (1) does not hold, and angles around the multiples of that between blades are tried.
    """
    c, slope = _start(seen, center)
    if center is None:
        (y, x), weight = np.nonzero(seen.use), seen.alpha[seen.use]
        middle = np.array([x, y]) @ weight / max(float(weight.sum()), 1.0)
        yield middle, min(1 / _start(seen, middle)[1], 2 * np.pi), None
    else:
        middle = center
    yield c, min(1 / slope, 2 * np.pi), None
    for spacings in _SPACINGS:
        yield middle, 0.0, spacings


def _start(seen: AlphaMap, center: Array | None) -> tuple[Array, float]:
    """The center and 1/ω for which (1) holds in the most pixels."""
    scale, use, std = _SMOOTHING_PX, seen.use, seen.std
    gy, gx = (scipy.ndimage.gaussian_filter(seen.alpha, scale, order=o) for o in ((1, 0), (0, 1)))
    # Independent noise σ gives the derivative of a Gaussian the error σ / (√(8π) s²).
    noise = float(np.median(std[use])) / (np.sqrt(8 * np.pi) * scale**2) if use.any() else 1.0
    steep = use & (np.hypot(gx, gy) > _MIN_GRADIENT_STD * noise)
    y, x = np.nonzero(steep)
    if len(x) < 3:
        raise MotionError("alpha hardly varies: no rotation, or full turns; use a shorter exposure")
    gx, gy = gx[steep], gy[steep]
    # c_x g_y − c_y g_x + s/ω = x g_y − y g_x, s = ±1
    A, b = np.column_stack([gy, -gx]), x * gy - y * gx
    best, score = (np.zeros(2), 0.0), -1.0
    for c, slope in _candidates(A, b, center):
        d = np.abs(b - A @ c)
        agree = np.abs(d / slope - 1) < _TOLERANCE
        if agree.sum() > score:
            best, score = (c, slope), float(agree.sum())
    c, slope = best
    for _ in range(10):
        d = b - A @ c
        ramp = np.abs(np.abs(d) / slope - 1) < _TOLERANCE
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
    """Centers and 1/ω > 0 from three pixels each, or from one if the center is known; seeded."""
    rng = np.random.default_rng(0)
    for _ in range(_SAMPLES):
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


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters, residuals in standard deviations, and their derivatives, in a search."""

    p: Array
    e: Array
    J: Array

    @property
    def cost(self) -> float:
        """Huber's loss: Student's t has almost no slope where a start is far off."""
        return float(scipy.special.huber(_HUBER_RESIDUAL, self.e).sum())

    def information(self) -> tuple[Array, Array]:
        """Curvature (m, m) and gradient (m,) of the cost."""
        weight = 1 / np.maximum(np.abs(self.e) / _HUBER_RESIDUAL, 1)
        return (self.J * weight[:, None]).T @ self.J, self.J.T @ (weight * self.e)


@dataclass(frozen=True, eq=False)
class Blades:
    """Parameters: the center unless it is known, ω, and coefficients of both edges of each blade."""

    center: Array | None
    ring: tuple[float, float]
    blades: list[tuple[float, float]]

    def fit(self, pixels: RingPixels, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """Center and ω (3,); curvature (m, m) of the cost, in this order; and residuals (n,).

        The center is fitted last: before, it is not well determined.
        """
        one = np.linalg.solve(self._basis, np.eye(len(_POWERS))[_POWERS.index(0)])
        sides = [middle + half * width for middle, width in self.blades for half in (-0.5, 0.5)]
        start = np.concatenate([[omega], *(side * one for side in sides)])
        p, e, J = replace(self, center=c)._descended(start, pixels)
        if self.center is None:
            p, e, J = self._descended(np.concatenate([c, p]), pixels)
        at = p if self.center is None else np.concatenate([self.center, p])
        return at[:3], J.T @ J, e

    def _descended(self, p: Array, pixels: RingPixels) -> tuple[Array, Array, Array]:
        """Parameters, residuals and their derivatives at the minimum of Huber's loss."""

        def moved(point: _Point, step: Array) -> _Point:
            """A step, shortened to where alpha is about linear."""
            p = point.p + step / max(self._step_excess(point.p, step), 1)
            return _Point(p, *self._residuals(p, pixels))

        start = _Point(p, *self._residuals(p, pixels))
        found, _ = descended(start, _Point.information, moved, _MAX_STEPS, _MIN_GAIN)
        return found.p, found.e, found.J

    def _step_excess(self, p: Array, step: Array) -> float:
        """Size of a step over the largest that is allowed."""
        free = 2 if self.center is None else 0
        largest = _MAX_TURN_STEP * p[free]
        center = np.abs(step[:free]).max(initial=0) / _MAX_CENTER_STEP_PX
        edges = np.abs(step[free + 1 :]).max(initial=0) / largest
        return float(max(abs(step[free]) / largest, center, edges))

    def _residuals(self, p: Array, pixels: RingPixels) -> tuple[Array, Array]:
        alpha, J = self._alpha(p, pixels)
        return (alpha - pixels.alpha) / pixels.std, J / pixels.std[:, None]

    @property
    def _basis(self) -> Array:
        """(k, k) combinations of the powers of ρ that are orthogonal in the ring."""
        rho = np.linspace(*self.ring, GRID) / np.mean(self.ring)
        triangle = np.linalg.qr(rho[:, None] ** np.array(_POWERS, float))[1]
        return np.asarray(np.linalg.inv(triangle) * np.sqrt(GRID))

    def _alpha(self, p: Array, pixels: RingPixels) -> tuple[Array, Array]:
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
                F, by_u, by_omega = ramp(u, omega, 1 / rho)
                alpha += sign * F
                J[:, first : first + m] -= sign * by_u[:, None] * powers
                J[:, free] += sign * by_omega
                if free:
                    bend = by_rho @ edge
                    J[:, 0] += sign * by_u * (dy / rho**2 + bend * dx / rho)
                    J[:, 1] += sign * by_u * (-dx / rho**2 + bend * dy / rho)
        return alpha, J


def ramp(u: Array, omega: float, pixel: Array) -> tuple[Array, Array, Array]:
    """Fraction of the exposure after an edge has passed the angle u, mean over a pixel; derivatives.

    The integral of a box of width ω convolved with one of the pixel's width: 0 long before the edge, 1
    after it; and its derivatives by u and ω. It is summed over full turns, so that a blade, the
    difference of two ramps, is periodic.
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

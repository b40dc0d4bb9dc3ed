"""Likelihood of directions of the color line from the pixels of a streak, and their posterior.

In this file, per pixel of the streak, C is the image's light, B the plate's, l a candidate for the
unit direction of the color line, w = B − (B·l) l the plate's component perpendicular to it, and

    α = 1 − C·w / |w|²          k = (C − (1 − α)B)·l          P = k l

is the closed-form solution. Its residual is the component of C along n = l × B / |l × B|,

    r = n·C = l·(B × C) / |l × B|          s² = Σ n²(σ_C² + (1 − α)²σ_B²).

*Hue variation*: for the true l, r / s is a standard normal variable at every pixel, for any α and k.
The published sum of squares of l·(B × C) lacks the denominators; with noise its minimum is the plate's
color. Standardized, noise prefers no direction.
*Feasibility*: 0 <= α <= 1, and P is neither negative nor brighter than a bound.

Both are log likelihoods, so they add.

A direction is a unit vector of non-negative light, and its cost −2 times the log of its
likelihood. Mean and covariance are sums over a grid of directions that adapts to the posterior. For a
plate of one hue the posterior is an arc from the plate's color to the truth and beyond.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Indices
from blurmatte.color.model import perpendicular, unit

_OUTLIER_STD = 3.0  # standard deviations beyond which the loss is linear
_EFFICIENCY = 1.131  # E[ψ′] / E[ψ²] over normal z, with ψ half the slope of that loss
SLACK = 0.02  # alpha by which an error of the plate may leave 0…1
_END_CHI2 = 9.0  # least at the ends of a grid: the posterior may rise again beyond a lower one


@dataclass(frozen=True, eq=False)
class StreakPixels:
    """The streak's pixels as columns: light, noise variances, and the block and tile of each.

    Sorted by block, and within blocks by tile: a selection of pixels and no `PixelBox`, which has them
    all, in rows.
    """

    C: Array  # (n, 3)
    B: Array  # (n, 3)
    vC: Array  # (n, 3)
    vB: Array  # (n, 3)
    block: Indices  # (n,) over which noise may be correlated
    tile: Indices  # (n,) over which alpha is nearly constant
    neighbors: tuple[Indices, Indices]  # adjacent blocks

    def every(self, step: int) -> "StreakPixels":
        """Every `step`-th pixel."""
        columns = (self.C, self.B, self.vC, self.vB)
        C, B, vC, vB = (a[::step] for a in columns)
        return StreakPixels(C, B, vC, vB, self.block[::step], self.tile[::step], self.neighbors)


@dataclass(frozen=True, eq=False)
class _Solutions:
    """The closed form for every direction and pixel, (directions, pixels) each."""

    n: Array  # (3, directions, pixels) unit vectors perpendicular to l and B
    r: Array  # residual, light
    r_std: Array
    alpha: Array
    alpha_std: Array
    k: Array
    k_std: Array
    transmission: Array  # 1 − α, mean of a tile


def closed_form(l: Array, p: StreakPixels) -> _Solutions:
    """The closed form for every direction l, (directions, 3), and pixel."""
    B_l, C_l = l @ p.B.T, l @ p.C.T
    across = np.stack([np.cross(l, axis) for axis in np.eye(3)])  # l × B = Σ B_c (l × e_c)
    n = np.einsum("cgi,pc->igp", across, p.B)  # (3, directions, pixels)
    length = np.sqrt(np.sum(n**2, axis=0)) + 1e-15
    n /= length
    alpha = 1 - (np.sum(p.C * p.B, axis=1) - C_l * B_l) / length**2
    k = C_l - (1 - alpha) * B_l
    transmission = 1 - np.clip(_means(alpha, length**2, p.tile), 0, 1)
    transmission2 = transmission**2
    w = (p.B.T[:, None, :] - l.T[:, :, None] * B_l) / length
    r_std, w_std, l_std = (
        np.sqrt(
            np.einsum("igp,pi->gp", d**2, p.vC)
            + transmission2 * np.einsum("igp,pi->gp", d**2, p.vB)
        )
        for d in (n, w, np.broadcast_to(l.T[:, :, None], n.shape))
    )
    r = (l @ np.cross(p.B, p.C).T) / length
    alpha_std = w_std / length
    return _Solutions(
        n, r, r_std, alpha, alpha_std, k, np.hypot(l_std, B_l * alpha_std), transmission
    )


def _means(alpha: Array, weight: Array, tile: Indices) -> Array:
    """(directions, pixels) weighted mean of α over each pixel's tile.

    The α of a single pixel, clipped to 0…1, would bias the variance by its noise, for some directions
    more than for others, which would look like evidence. So would the mean over larger areas, where α
    varies.
    """
    first = np.flatnonzero(np.diff(tile, prepend=-1))
    sums, weights = (np.add.reduceat(x, first, axis=1) for x in (alpha * weight, weight))
    return np.repeat(sums / (weights + 1e-30), np.diff(first, append=len(tile)), axis=1)


@dataclass(frozen=True)
class EvidenceKinds:
    """The kinds of evidence to use, and the bound of brightness."""

    hue: bool
    feasibility: bool
    max_brightness: float

    def cost(self, a: _Solutions, l: Array) -> Array:
        """(directions, pixels) −2 log likelihood, with linear tails for outliers."""
        cost = np.zeros_like(a.r)
        if self.hue:
            cost += _bounded(a.r / a.r_std)
        if self.feasibility:
            cost += _infeasibility(a, l, self.max_brightness)
        return cost


def _infeasibility(a: _Solutions, l: Array, max_brightness: float) -> Array:
    """(directions, pixels) cost of α, P or brightness outside the feasible range by more than noise."""
    beyond = [(np.maximum(-a.alpha, a.alpha - 1) - SLACK) / a.alpha_std, -a.k / a.k_std]
    if np.isfinite(max_brightness):
        brightest = l.max(axis=1)[:, None]
        excess = a.k * brightest - max_brightness * np.maximum(a.alpha, 0)
        beyond.append(excess / np.hypot(a.k_std * brightest, max_brightness * a.alpha_std))
    # Two standard deviations outside may be noise.
    return _bounded(np.sqrt(sum(np.maximum(z - 2, 0) ** 2 for z in beyond)))


def _bounded(z: Array) -> Array:
    """z² for small z, linear for outliers; scaled to give the right variances for normal z."""
    return np.asarray(
        _EFFICIENCY * 2 * _OUTLIER_STD**2 * (np.sqrt(1 + (z / _OUTLIER_STD) ** 2) - 1)
    )


def excess_cost(evidence: EvidenceKinds, l: Array, p: StreakPixels, phi: float) -> Array:
    """(directions,) χ² of each direction relative to the best of them.

    The excess Δ of a direction's cost over the least is a true difference λ plus noise of variance V
    independent of it: the residuals of two directions at a pixel are correlated by ρ < 1. If the
    direction were the truth, Δ would have the mean −λ and the variance 4λ + V. The most favorable λ
    gives

        χ² = Δ² / V          for Δ < V / 2
             Δ − V / 4       beyond,                  V = Σ 4(1 − ρ²).

    Both are divided by the variance inflation φ, `phi`; see `misfit`.
    """
    a = closed_form(l, p)
    cost = evidence.cost(a, l)
    best = np.argmin(cost.sum(axis=1))
    delta = np.sum(cost - cost[best], axis=1)
    if not evidence.hue:
        return np.asarray(delta / phi)
    both = a.n * a.n[:, best : best + 1]
    shared = np.einsum("igp,pi->gp", both, p.vC)
    shared += a.transmission * a.transmission[best] * np.einsum("igp,pi->gp", both, p.vB)
    rho = shared / (a.r_std * a.r_std[best])
    V = 4 * phi * np.sum(np.maximum(1 - rho**2, 0), axis=1) + 1e-12
    # An error of the plate's noise variance, here 30 %, is common to all pixels.
    plate = a.transmission**2 * np.einsum("igp,pi->gp", a.n**2, p.vB) / a.r_std**2
    V += (0.3 * np.sum(plate - plate[best], axis=1)) ** 2
    return np.asarray(np.where(delta < V / 2, delta**2 / V, delta - V / 4) / phi)


def misfit(l: Array, p: StreakPixels) -> float:
    """Variance inflation of the estimate by correlated residuals; 1 or more.

    The sums of z = r / s over blocks have φ times the variance of independent pixels if noise is
    correlated (JPEG) or the model has errors (a highlight, a second paint, a shadow). Model errors are
    similar from block to block and do not average out: the correlation of adjacent blocks, plus one
    standard deviation of it, estimates the part common to all blocks. l (3,) is the best direction.
    """
    solution = closed_form(l[None], p)
    z = np.clip(solution.r / solution.r_std, -_OUTLIER_STD, _OUTLIER_STD)[0]
    sums = np.bincount(p.block, z)
    phi = max(1.0, float(np.sum(sums**2)) / len(z))
    first, second = p.neighbors
    shared = np.sum(sums[first] * sums[second])
    both = np.sqrt(np.sum(sums[first] ** 2) * np.sum(sums[second] ** 2)) + 1e-12
    correlation = float(shared / both) + 1 / np.sqrt(max(len(first), 1))
    significant = np.clip(phi - 1 - 2 * np.sqrt(2 / len(sums)), 0, 1)
    common = min(max(correlation, 0.0), 1.0) * significant
    return float(phi * (1 + (len(sums) - 1) * common))


def posterior(evidence: EvidenceKinds, pixels: StreakPixels) -> tuple[Array, Array]:
    """Mean direction and (3, 3) covariance of the posterior.

    A grid of directions around the best one is rotated and scaled until it reaches four standard
    deviations on both sides along both principal axes. Along a narrow valley, as for a plate of one
    hue, the grid first adapts to its width and then grows along it.
    """
    best = _best_direction(evidence, pixels)
    phi = misfit(best, pixels)
    center, axes, half = best, perpendicular(best), np.full(2, np.radians(1.0))
    widest = best, np.zeros((3, 3))
    for _ in range(60):
        patch, at_end = _patch(center, axes, half)
        grid = np.vstack([best, patch])
        cost = excess_cost(evidence, grid, pixels, phi)
        mean, covariance = _moments(grid, cost)
        open_ends = np.array([np.any(cost[1:][end] < _END_CHI2 + cost.min()) for end in at_end])
        spread, turned = np.linalg.eigh(axes.T @ covariance @ axes)
        reach = half[_order(turned)]
        std = np.sqrt(np.maximum(spread, (half.max() / 1e6) ** 2))
        offset = np.abs((mean - center) @ axes @ turned)
        far_enough = ~open_ends[_order(turned)]
        if np.all(far_enough & (std > reach / 8) & (std < reach / 3) & (offset < reach / 4)):
            return mean, covariance
        if np.trace(covariance) > np.trace(widest[1]):
            widest = mean, covariance
        if half.max() > 1:
            break
        center, axes = _moved(axes @ turned, mean)
        half = np.clip(4 * std, np.where(far_enough, reach / 4, 1.5 * reach), 3 * reach)
    return widest  # a valley too long or too narrow for a grid: the part covered


def _order(turned: Array) -> Indices:
    """Index of the old axis nearest to each new one."""
    order: Indices = np.argmax(np.abs(turned), axis=0)
    return order


def _moved(axes: Array, to: Array) -> tuple[Array, Array]:
    """The new center, and the axes projected perpendicular to it."""
    first = unit(axes[:, 1] - (axes[:, 1] @ to) * to)
    return to, np.stack([np.cross(to, first), first], axis=1)


def _best_direction(evidence: EvidenceKinds, pixels: StreakPixels) -> Array:
    """The direction of least cost: a grid search, then local refinement of three minima."""
    few = pixels.every(max(1, len(pixels.C) // 500))
    grid = _octant(2.0)
    total = evidence.cost(closed_form(grid, few), grid).sum(axis=1)
    found = []
    for _ in range(3):
        start = grid[np.argmin(total)]
        total[grid @ start > np.cos(np.radians(15))] = np.inf
        found.append(_refined(evidence, few, start, 1.5))
    return _refined(evidence, pixels, min(found, key=lambda f: f[1])[0], 0.1)[0]


def _refined(
    evidence: EvidenceKinds, pixels: StreakPixels, start: Array, reach: float
) -> tuple[Array, float]:
    """A local minimum of the cost near `start`, and its cost; `reach` is the first step, degrees.

    Nelder and Mead's search needs no derivatives, which the cost has none of at bounds of the light.
    """
    tangent = perpendicular(start)

    def cost(x: Array) -> float:
        """Negative log likelihood of a direction; infinite for negative light."""
        l = unit(start + tangent @ x)[None]
        return float(evidence.cost(closed_form(l, pixels), l).sum()) if l.min() >= 0 else np.inf

    simplex = np.radians(reach) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-4}
    found = scipy.optimize.minimize(cost, np.zeros(2), method="Nelder-Mead", options=options)
    return unit(start + tangent @ found.x), float(found.fun)


def _octant(step: float) -> Array:
    """(g, 3) unit directions of non-negative light about `step` degrees apart."""
    theta = np.radians(np.arange(step / 2, 90, step))  # from the blue axis
    count = np.maximum(1, np.rint(90 * np.sin(theta) / step)).astype(int)
    t = np.repeat(theta, count)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    phi = (nth + 0.5) * np.pi / 2 / np.repeat(count, count)
    return np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=1)


def _patch(center: Array, axes: Array, half: Array) -> tuple[Array, Bools]:
    """Grid of directions of non-negative light, and (2, g) which are at the ends of each axis.

    It extends by `half` to both sides of the center along the two axes, in gnomonic projection: great
    circles, and the valleys of plates of one hue, are straight lines.
    """
    steps = np.linspace(-1, 1, 17)
    uv = np.stack([x.ravel() for x in np.meshgrid(steps, steps)])
    moved = center + (half[:, None] * uv).T @ axes.T
    lit = (moved >= 0).all(axis=1)
    grid = moved[lit]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True)), np.abs(uv[:, lit]) == 1


def _moments(grid: Array, cost: Array) -> tuple[Array, Array]:
    """Mean direction and covariance under exp(−cost / 2)."""
    weight = np.asarray(np.exp(-0.5 * (cost - cost.min())))
    weight /= weight.sum()
    center = unit(weight @ grid)
    away = grid - center
    return center, np.asarray((away * weight[:, None]).T @ away)

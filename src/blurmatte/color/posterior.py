"""Posterior mean and covariance of the direction of a color line.

In this file a direction is a unit vector of non-negative light, and its cost −2 times the log of its
likelihood. Mean and covariance are sums over a grid of directions that adapts to the posterior. For a
plate of one hue the posterior is an arc from the plate's color to the truth and beyond.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Bools
from blurmatte.color.evidence import Evidence, Pixels, closed_form, excess_cost, misfit
from blurmatte.color.model import perpendicular

_END_CHI2 = 9.0  # least at the ends of a grid: the posterior may rise again beyond a lower one


def posterior(evidence: Evidence, pixels: Pixels) -> tuple[Array, Array]:
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


def _order(turned: Array) -> npt.NDArray[np.intp]:
    """Index of the old axis nearest to each new one."""
    order: npt.NDArray[np.intp] = np.argmax(np.abs(turned), axis=0)
    return order


def _moved(axes: Array, to: Array) -> tuple[Array, Array]:
    """The new center, and the axes projected perpendicular to it."""
    first = unit(axes[:, 1] - (axes[:, 1] @ to) * to)
    return to, np.stack([np.cross(to, first), first], axis=1)


def _best_direction(evidence: Evidence, pixels: Pixels) -> Array:
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


def _refined(evidence: Evidence, pixels: Pixels, start: Array, reach: float) -> tuple[Array, float]:
    """A local minimum of the cost near `start`, and its cost; `reach` is the first step, degrees."""
    from scipy.optimize import minimize

    tangent = perpendicular(start)

    def cost(x: Array) -> float:
        """Negative log likelihood of a direction; infinite for negative light."""
        l = unit(start + tangent @ x)[None]
        return float(evidence.cost(closed_form(l, pixels), l).sum()) if l.min() >= 0 else np.inf

    simplex = np.radians(reach) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-4}
    found = minimize(cost, np.zeros(2), method="Nelder-Mead", options=options)
    return unit(start + tangent @ found.x), float(found.fun)


def _octant(step: float) -> Array:
    """(g, 3) unit directions of non-negative light about `step` degrees apart."""
    theta = np.radians(np.arange(step / 2, 90, step))  # from the blue axis
    count = np.maximum(1, np.rint(90 * np.sin(theta) / step)).astype(int)
    t = np.repeat(theta, count)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    phi = (nth + 0.5) * np.pi / 2 / np.repeat(count, count)
    return np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=1)


def _patch(center: Array, axes: Array, half: Array, count: int = 17) -> tuple[Array, Bools]:
    """Grid of directions of non-negative light, and (2, g) which are at the ends of each axis.

    It extends by `half` to both sides of the center along the two axes, in gnomonic projection: great
    circles, and the valleys of plates of one hue, are straight lines.
    """
    steps = np.linspace(-1, 1, count)
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


def unit(v: Array) -> Array:
    """The vector scaled to length 1."""
    return np.asarray(v / np.linalg.norm(v))

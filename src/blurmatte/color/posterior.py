"""What a likelihood of directions leaves possible: its mean and covariance.

In this file a direction is a unit vector of non-negative light, and the cost of one −2 times the log
of its likelihood. The mean and the covariance are sums over a grid of directions that adapts to what
is possible. A plate of one hue leaves an arc from the plate's color to the truth and beyond.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.color.evidence import Array, Evidence, Pixels, closed_form, implausibility, misfit

Bools = npt.NDArray[np.bool_]

# χ² at the ends of a grid: what is below may be the beginning of more that is possible, for further
# away noise explains more of a difference.
_EXCLUDED = 9.0
_FARTHER = 1.5  # times as far


def posterior(evidence: Evidence, pixels: Pixels) -> tuple[Array, Array]:
    """Mean direction and (3, 3) covariance of what the cost leaves possible.

    A grid of directions around the best one is turned and stretched until it reaches four standard
    deviations either way along both axes of the spread. Where the spread is a narrow valley, as
    before a plate of one hue, the grid first finds its width and then grows along it.
    """
    best = _best_direction(evidence, pixels)
    phi = misfit(best, pixels)
    center, axes, half = best, _tangent(best), np.full(2, np.radians(1.0))
    widest = best, np.zeros((3, 3))
    for _ in range(60):
        patch, at_end = _patch(center, axes, half)
        grid = np.vstack([best, patch])
        cost = implausibility(evidence, grid, pixels, phi)
        mean, covariance = _moments(grid, cost)
        open_ends = np.array([np.any(cost[1:][end] < _EXCLUDED + cost.min()) for end in at_end])
        spread, turned = np.linalg.eigh(axes.T @ covariance @ axes)
        reach = half[_order(turned)]
        std = np.sqrt(np.maximum(spread, (half.max() / 1e6) ** 2))
        aside = np.abs((mean - center) @ axes @ turned)
        far_enough = ~open_ends[_order(turned)]
        if np.all(far_enough & (std > reach / 8) & (std < reach / 3) & (aside < reach / 4)):
            return mean, covariance
        if np.trace(covariance) > np.trace(widest[1]):
            widest = mean, covariance
        if half.max() > 1:
            break
        center, axes = _moved(axes @ turned, mean)
        half = np.clip(4 * std, np.where(far_enough, reach / 4, _FARTHER * reach), 3 * reach)
    return widest  # a valley too long or too narrow for any grid: what was seen of it


def _order(turned: Array) -> npt.NDArray[np.intp]:
    """Which old axis each new one mostly is."""
    order: npt.NDArray[np.intp] = np.argmax(np.abs(turned), axis=0)
    return order


def _moved(axes: Array, to: Array) -> tuple[Array, Array]:
    """The new center, and the axes made perpendicular to it."""
    first = unit(axes[:, 1] - (axes[:, 1] @ to) * to)
    return to, np.stack([np.cross(to, first), first], axis=1)


def _best_direction(evidence: Evidence, pixels: Pixels) -> Array:
    """The least cost over all directions of non-negative light: a grid, then a polish."""
    few = pixels.every(max(1, len(pixels.C) // 500))
    grid = _octant(2.0)
    total = evidence.cost(closed_form(grid, few), grid).sum(axis=1)
    found = []
    for _ in range(3):
        start = grid[np.argmin(total)]
        total[grid @ start > np.cos(np.radians(15))] = np.inf
        found.append(_polished(evidence, few, start, 1.5))
    return _polished(evidence, pixels, min(found, key=lambda f: f[1])[0], 0.1)[0]


def _polished(
    evidence: Evidence, pixels: Pixels, start: Array, reach: float
) -> tuple[Array, float]:
    """The direction of least cost near another one, about `reach` degrees around; and that cost."""
    from scipy.optimize import minimize

    tangent = _tangent(start)

    def cost(x: Array) -> float:
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


def _tangent(l: Array) -> Array:
    return np.asarray(np.linalg.svd(l[:, None])[0][:, 1:])


def _patch(center: Array, axes: Array, half: Array, count: int = 17) -> tuple[Array, Bools]:
    """Directions around one, `half` to either side along the two axes, within non-negative light.

    Great circles are straight lines here, and so are the valleys that a plate of one hue leaves. And,
    (2, g), which of them are at the ends of each axis.
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
    """The vector at length 1."""
    return np.asarray(v / np.linalg.norm(v))

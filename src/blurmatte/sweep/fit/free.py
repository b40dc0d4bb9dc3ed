"""Search for silhouettes of any form: the cells of a `Mask`, its path and its colors.

Given path and color, alpha is linear in the cells m. Their cost adds to the loss of the residuals

    λ Σ |∇m| + μ Σ m (1 − m),    0 ≤ m ≤ 1,

a price of the rim's length, and one of cells that are covered in part. Without the second, a
shorter path with a softer rim, or a brighter color with a fainter mask, would be as likely.

Each step solves the normal equations of the cells that no bound holds, eliminates them from those of
path and color, and moves all (variable projection). Fits start on large pixels from the paths of other
shapes, from these shortened and extended, and from short lines; those of the least cost continue on
small pixels. Only path and color are damped, after the cells are eliminated under their bounds;
`descent` damps all parameters alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Ints, box_of, rows_columns
from blurmatte.descent import distinct
from blurmatte.streaks import dilated
from blurmatte.sweep.fit.multistart import with_principal_axes
from blurmatte.sweep.fit.ranking import MAX_LIGHT, MIN_LIGHT, bic_penalty
from blurmatte.sweep.model import mask_kernel as kernel
from blurmatte.sweep.model.color_field import fit_colors
from blurmatte.sweep.model.mask import Mask, rim_price
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import FROM_REST, LINE, PathFamily
from blurmatte.sweep.model.silhouette import moments
from blurmatte.sweep.model.state import State, state_at
from blurmatte.sweep.model.student_t import VARIANCE, loss, student_weight

# Price of the rim, units of log likelihood for each pixel of its length
_RIM_PRICE = 3.0
# Price μ of a cell, the same unit for each pixel of its width; on large pixels the basin is sought
_GRAY_PRICE = 8.0
_COARSE_GRAY_PRICE = 24.0
_SMOOTHED_STEP = 0.05  # of coverage between cells, below which the price of the rim is quadratic
_MAX_COARSE_PIXELS = 800  # of the streak, on large pixels
# About, on small ones: the time of a step increases with the cube of the number of cells
_FINE_PIXELS = 2500
_MARGIN_PX = 3  # around the streak, where the object may be
_MIN_TIME_WITHIN = 0.85  # of the exposure that a cell of the object spends there
_MAX_STARTS = 5  # fits of other shapes, the best, whose paths are starts
_LENGTHS = (0.6, 1.3, 1.8)  # of the best of these paths
_SHORT = (0.25, 0.5)  # of the streak's box: lengths of lines
_DIRECTIONS = 4  # of these lines, in half a turn
_FINALISTS = 2  # that continue on small pixels
_MIN_DIFFERENCE = 1.5  # between the paths of two of them, large pixels
_MAX_COARSE_STEPS, _COARSE_TOLERANCE = 12, 2.0
_MAX_FINE_STEPS, _FINE_TOLERANCE = 8, 1.0
# Of the cells alone, on large pixels from all starts and from the better half, and on small pixels
_FIRST_STEPS, _NEXT_STEPS = 2, 3
_FIRST_FINE_STEPS = 2
_MAX_CONTINUED = 4  # fits that continue with path and color
_MAX_MOVE_PX = 4.0  # of a path in a step
_SHOWN = 0.002  # alpha below which the field of colors has no pixels
_MAX_TRIALS = 5  # dampings in a step
_MAX_ACCELERATION = 2.0  # gain of a later step, of the last one
_REGULAR = 1e-3  # of the diagonal of the normal matrix, added to it


def fit_free(fits: Sequence[State]) -> State | None:
    """The best free silhouette, from fits of other shapes of one paint to one observation.

    None if none of the fits on large pixels costs less than the best of those, or one is empty.
    """
    best = min(fits, key=lambda state: state.cost)
    plain = with_principal_axes(best).observation
    count = int(np.count_nonzero(plain.streak))
    coarse = plain.coarser(int(np.ceil(np.sqrt(count / _MAX_COARSE_PIXELS))))
    fine = plain.coarser(max(1, round(float(np.sqrt(count / _FINE_PIXELS)))))
    limit, found = min(_price(one.on(coarse)) for one in fits), list[_Problem]()
    begun = [
        _with_cells(_Problem.of(coarse, *start, _COARSE_GRAY_PRICE), _FIRST_STEPS)
        for start in _starts(fits, best, coarse)
    ]
    begun.sort(key=lambda one: one.cost)
    half = [_with_cells(one, _NEXT_STEPS) for one in begun[: max(len(begun) // 2, _MAX_CONTINUED)]]
    for problem in sorted(half, key=lambda one: one.cost)[:_MAX_CONTINUED]:
        rival = _least_cost(found)
        found.append(_fitted(problem, _MAX_COARSE_STEPS, _COARSE_TOLERANCE, rival, limit))
    found.sort(key=lambda one: one.cost)
    if not found or found[0].price >= limit:
        return None
    ends, least = list[_Problem](), _MIN_DIFFERENCE * coarse.scale
    for one in distinct(found, lambda one, other: _apart(one, other) <= least)[:_FINALISTS]:
        start, rival = _with_cells(one.finer(fine), _FIRST_FINE_STEPS), _least_cost(ends)
        ends.append(_fitted(start, _MAX_FINE_STEPS, _FINE_TOLERANCE, rival))
    best_end = min(ends, key=lambda one: one.cost)
    if not best_end.mask.any():  # no cell is worth its price
        return None
    return replace(best_end, gray_price=_COARSE_GRAY_PRICE).state(best.radius).on(plain)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Cells on a path before an observation, whose pixels are as wide as the cells."""

    observation: Observation
    family: PathFamily
    path: Array  # (n,) float
    color: Array  # (3,) or (h, w, 3) float, linear RGB
    mask: Array  # (k, l) float
    corner: Ints  # (2,) of the first cell's center (x, y), from the path, cells
    gray_price: float
    allowed: Bools  # (k, l) which cells may be covered
    field_cost: float = 0.0

    @classmethod
    def of(
        cls, observation: Observation, family: PathFamily, path: Array, color: Array, price: float
    ) -> "_Problem":
        """Half covered cells, wherever they stay within the streak."""
        xy = (family.curve(path) - np.array(observation.origin)) / observation.scale
        y, x = np.nonzero(observation.streak)
        far = np.ceil(
            np.max([xy.max(axis=0) - (x.min(), y.min()), (x.max(), y.max()) - xy.min(axis=0)])
        )
        half = int(max(far, 1)) + _MARGIN_PX
        blank = np.zeros((2 * half + 1, 2 * half + 1))
        corner = np.array([-half, -half])
        known = cls(observation, family, path, color, blank, corner, price, blank == 0)
        allowed = known._within_streak()
        return replace(known, mask=np.where(allowed, 0.5, 0.0), allowed=allowed).cropped

    @property
    def cropped(self) -> "_Problem":
        """The same without the rows and columns of cells around those that are allowed."""
        if not self.allowed.any():
            return self
        box = box_of(self.allowed)
        place, corner = rows_columns(box), self.corner + np.array(box[:2])
        return replace(
            self, mask=self.mask[place].copy(), allowed=self.allowed[place], corner=corner
        )

    def finer(self, observation: Observation) -> "_Problem":
        """The same on smaller pixels, with all its light and the final price of gray cells."""
        by = self.observation.scale / observation.scale
        first = np.floor((self.corner - 1) * by).astype(int)
        last = np.ceil((self.corner + self.mask.shape[::-1]) * by).astype(int)
        columns, rows = (
            np.arange(a, b) / by - at for a, b, at in zip(first, last, self.corner, strict=True)
        )
        at = np.meshgrid(rows, columns, indexing="ij")
        mask = np.zeros(at[0].shape)
        scipy.ndimage.map_coordinates(self.mask, at, mask, order=1)
        known = replace(
            self, observation=observation, mask=mask, gray_price=_GRAY_PRICE, corner=first
        )
        allowed = known._within_streak()
        return replace(known, mask=np.clip(mask, 0, 1) * allowed, allowed=allowed).cropped.recolored

    def spread(self, path: Array) -> tuple[Ints, Array]:
        """Offsets (S, 2) of the pixels that a cell reaches, and the time there with derivatives."""
        scale = self.observation.scale
        t, weights = moments(self.family, path, scale)
        xy, D = self.family.at(path, t)
        at = (xy - np.array(self.observation.origin)) / scale + self.corner
        first = np.floor(at.min(axis=0))
        width, height = (np.floor(at.max(axis=0)) - first + 2).astype(int)
        spent = kernel.dwell(at, D / scale, weights, first, (int(height), int(width)))
        rows, columns = np.nonzero(np.abs(spent).sum(axis=0))
        offsets = np.stack([rows + int(first[1]), columns + int(first[0])], axis=1)
        return offsets, np.ascontiguousarray(spent[:, rows, columns].T)

    def moved(self, spread: tuple[Ints, Array], mask: Array, count: int = 1) -> Array:
        """(count, h, w) alpha, and its first derivatives by the path."""
        alpha = np.zeros((count, *self.observation.weight.shape))
        offsets, spent = spread
        kernel.moved(mask, offsets, np.ascontiguousarray(spent[:, :count]), alpha)
        return alpha

    def gathered(self, spread: tuple[Ints, Array], maps: Array) -> Array:
        """(k, …) sums over the pixels (k, h, w) of each cell: the adjoint of `moved`."""
        cells = np.zeros((len(maps), *self.mask.shape))
        kernel.gathered(np.ascontiguousarray(maps), *spread, cells)
        return cells

    def _within_streak(self) -> Bools:
        observation = self.observation
        near = dilated(observation.streak, _MARGIN_PX) | ~observation.valid
        time = self.gathered(self.spread(self.path), near[None].astype(float))[0]
        return np.asarray(time > _MIN_TIME_WITHIN)

    @cached_property
    def alpha(self) -> Array:
        """(h, w)."""
        return np.asarray(self.moved(self.spread(self.path), self.mask)[0])

    @property
    def recolored(self) -> "_Problem":
        """The same with the most probable field of colors; its mean where alpha is 0."""
        observation, alpha = self.observation, np.clip(self.alpha, 0, 1)
        shown = np.where(alpha > _SHOWN, alpha, 0)
        known = observation.light, shown, observation.weight, observation.pitch, observation.color
        motion = self.family.motion(self.path, observation.scale)
        field, _ = fit_colors(*known, observation.of_none[0], motion)
        solid = alpha > 10 * _SHOWN
        light = field.light(shown) / np.where(solid, alpha, 1)[..., None]
        color = np.where(solid[..., None], light, field.mean) @ observation.color.axes.T
        return replace(self, color=color, field_cost=field.cost)

    @property
    def is_possible(self) -> bool:
        """Whether the mean light is that of a surface."""
        mean = self.observation.rgb(self.color.reshape(-1, 3).mean(axis=0))
        return bool(mean.max() <= MAX_LIGHT and mean.min() >= MIN_LIGHT * mean.max())

    def residuals(self, alpha: Array) -> tuple[Array, Array]:
        """(h, w, 3) of unit variance, and the standard deviations of their light."""
        o, through = self.observation, (1 - np.clip(alpha, 0, 1))[..., None]
        variance = o.C_variance + through**2 * o.B_variance
        if o.chroma_error is not None:
            variance = variance + o.chroma_error**2
        std = np.sqrt(variance)
        a = alpha[..., None]
        return (o.C - (1 - a) * o.B - a * self.color) / std, std

    def rim_weights(self) -> Array:
        """(k, l) weights of squared steps to the right and down: the curvature of the price."""
        right, down = _steps(self.mask)
        price = _RIM_PRICE * self.observation.scale
        return np.asarray(price / np.sqrt(right**2 + down**2 + _SMOOTHED_STEP**2))

    @cached_property
    def evidence(self) -> float:
        """Loss, and the cost of the field of colors."""
        o, chi2 = self.observation, _squared(self.residuals(self.alpha)[0])
        return float((o.weight * loss(chi2, o.channels)).sum()) + self.field_cost

    @cached_property
    def rim(self) -> float:
        """Its length, cells."""
        right, down = _steps(self.mask)
        return float((np.sqrt(right**2 + down**2 + _SMOOTHED_STEP**2) - _SMOOTHED_STEP).sum())

    @cached_property
    def cost(self) -> float:
        """The evidence, and the prices of the cells."""
        gray = float((self.mask * (1 - self.mask)).sum())
        prices = _RIM_PRICE * self.rim + self.gray_price * gray
        return self.evidence + self.observation.scale * prices

    @property
    def price(self) -> float:
        """The evidence, that of one of all rims, and half a log of pixels for each parameter."""
        count = len(self.path) + 1 + round(_System.of(self).freedom)
        return self.evidence + rim_price(self.rim) + bic_penalty(self.observation, count)

    def state(self, radius: float) -> State:
        """Its state, with errors; the radius is only a unit."""
        system = _System.of(self)
        x0, y0, x1, y1 = box_of(self.mask != 0)
        cells = self.mask[y0:y1, x0:x1].round(4)
        scale = self.observation.scale
        middle = np.array([x0 + x1 - 1, y0 + y1 - 1]) / 2 + self.corner
        path = self.family.shifted(self.path, scale * middle)
        freedom, alpha_error = system.freedom, system.alpha_error
        shape, width = np.array([radius]), scale / radius
        rows = tuple(map(tuple, cells.tolist()))
        mask = Mask(rows, width, freedom, 0.0)
        state = state_at(self.observation, self.family, path, mask, shape)
        inflation = state.variance_inflation * VARIANCE
        wider = mask.sweep(self.family, path, 1.01 * shape, self.observation.pixels).alpha
        by_rim = float(np.sqrt(((wider - state.swept.alpha) ** 2).sum())) / 0.01
        rim_error = float(np.sqrt(inflation)) * alpha_error / max(by_rim, 1e-9)
        return state_at(
            self.observation, self.family, path, replace(mask, rim_error=rim_error), shape
        )


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of a step: those of free cells, and of path and color without them."""

    problem: _Problem
    spread: tuple[Ints, Array]
    free: Bools  # (k, l) cells that no bound holds
    number: Ints  # (k, l) of these, −1 of others
    data: Array  # (f, f) float: curvature of the loss by free cells
    factor: tuple[Array, bool]  # of the whole curvature by free cells
    mixed: Array  # (p, f) float: curvature by path and color, and free cells
    own: Array  # (p, p) float: by path and color
    descent: Array  # (p,) float: minus the gradient by path and color
    cells: Array  # (f,) float: by the free cells
    by_path: Array  # (n, h, w) float: derivatives of alpha

    @classmethod
    def of(cls, problem: _Problem) -> "_System":
        """The equations at a point."""
        o, n = problem.observation, len(problem.path)
        spread = problem.spread(problem.path)
        alpha, *slopes = problem.moved(spread, problem.mask, n + 1)
        e, std = problem.residuals(alpha)
        weight = o.weight * student_weight(_squared(e), o.channels)
        d = (problem.color - o.B) / std
        J = np.zeros((n + 3, *e.shape))
        for i, slope in enumerate(slopes):
            J[i] = slope[..., None] * d
        for c in range(3):
            J[n + c, ..., c] = alpha / std[..., c]
        weighted = J * weight[..., None]
        maps = np.empty((n + 4, *alpha.shape))
        np.einsum("pyxc,yxc->pyx", weighted, d, out=maps[:-1])
        maps[-1] = weight * np.einsum("yxc,yxc->yx", e, d)
        *mixed, pull = problem.gathered(spread, maps)
        smoothness = _smoothness(problem.rim_weights())
        pull = pull - (smoothness @ problem.mask.ravel()).reshape(problem.mask.shape)
        pull -= problem.gray_price * o.scale * (1 - 2 * problem.mask)
        held = ((problem.mask <= 0) & (pull < 0)) | ((problem.mask >= 1) & (pull > 0))
        free = problem.allowed & ~held
        number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        count = int(np.count_nonzero(free))
        data = kernel.normal_matrix(weight * _squared(d), *spread, number, count)
        at = np.flatnonzero(free)
        whole = data + smoothness[at][:, at].toarray()
        whole[np.diag_indices(count)] += _REGULAR * np.diag(whole) + 1e-9
        factor = scipy.linalg.cho_factor(whole, lower=True) if count else (whole, True)
        flat = weighted.reshape(n + 3, -1)
        return cls(
            problem, spread, free, number, data, factor, np.array([m[free] for m in mixed]),
            flat @ J.reshape(n + 3, -1).T, flat @ e.ravel(), pull[free], np.array(slopes),
        )  # fmt: skip

    def solved(self, right: Array) -> Array:
        """Solutions (r, f) of the equations of the cells."""
        if not right.size:
            return right
        return np.asarray(scipy.linalg.cho_solve(self.factor, right.T).T)

    def step_of_cells(self) -> _Problem:
        """The cells moved alone, while the cost falls."""
        step, before = self.solved(self.cells[None])[0], self.problem.cost
        for length in 0.5 ** np.arange(_MAX_TRIALS):
            tried = replace(self.problem, mask=self._covered(length * step))
            if tried.cost < before:
                return tried
        return self.problem

    def step(self, damping: float) -> tuple[_Problem, float]:
        """Path, color and cells moved, and the next damping."""
        n, before = len(self.problem.path), self.problem.cost
        solved = self.solved(np.concatenate([self.mixed, self.cells[None]]))
        reduced = self.own - self.mixed @ solved[:-1].T
        right = self.descent - self.mixed @ solved[-1]
        scales = np.maximum(np.diag(reduced), 0) + 0.01 * np.diag(self.own) + 1e-9
        for _ in range(_MAX_TRIALS):
            move = np.linalg.lstsq((reduced + reduced.T) / 2 + damping * np.diag(scales), right)[0]
            far = np.abs(move[:n]).max() / (_MAX_MOVE_PX * self.problem.observation.scale)
            move /= max(far, 1)
            tried = replace(
                self.problem,
                path=self.problem.path + move[:n],
                color=self.problem.color + move[n:],
                mask=self._covered(solved[-1] - move @ solved[:-1]),
            )
            if tried.is_possible and tried.cost < before:
                return tried, max(damping / 4, 1e-4)
            damping *= 5
        return self.problem, damping

    def _covered(self, step: Array) -> Array:
        mask = self.problem.mask.copy()
        mask[self.free] = np.clip(mask[self.free] + step, 0, 1)
        return mask

    @property
    def freedom(self) -> float:
        """Effective number of parameters of the cells: the trace of their influence on their fit."""
        if not len(self.data):
            return 0.0
        return float(np.trace(scipy.linalg.cho_solve(self.factor, self.data)))

    @property
    def alpha_error(self) -> float:
        """Root of the summed variance of alpha by the errors of cells, path and color, if noise is
        independent; that of the path alone is not included.
        """
        count = len(self.data)
        if not count:
            return 0.0
        ones = np.ones(self.problem.observation.weight.shape)
        overlap = kernel.normal_matrix(ones, *self.spread, self.number, count)
        inverse = scipy.linalg.cho_solve(self.factor, np.eye(count))
        variance = float((inverse * overlap).sum())
        solved = self.solved(self.mixed)
        reduced = self.own - self.mixed @ solved.T
        n = len(self.by_path)
        both = np.zeros((len(reduced), *ones.shape))
        both[:n] = self.by_path
        cells = np.zeros((len(reduced), *self.problem.mask.shape))
        cells[:, self.free] = solved
        shifted = np.concatenate([self.problem.moved(self.spread, one) for one in cells])
        J = (both - shifted).reshape(len(reduced), -1)
        covariance = np.linalg.pinv((reduced + reduced.T) / 2, hermitian=True)
        return float(np.sqrt(variance + max(float((covariance * (J @ J.T)).sum()), 0.0)))


def _fitted(
    problem: _Problem,
    max_steps: int,
    tolerance: float,
    rival: float = np.inf,
    limit: float = np.inf,
) -> _Problem:
    """The nearest point of the least cost.

    It stops early if the remaining steps, each with `_MAX_ACCELERATION` times the last gain, would
    neither reach the cost of a rival nor an evidence below a limit.
    """
    damping, last = 0.1, np.inf
    for turn in range(max_steps):
        problem = problem.recolored if turn else problem
        problem, damping = _System.of(problem).step(damping)
        gain, last = last - problem.cost, problem.cost
        behind = max(problem.cost - rival, problem.evidence - limit)
        if turn > 0 and behind > _MAX_ACCELERATION * (max_steps - 1 - turn) * max(gain, 0):
            break
        if turn > 1 and gain < tolerance:
            break
    return problem


def _with_cells(problem: _Problem, max_steps: int) -> _Problem:
    """The same with the cells fitted alone."""
    for _ in range(max_steps):
        before, problem = problem, _System.of(problem).step_of_cells()
        if problem is before:
            break
    return problem


def _least_cost(found: Sequence[_Problem]) -> float:
    return min((one.cost for one in found), default=np.inf)


def _starts(
    fits: Sequence[State], best: State, coarse: Observation
) -> Iterator[tuple[PathFamily, Array, Array]]:
    """Families, paths and colors to start from."""
    curves: list[Array] = []
    for state in sorted(fits, key=lambda one: one.cost)[:_MAX_STARTS]:
        own = LINE if state.family is FROM_REST else state.family
        for family in dict.fromkeys((own, LINE)):
            path = state.along(family).path
            curve = family.curve(path)
            if all(np.abs(curve - other).max() > coarse.scale for other in curves):
                curves.append(curve)
                yield family, path, _possible_color(state)
    ends, color = best.curve[[0, -1]], _possible_color(best)
    middle = ends.mean(axis=0)
    for by in _LENGTHS:
        yield LINE, (middle + by * (ends - middle)).ravel(), color
    x0, y0, x1, y1 = box_of(coarse.streak)
    corners = np.array([[x0, y0], [x1 - 1, y1 - 1]]) * coarse.scale
    middle, size = corners.mean(axis=0) + np.array(coarse.origin), corners[1] - corners[0]
    for angle in np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        along = np.array([np.cos(angle), np.sin(angle)])
        across_box = float(np.min(size / np.maximum(np.abs(along), 1e-3)))
        for part in _SHORT:
            half = part * across_box / 2 * along
            yield LINE, np.concatenate([middle - half, middle + half]), color


def _price(state: State) -> float:
    return state.cost + bic_penalty(state.observation, state.parameters)


def _possible_color(state: State) -> Array:
    """(3,) the nearest that a surface may have to a mean color, in the light of its observation."""
    return state.observation.of_rgb(np.clip(state.mean_color, 0, MAX_LIGHT))


def _apart(one: _Problem, other: _Problem) -> float:
    """Largest distance of two paths along an axis, pixels."""
    curves = (each.family.curve(each.path) for each in (one, other))
    return float(np.abs(next(curves) - next(curves)).max())


def _squared(x: Array) -> Array:
    """(h, w) sums of squares of (h, w, 3)."""
    return np.asarray(np.einsum("yxc,yxc->yx", x, x))


def _steps(mask: Array) -> tuple[Array, Array]:
    """(k, l) differences to the cells on the right and below; 0 at the border."""
    right, down = np.zeros_like(mask), np.zeros_like(mask)
    right[:, :-1], down[:-1] = np.diff(mask, axis=1), np.diff(mask, axis=0)
    return right, down


def _smoothness(weight: Array) -> "scipy.sparse.csr_array":
    """(n, n) curvature of ½ Σ weight (right² + down²) of the steps between n cells (k, l)."""
    index = np.arange(weight.size).reshape(weight.shape)
    pairs = np.hstack(
        [(index[:, :-1].ravel(), index[:, 1:].ravel()), (index[:-1].ravel(), index[1:].ravel())]
    )
    graph = scipy.sparse.csr_array((weight.ravel()[pairs[0]], pairs), 2 * (weight.size,))
    return scipy.sparse.csgraph.laplacian(graph + graph.T).tocsr()  # its columns are chosen

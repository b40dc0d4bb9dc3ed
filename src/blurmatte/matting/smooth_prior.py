"""A field of alpha that is smooth, but for edges, as the pixels' evidence wants it.

In this file A is the information of each pixel (or cell of pixels), x alpha, and D x its differences of
first or second order in all directions: a vector at each place. They are normal, but with a precision
Γ of each place, a matrix, that is not known: before they are seen as if ν of scale σ had been (a
Wishart distribution). So they follow a t distribution, mostly small, now and then an edge, and along
an edge they are as small as elsewhere. Given the rest, the mean of Γ is (ν + 1)(νσ²I + E[Dx Dxᵀ])⁻¹,
and given Γ, x is normal with information H = A + DᵀΓD. Both are repeated in turn. The expectation is
over what x can still be, not that of the best x alone, which would be too smooth; it is taken of
samples H⁻¹(√A ξ + DᵀL η) with normal ξ and η and LLᵀ = Γ, whose covariance is H⁻¹.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from os import cpu_count

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.matting.smooth_local import rougher

Array = npt.NDArray[np.float64]

BORDER = 2  # pixels around all maps, where the mask is False

_NU = 1.0  # differences seen before: edges are common
_POOL = 3  # cells across, over which precisions are alike
_TOLD_BY = 5  # cells across, over which a few samples tell a variance
_ROUNDS = 2
_STEPS, TOLERANCE = 300, 1e-5
LEAST = -0.05  # alpha: held at 0 its sum would be too large, for only noise above 0 would be left
_SHARP = 0.01**-2.0  # information of what is held
_SEED = 0  # of samples: the same answer every time
_TINY = 1e-6


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of alpha in each cell.

    Parameters
    ----------
    information : (h, w) float
        One over the variance of a cell's own alpha; 0 outside the mask. Its dtype is the one computed
        in.
    pull : (h, w) float
        That alpha times the information.
    mask : (h, w) bool
        Where alpha may be other than 0; False in the border.
    least : (h, w) float
        What alpha cannot be less than.
    """

    information: Floats
    pull: Floats
    mask: Bools
    least: Floats

    def weaker(self, factor: float) -> "Evidence":
        """With as many times the variance."""
        return replace(self, information=self.information / factor, pull=self.pull / factor)

    @property
    def count(self) -> int:
        """How many cells there are in the mask."""
        return int(np.count_nonzero(self.mask))

    def levels(self, most: int) -> list["Evidence"]:
        """From these cells, each of twice the width, to no more than `most`."""
        found = [self]
        while found[-1].count > most:
            found.append(found[-1].coarser())
        return found

    def coarser(self) -> "Evidence":
        """In cells of twice the width."""
        count = in_larger_cells(self.mask.astype(np.uint8))
        least = in_larger_cells(np.where(self.mask, self.least, 0))
        return Evidence(
            in_larger_cells(self.information),
            in_larger_cells(self.pull),
            count > 0,
            (least / np.maximum(count, 1)).astype(least.dtype),
        )


@dataclass(frozen=True)
class Prior:
    """How smooth a field is.

    Parameters
    ----------
    order : int
        1 if differences of neighbors are small, 2 if those of differences.
    scale : float
        Of a difference, in the cells of the level.
    """

    order: int
    scale: float

    def finer(self) -> "Prior":
        """In cells of half the width."""
        return Prior(self.order, self.scale / 2**self.order)


@dataclass(frozen=True, eq=False)
class Field:
    """A field and what it may be.

    Parameters
    ----------
    x : (h, w) float
        Its mean.
    variance : (h, w) float
    squares : (3 or 6, h, w) float64
        Expectation of Dx Dxᵀ, of neighbors together: the lower triangle, row by row.
    rough : (h, w) float
        Square of the local scale over that of the prior.
    left, freedom : float
        Squares that cells leave, over their variances, and how many there would be of noise.
    steps : int
        Of the last solution.
    converged : bool
        It ended before the most steps.
    """

    x: Floats
    variance: Floats
    squares: Array
    rough: Floats
    left: float
    freedom: float
    steps: int
    converged: bool

    @property
    def risk(self) -> float:
        """Unbiased estimate of the squared error, times the information, of all cells [Stein 1981].

        Up to a constant.
        """
        return self.left - 2 * self.freedom


def smoothed(
    evidence: Evidence,
    prior: Prior,
    start: Field | None,
    samples: int,
    cells: int = 1,
    local: bool = False,
) -> Field:
    """The field that evidence and prior agree on, from one of a coarser level or of another prior.

    `cells` is how many pixels there are to a cell: its differences stand for so many. With no samples
    only the mean is new; so it is for cells much smaller than anything in the field. If it is to be
    `local`, the scale is found where it is another than elsewhere.
    """
    A, mask = evidence.information, evidence.mask
    rng = np.random.default_rng(_SEED)
    noise = [rng.standard_normal((4, *mask.shape)).astype(A.dtype) for _ in range(samples)]
    field = start or _nothing(evidence, prior)
    root, held = _precision(prior, field, cells), np.zeros(mask.shape, np.int8)
    for turn in range(_ROUNDS):
        x = field.x.copy()
        beyond = mask * (np.int8(x > 1) - np.int8(x < evidence.least))
        if turn > 0 and noise:
            root = _precision(prior, field, cells)
        elif turn > 0 and np.array_equal(beyond, held):
            break
        held = beyond
        above, below = (A.dtype.type(_SHARP) * (held == side) for side in (1, -1))
        drawn = [np.zeros_like(x) for _ in noise]
        jobs: list[tuple[Floats, Floats, Floats]]
        jobs = [(A + above + below, evidence.pull + above + below * evidence.least, x)]
        for n, z in zip(noise, drawn, strict=True):
            # What is held from below is no better known for that: there was no object, or no answer.
            jobs.append((A + above, _disturbed(A + above, root, prior.order, mask, n), z))
        steps = _solve_all(root, prior.order, mask, jobs, _STEPS)
        field = replace(field, x=x, steps=steps, converged=steps < _STEPS)
        if noise:
            traces = [
                np.sum(n[0] * np.sqrt(A) * z, dtype=float)
                for n, z in zip(noise, drawn, strict=True)
            ]
            left, known = _left(evidence, x)
            variance = pooled(np.mean(np.square(drawn), axis=0), mask)
            if local and turn < _ROUNDS - 1:
                more = rougher(x, root, prior.order, A * variance, mask)
                field = replace(field, rough=field.rough * more)
            field = replace(
                field,
                variance=variance,
                squares=_squares(x, drawn, prior.order),
                left=left,
                freedom=known - float(np.mean(traces)),
            )
    return field


def sum_variance(evidence: Evidence, prior: Prior, field: Field, cells: int = 1) -> float:
    """Variance of the sum of a field over all cells."""
    ones = evidence.mask.astype(float)
    return float(changes(evidence, prior, field, [ones], cells)[0].sum()) * cells**2


def changes(
    evidence: Evidence,
    prior: Prior,
    field: Field,
    pulls: list[Array],
    cells: int = 1,
    tolerance: float = 0.0,
) -> list[Array]:
    """What becomes of a field if the pull is so much more, for each."""
    root, A = _precision(prior, field, cells).astype(float), evidence.information.astype(float)
    found = [np.zeros(A.shape) for _ in pulls]
    jobs: list[tuple[Floats, Floats, Floats]]
    jobs = [(A, pull, x) for pull, x in zip(pulls, found, strict=True)]
    _solve_all(root, prior.order, evidence.mask, jobs, 2 * _STEPS, tolerance)
    return found


def _precision(prior: Prior, field: Field, cells: int) -> Floats:
    """L of Γ, for differences that stand for so many pixels."""
    from blurmatte.matting.smooth_kernel import precision  # numba takes half a second

    root = np.empty(field.squares.shape, field.x.dtype)
    least = _NU * prior.scale**2 * field.rough
    precision(field.squares, prior.order, least, cells * (_NU + 1), root)
    return root


def _nothing(evidence: Evidence, prior: Prior) -> Field:
    zero = np.zeros_like(evidence.information)
    squares = np.zeros((3 * prior.order, *zero.shape))
    squares[[0, 2, 5][: prior.order + 1]] = prior.scale**2
    return Field(zero, zero, squares, np.ones_like(zero), np.inf, 0.0, 0, False)


def finer(field: Field, shape: tuple[int, ...], order: int) -> Field:
    """The start that a field is for the level of half the width."""
    from blurmatte.matting.smooth_kernel import doubled  # numba takes half a second

    squares = np.zeros((len(field.squares), *shape))
    for part, of_level in zip(squares, field.squares / 4**order, strict=True):
        doubled(of_level, BORDER, part)
    maps = field.x, field.variance, field.rough
    x, variance, rough = (map_in_smaller_cells(values, shape) for values in maps)
    rough = np.maximum(rough, np.float32(_TINY))  # the border is of no meaning, but divided by
    return replace(field, x=x, variance=variance, squares=squares, rough=rough)


def map_in_smaller_cells(values: Floats, shape: tuple[int, ...]) -> Floats:
    """A map in cells of half the width, between theirs linear."""
    from blurmatte.matting.smooth_kernel import doubled

    out = np.zeros(shape, values.dtype)
    doubled(values, BORDER, out)
    return out


def _solve_all(
    root: Floats,
    order: int,
    mask: Bools,
    jobs: list[tuple[Floats, Floats, Floats]],
    most: int,
    tolerance: float = TOLERANCE,
) -> int:
    """Solve for each information and right hand side, into the array given with them.

    How many steps the first took.
    """
    from blurmatte.matting.smooth_kernel import conjugate_gradients  # numba takes half a second

    def solve(job: tuple[Floats, Floats, Floats]) -> int:
        A, b, x = job
        return int(conjugate_gradients(A, root, order, mask, b, x, most, tolerance))

    with ThreadPoolExecutor(cpu_count()) as threads:
        return list(threads.map(solve, jobs))[0]  # noqa: RUF015  all must have ended


def _disturbed(A: Floats, root: Floats, order: int, mask: Bools, normal: Floats) -> Floats:
    """A right hand side whose solution has the covariance H⁻¹."""
    from blurmatte.matting.smooth_kernel import backward, spread

    b: Floats = np.sqrt(A) * normal[0] * mask
    t = np.zeros((3, *mask.shape), b.dtype)
    spread(root, order, normal[1:], t)
    backward(t, order, mask, b)
    return b


def _squares(x: Floats, samples: list[Floats], order: int) -> Array:
    from scipy.ndimage import uniform_filter

    from blurmatte.matting.smooth_kernel import forward, outer

    t, total = np.zeros((3, *x.shape), x.dtype), np.zeros((3 * order, *x.shape))
    for values, weight in ((x, 1.0), *((z, 1 / len(samples)) for z in samples)):
        forward(values, order, t)
        outer(t, order, weight, total)
    return np.asarray(uniform_filter(total, (0, _POOL, _POOL)), float)


def pooled(variance: Floats, mask: Bools) -> Floats:
    """Means of neighbors within the mask: a few samples tell a variance only roughly."""
    from scipy.ndimage import uniform_filter

    near, share = (uniform_filter(v, _TOLD_BY) for v in (variance * mask, mask.astype(float)))
    return np.asarray(np.where(mask, near.clip(0) / share.clip(1e-9), 0), variance.dtype)


def _left(evidence: Evidence, x: Floats) -> tuple[float, int]:
    """Squares that cells leave, over their variances, and how many cells know anything."""
    known = evidence.information > 0
    A = evidence.information[known]
    left = (evidence.pull[known] - A * x[known]) ** 2 / A
    return float(np.sum(left, dtype=float)), len(A)


def in_larger_cells(values: Floats) -> Floats:
    """Sums over 2 by 2, the border kept."""
    inner = values[BORDER:-BORDER, BORDER:-BORDER]
    h, w = inner.shape
    inner = np.pad(inner, ((0, h % 2), (0, w % 2)))
    h, w = inner.shape
    rows = inner[::2] + inner[1::2]
    return np.pad(rows[:, ::2] + rows[:, 1::2], BORDER)

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

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

BORDER = 2  # pixels around all maps, where the mask is False

_NU = 1.0  # differences seen before: edges are common
_POOL = 3  # cells across, over which precisions are alike
_TOLD_BY = 5  # cells across, over which a few samples tell a variance
_ROUNDS = 2
_STEPS, _TOLERANCE = 300, 1e-5
_LEAST = -0.05  # alpha: held at 0 its sum would be too large, for only noise above 0 would be left
_SHARP = 0.01**-2.0  # information of what is held
_SEED = 0  # of samples: the same answer every time


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of alpha in each cell.

    Parameters
    ----------
    information : (h, w) float
        One over the variance of a cell's own alpha; 0 outside the mask.
    pull : (h, w) float
        That alpha times the information.
    mask : (h, w) bool
        Where alpha may be other than 0; False in the border.
    """

    information: Array
    pull: Array
    mask: Bools

    def weaker(self, factor: float) -> "Evidence":
        """With as many times the variance."""
        return Evidence(self.information / factor, self.pull / factor, self.mask)

    def coarser(self) -> "Evidence":
        """In cells of twice the width."""
        return Evidence(
            _blocks(self.information),
            _blocks(self.pull),
            _blocks(self.mask.astype(float)) > 0,
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
    squares : (3 or 6, h, w) float
        Expectation of Dx Dxᵀ, of neighbors together: the lower triangle, row by row.
    left, freedom : float
        Squares that cells leave, over their variances, and how many there would be of noise.
    steps : int
        Of the last solution.
    converged : bool
        It ended before the most steps.
    """

    x: Array
    variance: Array
    squares: Array
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
    evidence: Evidence, prior: Prior, start: Field | None, samples: int, cells: int = 1
) -> Field:
    """The field that evidence and prior agree on, from one of a coarser level or of another prior.

    `cells` is how many pixels there are to a cell: its differences stand for so many. With no samples
    only the mean is new; so it is for cells much smaller than anything in the field.
    """
    A, mask = evidence.information, evidence.mask
    rng = np.random.default_rng(_SEED)
    noise = [rng.standard_normal((4, *mask.shape)) for _ in range(samples)]
    field = start or _nothing(mask, prior)
    for _ in range(_ROUNDS):
        x, (gamma, root) = field.x.copy(), _precision(prior, field, cells)
        above, below = (_SHARP * (mask & beyond) for beyond in (x > 1, x < _LEAST))
        drawn = [np.zeros(mask.shape) for _ in noise]
        jobs = [(A + above + below, evidence.pull + above + below * _LEAST, x)]
        for n, z in zip(noise, drawn, strict=True):
            # What is held from below is no better known for that: there was no object, or no answer.
            jobs.append((A + above, _disturbed(A + above, root, prior.order, mask, n), z))
        steps = _solve_all(gamma, prior.order, mask, jobs, _STEPS)
        field = replace(field, x=x, steps=steps, converged=steps < _STEPS)
        if noise:
            traces = [np.sum(n[0] * np.sqrt(A) * z) for n, z in zip(noise, drawn, strict=True)]
            left, known = _left(evidence, x)
            field = replace(
                field,
                variance=_pooled(np.mean(np.square(drawn), axis=0), mask),
                squares=_squares(x, drawn, prior.order),
                left=left,
                freedom=known - float(np.mean(traces)),
            )
    return field


def sum_variance(evidence: Evidence, prior: Prior, field: Field, cells: int = 1) -> float:
    """Variance of the sum of a field over all cells."""
    (gamma, _), whole = _precision(prior, field, cells), np.zeros(field.x.shape)
    ones = evidence.mask.astype(float)
    job = evidence.information, ones, whole
    _solve_all(gamma, prior.order, evidence.mask, [job], 2 * _STEPS, 0.0)
    return float(whole.sum()) * cells**2


def _precision(prior: Prior, field: Field, cells: int) -> tuple[Array, Array]:
    """Γ, for differences that stand for so many pixels, and L."""
    from blurmatte.matting.smooth_kernel import precision  # numba takes half a second

    gamma, root = np.zeros((2, *field.squares.shape))
    least = _NU * prior.scale**2
    precision(field.squares, prior.order, least, cells * (_NU + 1), gamma, root)
    return gamma, root


def _nothing(mask: Bools, prior: Prior) -> Field:
    zero = np.zeros(mask.shape)
    squares = np.zeros((3 * prior.order, *mask.shape))
    squares[[0, 2, 5][: prior.order + 1]] = prior.scale**2
    return Field(zero, zero, squares, np.inf, 0.0, 0, False)


def finer(field: Field, shape: tuple[int, ...], order: int) -> Field:
    """The start that a field is for the level of half the width."""

    def up(values: Array) -> Array:
        inner = np.repeat(np.repeat(values[BORDER:-BORDER, BORDER:-BORDER], 2, 0), 2, 1)
        h, w = (side - 2 * BORDER for side in shape)
        return np.pad(_softened(inner)[:h, :w], BORDER)

    return replace(
        field,
        x=up(field.x),
        variance=up(field.variance).clip(0),
        squares=np.stack([up(part) for part in field.squares]) / 4**order,
    )


def _solve_all(
    gamma: Array,
    order: int,
    mask: Bools,
    jobs: list[tuple[Array, Array, Array]],
    most: int,
    tolerance: float = _TOLERANCE,
) -> int:
    """Solve for each information and right hand side, into the array given with them.

    How many steps the first took.
    """
    from blurmatte.matting.smooth_kernel import conjugate_gradients  # numba takes half a second

    def solve(job: tuple[Array, Array, Array]) -> int:
        A, b, x = job
        return int(conjugate_gradients(A, gamma, order, mask, b, x, most, tolerance))

    with ThreadPoolExecutor(cpu_count()) as threads:
        return list(threads.map(solve, jobs))[0]  # noqa: RUF015  all must have ended


def _disturbed(A: Array, root: Array, order: int, mask: Bools, normal: Array) -> Array:
    """A right hand side whose solution has the covariance H⁻¹."""
    from blurmatte.matting.smooth_kernel import backward, spread

    b: Array = np.sqrt(A) * normal[0] * mask
    t = np.zeros((3, *mask.shape))
    spread(root, order, normal[1:], t)
    backward(t, order, mask, b)
    return b


def _squares(x: Array, samples: list[Array], order: int) -> Array:
    from scipy.ndimage import uniform_filter

    from blurmatte.matting.smooth_kernel import forward, outer

    t, total = np.zeros((3, *x.shape)), np.zeros((3 * order, *x.shape))
    for values, weight in ((x, 1.0), *((z, 1 / len(samples)) for z in samples)):
        forward(values, order, t)
        outer(t, order, weight, total)
    return np.asarray(uniform_filter(total, (0, _POOL, _POOL)), float)


def _pooled(variance: Array, mask: Bools) -> Array:
    """Means of neighbors within the mask: a few samples tell a variance only roughly."""
    from scipy.ndimage import uniform_filter

    near: Array = uniform_filter(np.where(mask, variance, 0), _TOLD_BY)
    share: Array = uniform_filter(mask.astype(float), _TOLD_BY)
    return np.asarray(np.where(mask, near.clip(0) / share.clip(1e-9), 0))


def _left(evidence: Evidence, x: Array) -> tuple[float, int]:
    """Squares that cells leave, over their variances, and how many cells know anything."""
    known = evidence.information > 0
    A = evidence.information[known]
    return float(np.sum((evidence.pull[known] - A * x[known]) ** 2 / A)), len(A)


def _blocks(values: Array) -> Array:
    """Sums over 2 by 2, the border kept."""
    inner = values[BORDER:-BORDER, BORDER:-BORDER]
    h, w = inner.shape
    inner = np.pad(inner, ((0, h % 2), (0, w % 2)))
    h, w = inner.shape
    return np.pad(inner.reshape(h // 2, 2, w // 2, 2).sum(axis=(1, 3)), BORDER)


def _softened(values: Array) -> Array:
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values, 2, origin=0))

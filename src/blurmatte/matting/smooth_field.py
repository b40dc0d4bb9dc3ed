"""A field of alpha, smooth except at edges, estimated from evidence in cells.

In this file A is the information of each cell, x alpha, and D x its differences of first or second
order in all directions: a vector at each place. The differences are normal with a precision matrix Γ
of each place, which has a Wishart prior of ν degrees of freedom and scale σ. So the differences follow
a t distribution: most are small, a few are edges, and along an edge they stay small. Given x, the mean
of Γ is (ν + 1)(νσ²I + E[Dx Dxᵀ])⁻¹; given Γ, x is normal with information H = A + DᵀΓD. Both steps
alternate. The expectation is over the posterior of x, because the best x alone would be too smooth. It
is taken from samples H⁻¹(√A ξ + DᵀL η) with normal ξ and η and LLᵀ = Γ, whose covariance is H⁻¹.

The scale may vary. If Γ is right, DxᵀΓDx of the mean x is, summed over a neighborhood, about equal to
the effective number of parameters there, the sum of A times the variance [MacKay 1992]. The square of
the local scale is multiplied by their ratio. The precision of each place follows well-determined
edges; the scale follows edges with little evidence at each place, and the flat areas between them.

The error of the field at each place comes from simulation. A field has errors from noise, from
smoothing, and from edges and priors that noise changes. The inverse of the equations contains the
first, the mean of the second under the prior, and not the third. So evidence is drawn from fields
similar to the truth, and fitted from the coarsest level on, as that of the picture was. The truth is
rougher than the fitted field. The field plus its smoothed residuals [twicing; Tukey 1977] is rougher
than the truth, by noise. Half of the simulations start from each. Where the residuals of the picture
exceed those of the simulations, the truth is rougher than both, and the variance is multiplied by the
ratio of their squares.

Cells of each level are twice as wide as those of the level before. All maps have a border of `BORDER`
cells, in which the mask is False.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.compiling import in_threads
from blurmatte.matting import smooth_kernel as kernel
from blurmatte.statistics import block_sums

BORDER = 2  # cells around all maps
# Settings of the estimate of a field.
_PRIOR_DOF = 1.0  # ν; one, since edges are common
_PRECISION_WINDOW = 3  # cells across over which E[Dx Dxᵀ] is averaged
_VARIANCE_WINDOW = 5  # cells across over which sampled variances are averaged
LOCAL_DOF = 12.0  # effective parameters that determine a local scale to 40 %
LOCAL_PRIOR_DOF = 1.0  # effective parameters that the scale of the field counts as
_ROUNDS = 2  # alternations of both steps
_TRIALS = 4  # simulations of the error, with a fixed seed
_MAX_STEPS = 300  # of conjugate gradients
TOLERANCE = 1e-5  # gain of log likelihood per cell below which these stop
MIN_ALPHA = -0.05  # at 0 only positive noise would remain, and sums would be too large
_BOUND_STD = 0.01  # standard deviation by which a bound may be violated


@dataclass(frozen=True, eq=False)
class CellEvidence:
    """Information on alpha in each cell; maps are (h, w), of the dtype of the computation."""

    information: Floats  #: one over the variance of a cell's own alpha; 0 outside the mask
    pull: Floats  #: that alpha times the information
    mask: Bools  #: where alpha may be other than 0; False in the border
    lower: Floats  #: lower bound of alpha

    def weaker(self, factor: float) -> "CellEvidence":
        """The same with `factor` times the variance."""
        return replace(self, information=self.information / factor, pull=self.pull / factor)

    @property
    def count(self) -> int:
        """Number of cells in the mask."""
        return int(np.count_nonzero(self.mask))

    def levels(self, max_cells: int) -> list["CellEvidence"]:
        """The level and coarser ones, up to the first with at most `max_cells` cells."""
        found = [self]
        while found[-1].count > max_cells:
            found.append(found[-1].coarser())
        return found

    def coarser(self) -> "CellEvidence":
        """In cells of twice the width."""
        count = sums_2x2(self.mask.astype(np.uint8))
        lower = sums_2x2(np.where(self.mask, self.lower, 0))
        return CellEvidence(
            sums_2x2(self.information),
            sums_2x2(self.pull),
            count > 0,
            (lower / np.maximum(count, 1)).astype(lower.dtype),
        )


def upsampled(values: Floats, shape: tuple[int, ...]) -> Floats:
    """A map (h, w) in cells of half the width, interpolated linearly to a shape."""
    out = np.zeros(shape, values.dtype)
    kernel.doubled(values, BORDER, out)
    return out


def sums_2x2(values: Floats) -> Floats:
    """Sums over 2 by 2 cells, with a border of the same width."""
    inner = values[BORDER:-BORDER, BORDER:-BORDER]
    h, w = inner.shape
    inner = np.pad(inner, ((0, h % 2), (0, w % 2)))
    return np.pad(block_sums(inner, 2), BORDER)


@dataclass(frozen=True)
class Prior:
    """Smoothness of a field."""

    order: int  #: of the differences: 1 of neighbors, 2 of these differences
    scale: float  #: of a difference, in the cells of the level

    def finer(self) -> "Prior":
        """In cells of half the width."""
        return Prior(self.order, self.scale / 2**self.order)


@dataclass(frozen=True, eq=False)
class Field:
    """Posterior of a field."""

    x: Floats  #: (h, w) mean
    variance: Floats  #: (h, w)
    squares: Array  #: (3 or 6, h, w) E[Dx Dxᵀ] of neighbors: the lower triangle, row by row
    roughness: Floats  #: (h, w) square of the local scale over that of the prior
    residual_chi2: float  #: of all cells
    freedom: float  #: degrees of freedom of this χ²
    steps: int  #: of the last solution
    converged: bool  #: whether it stopped before the largest number of steps

    @property
    def risk(self) -> float:
        """Unbiased estimate of the squared error times the information, summed [Stein 1981].

        Up to a constant.
        """
        return self.residual_chi2 - 2 * self.freedom


def fit_field(
    evidence: CellEvidence,
    prior: Prior,
    start: Field | None,
    samples: int,
    cells: int = 1,
    local: bool = False,
) -> Field:
    """Fit a field to evidence and prior.

    start: from a coarser level or another prior.
    samples: samples of the posterior. With 0 only the mean changes, which suffices for cells much
        smaller than the structure of the field.
    cells: pixels per cell; its differences count as many times.
    local: whether to fit the local scale.
    """
    A, mask, rounds = evidence.information, evidence.mask, _ROUNDS
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal((4, *mask.shape)).astype(A.dtype) for _ in range(samples)]
    field = start or _initial(evidence, prior)
    root, held = _precision(prior, field, cells), np.zeros(mask.shape, np.int8)
    for turn in range(rounds):
        x = field.x.copy()
        beyond = mask * (np.int8(x > 1) - np.int8(x < evidence.lower))
        if turn > 0 and noise:
            root = _precision(prior, field, cells)
        elif turn > 0 and np.array_equal(beyond, held):
            break
        held = beyond
        drawn, steps = _solve_with_samples(evidence, root, prior.order, held, x, noise)
        field = replace(field, x=x, steps=steps, converged=steps < _MAX_STEPS)
        if noise:
            traces = [
                np.sum(n[0] * np.sqrt(A) * z, dtype=float)
                for n, z in zip(noise, drawn, strict=True)
            ]
            chi2, known = _residual_chi2(evidence, x)
            variance = pooled_variance(np.mean(np.square(drawn), axis=0), mask)
            if local and turn < rounds - 1:
                factor = _roughness_factor(x, root, prior.order, A * variance, mask)
                field = replace(field, roughness=field.roughness * factor)
            field = replace(
                field,
                variance=variance,
                squares=_squares(x, drawn, prior.order),
                residual_chi2=chi2,
                freedom=known - float(np.mean(traces)),
            )
    return field


def _solve_with_samples(
    evidence: CellEvidence,
    root: Floats,
    order: int,
    held: npt.NDArray[np.int8],
    x: Floats,
    noise: list[Floats],
) -> tuple[list[Floats], int]:
    """Write the mean into x; samples around it, and the steps that the mean took.

    Cells beyond a bound (`held` is 1 above and −1 below) get information on its value.
    """
    A, mask = evidence.information, evidence.mask
    weight = A.dtype.type(_BOUND_STD**-2.0)
    above, below = (weight * (held == side) for side in (1, -1))
    drawn = [np.zeros_like(x) for _ in noise]
    jobs: list[tuple[Floats, Floats, Floats]]
    jobs = [(A + above + below, evidence.pull + above + below * evidence.lower, x)]
    for n, z in zip(noise, drawn, strict=True):
        # The lower bound does not reduce the variance: it holds pixels without object or information.
        jobs.append((A + above, _disturbed(A + above, root, order, mask, n), z))
    return drawn, _solve_all(root, order, mask, jobs, _MAX_STEPS)


def sum_variance(evidence: CellEvidence, prior: Prior, field: Field, cells: int = 1) -> float:
    """Variance of the sum of a field over all pixels, `cells` of which make a cell."""
    ones = evidence.mask.astype(float)
    return float(field_changes(evidence, prior, field, [ones], cells)[0].sum()) * cells**2


def field_changes(
    evidence: CellEvidence,
    prior: Prior,
    field: Field,
    pulls: list[Array],
    cells: int = 1,
    tolerance: float = 0.0,
) -> list[Array]:
    """Changes of a field by changes of the pull (h, w), for each of these."""
    root, A = _precision(prior, field, cells).astype(float), evidence.information.astype(float)
    found = [np.zeros(A.shape) for _ in pulls]
    jobs: list[tuple[Floats, Floats, Floats]]
    jobs = [(A, pull, x) for pull, x in zip(pulls, found, strict=True)]
    _solve_all(root, prior.order, evidence.mask, jobs, 2 * _MAX_STEPS, tolerance)
    return found


def finer_field(field: Field, shape: tuple[int, ...], order: int) -> Field:
    """The start for the level of half the width."""
    squares = np.zeros((len(field.squares), *shape))
    for part, of_level in zip(squares, field.squares / 4**order, strict=True):
        kernel.doubled(of_level, BORDER, part)
    maps = field.x, field.variance, field.roughness
    x, variance, roughness = (upsampled(values, shape) for values in maps)
    roughness = np.maximum(roughness, np.float32(1e-6))  # 0 in the border, where it is a divisor
    return replace(field, x=x, variance=variance, squares=squares, roughness=roughness)


def pooled_variance(variance: Floats, mask: Bools) -> Floats:
    """Means over neighbors in the mask, since few samples determine a variance only roughly."""
    width = _VARIANCE_WINDOW
    near, share = (
        scipy.ndimage.uniform_filter(v, width) for v in (variance * mask, mask.astype(float))
    )
    return np.asarray(np.where(mask, near.clip(0) / share.clip(1e-9), 0), variance.dtype)


def local_mean(values: Floats, parameters: Floats, mask: Bools) -> Array:
    """Gaussian means over neighborhoods of `LOCAL_DOF` effective parameters on average.

    The effective parameters (h, w) of a cell are its information times its variance.
    """
    total = max(np.sum(parameters * mask, dtype=float), 1.0)
    area = LOCAL_DOF * np.count_nonzero(mask) / total  # 4πs²
    inside = np.where(mask, values, 0).astype(float)
    return np.asarray(
        scipy.ndimage.gaussian_filter(inside, np.sqrt(area / (4 * np.pi)), mode="constant")
    )


def _roughness_factor(
    x: Floats, root: Floats, order: int, parameters: Floats, mask: Bools
) -> Floats:
    """Factor (h, w) of the square of the local scale; `parameters` is that of `local_mean`."""
    t = np.zeros((3, *x.shape), x.dtype)
    kernel.forward(x, order, t)
    weighed = t.copy()
    kernel.weigh(root, order, weighed)
    squares = np.sum(t * weighed, axis=0, dtype=float)
    expected = np.asarray(parameters * mask, float)
    total = expected.sum()
    if not (total > 0 and squares.sum() > 0):
        return np.ones_like(x)
    near, usual = (
        local_mean(m, parameters, mask) for m in (squares * total / squares.sum(), expected)
    )
    mean = total / np.count_nonzero(mask)
    prior = LOCAL_PRIOR_DOF / LOCAL_DOF * mean
    return np.asarray((prior + near) / (prior + usual), x.dtype)


def _precision(prior: Prior, field: Field, cells: int) -> Floats:
    """L of Γ, for differences that count for `cells` pixels."""
    nu = _PRIOR_DOF
    root = np.empty(field.squares.shape, field.x.dtype)
    least = nu * prior.scale**2 * field.roughness
    kernel.precision(field.squares, prior.order, least, cells * (nu + 1), root)
    return root


def _initial(evidence: CellEvidence, prior: Prior) -> Field:
    """A field of 0 with the differences of the prior."""
    zero = np.zeros_like(evidence.information)
    squares = np.zeros((3 * prior.order, *zero.shape))
    squares[[0, 2, 5][: prior.order + 1]] = prior.scale**2
    return Field(zero, zero, squares, np.ones_like(zero), np.inf, 0.0, 0, False)


def _solve_all(
    root: Floats,
    order: int,
    mask: Bools,
    jobs: list[tuple[Floats, Floats, Floats]],
    max_steps: int,
    tolerance: float = TOLERANCE,
) -> int:
    """Solve for each (information, right-hand side, solution) in place; steps of the first."""

    def solve(job: tuple[Floats, Floats, Floats]) -> int:
        """Solve one system in place; the number of steps."""
        A, b, x = job
        return int(kernel.conjugate_gradients(A, root, order, mask, b, x, max_steps, tolerance))

    steps, *_ = in_threads(solve, jobs)
    return steps


def _disturbed(A: Floats, root: Floats, order: int, mask: Bools, normal: Floats) -> Floats:
    """A right-hand side whose solution has the covariance H⁻¹."""
    b: Floats = np.sqrt(A) * normal[0] * mask
    t = np.zeros((3, *mask.shape), b.dtype)
    kernel.spread(root, order, normal[1:], t)
    kernel.backward(t, order, mask, b)
    return b


def _squares(x: Floats, samples: list[Floats], order: int) -> Array:
    """E[Dx Dxᵀ] of the mean and samples around it."""
    t, total = np.zeros((3, *x.shape), x.dtype), np.zeros((3 * order, *x.shape))
    for values, weight in ((x, 1.0), *((z, 1 / len(samples)) for z in samples)):
        kernel.forward(values, order, t)
        kernel.outer(t, order, weight, total)
    width = _PRECISION_WINDOW
    return np.asarray(scipy.ndimage.uniform_filter(total, (0, width, width)), float)


def _residual_chi2(evidence: CellEvidence, x: Floats) -> tuple[float, int]:
    """χ² of the residuals of all cells, and how many cells have information."""
    known = evidence.information > 0
    A = evidence.information[known]
    chi2 = (evidence.pull[known] - A * x[known]) ** 2 / A
    return float(np.sum(chi2, dtype=float)), len(A)


def simulated_variance(
    evidence: CellEvidence,
    prior: Prior,
    field: Field,
    refit: Callable[[CellEvidence], Floats],
    cells: int = 1,
) -> tuple[Floats, float]:
    """Variance of each cell of a field, (h, w), and the square of the bias of its sum.

    field: fitted with this prior.
    refit: the field of other evidence, including the choice of the prior.
    cells: pixels per cell.
    """
    A, x, mask = evidence.information, field.x, evidence.mask
    tolerance, residuals = TOLERANCE, [_residuals(evidence, x)]
    (more,) = field_changes(evidence, prior, field, residuals, cells, tolerance)
    rougher = np.where(mask, np.clip(x + more, evidence.lower, 1), 0)
    normal, squares, sums = np.random.default_rng(1), np.zeros(x.shape), np.zeros(_TRIALS)
    for trial in range(_TRIALS):
        true = rougher if trial % 2 else x
        pull = A * true + np.sqrt(A) * normal.standard_normal(A.shape)
        drawn = replace(evidence, pull=pull.astype(A.dtype))
        found = refit(drawn)
        squares += (found - true) ** 2 / _TRIALS
        sums[trial] = np.sum(found - true, dtype=float)
        residuals.append(_residuals(drawn, found))
    others = field_changes(evidence, prior, field, residuals[1:], cells, tolerance)
    parameters = A * field.variance
    near, usual = (
        local_mean(m, parameters, mask) for m in (more**2, np.mean(np.square(others), axis=0))
    )
    before = LOCAL_PRIOR_DOF / LOCAL_DOF * usual
    factor = np.maximum((near + before) / np.maximum(usual + before, 1e-30), 1)
    bias_square = max(sums.mean() ** 2 - sums.var(ddof=1) / _TRIALS, 0.0)
    return (pooled_variance(squares, mask) * factor).astype(x.dtype), float(bias_square)


def _residuals(evidence: CellEvidence, x: Floats) -> Array:
    """Residuals of the pull, where x is not at a bound."""
    free = (x > evidence.lower) & (x < 1)
    return np.where(free, evidence.pull - evidence.information * x, 0).astype(float)

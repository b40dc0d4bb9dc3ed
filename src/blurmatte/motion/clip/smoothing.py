"""Smoothing spline of a curve in time through measurements with covariance, one left out at a time.

In this file the state s(t) is the value of a curve and its derivatives up to an order p − 1, one after
the other, each with as many axes as the curve has. The derivative of order p is white noise of the
intensity q, whose mean is the smoothing spline of degree 2p − 1 [Wahba 1978]; q = 0 is a polynomial.
Over a time h

    s(t + h) = F s(t) + w,    F = exp(h N),    Cov w = q ∫ F(u) e eᵀ F(u)ᵀ du,

N the shift to the next derivative, e the last one. A measurement k has the information (Λ, η) =
(Hᵀ R⁻¹ H, Hᵀ R⁻¹ y) about s. Information from earlier and later ones is carried to its time by the
two-filter recursion [Fraser and Potter 1969]; their sum is all but its own. Nothing is known of s
before the first measurement.

Errors are those of Student's t: most are as stated, a few are mistakes. A measurement of m numbers with
the residual χ² has the weight (ν + m) / (ν + χ²), 1 at most, and the covariance of estimates is
(ν + m + 2) / (ν + m) times that of normal errors [Lange, Little, Taylor 1989].

The recursion is compiled. It carries a square root of the information [Paige and Saunders 1977]: R with
RᵀR = Λ, and z = R s. Sums of squares do not become negative by rounding, as differences of large terms
do.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import factorial

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Indices
from blurmatte.compiling import njit
from blurmatte.statistics import student_loss, student_weight

_MAX_CONDITION = 1e11  # of scaled information; above it the state is not determined
_MIN_STEP_DECADES = 0.2  # of the search for intensities and errors
_STUDENT_FREEDOM = 4.0  # degrees of freedom of the likelihood, few: bounces are outliers
MIN_OUTLIER_PROBABILITY = 1e-3  # that noise differs by as much in any measurement
MIN_STD_PX = 1e-3  # no position, displacement or radius is known better


@dataclass(frozen=True, eq=False)
class Measurements:
    """Linear measurements y = H s + noise of the state of a curve.

    Parameters
    ----------
    times : (n,) float
        Increasing.
    H : (n, m, p a) float
        For p derivatives of a axes.
    y : (n, m) float
    weights : (n, m, m) float
        R⁻¹; 0 for what was not measured.
    axes : int
    """

    times: Array
    H: Array
    y: Array
    weights: Array
    axes: int

    @property
    def order(self) -> int:
        """Number of derivatives in the state, p."""
        return int(self.H.shape[2]) // self.axes

    @property
    def information(self) -> tuple[Array, Array]:
        """(n, s, s), (n, s) information of each about the state."""
        HW = np.einsum("kms,kmn->ksn", self.H, self.weights)
        return HW @ self.H, np.einsum("ksn,kn->ks", HW, self.y)

    def taken(self, which: Indices) -> "Measurements":
        """Some of them."""
        return Measurements(
            self.times[which], self.H[which], self.y[which], self.weights[which], self.axes
        )

    def left_out(self, intensity: float) -> tuple[Array, Array]:
        """(n, s, s), (n, s) information about the state at each time from all other measurements."""
        before, after = self._carried(intensity)
        return before[0] + after[0], before[1] + after[1]

    def from_each_side(self, intensity: float) -> tuple["Estimate", "Estimate"]:
        """The state at each time from those before it, and from it and those after it."""
        before, after = self._carried(intensity)
        L, v = self.information
        return Estimate.of(before), Estimate.of((after[0] + L, after[1] + v))

    @property
    def _square_roots(self) -> tuple[Array, Array]:
        """(n, m, s) S with SᵀS = Λ, and (n, m) z with Sᵀz = η."""
        values, vectors = np.linalg.eigh(self.weights)
        W = np.sqrt(np.maximum(values, 0))[:, :, None] * vectors.swapaxes(1, 2)
        return W @ self.H, np.einsum("kmn,kn->km", W, self.y)

    def _carried(self, intensity: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Information at each time from those before it, and from those after it."""
        S, z = self._square_roots
        before = _carried(self.times, S, z, intensity, self.axes)
        after = _carried(-self.times[::-1], S[::-1], z[::-1], intensity, self.axes, -1)
        return before, (after[0][::-1], after[1][::-1])


@dataclass(frozen=True, eq=False)
class Estimate:
    """A Gaussian estimate of the state at several times; NaN where it is not determined.

    Parameters
    ----------
    mean : (n, s) float
    covariance : (n, s, s) float
    """

    mean: Array
    covariance: Array

    @classmethod
    def of(cls, information: tuple[Array, Array]) -> "Estimate":
        """From information."""
        L, v = information
        scale = np.sqrt(np.diagonal(L, axis1=1, axis2=2))  # sums of squares
        known = np.all(np.isfinite(scale) & (scale > 0), axis=1)
        mean, covariance = np.full(v.shape, np.nan), np.full(L.shape, np.nan)
        both = scale[:, :, None] * scale[:, None]
        values, vectors = np.linalg.eigh(L[known] / both[known])
        known[known] = values[:, 0] * _MAX_CONDITION > values[:, -1]
        use = values[:, 0] * _MAX_CONDITION > values[:, -1]
        values, vectors = values[use], vectors[use]
        V = (vectors / values[:, None]) @ vectors.swapaxes(1, 2) / both[known]
        mean[known], covariance[known] = np.einsum("kij,kj->ki", V, v[known]), V
        return cls(mean, covariance)

    @property
    def known(self) -> Bools:
        """(n,) where the state is determined."""
        return np.asarray(np.isfinite(self.mean[:, 0]))


@lru_cache(maxsize=1024)
def transition(step: float, order: int, axes: int) -> Array:
    """F, (p a, p a)."""
    F = sum(step**k / factorial(k) * np.eye(order, k=k) for k in range(order))
    return np.asarray(np.kron(F, np.eye(axes)), float)


@lru_cache(maxsize=1024)
def _diffusion_root(step: float, order: int, axes: int) -> Array:
    """G with G Gᵀ = Cov w for q = 1, (p a, p a): that of a unit step, scaled."""
    left = np.arange(order)[::-1]  # derivatives from each to the noise
    times = scipy.special.factorial(left)
    unit = 1 / ((1 + left[:, None] + left) * np.outer(times, times))
    powers = np.repeat(step ** (order - np.arange(order) - 0.5), axes)
    return np.asarray(powers[:, None] * np.linalg.cholesky(np.kron(unit, np.eye(axes))))


def _carried(
    times: Array, S: Array, z: Array, intensity: float, axes: int, sign: int = 1
) -> tuple[Array, Array]:
    """Information at each time from the measurements before it; `sign` −1 if time runs backwards."""
    n, _, s = S.shape
    order = s // axes
    flip = np.repeat(float(sign) ** np.arange(order), axes)  # odd derivatives change sign
    steps = np.diff(times, prepend=times[:1]).tolist()
    inverses = np.array([transition(-step, order, axes) for step in steps]).reshape(n, s, s)
    roots = np.array([_diffusion_root(step, order, axes) for step in steps]).reshape(n, s, s)
    L, v = np.zeros((n, s, s)), np.zeros((n, s))
    carry(flip * S, np.ascontiguousarray(z), intensity, inverses, roots, L, v)
    return np.outer(flip, flip) * L, flip * v


def student_cost(chi2: Array, logs: Array, freedom: Array) -> float:
    """Negative log likelihood (Student's t) of measurements about their predictions.

    chi2, logs, freedom (n,): χ², log determinant of its covariance, and degrees of freedom of each.
    """
    return float(np.sum(student_loss(chi2, _STUDENT_FREEDOM, freedom) + logs / 2))


def student_weights(chi2: Array, freedom: Array) -> Array:
    """(n,) weights of measurements with residuals χ² of so many numbers each."""
    return np.asarray(np.minimum(student_weight(chi2, _STUDENT_FREEDOM, freedom), 1.0))


def student_inflation(freedom: int) -> float:
    """Factor of the covariance of estimates from measurements of so many numbers each."""
    return (_STUDENT_FREEDOM + freedom + 2) / (_STUDENT_FREEDOM + freedom)


def least_decades(
    cost: Callable[[Array], float], starts: Sequence[Array], ranges: Sequence[tuple[float, float]]
) -> Array:
    """The powers of ten near starts, within ranges, of the least cost, by pattern searches."""
    low, high = np.transpose(ranges)
    axes = np.eye(len(low))
    at = cache(lambda *x: cost(np.array(x)))  # searches return to where one was before

    def search(start: Array) -> tuple[float, list[float]]:
        """The least cost near a start, and where it is."""
        best, step = np.clip(start, low, high), 1.0
        least = at(*best.tolist())
        while step > _MIN_STEP_DECADES:
            trials = [np.clip(best + step * axis, low, high) for axis in (*axes, *-axes)]
            costs = [at(*trial.tolist()) for trial in trials]
            k = int(np.argmin(costs))
            if costs[k] < least:
                best, least = trials[k], costs[k]
            else:
                step /= 2
        return least, best.tolist()

    return np.array(min(map(search, starts), key=lambda found: found[0])[1])


def noise_scale(chi2: Array, freedom: Array) -> float:
    """Variance of the noise in units of the stated one, from the median of χ² (n,); at least 1."""
    return max(float(np.median(chi2 / scipy.special.chdtri(freedom, 0.5))), 1.0)


@njit()
def carry(S, z, intensity, inverses, roots, carried_L, carried_v):  # type: ignore[no-untyped-def]
    """Information (n, s, s), (n, s) at each time from the measurements before it.

    S (n, m, s), z (n, m): square root of the information of each measurement, and what it measured.
    inverses, roots (n, s, s): F⁻¹, and G with G Gᵀ = Cov w for q = 1, of the step to each time.
    carried_L, carried_v: results, 0 at the first time.
    """
    n, m, s = S.shape
    known = np.zeros((s + m, s + 1))  # R and z, and those of the measurement below
    both = np.eye(2 * s, 2 * s + 1)  # equations of noise u of variance 1 and of the state
    for k in range(1, n):
        known[s:, :s], known[s:, s] = S[k - 1], z[k - 1]
        known[:s] = np.linalg.qr(known)[1][:s]
        moved = np.ascontiguousarray(known[:s, :s]) @ inverses[k]
        both[s:, :s], both[s:, s:-1] = -(intensity**0.5) * moved @ roots[k], moved
        both[s:, -1] = known[:s, s]
        known[:s] = np.linalg.qr(both)[1][s:, s:]
        R = np.ascontiguousarray(known[:s, :s])
        carried_L[k], carried_v[k] = R.T @ R, R.T @ np.ascontiguousarray(known[:s, s])

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
"""

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_MAX_CONDITION = 1e11  # of scaled information; above it the state is not determined


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

    def taken(self, which: npt.NDArray[np.intp]) -> "Measurements":
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

    def _carried(self, intensity: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Information at each time from those before it, and from those after it."""
        L, v = self.information
        before = _carried(self.times, L, v, intensity, self.axes)
        after = _carried(-self.times[::-1], L[::-1], v[::-1], intensity, self.axes, -1)
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
        scale = np.sqrt(np.diagonal(L, axis1=1, axis2=2))
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
    def known(self) -> npt.NDArray[np.bool_]:
        """(n,) where the state is determined."""
        return np.asarray(np.isfinite(self.mean[:, 0]))


@lru_cache(maxsize=1024)
def transition(step: float, order: int, axes: int) -> Array:
    """F, (p a, p a)."""
    F = np.zeros((order, order))
    for i in range(order):
        for j in range(i, order):
            F[i, j] = step ** (j - i) / factorial(j - i)
    return np.asarray(np.kron(F, np.eye(axes)), float)


@lru_cache(maxsize=1024)
def diffusion(step: float, order: int, axes: int) -> Array:
    """Covariance of w for q = 1, (p a, p a)."""
    Q = np.zeros((order, order))
    for i in range(order):
        for j in range(order):
            a, b = order - 1 - i, order - 1 - j
            Q[i, j] = step ** (a + b + 1) / ((a + b + 1) * factorial(a) * factorial(b))
    return np.asarray(np.kron(Q, np.eye(axes)), float)


def _carried(
    times: Array, L: Array, v: Array, intensity: float, axes: int, sign: int = 1
) -> tuple[Array, Array]:
    """Information at each time from the measurements before it; `sign` −1 if time runs backwards."""
    size = L.shape[1]
    order = size // axes
    flip = np.repeat(float(sign) ** np.arange(order), axes)  # odd derivatives change sign
    before_L, before_v = np.zeros_like(L), np.zeros_like(v)
    carried_L, carried_v = np.zeros((size, size)), np.zeros(size)
    for k in range(1, len(times)):
        step = float(times[k] - times[k - 1])
        inverse = transition(-step, order, axes)
        flipped = np.outer(flip, flip)
        M = inverse.T @ (carried_L + flipped * L[k - 1]) @ inverse
        u = inverse.T @ (carried_v + flip * v[k - 1])
        damping = np.eye(size) + intensity * M @ diffusion(step, order, axes)
        both = np.linalg.solve(damping, np.column_stack([M, u]))
        carried_L, carried_v = (both[:, :-1] + both[:, :-1].T) / 2, both[:, -1]
        before_L[k], before_v[k] = flipped * carried_L, flip * carried_v
    return before_L, before_v

"""Maximum-likelihood fit of rotating blades: center, angle of rotation and edges.

Each blade of a rigid object lies between two curves φ(ρ), sums of a few powers of ρ. Alpha of a pixel
is the difference of two ramps of width ω, both averaged over the pixel's angular width 1/ρ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.descent import descended
from blurmatte.motion.space.rotation_ring import GRID, RingPixels

# Of ρ: −1 and −3 describe straight edges that miss the center, 2 describes curved edges.
_POWERS = (-3.0, -1.0, 0.0, 1.0, 2.0)


# The descent of a fit of blades.
_MAX_STEPS = 60
_MIN_GAIN = 1e-2  # log likelihood: the fit has converged
_MAX_TURN_STEP = 0.5  # of ω, for ω and the edges: the range of the linearization
_MAX_CENTER_STEP_PX = 5.0
_HUBER_RESIDUAL = 3.0  # standard deviations: larger residuals have the linear loss


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters, residuals in standard deviations, and their derivatives, in a search."""

    p: Array
    e: Array
    J: Array

    @property
    def cost(self) -> float:
        """Huber's loss."""
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

"""Blades that turn: the most likely center, angle and edges.

Each blade of a rigid thing lies between two curves φ(ρ), sums of a few powers of ρ, and alpha of a
pixel is the difference of two ramps of width ω, both averaged over the pixel's width 1/ρ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.motion.rotation_ring import Pixels

Array = npt.NDArray[np.float64]

_GRID = 720  # angles
_POWERS = (
    -3.0,
    -1.0,
    0.0,
    1.0,
    2.0,
)  # of ρ: −1 and −3 for straight edges beside the center, 2 for bent ones
_RAMP, _FAR = 0.5, 5.0  # of ω, and pixels of the center: the largest step
_STEPS, _ENOUGH = 60, 1e-2  # units of log likelihood: no step gains more
_LEAST = 1e-12  # of the largest curvature, what a parameter without any is given
_DOUBT = 3.0  # residuals, from which on they count less


@dataclass(frozen=True, eq=False)
class Blades:
    """Parameters: the center unless it is known, ω, and for both edges of each blade its powers."""

    center: Array | None
    ring: tuple[float, float]
    blades: list[tuple[float, float]]

    def fit(self, pixels: Pixels, c: Array, omega: float) -> tuple[Array, Array, Array]:
        """Center and ω (3,); curvature (m, m) of the cost, those first; and residuals (n,).

        The center follows when the rest is nearly right: before, it would go anywhere.
        """
        one = np.linalg.solve(self._basis, np.eye(len(_POWERS))[_POWERS.index(0)])
        sides = [middle + half * width for middle, width in self.blades for half in (-0.5, 0.5)]
        start = np.concatenate([[omega], *(side * one for side in sides)])
        p, e, J = replace(self, center=c)._descended(start, pixels)
        if self.center is None:
            p, e, J = self._descended(np.concatenate([c, p]), pixels)
        at = p if self.center is None else np.concatenate([self.center, p])
        return at[:3], J.T @ J, e

    def _descended(self, p: Array, pixels: Pixels) -> tuple[Array, Array, Array]:
        """Parameters, residuals and their derivatives after Levenberg–Marquardt steps.

        Large residuals count less (Huber's loss).
        """
        caution = 1e-3
        e, J = self._residuals(p, pixels)
        for _ in range(_STEPS):
            weight = 1 / np.maximum(np.abs(e) / _DOUBT, 1)
            H, g = (J * weight[:, None]).T @ J, J.T @ (weight * e)
            damped = H + caution * np.diag(np.diag(H)) + _LEAST * np.diag(H).max() * np.eye(len(p))
            step = np.linalg.solve(damped, g)
            tried = p - step / max(self._too_far(p, step), 1)
            e_tried, J_tried = self._residuals(tried, pixels)
            gain = float(_huber(e) - _huber(e_tried))
            if gain <= 0:
                caution *= 5
                continue
            p, e, J, caution = tried, e_tried, J_tried, max(caution / 5, 1e-8)
            if gain < _ENOUGH:
                break
        return p, e, J

    def _too_far(self, p: Array, step: Array) -> float:
        """By how much a step leaves the range of the linear: a ramp, or some pixels of the center."""
        free = 2 if self.center is None else 0
        turn, center = abs(step[free]) / (_RAMP * p[free]), np.abs(step[:free]).max(initial=0)
        edges = np.abs(step[free + 1 :]).max(initial=0) / (_RAMP * p[free])
        return float(max(turn, center / _FAR, edges))

    def _residuals(self, p: Array, pixels: Pixels) -> tuple[Array, Array]:
        alpha, J = self._alpha(p, pixels)
        return (alpha - pixels.alpha) / pixels.std, J / pixels.std[:, None]

    @property
    def _basis(self) -> Array:
        """(k, k) sums of the powers of ρ that differ from each other as much as can be in the ring."""
        rho = np.linspace(*self.ring, _GRID) / np.mean(self.ring)
        triangle = np.linalg.qr(rho[:, None] ** np.array(_POWERS, float))[1]
        return np.asarray(np.linalg.inv(triangle) * np.sqrt(_GRID))

    def _alpha(self, p: Array, pixels: Pixels) -> tuple[Array, Array]:
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


def _huber(e: Array) -> float:
    """Half the sum of squares, but for what is beyond doubt."""
    far = np.maximum(np.abs(e) - _DOUBT, 0)
    return float(np.sum(e**2 - far**2)) / 2


def ramp(u: Array, omega: float, pixel: Array) -> tuple[Array, Array, Array]:
    """How much of the exposure, in the mean over a pixel, an edge had passed that is u behind.

    The integral of a box of width ω blurred by one of the pixel's width, over all turns: 0 long
    before the edge, 1 after it, and derivatives by u and ω. The silhouette comes round again with every
    full turn, so that a blade, the difference of two of these, wraps around.
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

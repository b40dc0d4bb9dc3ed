"""Spin: the rotation of a ball in space during the exposure, and the light on it.

In this file n is an outward unit normal of the ball in the camera's frame: x right, y down, z towards
the camera. With the rotation vector ω of the whole exposure, the point of the body seen at n at the
exposure fraction t is R(t)ᵀ n, R(t) = exp((t − 1/2) [ω]ₓ). The light on the ball does not turn with
it. It is a factor of the color,

    f(n) = 1 + Σₖ bₖ Yₖ(n),

with the spherical harmonics of orders 1 and 2, less their means over the disc. They contain 99 % of
the energy of a matte surface under any distant light [Ramamoorthi & Hanrahan 2001]. Lamps of different
hues add Σₖ βₖ Yₖ(n), with coefficients βₖ of each channel, for a color near the ball's mean.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.sweep.sweep import Sweep

HARMONICS = 8  # of the light on a ball: those of orders 1 and 2
AMBIGUITY = "the direction of time is unknown: reversing path and spin gives the same picture"


@dataclass(frozen=True, eq=False)
class Spin:
    """Rotation of a ball during the exposure, in the direction of time of its sweep.

    Axes are (x, y, z) with x right, y down and z towards the camera; about +z a ball turns x towards y,
    clockwise in the picture. The sweep of one picture has no known direction of time: the reversed path
    with the reversed spin explains it equally well.

    Parameters
    ----------
    rotation : (3,) float
        Rotation vector, radians per exposure.
    shading : (8,) float
        Coefficients of the light on the ball, relative to the mean: harmonics of orders 1 and 2.
    covariance : (11, 11) float
        Of rotation and shading.
    log_evidence_margin : float
        Log Bayes factor between this rotation and the next best distinct one.
    sweep : Sweep, optional
        The sweep with the path and shape that were refined with the rotation.

    Examples
    --------
    >>> quarter = bm.deblurring.Spin(np.radians([0, 0, 90]))
    >>> print(f"{quarter.rate_deg:.0f}° about {quarter.axis}")
    90° about [0. 0. 1.]
    """

    rotation: Array
    shading: Array = field(default_factory=lambda: np.zeros(HARMONICS))
    covariance: Array = field(default_factory=lambda: np.zeros((3 + HARMONICS, 3 + HARMONICS)))
    log_evidence_margin: float = np.inf
    sweep: Sweep | None = None

    def __post_init__(self) -> None:
        shapes = {"rotation": (3,), "shading": (HARMONICS,), "covariance": (3 + HARMONICS,) * 2}
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise ValueError(
                    f"{name} must be finite numbers of shape {shape}, got {value.shape}"
                )
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        x, y, z = self.axis
        return (
            f"Spin({self.rate_deg:.1f} ± {self.rate_std_deg:.1f}° per exposure about "
            f"({x:.2f}, {y:.2f}, {z:.2f}) ± {self.axis_std_deg:.1f}°)"
        )

    @property
    def rate(self) -> float:
        """Radians per exposure, not negative."""
        return float(np.linalg.norm(self.rotation))

    @property
    def rate_deg(self) -> float:
        """Degrees per exposure, not negative."""
        return float(np.degrees(self.rate))

    @property
    def axis(self) -> Array:
        """(3,) unit vector; (0, 0, 1) if the ball does not turn."""
        return self.rotation / self.rate if self.rate > 0 else np.array([0.0, 0.0, 1.0])

    @property
    def rotation_covariance(self) -> Array:
        """(3, 3) covariance of the rotation vector, radians²."""
        return np.asarray(self.covariance[:3, :3])

    @property
    def rate_std_deg(self) -> float:
        """Standard deviation of the rate, degrees per exposure."""
        return float(np.degrees(np.sqrt(self.axis @ self.rotation_covariance @ self.axis)))

    @property
    def axis_std_deg(self) -> float:
        """Root mean square error of the axis, degrees, at most 180."""
        across = np.trace(self.rotation_covariance) - np.radians(self.rate_std_deg) ** 2
        return float(min(np.degrees(np.sqrt(max(across, 0.0)) / max(self.rate, 1e-9)), 180.0))

    @property
    def ambiguity(self) -> str:
        """What one picture does not determine."""
        return AMBIGUITY

    def turns(self, t: Array) -> Array:
        """(T, 3, 3) rotations from the body to the camera's frame at exposure fractions (T,)."""
        vectors = (np.asarray(t, float)[:, None] - 0.5) * self.rotation
        return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(vectors).as_matrix())

    def jacobians(self, t: Array) -> Array:
        """(T, 3, 3) left Jacobians: a change δ of the rotation turns the body at tₖ by jacobiansₖ δ."""
        x, y, z = axis = self.axis
        angle = self.rate * (np.asarray(t, float) - 0.5)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        shrunk = np.sinc(angle / np.pi)[:, None, None]  # sin angle / angle
        aside = (np.sin(angle / 2) * np.sinc(angle / 2 / np.pi))[:, None, None]
        J = shrunk * np.eye(3) + (1 - shrunk) * np.outer(axis, axis) + aside * cross
        return np.asarray((np.asarray(t, float) - 0.5)[:, None, None] * J)

    def light(self, normal: Array) -> Array:
        """(m,) factor of the color at unit normals (m, 3)."""
        return np.asarray(1 + harmonics(normal) @ self.shading)


def harmonics(normal: Array) -> Array:
    """(m, 8) real spherical harmonics of orders 1 and 2 at unit normals (m, 3).

    Their means over the disc are 0, so that the mean light is that of the color.
    """
    x, y, z = normal.T
    return np.stack([x, y, z - 2 / 3, x * y, y * z, z * x, x * x - y * y, z * z - 1 / 2], axis=1)

"""The time that a camera takes to read its rows, from how it stretches a disc in the frames of a clip.

A camera with a rolling shutter exposes each row later than the one above it, by the readout time ρ, in
exposures. In this file u = ρ v, with v the displacement (x, y) of an object in an exposure, pixels,
and e is the unit vector of the picture from each row to the next: (0, 1) unless the file was turned
upright. A point d from the center is seen ρ eᵀd exposures later, moved by u eᵀd: the image of a disc
that moves at constant velocity is its image under (I − u eᵀ)⁻¹, to first order an ellipse of the
stretch

    (a, b) = (u_x e_x − u_y e_y, u_x e_y + u_y e_x) / 2,

as `Silhouette` has it, and of a factor of the size that goes into the radius. Shadows next to the disc,
compression, and the lens change it too: frames differ from this by an error of their own, the likeliest
with Student's t as the distribution of errors. The stretch in a frame is then known from two sources,
the camera and the frame itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import DIRECTIONS, Array, Direction
from blurmatte.motion.clip.smoothing import least_decades, student_cost, student_weights
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR

Stretch = tuple[Array, Array]  # (2,) and covariance (2, 2)

_ROUNDS = 10  # of weights and readout time
_SCATTER_DECADES = (-3.0, 0.0)  # of the stretches, powers of ten
# Of which the first order is a good approximation: an ellipse 1.8 times as long as wide
_MAX_STRETCH = 0.3


@dataclass(frozen=True)
class RollingShutter:
    """How a camera stretches discs.

    Parameters
    ----------
    readout : float
        Time between two rows, exposures.
    scatter : float
        Standard deviation of stretches about that, in each direction, beyond the errors of frames.
    log_odds : float
        Against a camera that exposes all rows at once.
    rows : "down", "up", "left" or "right"
        Where the next row lies in the picture.
    """

    readout: float = 0.0
    scatter: float = 0.0
    log_odds: float = 0.0
    rows: Direction = "down"

    @classmethod
    def of(
        cls, frames: Sequence[tuple[Stretch, Array]], rows: Direction = "down"
    ) -> RollingShutter:
        """From the stretch of the disc and its displacement (2,), pixels, in several exposures."""
        if not frames:
            return cls(rows=rows)
        y = np.array([stretch for (stretch, _), _ in frames])
        V = np.array([covariance for (_, covariance), _ in frames])
        X = np.array([_slope(displacement, rows) for _, displacement in frames])
        penalty = 0.5 * float(np.log(y.size))
        without, (cost, found) = _likeliest(y, V, np.zeros_like(X))[0], _likeliest(y, V, X)
        return replace(found, log_odds=without - cost - penalty, rows=rows)

    @property
    def is_decisive(self) -> bool:
        """Whether the rows are certainly exposed one after another."""
        return self.log_odds > DECISIVE_LOG_BAYES_FACTOR

    def stretch(self, displacement: Array, own: Stretch | None = None) -> tuple[Array, float]:
        """Stretch of a disc that moves by a displacement (2,), pixels, in an exposure, and its cost.

        The cost is minus the log of the Occam factor of a stretch that is fitted to the frame: the
        disc is that much less likely than its residuals say.

        own: as its frame alone measures it.
        """
        stretch, cost = self.readout * _slope(displacement, self.rows), 0.0
        if own is not None and self.scatter > 0:
            e, among = own[0] - stretch, self.scatter**2 * np.eye(2)
            chi2 = e @ np.linalg.solve(own[1] + among, e)
            V = own[1] / student_weights(np.array([chi2]), np.array([2.0]))[0]
            change = among @ np.linalg.solve(V + among, e)
            cost = 0.5 * float(np.linalg.slogdet(np.eye(2) + among @ np.linalg.inv(V))[1])
            cost += 0.5 * float(change @ change) / self.scatter**2
            stretch = stretch + change
        limit = min(1.0, _MAX_STRETCH / max(float(np.linalg.norm(stretch)), 1e-12))
        return stretch * limit, cost


def _slope(displacement: Array, rows: Direction) -> Array:
    """(2,) stretch by the readout time."""
    (u, v), (x, y) = displacement, DIRECTIONS[rows]
    return np.array([u * x - v * y, u * y + v * x]) / 2


def _likeliest(y: Array, V: Array, X: Array) -> tuple[float, RollingShutter]:
    """The least cost of stretches y (n, 2) with errors V (n, 2, 2), and its ρ and scatter."""
    numbers = np.full(len(y), 2.0)

    def fitted(scatter: float) -> tuple[float, RollingShutter]:
        """Cost and ρ."""
        readout, S = 0.0, V + scatter**2 * np.eye(2)
        SX = np.linalg.solve(S, X[..., None])[..., 0]
        for _ in range(_ROUNDS):
            e = y - readout * X
            chi2 = np.einsum("ki,ki->k", e, np.linalg.solve(S, e[..., None])[..., 0])
            w = student_weights(chi2, numbers)
            information = float(np.sum(w * np.einsum("ki,ki->k", X, SX)))
            readout = float(np.sum(w * np.einsum("ki,ki->k", y, SX))) / max(information, 1e-12)
        logs = np.linalg.slogdet(S)[1]
        return student_cost(chi2, logs, numbers), RollingShutter(readout, scatter)

    start = np.array([sum(_SCATTER_DECADES) / 2])
    decades = least_decades(lambda x: fitted(10.0 ** x[0])[0], [start], [_SCATTER_DECADES])
    return fitted(float(10.0 ** decades[0]))

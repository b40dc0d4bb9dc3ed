"""The time that a camera takes to read its rows, from how it stretches a disc in the frames of a clip.

A camera with a rolling shutter exposes each row later than the one above it, by the readout time ρ, in
exposures. In this file u = ρ v, with v the displacement (x, y) of an object in an exposure, pixels. A
point y below the center is seen y ρ exposures later, moved by y u: the image of a disc that moves at
constant velocity is its image under (I − u e_yᵀ)⁻¹, to first order an ellipse of the stretch

    (a, b) = (−u_y, u_x) / 2,

as `Silhouette` has it, and of a factor of the size that goes into the radius.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from blurmatte.motion.clip.smoothing import student_cost, student_weights
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR

Array = npt.NDArray[np.float64]

_ROUNDS = 10  # of weights and readout time
# Of which the first order is a good approximation: an ellipse 1.8 times as long as wide
_MAX_STRETCH = 0.3


def camera_stretch(readout: float, displacement: Array) -> tuple[float, float]:
    """Stretch of a disc that moves by a displacement (2,), pixels, in an exposure.

    readout: time between two rows, exposures.
    """
    x, y = readout * displacement
    stretch = np.array([0.0 - y, x]) / 2
    stretch *= min(1.0, _MAX_STRETCH / max(float(np.linalg.norm(stretch)), 1e-12))
    return float(stretch[0]), float(stretch[1])


def readout_time(stretches: Sequence[tuple[Array, Array]], displacements: Sequence[Array]) -> float:
    """Time between two rows, exposures, from several frames; 0 if it explains them no better.

    Errors of stretches are those of Student's t, larger than stated by the likeliest factor.

    stretches: (2,) and covariance (2, 2) of each frame.
    displacements: (2,) of the object in each exposure, pixels.
    """
    if not stretches:
        return 0.0
    y = np.array([stretch for stretch, _ in stretches])
    V = np.array([covariance for _, covariance in stretches])
    X = np.array([(-v[1] / 2, v[0] / 2) for v in displacements])
    numbers = np.full(len(y), 2.0)

    def fitted(X: Array) -> tuple[float, float]:
        """ρ and its cost."""
        readout, scale = 0.0, 1.0
        for _ in range(_ROUNDS):
            e = y - readout * X
            chi2 = np.einsum("ki,ki->k", e, np.linalg.solve(V, e[..., None])[..., 0])
            w = student_weights(chi2 / scale, numbers)
            scale = max(float(np.sum(w * chi2) / np.sum(numbers)), 1e-12)
            VX = np.linalg.solve(V, X[..., None])[..., 0]
            information = float(np.sum(w * np.einsum("ki,ki->k", X, VX)))
            readout = float(np.sum(w * np.einsum("ki,ki->k", y, VX))) / max(information, 1e-12)
        logs = np.full(len(y), 2 * np.log(scale))
        return readout, student_cost(chi2 / scale, logs, numbers)

    (_, without), (readout, cost) = fitted(np.zeros_like(X)), fitted(X)
    penalty = 0.5 * float(np.log(numbers.sum()))
    return readout if without - cost - penalty > DECISIVE_LOG_BAYES_FACTOR else 0.0

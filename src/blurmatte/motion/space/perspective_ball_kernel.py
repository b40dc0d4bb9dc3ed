"""Alpha of a ball that moves before a camera, and its derivatives, compiled.

In this file lengths in space are radii of the ball. A ball at X, in the direction d = X/|X|, covers
the rays x within the angle ρ = asin(1/|X|) of d. A pixel lies s = (ρ − ψ)/|∇ψ| pixels inside the
outline, with ψ the angle between x and d and ∇ψ its change from pixel to pixel. So

    ds/dX = ((x − d cos ψ)/(|X| sin ψ) − d tan ρ/|X|) / |∇ψ| .
"""

import numpy as np

from blurmatte.compiling import njit
from blurmatte.sweep.model.rim_kernel import reach_of
from blurmatte.sweep.model.silhouette_kernel import covered


@njit()
def flight(X, D, weights, boxes, rays, slopes, alpha, J):  # type: ignore[no-untyped-def]
    """Add the coverage by a moving ball to alpha (h, w), and its derivatives to J (h, w, n).

    X (T, 3) are its centers, D (T, 3, n) their derivatives, weights (T,) parts of the exposure, boxes
    (T, 4) the pixels x0, y0, x1, y1 that may see it; rays (h, w, 3) are unit directions, slopes
    (h, w, 3, 2) their change from pixel to pixel.
    """
    n, reach = D.shape[2], reach_of(0.0)  # beyond, a pixel is inside or outside
    d, by_X = np.empty(3), np.empty(3)
    for k in range(len(X)):
        distance = np.sqrt(X[k, 0] ** 2 + X[k, 1] ** 2 + X[k, 2] ** 2)
        if distance <= 1:
            continue
        for c in range(3):
            d[c] = X[k, c] / distance
        rho = np.arcsin(1 / distance)
        tan_rho = np.tan(rho)
        for j in range(boxes[k, 1], boxes[k, 3]):
            for i in range(boxes[k, 0], boxes[k, 2]):
                x, slope = rays[j, i], slopes[j, i]
                cosine = x[0] * d[0] + x[1] * d[1] + x[2] * d[2]
                sine = np.sqrt(max(1 - cosine * cosine, 1e-30))
                gx = -(slope[0, 0] * d[0] + slope[1, 0] * d[1] + slope[2, 0] * d[2]) / sine
                gy = -(slope[0, 1] * d[0] + slope[1, 1] * d[1] + slope[2, 1] * d[2]) / sine
                G = np.sqrt(gx * gx + gy * gy)
                s = (rho - np.arctan2(sine, cosine)) / max(G, 1e-30) - G / (24 * rho)
                if s >= reach:
                    alpha[j, i] += weights[k]
                    continue
                if not s > -reach:
                    continue
                part, gain = covered(s, gx / G, gy / G)
                alpha[j, i] += weights[k] * part
                if gain == 0:
                    continue
                for c in range(3):
                    outward = (x[c] - d[c] * cosine) / sine
                    by_X[c] = weights[k] * gain * (outward - d[c] * tan_rho) / (distance * G)
                for p in range(n):
                    J[j, i, p] += by_X[0] * D[k, 0, p] + by_X[1] * D[k, 1, p] + by_X[2] * D[k, 2, p]

"""The swept polynomials of a disc, compiled."""

import numpy as np

from blurmatte.compiling import njit
from blurmatte.sweep.model.rim_kernel import reach_of, variance_of
from blurmatte.sweep.model.silhouette_kernel import covered_softly


@njit()
def swept(xy, weights, radius, soft, order, S):  # type: ignore[no-untyped-def]
    """Add to S (h, w, k) the integrals of functions on a disc over the time when it covers a pixel.

    Centers xy (T, 2), radius and blur of the rim are in pixels, the weights (T,) are parts of the
    exposure. With (u, v, z) the normal of a sphere, the functions are uⁱ vʲ up to an order, sorted by
    order and then by j, and z, z u, z v. A pixel at the rim has the value in the middle of its covered
    part.
    """
    h, w, _ = S.shape
    variance, reach = variance_of(soft), reach_of(soft)
    wide, curvature = 1 / np.sqrt(variance), 1 / radius
    rim = radius - variance / 2 * curvature
    outer, half_width = rim + reach, np.sqrt(3 * variance)  # of the box of this variance
    power_u, power_v = np.ones(order + 1), np.ones(order + 1)
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        first, last = max(int(np.ceil(cy - outer)), 0), min(int(np.floor(cy + outer)), h - 1)
        for j in range(first, last + 1):
            dy = j - cy
            half = np.sqrt(max(outer * outer - dy * dy, 0.0))
            left, right = max(int(np.ceil(cx - half)), 0), min(int(np.floor(cx + half)), w - 1)
            for i in range(left, right + 1):
                dx = i - cx
                d = np.sqrt(dx * dx + dy * dy)
                nx, ny = (dx / d, dy / d) if d > 1e-9 else (1.0, 0.0)
                part, _, _ = covered_softly(rim - d, nx, ny, soft, wide, curvature)
                if part <= 0:
                    continue
                if d > radius - half_width:
                    d = min(max((d - half_width + radius) / 2, 0.0), radius)
                u, v, part = nx * d / radius, ny * d / radius, weights[k] * part
                z = part * np.sqrt(max(1 - u * u - v * v, 0.0))
                for n in range(order):
                    power_u[n + 1], power_v[n + 1] = power_u[n] * u, power_v[n] * v
                at = 0
                for n in range(order + 1):
                    for m in range(n + 1):
                        S[j, i, at] += part * power_u[n - m] * power_v[m]
                        at += 1
                S[j, i, at] += z
                S[j, i, at + 1] += z * u
                S[j, i, at + 2] += z * v

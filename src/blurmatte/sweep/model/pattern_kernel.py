"""The swept polynomials of a disc, compiled."""

import numpy as np

from blurmatte.compiling import njit
from blurmatte.sweep.model.rim_kernel import reach_of, variance_of
from blurmatte.sweep.model.silhouette_kernel import covered_softly, within


@njit()
def swept(xy, weights, radius, soft, order, S):  # type: ignore[no-untyped-def]
    """Add to S (h, w, k) the integrals of functions on a disc over the time when it covers a pixel.

    Centers xy (T, 2), radius and blur of the rim are in pixels, the weights (T,) are parts of the
    exposure. With (u, v, z) the normal of a sphere, the functions are uⁱ vʲ up to an order, sorted by
    order and then by j, and z, z u, z v. A pixel at the rim has the value in the middle of its covered
    part.
    """
    h, w, _ = S.shape
    wide, curvature, rim, outer, half_width = _rim_of(radius, soft)
    power_u, power_v = np.ones(order + 1), np.ones(order + 1)
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        for j in range(*within(cy, outer, h)):
            dy = j - cy
            half = np.sqrt(max(outer * outer - dy * dy, 0.0))
            for i in range(*within(cx, half, w)):
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


@njit()
def derivatives(  # type: ignore[no-untyped-def]
    xy, by_path, weights, radius, soft, by_powers, of_z, plate, J
):
    """Add to J (h, w, q + 2) the derivatives of light by the parameters of a path, radius and blur.

    The light of a pixel is the integral of f − B as `swept` integrates functions, with the pattern f
    that is the sum of by_powers[i, j] uⁱ vʲ and of z, z u, z v with the coefficients of_z (3,).

    by_path (T, 2, q): of the centers. plate (h, w): B.
    """
    h, w, count = J.shape
    wide, curvature, rim, outer, half_width = _rim_of(radius, soft)
    rim_by_radius = 1 + variance_of(soft) / 2 * curvature**2
    for k in range(len(xy)):
        cx, cy = xy[k, 0], xy[k, 1]
        for j in range(*within(cy, outer, h)):
            dy = j - cy
            half = np.sqrt(max(outer * outer - dy * dy, 0.0))
            for i in range(*within(cx, half, w)):
                dx = i - cx
                d = np.sqrt(dx * dx + dy * dy)
                nx, ny = (dx / d, dy / d) if d > 1e-9 else (1.0, 0.0)
                part, by_edge, by_soft = covered_softly(rim - d, nx, ny, soft, wide, curvature)
                if part <= 0:
                    continue
                # Distance from the center in the middle of the covered part, and its derivatives
                at, by_d, by_radius, by_width = d, 1.0, 0.0, 0.0
                if d > radius - half_width:
                    at, by_d, by_radius, by_width = (d - half_width + radius) / 2, 0.5, 0.5, -0.5
                    if at > radius:
                        at, by_d, by_radius, by_width = radius, 0.0, 1.0, 0.0
                f, f_u, f_v = _with_slopes(by_powers, of_z, nx * at / radius, ny * at / radius)
                f -= plate[j, i]
                outward = part * curvature * (f_u * nx + f_v * ny)
                around = part * curvature * (f_v * nx - f_u * ny) * (at / d if d > 1e-9 else 1.0)
                by_d = by_edge * f - outward * by_d
                by_x, by_y = nx * by_d + ny * around, ny * by_d - nx * around
                for n in range(count - 2):
                    by_n = by_x * by_path[k, 0, n] + by_y * by_path[k, 1, n]
                    J[j, i, n] += weights[k] * by_n
                by_radius = rim_by_radius * by_edge * f + outward * (by_radius - at * curvature)
                J[j, i, count - 2] += weights[k] * by_radius
                by_soft = by_soft * f + outward * by_width * np.sqrt(3.0) * soft * wide
                J[j, i, count - 1] += weights[k] * by_soft


@njit()
def _rim_of(radius, soft):  # type: ignore[no-untyped-def]
    """Of a disc: 1/σ of the rim's profile, its curvature and radius, the radius of pixels that see it.

    The last number is half the width of a box of the variance σ².
    """
    variance, curvature = variance_of(soft), 1 / radius
    rim = radius - variance / 2 * curvature
    return 1 / np.sqrt(variance), curvature, rim, rim + reach_of(soft), np.sqrt(3 * variance)


@njit()
def _with_slopes(by_powers, of_z, u, v):  # type: ignore[no-untyped-def]
    """The value of a pattern and its derivatives by u and v."""
    order = len(by_powers) - 1
    z = np.sqrt(max(1 - u * u - v * v, 1e-12))
    of_normal = of_z[0] + u * of_z[1] + v * of_z[2]
    f, f_u, f_v = z * of_normal, z * of_z[1] - u / z * of_normal, z * of_z[2] - v / z * of_normal
    g, g_u, g_v = 0.0, 0.0, 0.0
    for n in range(order, -1, -1):  # Horner's rule in u, of polynomials in v
        a, a_v = by_powers[n, order - n], 0.0
        for m in range(order - n - 1, -1, -1):
            a_v = a_v * v + a
            a = a * v + by_powers[n, m]
        g_u = g_u * u + g
        g, g_v = g * u + a, g_v * u + a_v
    return f + g, f_u + g_u, f_v + g_v

"""Compiled loops over the information of each pixel on alpha.

In this file C, B, V_C, V_B, N are image, plate, their variances and the normals of the color model as
in `pixelwise`. Maps of a color are (h, w, 3).
"""

from blurmatte.compiling import FAST_MATH, njit

STUDENT_DOF = 5.0  # of the t distribution of the residual that two normals leave


@njit(inline="always", fastmath=FAST_MATH)
def _across(N, i, light):  # type: ignore[no-untyped-def]
    """The part of light along a normal."""
    return N[0, i] * light[0] + N[1, i] * light[1] + N[2, i] * light[2]


@njit(inline="always", fastmath=FAST_MATH)
def _covariance(N, i, j, V):  # type: ignore[no-untyped-def]
    """Covariance of the parts of light along two normals, of independent channels."""
    return (
        N[0, i] * N[0, j] * V[0] + N[1, i] * N[1, j] * V[1] + N[2, i] * N[2, j] * V[2]
    )  # fmt: skip


@njit(fastmath=FAST_MATH)
def evidence(C, B, V_C, V_B, N, alpha, mask, information, pull):  # type: ignore[no-untyped-def]
    """Write the information A of each pixel of the mask, and its pull, A times its own alpha.

    The plate's noise is on both sides of the equation; the bias of the pull by it is subtracted. The
    weights come from `alpha`, that of the neighborhood, so that they are independent of the noise.
    """
    lines = N.shape[1]
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            t = 1.0 - alpha[y, x]
            B0, B1, B2 = float(B[y, x, 0]), float(B[y, x, 1]), float(B[y, x, 2])
            V = V_B[y, x, 0], V_B[y, x, 1], V_B[y, x, 2]
            difference = B0 - C[y, x, 0], B1 - C[y, x, 1], B2 - C[y, x, 2]
            S = (
                V_C[y, x, 0] + t * t * V[0],
                V_C[y, x, 1] + t * t * V[1],
                V_C[y, x, 2] + t * t * V[2],
            )
            b1, d1, v01, v11, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
            if lines == 2:
                b1, d1 = _across(N, 1, (B0, B1, B2)), _across(N, 1, difference)
                v01, v11 = _covariance(N, 0, 1, V), _covariance(N, 1, 1, V)
                s01, s11 = _covariance(N, 0, 1, S), _covariance(N, 1, 1, S)
            b0, d0 = _across(N, 0, (B0, B1, B2)), _across(N, 0, difference)
            s00, v00 = _covariance(N, 0, 0, S), _covariance(N, 0, 0, V)
            det = s00 * s11 - s01 * s01
            q00, q01, q11 = s11 / det, -s01 / det, s00 / det
            A = b0 * b0 * q00 + 2 * b0 * b1 * q01 + b1 * b1 * q11
            p = b0 * d0 * q00 + (b0 * d1 + b1 * d0) * q01 + b1 * d1 * q11
            weight = 1.0
            if lines == 2:
                total = d0 * d0 * q00 + 2 * d0 * d1 * q01 + d1 * d1 * q11
                chi2 = max(total - p * p / max(A, 1e-30), 0.0)
                weight = (STUDENT_DOF + 1) / (STUDENT_DOF + chi2)
            bias = v00 * q00 + 2 * v01 * q01 + v11 * q11
            information[y, x], pull[y, x] = weight * A, weight * (p - t * bias)


@njit()
def add_rounded(of_image, image, of_plate, plate, mask, off, width, border, out):  # type: ignore[no-untyped-def]
    """Add the pull of rounding errors to cells (n, h, w).

    `of_image`, `of_plate` are codes (h, w, 3), `image`, `plate` the pull per code, and `off` (n, 3,
    codes) the rounding error of each code.
    """
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            i, j = border + y // width, border + x // width
            for k in range(off.shape[0]):
                total = 0.0
                for c in range(3):
                    total += plate[y, x, c] * off[k, c, of_plate[y, x, c]]
                    total -= image[y, x, c] * off[k, c, of_image[y, x, c]]
                out[k, i, j] += total

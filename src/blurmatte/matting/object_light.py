"""Light of the object, given alpha; inpainted where a pixel has none.

In this file P is the premultiplied light, M (3, rank) a basis of the color model and V the noise
variance of C − (1 − α) B. The light within the model that fits best is

    P = M (MᵀV⁻¹M)⁻¹ MᵀV⁻¹ (C − (1 − α) B),    Var P = M (MᵀV⁻¹M)⁻¹ Mᵀ + (dP/dα)² Var α.

A clipped channel has no weight: its light follows from the other channels and the model, if at least
as many channels remain as the model has dimensions. A clipped plate matters only where it is visible.

Where all channels are clipped, or the plate is unknown, alpha may still be known from a sweep or from
neighbors. Without light the layer would have a hole there: the neighbors' light is inpainted by
normalized convolution.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.color.model import ColorModel
from blurmatte.compiling import njit
from blurmatte.matting.maps import PixelMaps, Quality, has_flag, in_strips
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.sweep.model.silhouette import OPAQUE

_NOT_FILLED = Quality.OUTSIDE | Quality.OCCLUDED | Quality.PLATE_IN_MODEL


def light_given(
    alpha: Floats, alpha_std: Floats, model: ColorModel, image: LinearImage, plate: LinearImage
) -> tuple[Array, Array, Array]:
    """P (h, w, 3), its standard deviation, and reduced χ² (h, w) of the residuals.

    P is 0 where alpha is 0. Where too many channels are clipped P is 0 with an infinite standard
    deviation. χ² is 1 where no degree of freedom remains.
    """
    M = np.zeros((3, 3))
    M[:, : model.rank] = model.basis
    whole = (image.valid & plate.valid).all()
    visible = np.asarray(alpha < OPAQUE)[..., None]  # the plate
    usable = np.ones(image.rgb.shape, bool) if whole else image.usable & (plate.usable | ~visible)
    alpha, alpha_std = (np.ascontiguousarray(a, float) for a in (alpha, alpha_std))
    kind = np.result_type(image.rgb, plate.rgb)
    given = image.rgb, plate.rgb, image.variance, plate.variance
    C, B, V_C, V_B = (np.ascontiguousarray(a, kind) for a in given)
    P, P_std, chi2 = np.empty(C.shape), np.empty(C.shape), np.empty(alpha.shape)
    known = C, B, V_C, V_B, usable, alpha, alpha_std
    found = P, P_std, chi2

    def rows(strip: slice) -> None:
        """Fill some rows."""
        _light(tuple(m[strip] for m in known), M, model.rank, tuple(m[strip] for m in found))

    in_strips(rows, len(alpha))
    return found


@njit(inline="always")
def _inverse(a, b, c, d, e, f):  # type: ignore[no-untyped-def]
    """Lower triangle of the inverse of a symmetric matrix, from its lower triangle."""
    p, q, r = c * f - e * e, d * e - b * f, b * e - c * d
    scale = 1.0 / (a * p + b * q + d * r)
    return (
        scale * p, scale * q, scale * (a * f - d * d),
        scale * r, scale * (b * d - a * e), scale * (a * c - b * b),
    )  # fmt: skip


@njit(inline="always")
def _solvable(a, b, c, count, rank):  # type: ignore[no-untyped-def]
    """True if so many channels determine the light; a, b, c are the first of MᵀV⁻¹M."""
    if count == 3:
        return True
    if rank == 1:
        return count >= 1 and a > 0
    return count == 2 and rank == 2 and a * c - b * b > 1e-9 * (a + c) ** 2


@njit()
def _light(known, M, rank, found):  # type: ignore[no-untyped-def]
    """Write P, its standard deviation and χ² of every pixel.

    `known` are C, B, V_C, V_B and usable (h, w, 3), alpha and alpha_std (h, w); `found` are P, P_std
    (h, w, 3) and chi2 (h, w), written. M is (3, 3), its last columns 0.
    """
    C, B, V_C, V_B, usable, alpha, alpha_std = known
    P, P_std, chi2 = found
    W, rest, weighed = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            t, count = 1.0 - alpha[y, x], 0
            for c in range(3):
                rest[c] = C[y, x, c] - t * B[y, x, c]
                W[c] = 0.0
                if usable[y, x, c]:
                    W[c] = 1.0 / max(V_C[y, x, c] + t * t * V_B[y, x, c], VARIANCE_FLOOR)
                    count += 1
                for i in range(3):
                    weighed[c, i] = W[c] * M[c, i]
            a, b, c2, d, e, f = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for c in range(3):
                a += M[c, 0] * weighed[c, 0]
                b += M[c, 1] * weighed[c, 0]
                c2 += M[c, 1] * weighed[c, 1]
                d += M[c, 2] * weighed[c, 0]
                e += M[c, 2] * weighed[c, 1]
                f += M[c, 2] * weighed[c, 2]
            solvable = _solvable(a, b, c2, count, rank)
            if rank < 3:
                f = 1.0
            if rank < 2:
                c2 = 1.0
            somewhere, squares = alpha[y, x] != 0, 0.0
            if solvable:
                i00, i10, i11, i20, i21, i22 = _inverse(a, b, c2, d, e, f)
            for c in range(3):
                light, std = 0.0, 0.0
                if somewhere and not solvable:
                    std = np.inf
                elif somewhere:
                    m0, m1, m2 = M[c, 0], M[c, 1], M[c, 2]
                    n0 = m0 * i00 + m1 * i10 + m2 * i20
                    n1 = m0 * i10 + m1 * i11 + m2 * i21
                    n2 = m0 * i20 + m1 * i21 + m2 * i22
                    slope = 0.0
                    for k in range(3):
                        to = n0 * weighed[k, 0] + n1 * weighed[k, 1] + n2 * weighed[k, 2]
                        light += to * rest[k]
                        slope += to * B[y, x, k]
                    own = n0 * m0 + n1 * m1 + n2 * m2
                    std = np.sqrt(own + (slope * alpha_std[y, x]) ** 2)
                P[y, x, c], P_std[y, x, c] = light, std
                squares += (rest[c] - light) ** 2 * W[c]
            # Where alpha is 0 no light is fitted; a model of rank 3 leaves no degree of freedom.
            left = count - rank if somewhere else count
            chi2[y, x] = squares / max(left, 1)
            if left <= 0 and not (count == 3 and rank == 3):
                chi2[y, x] = 1.0


def inpaint_light(maps: PixelMaps, image: LinearImage, plate: LinearImage) -> None:
    """Write light where alpha is known and light is not.

    Color and brightness are the alpha-weighted mean of the nearest neighbors; the error is their
    standard deviation. A channel that the image clips has at least the light that the image shows; the
    excess over the mean is added to light and error.

    The maps, of the same box as the pictures, are changed in place.
    """
    alpha = np.clip(maps.alpha.astype(float), 0, 1)
    here = ~has_flag(maps.quality, _NOT_FILLED) & np.isfinite(maps.alpha_std) & (alpha > 0)
    lit = np.isfinite(maps.premultiplied_std).all(axis=-1)
    dark, known = here & ~lit, here & lit
    if not dark.any() or not known.any():
        return
    color, spread = _of_neighbors(alpha, maps.premultiplied.astype(float), known, dark)
    a, a_std = alpha[dark][:, None], maps.alpha_std[dark][:, None]
    lower_bound = image.rgb[dark] - (1 - a) * plate.rgb[dark]
    bounded = image.clipped[dark] & (plate.usable[dark] | (a == 1))
    excess = np.where(bounded, np.maximum(lower_bound - a * color, 0), 0)
    maps.premultiplied[dark] = a * color + excess
    maps.premultiplied_std[dark] = np.sqrt((a * spread) ** 2 + (a_std * color) ** 2 + excess**2)


def _of_neighbors(alpha: Array, P: Array, known: Bools, dark: Bools) -> tuple[Array, Array]:
    """(n, 3) mean color of the neighbors of each dark pixel, and its standard deviation.

    Gaussian neighborhoods double in width until at least 5 % of their alpha has known light.
    """
    weight = np.where(known, alpha, 0)
    light = np.where(known[..., None], P, 0)
    squares = light**2 / np.maximum(alpha, 1e-6)[..., None]
    color, spread = np.zeros((2, np.count_nonzero(dark), 3))
    missing, std_px = np.ones(len(color), bool), 1.5
    while missing.any():
        sides = std_px, std_px, 0
        within = scipy.ndimage.gaussian_filter(weight, std_px, mode="constant")[dark]
        total = scipy.ndimage.gaussian_filter(alpha * (known | dark), std_px, mode="constant")[dark]
        sums, second = (
            scipy.ndimage.gaussian_filter(m, sides, mode="constant")[dark] for m in (light, squares)
        )
        min_fraction = 0.05 if std_px < max(alpha.shape) else 0.0
        now = missing & (within > min_fraction * total)
        color[now] = sums[now] / within[now, None]
        variance = second[now] / within[now, None] - color[now] ** 2
        spread[now] = np.sqrt(np.maximum(variance, 0))
        missing, std_px = missing & ~now, 2 * std_px
    return color, spread

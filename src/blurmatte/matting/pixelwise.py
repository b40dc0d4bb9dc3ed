"""Pixelwise: the closed form of each pixel alone, in threads over strips of rows.

In this file C is the image's light, B the plate's, P the object's premultiplied light, s² the noise
variance of C − (1 − α)B per channel, S = diag(s²), and N the (3, K) normals of the color model: K = 2
for a line of colors, 1 for a plane. No color of the object has a part along N, so NᵀP = 0 and

    Nᵀ(B − C) = α NᵀB                                   short: d = α b                  (1)

is a straight-line fit in α with covariance Σ = NᵀSN. With A = bᵀΣ⁻¹b,

    α = bᵀΣ⁻¹d / A          Var α = 1 / A               χ² = dᵀΣ⁻¹d − α² A   (K = 2)
    P = M (C − (1 − α)B)    M = I − S N Σ⁻¹ Nᵀ          the nearest color of the model
    Var P = M S Mᵀ + (MB)(MB)ᵀ Var α

A plane has one normal. A second one, zero with variance 1, is added, so that one loop serves lines and
planes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurmatte.background.robust_mean_kernel import variance_at
from blurmatte.checks import Box, Codes, Codes8, Floats, check_map, rows_columns
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import MARGIN_PX
from blurmatte.compiling import FAST_MATH, ONE, TWO, ZERO, njit
from blurmatte.matting.case import Answer, Case, Solver
from blurmatte.matting.maps import (
    MAX_CHI2,
    MAX_RANGE_STDS,
    MIN_VARIANCE,
    PixelMaps,
    Quality,
    in_strips,
)
from blurmatte.matting.special_pixels import solve_clipped, solve_mixed_plate
from blurmatte.matting.stats import SolutionStats
from blurmatte.radiometry import Noise, NoiseModel

# Without "nnan" and "ninf": the error of a pixel without information is infinite and must stay so.
_FAST_MATH = FAST_MATH | {"afn"}

_INFINITE = np.float32(np.inf)
_TINY = np.float32(1e-30)  # keeps 0/0 at 0 where the plate is black; far below any A

_PLATE_IN_MODEL, _OUT_OF_RANGE = np.uint8(Quality.PLATE_IN_MODEL), np.uint8(Quality.OUT_OF_RANGE)
_MISFIT, _UNKNOWN = np.uint8(Quality.MISFIT), np.uint8(Quality.SATURATED | Quality.OCCLUDED)
_MAX_RANGE_STDS, _MAX_CHI2 = np.float32(MAX_RANGE_STDS), np.float32(MAX_CHI2)


@dataclass(frozen=True)
class Pixelwise(Solver):
    """Solve each pixel alone, in closed form ([GC07 §3.2], weighted by the noise).

    Parameters
    ----------
    max_alpha_std : float
        A pixel whose alpha is less certain than this is marked PLATE_IN_MODEL, > 0.

    Examples
    --------
    >>> answer = bm.solve(image, plate, solution.model, bm.Pixelwise())
    >>> print(answer)
    Solution(128x72, alpha up to 0.35, typical std 0.01, 0.0% of the streak's pixels flagged)
    """

    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        if not self.max_alpha_std > 0:
            raise ValueError(f"max_alpha_std must be positive, got {self.max_alpha_std}")

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Solve the whole picture of a case."""
        maps = closed_form(case, (0, 0, *case.image.size), out, self)
        return Answer(maps, case.model, case.streak, SolutionStats(), assumes="")

    def __call__(
        self,
        image: Floats | Codes,
        plate: Floats | Codes,
        model: ColorModel,
        image_noise: Noise | Floats,
        plate_noise: Noise | Floats,
        flags: Codes8 | None = None,
        tables: tuple[Floats, Floats] | None = None,
        out: PixelMaps | None = None,
    ) -> PixelMaps:
        """Alpha and premultiplied light of every pixel; NumPy in, NumPy out.

        Parameters
        ----------
        image, plate : (H, W, 3)
            Linear light as floats; or code values, uint8 or uint16, decoded by `tables`.
        model : ColorModel
            With a model of rank 3 a single pixel has no information: alpha is 0, its error infinite.
        image_noise, plate_noise : Noise or (H, W, 3) variances
            Variances per pixel are for light only, not for code values.
        flags : (H, W) uint8, optional
            `Quality` bits already known; the result keeps them.
        tables : two (levels,) floats, optional
            Linear light of each code value of image and plate (`Transfer.table`).
        out : PixelMaps, optional
            Arrays to write to; their dtype is that of the computation. New arrays take twice as long.

        Returns
        -------
        PixelMaps
            Raw estimates, neither clipped nor masked.
        """
        height, width = image.shape[:2]
        dtype = (tables[0] if tables else image).dtype if out is None else out.alpha.dtype
        maps = PixelMaps.empty(height, width, dtype) if out is None else out
        check_map("out", maps.premultiplied, (height, width, 3))
        if model.rank == 3:
            return _unknown(maps, flags)
        N = _normals(model, dtype)
        max_std = dtype.type(self.max_alpha_std)

        def solve_rows(rows: slice) -> None:
            """Solve some rows."""
            maps.quality[rows] = 0 if flags is None else flags[rows]
            noise = [n if isinstance(n, Noise) else n[rows] for n in (image_noise, plate_noise)]
            solve, arguments = _compiled(image[rows], plate[rows], noise, tables, dtype)
            solve(*arguments, N, max_std, tuple(np.reshape(m[rows], -1) for m in maps))

        in_strips(solve_rows, height)
        return maps


def closed_form(
    case: Case, box: Box, out: PixelMaps | None = None, solver: Pixelwise | None = None
) -> PixelMaps:
    """Maps of the whole picture from the closed form of each pixel in a box.

    Pixels with one clipped channel and those at uncertain edges are solved by their own equations.

    out: arrays to write to.
    """
    solver = solver or Pixelwise()
    image, plate, model = case.image.crop(box), case.plate.crop(box), case.model
    whole = image.size == case.image.size
    flags, place = case.flags, rows_columns(box)
    noise: Any = image.noise, plate.noise  # known
    direct = out if whole else None
    near = solver(image.rgb, plate.rgb, model, noise[0], noise[1], flags[place], out=direct)
    solve_clipped(near, image, plate, model, solver.max_alpha_std)
    maps = near if whole else _in_picture(near, box, flags, out)
    around = case.streak.around(MARGIN_PX)
    C, B, mixed = case.within(around)
    solve_mixed_plate(maps.within(around), mixed, C, B, model, solver.max_alpha_std)
    return maps


def _in_picture(near: PixelMaps, box: Box, flags: Codes8, out: PixelMaps | None) -> PixelMaps:
    """Maps of a picture from those of a box, 0 elsewhere."""
    height, width = flags.shape
    maps = PixelMaps.zeros(height, width, near.alpha.dtype) if out is None else out
    if out is not None:
        check_map("out", out.premultiplied, (height, width, 3))
        for values in out:
            values[...] = 0
    maps.quality[...] = flags
    maps.write(box, near)
    return maps


def _unknown(maps: PixelMaps, flags: Codes8 | None) -> PixelMaps:
    """Alpha and light 0 with an infinite error."""
    for values, stds in (
        (maps.alpha, maps.alpha_std),
        (maps.premultiplied, maps.premultiplied_std),
    ):
        values[:], stds[:] = 0, np.inf
    maps.quality[:] = (0 if flags is None else flags) | np.uint8(Quality.PLATE_IN_MODEL)
    return maps


def _compiled(
    image: Any, plate: Any, noise: list[Noise | Floats], tables: Any, dtype: np.dtype[Any]
) -> tuple[Callable[..., None], tuple[Any, ...]]:
    """The compiled loop for this kind of input, and its arguments from image to noise."""
    C, B = (np.ascontiguousarray(a).reshape(-1) for a in (image, plate))
    if tables is not None:
        light = tuple(np.asarray(table, dtype) for table in tables)
        return solve_codes, ((C, B), light, *(_coefficients(n, dtype) for n in noise))
    C, B = (a.astype(dtype, copy=False) for a in (C, B))
    if all(isinstance(n, NoiseModel) for n in noise):
        return solve_light, (C, B, *(_coefficients(n, dtype) for n in noise))
    variances = (
        (n.variance(light) if isinstance(n, Noise) else n) + MIN_VARIANCE
        for n, light in zip(noise, (image, plate), strict=True)
    )
    return solve_light_with_variances, (
        C, B, *(np.ascontiguousarray(v, dtype).reshape(-1) for v in variances),
    )  # fmt: skip


def _normals(model: ColorModel, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    """Six numbers of two normals and the variance added to the second, which is zero for a plane."""
    normals = np.zeros((2, 3))
    normals[: 3 - model.rank] = model.normals.T
    return tuple(dtype.type(x) for x in (*normals.ravel(), model.rank - 1))


def _coefficients(noise: Noise | Floats, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    """Nine numbers of a noise model: those of 1, light and light² of each channel."""
    if not isinstance(noise, NoiseModel):
        raise TypeError("code values need a NoiseModel, whose variance is a polynomial of light")
    coefficients = noise.coefficients.copy()
    coefficients[:, 0] += MIN_VARIANCE
    return tuple(dtype.type(x) for x in coefficients.ravel())


@njit(inline="always", fastmath=_FAST_MATH)
def _solve_pixel(C, B, vC, vB, N):  # type: ignore[no-untyped-def]
    """(α, Var α, χ², P, Var P) of one pixel; C, B, vC, vB are triples, N two normals and the pad."""
    n00, n01, n02, n10, n11, n12, pad = N
    b1 = n00 * B[0] + n01 * B[1] + n02 * B[2]
    b2 = n10 * B[0] + n11 * B[1] + n12 * B[2]
    e0, e1, e2 = B[0] - C[0], B[1] - C[1], B[2] - C[2]
    d1 = n00 * e0 + n01 * e1 + n02 * e2
    d2 = n10 * e0 + n11 * e1 + n12 * e2

    # The plate's noise counts by 1 − α. An unweighted fit of α is accurate enough for a weight.
    plain = (b1 * d1 + b2 * d2) / (b1 * b1 + b2 * b2 + _TINY)
    through = ONE - min(max(plain, ZERO), ONE)
    s0 = vC[0] + through * through * vB[0]
    s1 = vC[1] + through * through * vB[1]
    s2 = vC[2] + through * through * vB[2]

    S11 = n00 * n00 * s0 + n01 * n01 * s1 + n02 * n02 * s2
    S12 = n00 * n10 * s0 + n01 * n11 * s1 + n02 * n12 * s2
    S22 = n10 * n10 * s0 + n11 * n11 * s1 + n12 * n12 * s2 + pad
    det = S11 * S22 - S12 * S12
    w1, w2 = S22 * b1 - S12 * b2, S11 * b2 - S12 * b1  # det · Σ⁻¹b
    A = w1 * b1 + w2 * b2 + _TINY  # det · A
    alpha = (w1 * d1 + w2 * d2) / A
    variance = det / A
    crossed = d1 * b2 - d2 * b1
    chi2 = crossed * crossed / A

    inverse = ONE / det
    r1, r2 = alpha * b1 - d1, alpha * b2 - d2  # Nᵀ(C − (1 − α)B): residual across the model
    g1, g2 = (S22 * r1 - S12 * r2) * inverse, (S11 * r2 - S12 * r1) * inverse
    f1, f2 = w1 * inverse, w2 * inverse
    t = ONE - alpha
    P0 = C[0] - t * B[0] - s0 * (n00 * g1 + n10 * g2)
    P1 = C[1] - t * B[1] - s1 * (n01 * g1 + n11 * g2)
    P2 = C[2] - t * B[2] - s2 * (n02 * g1 + n12 * g2)
    m0 = B[0] - s0 * (n00 * f1 + n10 * f2)
    m1 = B[1] - s1 * (n01 * f1 + n11 * f2)
    m2 = B[2] - s2 * (n02 * f1 + n12 * f2)
    q0 = S22 * n00 * n00 - TWO * S12 * n00 * n10 + S11 * n10 * n10
    q1 = S22 * n01 * n01 - TWO * S12 * n01 * n11 + S11 * n11 * n11
    q2 = S22 * n02 * n02 - TWO * S12 * n02 * n12 + S11 * n12 * n12
    v0 = max(s0 - s0 * s0 * q0 * inverse, ZERO) + m0 * m0 * variance
    v1 = max(s1 - s1 * s1 * q1 * inverse, ZERO) + m1 * m1 * variance
    v2 = max(s2 - s2 * s2 * q2 * inverse, ZERO) + m2 * m2 * variance
    return alpha, variance, chi2, P0, P1, P2, v0, v1, v2


@njit(inline="always", fastmath=_FAST_MATH)
def _store(i, answer, max_std, maps):  # type: ignore[no-untyped-def]
    alpha, alpha_std, P, P_std, quality = maps
    a, variance, chi2, P0, P1, P2, v0, v1, v2 = answer
    std = np.sqrt(variance)
    lost = ZERO if quality[i] & _UNKNOWN == 0 else _INFINITE
    alpha[i], alpha_std[i] = a, std + lost
    P[3 * i], P[3 * i + 1], P[3 * i + 2] = P0, P1, P2
    P_std[3 * i] = np.sqrt(v0) + lost
    P_std[3 * i + 1] = np.sqrt(v1) + lost
    P_std[3 * i + 2] = np.sqrt(v2) + lost
    reach = _MAX_RANGE_STDS * std
    quality[i] |= (
        (std > max_std) * _PLATE_IN_MODEL
        | ((a < -reach) | (a > ONE + reach)) * _OUT_OF_RANGE
        | (chi2 > _MAX_CHI2) * _MISFIT
    )


@njit(fastmath=_FAST_MATH)
def solve_light(C, B, vC, vB, N, max_std, maps):  # type: ignore[no-untyped-def]
    """Solve pixels given as light and write maps: alpha, alpha_std, P, P_std and quality.

    All arrays are flat, with three values a pixel in C, B, P, P_std.

    vC and vB are nine numbers, the coefficients of 1, light, light² of each channel. They are tuples:
    an array might alias an output, which would keep the compiler from vectorizing the loop.
    """
    for i in range(maps[0].shape[0]):
        c = (C[3 * i], C[3 * i + 1], C[3 * i + 2])
        b = (B[3 * i], B[3 * i + 1], B[3 * i + 2])
        v = (variance_at(c[0], vC, 0), variance_at(c[1], vC, 1), variance_at(c[2], vC, 2))
        w = (variance_at(b[0], vB, 0), variance_at(b[1], vB, 1), variance_at(b[2], vB, 2))
        answer = _solve_pixel(c, b, v, w, N)
        _store(i, answer, max_std, maps)


@njit(fastmath=_FAST_MATH)
def solve_light_with_variances(C, B, vC, vB, N, max_std, maps):  # type: ignore[no-untyped-def]
    """As `solve_light`, but vC and vB are flat arrays with a variance for each value of C and B."""
    for i in range(maps[0].shape[0]):
        c = (C[3 * i], C[3 * i + 1], C[3 * i + 2])
        b = (B[3 * i], B[3 * i + 1], B[3 * i + 2])
        v = (vC[3 * i], vC[3 * i + 1], vC[3 * i + 2])
        w = (vB[3 * i], vB[3 * i + 1], vB[3 * i + 2])
        answer = _solve_pixel(c, b, v, w, N)
        _store(i, answer, max_std, maps)


@njit(inline="always", fastmath=_FAST_MATH)
def _look_up(codes, table, light):  # type: ignore[no-untyped-def]
    for i in range(codes.shape[0]):
        light[i] = table[codes[i]]


@njit(fastmath=_FAST_MATH)
def solve_codes(codes, tables, vC, vB, N, max_std, maps):  # type: ignore[no-untyped-def]
    """As `solve_light`, but for code values of image and plate, decoded by the tables of both.

    They are decoded in blocks of 1024 pixels, which fit the cache.
    A table look-up inside the loop over pixels would keep the compiler from vectorizing it.
    """
    (C, B), (table_C, table_B) = codes, tables
    alpha, alpha_std, P, P_std, quality = maps
    step = 1024
    light_C, light_B = np.empty(3 * step, table_C.dtype), np.empty(3 * step, table_B.dtype)
    for i in range(0, alpha.shape[0], step):
        j = min(i + step, alpha.shape[0])
        c, b = light_C[: 3 * (j - i)], light_B[: 3 * (j - i)]
        _look_up(C[3 * i : 3 * j], table_C, c)
        _look_up(B[3 * i : 3 * j], table_B, b)
        light = P[3 * i : 3 * j], P_std[3 * i : 3 * j]
        solve_light(c, b, vC, vB, N, max_std, (alpha[i:j], alpha_std[i:j], *light, quality[i:j]))

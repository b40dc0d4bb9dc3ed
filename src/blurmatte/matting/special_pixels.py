"""Pixels with a solution of their own: an uncertain plate at hard edges, and one clipped channel.

A plate that is shifted by a fraction of a pixel, or blurred a little more, has errors at its edges,
towards the neighbors' colors: along a segment, not in all directions [GC07 §3.3]. So the error of the
plate's light B is a covariance matrix instead of a variance for each channel,

    V + κ K        K = covariance of B over a pixel's neighborhood,

and κ, the relative error along the segments, is estimated from edges where nothing moved. With it

    Nᵀ(B − C) = α NᵀB,   Σ = Nᵀ(V_C + (1 − α)²(V + κK))N,   α = bᵀΣ⁻¹d / bᵀΣ⁻¹b,   Var α = 1 / bᵀΣ⁻¹b

weighs the equations of the closed form. For large κ a line of colors keeps only the equation across its
own color and the segment: the three unknowns of the paper. A plane keeps none, and the standard
deviation is the interval of alpha between the segment's ends.

Where one channel is clipped, let l be the unit direction of the line of colors, and i, j the channels
that are not clipped. Of the two equations of a line one remains, that of the normal m in the plane of i
and j, m ∝ (−l_j, l_i):

    m (B − C) = α m B,      α = m (B − C) / m B,      Var α = s² / (m B)²,

with s² = Σ m² (σ_C² + (1 − α)² σ_B²). The light is k l in all channels, the clipped one included, with

    k = (C_i B_j − C_j B_i) / (l_i B_j − l_j B_i).

A plane of colors has no equation left. For a line, none remains to test the fit.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.color.model import ColorModel
from blurmatte.matting.maps import MAX_CHI2, MIN_VARIANCE, PixelMaps, Quality, alpha_flags, has_flag
from blurmatte.radiometry import LinearImage
from blurmatte.radiometry.image import VARIANCE_FLOOR

# Settings of the search for uncertain edges.
_NEIGHBORHOOD_PX = 3  # width over which the covariance of the plate's light is taken
_EDGE_QUANTILE = 0.9  # of K's trace; pixels above it are edges that determine κ
_KEPT_FRACTION = 0.95  # lower part of the differences that counts; others may move there
_KEPT_MEAN = 0.76  # mean of that part of χ² with one degree of freedom
_MIN_NOISE_RATIO = 0.25  # variance along the segment over noise, of an uncertain pixel


def one_clipped(image: LinearImage, plate: LinearImage) -> Bools:
    """(H, W) True where exactly one channel of a pixel is clipped, in the image or the plate."""
    two_left = np.count_nonzero(image.usable & plate.usable, axis=-1) == 2
    return np.asarray(two_left)


def solve_clipped(
    maps: PixelMaps, image: LinearImage, plate: LinearImage, model: ColorModel, max_alpha_std: float
) -> None:
    """Write alpha and light of pixels with one clipped channel into maps of the closed form.

    maps: changed in place; the bit SATURATED stays.
    image, plate: noise known.
    model: a line of colors; for others nothing is written.
    max_alpha_std: a pixel with a larger standard deviation of alpha is marked PLATE_IN_MODEL.
    """
    if model.rank != 1 or (image.valid & plate.valid).all():
        return
    y, x = np.nonzero(one_clipped(image, plate) & ~has_flag(maps.quality, Quality.OCCLUDED))
    unclipped = (image.usable & plate.usable)[y, x]
    pair = np.nonzero(unclipped)[1].reshape(-1, 2)  # the channels i, j of each pixel

    def two(values: Floats) -> Array:
        """(n, 2) values of the channels that are not clipped."""
        return np.take_along_axis(values[y, x].astype(float), pair, axis=1)

    C, B = two(image.rgb), two(plate.rgb)
    vC, vB = two(image.variance) + MIN_VARIANCE, two(plate.variance) + MIN_VARIANCE
    l = model.basis[:, 0][pair]
    m = np.stack([-l[:, 1], l[:, 0]], axis=1)
    mB = np.sum(m * B, axis=1)
    mB = np.where(np.abs(mB) > 1e-6, mB, np.nan)  # a plate on the line of colors: no information
    alpha = np.sum(m * (B - C), axis=1) / mB
    through = (1 - np.clip(alpha, 0, 1))[:, None]
    variance = vC + through**2 * vB
    alpha_std = np.sqrt(np.sum(m**2 * variance, axis=1)) / np.abs(mB)
    k = (C[:, 0] * B[:, 1] - C[:, 1] * B[:, 0]) / mB
    k_std = np.sqrt(np.sum(B[:, ::-1] ** 2 * variance, axis=1)) / np.abs(mB)
    color = model.basis[:, 0]
    known = np.isfinite(alpha)
    at = y[known], x[known]
    values = alpha, alpha_std, np.outer(k, color), np.outer(k_std, np.abs(color))
    for target, some in zip(maps, values, strict=False):
        target[at] = some[known]
    kept = maps.quality[at] & np.uint8(Quality.SATURATED | Quality.OUTSIDE)
    maps.quality[at] = kept | alpha_flags(alpha[known], alpha_std[known], max_alpha_std)


@dataclass(frozen=True, eq=False)
class MixedPlate:
    """Pixels at which the plate is uncertain along a segment."""

    edges: Bools  #: (h, w)
    covariance: Array  #: (n, 3, 3) κK of these pixels, light²

    def with_edge_variance(self, plate: LinearImage) -> LinearImage:
        """The plate with the variance of its edges added, for each channel."""
        variance = np.array(plate.variance)
        variance[self.edges] += np.diagonal(self.covariance, axis1=-2, axis2=-1)
        return plate.with_noise(variance)


# Image, plate and its uncertain edges in a box of the picture
NearPictures = tuple[LinearImage, LinearImage, MixedPlate]


def mixed_plate(image: LinearImage, plate: LinearImage, still: Bools) -> MixedPlate:
    """Find where a plate's edges are uncertain, and how uncertain they are.

    The noise is known; `still` (h, w) is True where nothing moved. The result has no pixels if the
    plate's edges fit within the noise.
    """
    B = np.asarray(plate.rgb, float)
    K = _neighborhoods(B)
    trace = K[..., 0] + K[..., 3] + K[..., 5]
    noise = np.sum(image.variance + plate.variance, axis=-1)
    kappa = _kappa(np.sum((image.rgb - B) ** 2, axis=-1)[still], noise[still], trace[still])
    edges = (kappa * trace > _MIN_NOISE_RATIO * noise) & image.valid & plate.valid
    whole = np.take(K[edges], [[0, 1, 2], [1, 3, 4], [2, 4, 5]], axis=1)
    return MixedPlate(edges, kappa * whole)


def _neighborhoods(B: Array) -> Array:
    """(h, w, 6) covariance of the light around each pixel: RR, RG, RB, GG, GB, BB."""
    width = _NEIGHBORHOOD_PX
    centered = B - B.mean(axis=(0, 1))
    i, j = np.triu_indices(3)
    products = centered[..., i] * centered[..., j]
    first, second = (
        np.asarray(scipy.ndimage.uniform_filter(x, (width, width, 0))) for x in (centered, products)
    )
    return np.asarray(second - first[..., i] * first[..., j])


def _kappa(d2: Array, noise: Array, trace: Array) -> float:
    """Excess of (C − B)² over noise at the strongest edges, in units of K's trace.

    A trimmed mean: a shift affects edges of one direction only, so a median could miss it.
    """
    if d2.size == 0:
        return 0.0
    strong = trace >= np.quantile(trace, _EDGE_QUANTILE)
    excess = np.sort(((d2 - noise) / (trace + VARIANCE_FLOOR))[strong])
    kept = excess[: int(np.ceil(_KEPT_FRACTION * len(excess)))]
    return max(float(kept.mean()) / _KEPT_MEAN, 0.0)


def solve_mixed_plate(
    maps: PixelMaps,
    mixed: MixedPlate,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    max_alpha_std: float,
) -> None:
    """Write alpha, light and their errors of the edge pixels into maps of the closed form.

    maps: of the same size as image and plate; changed in place.
    image, plate: noise known.
    model: of rank 1 or 2.
    max_alpha_std: a pixel with a larger standard deviation of alpha is marked PLATE_IN_MODEL.
    """
    if model.rank == 3 or not mixed.edges.any():
        return
    C, B, N, plate_error, image_error = parts_at_edges(mixed, image, plate, model)
    b, d = B @ N, (B - C) @ N
    alpha = np.sum(b * d, axis=1) / (np.sum(b * b, axis=1) + 1e-30)
    for _ in range(3):  # the weights depend on alpha
        t = 1 - np.clip(alpha, 0, 1)
        S = image_error + (t**2)[:, None, None] * plate_error
        inverse = np.linalg.inv(N.T @ S @ N)
        weighted = np.einsum("nij,nj->ni", inverse, b)
        information = np.sum(weighted * b, axis=1) + 1e-30
        alpha = np.sum(weighted * d, axis=1) / information
    std = information**-0.5
    chi2 = np.einsum("ni,nij,nj->n", d, inverse, d) - alpha**2 * information
    nearest = np.eye(3) - S @ N @ inverse @ N.T
    P = np.einsum("nij,nj->ni", nearest, C - (1 - alpha)[:, None] * B)
    slope = np.einsum("nij,nj->ni", nearest, B)
    variance = np.maximum(np.einsum("nij,njk,nik->ni", nearest, S, nearest), 0)
    values = alpha, std, P, np.sqrt(variance + (slope * std[:, None]) ** 2)
    for target, some in zip(maps, values, strict=False):
        target[mixed.edges] = some
    misfit = (chi2 > MAX_CHI2) & (model.rank == 1)
    maps.quality[mixed.edges] = (
        maps.quality[mixed.edges] & np.uint8(Quality.OUTSIDE)
        | alpha_flags(alpha, std, max_alpha_std)
        | misfit * np.uint8(Quality.MISFIT)
    )


def parts_at_edges(
    mixed: MixedPlate, image: LinearImage, plate: LinearImage, model: ColorModel
) -> tuple[Array, Array, Array, Array, Array]:
    """C, B (n, 3), the normals, and the covariances (n, 3, 3) of plate and image."""
    at = mixed.edges
    C, B = (np.asarray(picture.rgb[at], float) for picture in (image, plate))
    V_C, V_B = (
        np.asarray(picture.variance[at], float)[:, :, None] * np.eye(3) + MIN_VARIANCE * np.eye(3)
        for picture in (image, plate)
    )
    return C, B, model.normals, V_B + mixed.covariance, V_C

"""At hard edges the plate is only known up to a segment between the colors on both sides [GC07 §3.3].

A plate that lies a fraction of a pixel beside the image, or is a little less sharp, is wrong where its
colors change, and wrong towards the neighbors' colors: along a segment, not in all directions. So the
error of the plate's light B is not a variance for each channel but a matrix,

    V + κ K        K = covariance of B over a pixel's neighborhood,

and κ, how far along the segments the plate is off, is read off the edges where nothing moved. With it

    Nᵀ(B − C) = α NᵀB,   Σ = Nᵀ(V_C + (1 − α)²(V + κK))N,   α = bᵀΣ⁻¹d / bᵀΣ⁻¹b,   Var α = 1 / bᵀΣ⁻¹b

weighs the equations of the closed form. The larger κ is, the more a line of colors is left with the
one equation across its own color and the segment: the three unknowns of the paper. A plane is left with
none but the segment's ends: then the standard deviation is the interval in which alpha may lie.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage

Array = npt.NDArray[np.float64]

_ACROSS = 3  # pixels: the neighborhood
_STRONG = 0.9  # quantile of K's trace: edges that tell how far the plate is off
_MATTERS = 0.25  # of the noise's variance: less at a pixel is none of our business
_KEPT, _MEAN_OF_KEPT = (
    0.95,
    0.76,
)  # the lower part of χ² of one: something may move beside the streak
_TINY = 1e-30
_ROUNDS = 3  # to know by how much the plate shines through
_SIGMAS_OUT, _CHI2_MISFIT = 3.0, 16.0  # as in `kernel`


@dataclass(frozen=True, eq=False)
class MixedPlate:
    """Where the plate is only known up to a segment.

    Parameters
    ----------
    edges : (h, w) bool
    covariance : (n, 3, 3) float
        κK of these pixels, light².
    """

    edges: Bools
    covariance: Array

    def widened(self, plate: LinearImage) -> LinearImage:
        """The plate with the variance of its edges per channel, for whoever needs no more."""
        variance = np.array(plate.variance)
        variance[self.edges] += np.diagonal(self.covariance, axis1=-2, axis2=-1)
        return plate.with_noise(variance)


def mixed_plate(image: LinearImage, plate: LinearImage, still: Bools) -> MixedPlate:
    """Find where a plate's edges are uncertain, and how uncertain they are.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    still : (h, w) bool
        Where nothing moved.

    Returns
    -------
    MixedPlate
        Without a pixel if the plate's edges fit as well as noise allows.
    """
    B = np.asarray(plate.rgb, float)
    K = _neighborhoods(B)
    trace = np.trace(K, axis1=-2, axis2=-1)
    noise = np.sum(image.variance + plate.variance, axis=-1)
    kappa = _kappa(np.sum((image.rgb - B) ** 2, axis=-1)[still], noise[still], trace[still])
    edges = (kappa * trace > _MATTERS * noise) & image.valid & plate.valid
    return MixedPlate(edges, kappa * K[edges])


def _neighborhoods(B: Array) -> Array:
    """(h, w, 3, 3) covariance of the light around each pixel."""
    from scipy.ndimage import uniform_filter

    def mean(x: Array) -> Array:
        return np.asarray(uniform_filter(x, (_ACROSS, _ACROSS, 0)))

    centered = B - B.mean(axis=(0, 1))
    first = mean(centered)
    second = mean((centered[..., :, None] * centered[..., None, :]).reshape(*B.shape[:2], 9))
    return second.reshape(*B.shape, 3) - first[..., :, None] * first[..., None, :]


def _kappa(d2: Array, noise: Array, trace: Array) -> float:
    """What (C − B)² has beyond noise at the strongest edges, in units of K's trace.

    A mean, for of edges in several directions a shift may spoil but few; less the worst.
    """
    if d2.size == 0:
        return 0.0
    strong = trace >= np.quantile(trace, _STRONG)
    excess = np.sort(((d2 - noise) / (trace + 1e-14))[strong])
    kept = excess[: int(np.ceil(_KEPT * len(excess)))]
    return max(float(kept.mean()) / _MEAN_OF_KEPT, 0.0)


def evidence_at_edges(
    mixed: MixedPlate,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    alpha: npt.NDArray[np.floating],
) -> tuple[Array, Array]:
    """Information and pull of each edge pixel (n,), as `evidence_of` gives the others.

    Parameters
    ----------
    mixed : MixedPlate
    image, plate : LinearImage
        Noise known.
    model : ColorModel
        Of rank 1 or 2.
    alpha : (h, w) float
        About what alpha is.
    """
    from blurmatte.matting.evidence_kernel import evidence_of_matrices  # numba takes half a second

    at = mixed.edges
    light = (np.asarray(picture.rgb[at], float) for picture in (image, plate))
    noise = (np.asarray(picture.variance[at], float) + 1e-12 for picture in (image, plate))
    t = np.asarray(alpha, float)[at]
    information, pull = np.zeros((2, len(t)))
    N = np.ascontiguousarray(model.normals)
    evidence_of_matrices(*light, *noise, mixed.covariance, N, t, information, pull)
    return information, pull


def solve_mixed_plate(
    maps: PixelMaps,
    mixed: MixedPlate,
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    max_alpha_std: float,
) -> None:
    """Write alpha, light and their errors of the edge pixels into maps of the closed form.

    Parameters
    ----------
    maps : PixelMaps
        Of the same size as image and plate; changed in place.
    mixed : MixedPlate
    image, plate : LinearImage
        Noise known.
    model : ColorModel
        Of rank 1 or 2.
    max_alpha_std : float
        A pixel whose alpha is less certain than this is marked PLATE_IN_MODEL.
    """
    if model.rank == 3 or not mixed.edges.any():
        return
    C, B, N, plate_error, image_error = _parts(mixed, image, plate, model)
    b, d = B @ N, (B - C) @ N
    alpha = np.sum(b * d, axis=1) / (np.sum(b * b, axis=1) + _TINY)
    for _ in range(_ROUNDS):
        t = 1 - np.clip(alpha, 0, 1)
        S = image_error + (t**2)[:, None, None] * plate_error
        inverse = np.linalg.inv(N.T @ S @ N)
        to = np.einsum("nij,nj->ni", inverse, b)
        information = np.sum(to * b, axis=1) + _TINY
        alpha = np.sum(to * d, axis=1) / information
    std = information**-0.5
    chi2 = np.einsum("ni,nij,nj->n", d, inverse, d) - alpha**2 * information
    nearest = np.eye(3) - S @ N @ inverse @ N.T
    P = np.einsum("nij,nj->ni", nearest, C - (1 - alpha)[:, None] * B)
    by_alpha = np.einsum("nij,nj->ni", nearest, B)
    spread = np.maximum(np.einsum("nij,njk,nik->ni", nearest, S, nearest), 0)
    values = alpha, std, P, np.sqrt(spread + (by_alpha * std[:, None]) ** 2)
    for target, some in zip(maps, values, strict=False):
        target[mixed.edges] = some
    out = np.abs(alpha - 0.5) > 0.5 + _SIGMAS_OUT * std
    misfit = (chi2 > _CHI2_MISFIT) & (model.rank == 1)
    maps.quality[mixed.edges] = (
        maps.quality[mixed.edges] & np.uint8(Quality.OUTSIDE)
        | (std > max_alpha_std) * np.uint8(Quality.PLATE_IN_MODEL)
        | out * np.uint8(Quality.OUT_OF_RANGE)
        | misfit * np.uint8(Quality.MISFIT)
    )


def _parts(
    mixed: MixedPlate, image: LinearImage, plate: LinearImage, model: ColorModel
) -> tuple[Array, Array, Array, Array, Array]:
    """C, B (n, 3), the normals, and the covariances (n, 3, 3) of plate and image."""
    at = mixed.edges
    C, B = (np.asarray(picture.rgb[at], float) for picture in (image, plate))
    V_C, V_B = (
        np.asarray(picture.variance[at], float)[:, :, None] * np.eye(3) + 1e-12 * np.eye(3)
        for picture in (image, plate)
    )
    return C, B, model.normals, V_B + mixed.covariance, V_C

"""Evidence of single pixels on alpha: their information, their pull, and its inflated variance.

The information is one over the variance of a pixel's own alpha, the pull that alpha times the
information. In this file C is the image's light and B the plate's. The noise inflation is the variance
of a sum over a block, around and within a streak, divided by that of independent pixels.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.color.model import ColorModel
from blurmatte.matting.evidence_kernel import STUDENT_DOF, evidence
from blurmatte.matting.maps import in_strips
from blurmatte.matting.special_pixels import MixedPlate, one_clipped, parts_at_edges
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.radiometry.compression import BLOCK
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import (
    BLOCK_SIZES,
    MEDIAN_1,
    block_squares,
    block_sums,
    core_mean_square,
    significant_inflation,
    student_weight,
    window_sums,
)


@dataclass(frozen=True, eq=False)
class PixelPairs:
    """Light and noise of image and plate, as `information_of` needs them; made by `pixels_of`.

    Pictures and no `PixelBox`: light stays in its own dtype, and clipped channels remain known.
    """

    image: LinearImage  #: with a noise variance of each value, from the smoothed light
    plate: LinearImage  #: with a noise variance of each value
    model: ColorModel
    inside: Bools  #: (h, w) where alpha may be other than 0
    use: Bools  #: (h, w) where such a pixel has information
    mixed: MixedPlate | None
    wide: LinearImage  #: the plate with the variance of its edges added
    coarse: Floats | None = None  #: (h, w, 3) plate without fine structure, if that is ignored

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C, B and their variances, with those of the plate's edges."""
        return self.image.rgb, self.plate.rgb, self.image.variance, self.wide.variance


@dataclass(frozen=True, eq=False)
class FirstEstimate:
    """An estimate of alpha without a prior on the light of neighbors."""

    pixels: PixelPairs
    alpha: Floats  #: (h, w)
    variance: Floats  #: (h, w) of alpha
    noise_factor: float  #: factor of the noise variance, for correlated noise


def without_fine_structure(pixels: PixelPairs) -> PixelPairs:
    """Pixels whose evidence ignores the plate's fine structure.

    Compression removes more of faint, fine structure where the object covers it than in the plate. By
    that difference alone alpha would be overestimated.
    """
    B = pixels.plate.rgb
    return replace(
        pixels, coarse=scipy.ndimage.uniform_filter(B, (BLOCK_SIZES[-1], BLOCK_SIZES[-1], 0))
    )


def pixels_of(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    inside: Bools,
    mixed: MixedPlate | None = None,
) -> PixelPairs:
    """Light and noise of the pixels, independent of alpha.

    image, plate: noise known.
    model: of any rank. With rank 1 a pixel with one clipped channel has information.
    inside (h, w): where alpha may be other than 0.
    mixed: where the plate's edges are uncertain.
    """
    use = inside & image.valid & plate.valid
    V_C = smooth_variance(image).astype(image.rgb.dtype)
    if model.rank == 1 and not (image.valid & plate.valid).all():
        clipped = inside & one_clipped(image, plate)
        # The variance of a clipped value, (10 × white)²: practically no information.
        V_C[clipped[..., None] & ~(image.usable & plate.usable)] = 100.0
        use |= clipped

    def plain(picture: LinearImage, variance: Floats) -> LinearImage:
        """The picture with a variance for each pixel."""
        return replace(picture, rgb=np.ascontiguousarray(picture.rgb), noise=variance)

    V_B = np.ascontiguousarray(plate.variance, plate.rgb.dtype)
    plate = plain(plate, V_B)
    wide = plate if mixed is None or not mixed.edges.any() else mixed.with_edge_variance(plate)
    return PixelPairs(plain(image, V_C), plate, model, inside, use, mixed, wide)


def information_of(pixels: PixelPairs, alpha: Floats) -> tuple[Floats, Floats]:
    """Information and pull (h, w) of each pixel, both 0 where it is clipped or not inside.

    The noise of pixels counts as independent (see `sum_inflation`). For a line or plane of colors
    from the closed form; for a model of rank 3 from the attenuation of the plate's texture.

    alpha (h, w) is an estimate independent of the pixel's noise, since the plate's noise is weighted
    by 1 − alpha.
    """
    model, mixed, use = pixels.model, pixels.mixed, pixels.use
    if model.rank == 3:
        C, B, V_C, V_B = (np.asarray(a, float) for a in pixels.arrays)
        return _of_texture(C, B, V_C, V_B, np.asarray(alpha, float), use)
    information, pull = np.zeros((2, *use.shape), pixels.image.rgb.dtype)
    N = np.ascontiguousarray(model.normals)
    maps = np.asarray(alpha, information.dtype), use, information, pull

    def rows(strip: slice) -> None:
        """Fill the maps of some rows."""
        C, B, V_C, V_B = (a[strip] for a in pixels.arrays)
        if pixels.coarse is not None:
            t, coarse = 1 - maps[0][strip][..., None], pixels.coarse[strip]
            # The visible fine structure is subtracted from C, and its noise added to that of C.
            C, B, V_C, V_B = C - t * (B - coarse), coarse, V_C + t**2 * V_B, np.zeros_like(V_B)
        evidence(C, B, V_C, V_B, N, *(m[strip] for m in maps))

    in_strips(rows, len(use))
    if mixed is not None:
        at_edges = _at_edges(mixed, pixels, alpha)
        for own, of_edges in zip((information, pull), at_edges, strict=True):
            own[mixed.edges] = of_edges * pixels.inside[mixed.edges]
    return information, pull


def _at_edges(mixed: MixedPlate, pixels: PixelPairs, alpha: Floats) -> tuple[Array, Array]:
    """Information and pull (n,) of the pixels at uncertain edges; for a line or plane of colors."""
    model = pixels.model
    C, B, N, plate_error, image_error = parts_at_edges(mixed, pixels.image, pixels.plate, model)
    t = 1 - np.asarray(alpha, float)[mixed.edges]
    b, d, of_plate = B @ N, (B - C) @ N, N.T @ plate_error @ N
    inverse = np.linalg.inv(N.T @ image_error @ N + (t**2)[:, None, None] * of_plate)
    information, pull, total = (
        np.einsum("ni,nij,nj->n", x, inverse, y) for x, y in ((b, b), (b, d), (d, d))
    )
    weight = np.ones(len(t))
    if model.rank == 1:
        chi2 = np.maximum(total - pull**2 / np.maximum(information, 1e-30), 0)
        weight = student_weight(chi2, STUDENT_DOF, 1)
    bias = np.einsum("nij,nij->n", of_plate, inverse)
    return weight * information, weight * (pull - t * bias)


def _of_texture(
    C: Array, B: Array, V_C: Array, V_B: Array, alpha: Array, use: Bools
) -> tuple[Array, Array]:
    """Evidence for a model of rank 3: ∇C = (1 − α)∇B, except for noise and the object's own texture.

    The variance of the object's texture is the excess of the residuals of a first alpha, averaged over
    neighborhoods.
    """
    pairs: list[tuple[Bools, Array, Array, Array, Array]] = []
    for axis in (0, 1):
        both = use & np.roll(use, -1, axis)
        last = (slice(None),) * axis + (slice(-1, None),)
        both[last] = False
        c, b = np.roll(C, -1, axis) - C, np.roll(B, -1, axis) - B
        v_C, v_B = np.roll(V_C, -1, axis) + V_C, np.roll(V_B, -1, axis) + V_B
        pairs.append((both[..., None], c, b, v_C, v_B))

    def sums(texture_variance: float) -> tuple[Array, Array]:
        """Information and pull for a variance of the texture."""
        information, pull = np.zeros((2, *use.shape))
        t = (1 - alpha)[..., None]
        for axis, (both, c, b, v_C, v_B) in enumerate(pairs):
            weight = both / (v_C + t**2 * v_B + texture_variance + VARIANCE_FLOOR)
            for total, values in ((information, b * b), (pull, b * (b - c) - t * v_B)):
                half = np.sum(weight * values, axis=-1) / 2
                total += half + np.roll(half, 1, axis)
        return information, pull

    information, pull = (scipy.ndimage.gaussian_filter(m, sigma=3.0) for m in sums(0.0))
    t = (1 - np.clip(pull / (information + 1e-9), 0, 1))[..., None]
    excess = [
        np.median(((c - t * b) ** 2 - v_C - t**2 * v_B)[both[..., 0]]) / MEDIAN_1
        for both, c, b, v_C, v_B in pairs
        if both.any()
    ]
    return sums(max(float(np.mean(excess)), 0.0) if excess else 0.0)


def min_alpha(pixels: PixelPairs, sum_inflation: float) -> Floats:
    """Lower bound of alpha, (h, w), since the light of an object is not negative; −∞ without one.

    In no channel (1 − α) B can exceed C. The light is averaged with a Gaussian of 2 pixels and C raised
    by three standard deviations, so that the bound is negligible where there was no object.
    `sum_inflation` is the factor by which correlation of noise raises the variance of sums.
    """
    std_px = 2.0
    C, B, V_C, V_B = (scipy.ndimage.gaussian_filter(a, (std_px, std_px, 0)) for a in pixels.arrays)
    noise = np.sqrt((V_C + V_B) * sum_inflation / (4 * np.pi * std_px**2))
    bound = np.max(1 - (C + 3.0 * noise) / np.maximum(B, 1e-9), axis=-1)
    return np.where(pixels.use & (bound > 0), bound, -np.inf)


def sum_inflation(pixels: PixelPairs, alpha: Floats) -> float:
    """Factor by which correlation raises the variance of sums of noise over blocks, 1 or more.

    Around the streak it follows from the difference of image and plate. Within the streak, compression
    leaves other noise. For a line l of colors it follows there from the equation without alpha,
    (l × B)·C = 0. For a plane it follows from the fine structure of the pixels' alpha, compared with
    that around the streak. If noise around the streak is independent, it is assumed so within:
    otherwise true fine structure of alpha would count as noise. The parameters are those of
    `information_of`.
    """
    valid = pixels.image.valid & pixels.plate.valid
    still = replace(pixels, inside=~pixels.inside, use=valid & ~pixels.inside)
    if pixels.model.rank == 1:
        return max(_around_streak(still), _within_streak(pixels, alpha, valid & pixels.inside))
    if pixels.model.rank == 3:
        return _around_streak(still)
    of_alpha = information_of(still, np.zeros(alpha.shape))
    inflation = _of_alpha(*of_alpha, still.use)
    if inflation == 1:
        return inflation
    within, around = (_fine_structure(*e) for e in (information_of(pixels, alpha), of_alpha))
    return inflation * max(within / around, 1.0)


def _around_streak(pixels: PixelPairs) -> float:
    """Noise inflation from the difference of image and plate."""
    C, B, V_C, V_B = (a[pixels.use] for a in pixels.arrays)
    e = np.zeros(pixels.image.rgb.shape, C.dtype)
    e[pixels.use] = (C - B) / np.sqrt(np.maximum(V_C + V_B, VARIANCE_FLOOR))
    squares = block_squares(e, pixels.use, BLOCK).ravel()
    return significant_inflation(squares, len(squares))


def _within_streak(pixels: PixelPairs, alpha: Floats, inside: Bools) -> float:
    """Noise inflation from the equation without alpha, for a line of colors.

    Differences of neighboring blocks are used: they cancel the residual of a slightly wrong color.
    """
    l, rest = pixels.model.basis[:, 0], np.empty((2, *inside.shape))

    def rows(strip: slice) -> None:
        """Write (l × B)·C and its variance of some rows."""
        C, B, V_C, V_B = (a[strip] for a in pixels.arrays)
        through, m = 1 - np.asarray(alpha[strip], float)[..., None], np.cross(l, B)
        both = m * C, m**2 * (V_C + through**2 * V_B)
        rest[:, strip] = [np.where(inside[strip], x.sum(axis=-1), 0) for x in both]

    in_strips(rows, len(inside))
    e, variance, count = (block_sums(m, BLOCK) for m in (*rest, inside.astype(float)))
    full = count > BLOCK**2 / 2
    squares = []
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        both = full[a] & full[b]
        squares.append((e[a] - e[b])[both] ** 2 / (variance[a] + variance[b])[both])
    return significant_inflation(np.concatenate(squares), int(np.count_nonzero(full)))


def _of_alpha(information: Floats, pull: Floats, use: Bools) -> float:
    """Noise inflation from the pixels' own alpha around the streak.

    Over windows around each pixel, independent of the position of a grid of blocks.
    """
    variance, sums, count = (window_sums(m, BLOCK, "constant") for m in (information, pull, use))
    full = (count > BLOCK**2 / 2) & (variance > 0)
    squares = sums[full] ** 2 / variance[full]
    return significant_inflation(squares, len(squares) // BLOCK**2)


def _fine_structure(information: Floats, pull: Floats) -> float:
    """Mean square of mixed fourth differences of means over 2 by 2 pixels, over their variance.

    A smooth field contributes little to them, and the result does not depend on how pictures are cut.
    """
    I, p = (m[:-1, :-1] + m[1:, :-1] + m[:-1, 1:] + m[1:, 1:] for m in (information, pull))
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.where(I > 0, 1 / I, np.nan)
    e = p * variance
    for _ in range(2):  # down, then across
        e = (e[:-4] - 2 * e[2:-2] + e[4:]).T
        variance = (variance[:-4] + 4 * variance[2:-2] + variance[4:]).T
    known = np.isfinite(variance)
    return core_mean_square(e[known] ** 2 / variance[known])

"""What single pixels know of alpha: their information, and what they pull it to.

In this file C is the image's light and B the plate's.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats
from blurmatte.color import ColorModel
from blurmatte.matting.clipped import one_clipped
from blurmatte.matting.mixed_plate import MixedPlate, evidence_at_edges
from blurmatte.matting.pixelwise import in_strips
from blurmatte.radiometry import LinearImage, smooth_variance
from blurmatte.statistics import BLOCK_SIZES

Array = npt.NDArray[np.float64]

_UNTOLD = 100.0  # variance of clipped light: no more is known than that it is no ten times white
_MEDIAN = 0.455  # of χ² of one
_NEAR, _SURE = 2.0, 3.0  # pixels, over which light is averaged, and standard deviations of it
_DARK = 1e-9  # a plate that tells nothing, but is divided by
_TEXTURE_SCALE = 3.0  # pixels, a first neighborhood to compare textures in


@dataclass(frozen=True, eq=False)
class Pixels:
    """Light and noise of image and plate, as `evidence_of` needs them; made by `pixels_of`.

    Parameters
    ----------
    image, plate : LinearImage
        With a noise variance of each value; of the image as the neighborhood's light has it.
    model : ColorModel
    inside, use : (h, w) bool
        Where alpha may be other than 0, and where a pixel there tells of it.
    mixed : MixedPlate or None
    wide : LinearImage
        The plate with the variance of its edges, too.
    coarse : (h, w, 3) float, optional
        The plate's light without its fine structure, if that is not to tell anything (`coarsely`).
    """

    image: LinearImage
    plate: LinearImage
    model: ColorModel
    inside: Bools
    use: Bools
    mixed: MixedPlate | None
    wide: LinearImage
    coarse: Floats | None = None

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C, B and their variances, but for what the plate's edges have more."""
        return self.image.rgb, self.plate.rgb, self.image.variance, self.plate.variance

    @property
    def with_edges(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C, B and their variances."""
        return self.image.rgb, self.plate.rgb, self.image.variance, self.wide.variance


def coarsely(pixels: Pixels) -> Pixels:
    """So that the plate's fine structure tells nothing.

    Of what is faint and fine compression leaves out more where the object lies over it than where the
    plate is seen alone. By that difference alpha would come out too large.
    """
    from scipy.ndimage import uniform_filter

    B = pixels.plate.rgb
    return replace(pixels, coarse=uniform_filter(B, (BLOCK_SIZES[-1], BLOCK_SIZES[-1], 0)))


def pixels_of(
    image: LinearImage,
    plate: LinearImage,
    model: ColorModel,
    inside: Bools,
    mixed: MixedPlate | None = None,
) -> Pixels:
    """What does not change with alpha.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    model : ColorModel
        Of any rank. Of a line of colors a pixel may be clipped in one channel.
    inside : (h, w) bool
        Where alpha may be other than 0.
    mixed : MixedPlate, optional
        Where the plate's edges are uncertain.
    """
    use = inside & image.valid & plate.valid
    V_C = smooth_variance(image).astype(image.rgb.dtype)
    if (
        model.rank == 1 and not (image.valid & plate.valid).all()
    ):  # two channels still tell something
        clipped = inside & one_clipped(image, plate)
        V_C[clipped[..., None] & ~(image.usable & plate.usable)] = _UNTOLD
        use |= clipped

    def plain(picture: LinearImage, variance: Floats) -> LinearImage:
        return replace(picture, rgb=np.ascontiguousarray(picture.rgb), noise=variance)

    V_B = np.ascontiguousarray(plate.variance, plate.rgb.dtype)
    plate = plain(plate, V_B)
    wide = plate if mixed is None or not mixed.edges.any() else mixed.widened(plate)
    return Pixels(plain(image, V_C), plate, model, inside, use, mixed, wide)


def evidence_of(pixels: Pixels, alpha: Floats) -> tuple[Floats, Floats]:
    """Information and pull of each pixel, both 0 where it is clipped or not inside.

    As though each pixel's noise were its own (`noise_inflation`). Of a line or plane of colors by the
    closed form; of any colors by how much of the plate's texture is seen.

    Parameters
    ----------
    pixels : Pixels
    alpha : (h, w)
        About what alpha is, known from elsewhere than the pixel: by 1 − alpha the plate's noise counts.

    Returns
    -------
    information, pull : (h, w) float
        One over the variance of a pixel's own alpha, and that alpha times the information.
    """
    model, mixed, use = pixels.model, pixels.mixed, pixels.use
    if model.rank == 3:
        C, B, V_C, V_B = (np.asarray(a, float) for a in pixels.with_edges)
        return _of_texture(C, B, V_C, V_B, np.asarray(alpha, float), use)
    from blurmatte.matting.evidence_kernel import evidence  # numba takes half a second

    information, pull = np.zeros((2, *use.shape), pixels.image.rgb.dtype)
    N = np.ascontiguousarray(model.normals)
    maps = np.asarray(alpha, information.dtype), use, information, pull

    def rows(strip: slice) -> None:
        C, B, V_C, V_B = (a[strip] for a in pixels.arrays)
        if pixels.coarse is not None:
            t, coarse = 1 - maps[0][strip][..., None], pixels.coarse[strip]
            # What shines through of the fine structure is taken off; its noise is in C then.
            C, B, V_C, V_B = C - t * (B - coarse), coarse, V_C + t**2 * V_B, np.zeros_like(V_B)
        evidence(C, B, V_C, V_B, N, *(m[strip] for m in maps))

    in_strips(rows, len(use))
    if mixed is not None:
        at_edges = evidence_at_edges(mixed, pixels.image, pixels.plate, model, alpha)
        for own, of_edges in zip((information, pull), at_edges, strict=True):
            own[mixed.edges] = of_edges * pixels.inside[mixed.edges]
    return information, pull


def _of_texture(
    C: Array, B: Array, V_C: Array, V_B: Array, alpha: Array, use: Bools
) -> tuple[Array, Array]:
    """Of any colors: ∇C = (1 − α)∇B, but for noise and what is painted on the object.

    How much is painted is what a first alpha, of neighborhoods, leaves in all.
    """
    from scipy.ndimage import gaussian_filter

    pairs: list[tuple[Bools, Array, Array, Array, Array]] = []
    for axis in (0, 1):
        both = use & np.roll(use, -1, axis)
        last = (slice(None),) * axis + (slice(-1, None),)
        both[last] = False
        c, b = np.roll(C, -1, axis) - C, np.roll(B, -1, axis) - B
        v_C, v_B = np.roll(V_C, -1, axis) + V_C, np.roll(V_B, -1, axis) + V_B
        pairs.append((both[..., None], c, b, v_C, v_B))

    def sums(painted: float) -> tuple[Array, Array]:
        information, pull = np.zeros((2, *use.shape))
        t = (1 - alpha)[..., None]
        for axis, (both, c, b, v_C, v_B) in enumerate(pairs):
            weight = both / (v_C + t**2 * v_B + painted + 1e-14)
            for total, values in ((information, b * b), (pull, b * (b - c) - t * v_B)):
                half = np.sum(weight * values, axis=-1) / 2
                total += half + np.roll(half, 1, axis)
        return information, pull

    information, pull = sums(0.0)
    first: Array = gaussian_filter(pull, _TEXTURE_SCALE) / (
        gaussian_filter(information, _TEXTURE_SCALE) + 1e-9
    )
    t = (1 - np.clip(first, 0, 1))[..., None]
    left = [
        np.median(((c - t * b) ** 2 - v_C - t**2 * v_B)[both[..., 0]]) / _MEDIAN
        for both, c, b, v_C, v_B in pairs
        if both.any()
    ]
    return sums(max(float(np.mean(left)), 0.0)) if left else (information, pull)


def least_alpha(pixels: Pixels, together: float) -> Floats:
    """What alpha of each pixel cannot be less than, (h, w): no light of an object is negative.

    In no channel (1 − α) B can be more than C. Of light of neighborhoods, and less by what noise may
    be, so that next to nothing is told where there was no object; −∞ where no channel tells.

    Parameters
    ----------
    pixels : Pixels
    together : float
        By how much more noise adds up than if each pixel had its own.
    """
    from scipy.ndimage import gaussian_filter

    C, B, V_C, V_B = (gaussian_filter(a, (_NEAR, _NEAR, 0)) for a in pixels.with_edges)
    noise = np.sqrt((V_C + V_B) * together / (4 * np.pi * _NEAR**2))
    least = np.max(1 - (C + _SURE * noise) / np.maximum(B, _DARK), axis=-1)
    return np.where(pixels.use & (least > 0), least, -np.inf)

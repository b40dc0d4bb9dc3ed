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
from blurmatte.radiometry import LinearImage, block_squares, block_sums, smooth_variance
from blurmatte.streaks import Streak

Array = npt.NDArray[np.float64]

_LEAST_RIM = 4.0  # pixels that a streak's rims may reach unseen, and
_RIM = 0.15  # half widths of it
_WINDOW, _SIGMAS = 0.05, 4.0  # half widths of a streak to look for more of it in, and how clearly
_BLOCK = 8  # pixels: noise that hangs together does so over less, or over such blocks
_KEPT, _MEAN_OF_KEPT = 0.9, 0.606  # the lower part of χ² of one
_UNTOLD = 100.0  # variance of clipped light: no more is known than that it is no ten times white
_MEDIAN = 0.455  # of χ² of one
_CHANCE = 2.5  # standard deviations of a mean of squares
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
    """

    image: LinearImage
    plate: LinearImage
    model: ColorModel
    inside: Bools
    use: Bools
    mixed: MixedPlate | None
    wide: LinearImage

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C, B and their variances, but for what the plate's edges have more."""
        return self.image.rgb, self.plate.rgb, self.image.variance, self.plate.variance

    @property
    def with_edges(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C, B and their variances."""
        return self.image.rgb, self.plate.rgb, self.image.variance, self.wide.variance


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

    As though each pixel's noise were its own (`noise_together`). Of a line or plane of colors by the
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
    from blurmatte.matting.smooth_kernel import evidence  # numba takes half a second

    information, pull = np.zeros((2, *use.shape), pixels.image.rgb.dtype)
    N = np.ascontiguousarray(model.normals)
    maps = np.asarray(alpha, information.dtype), use, information, pull

    def rows(strip: slice) -> None:
        light = (a[strip] for a in pixels.arrays)
        evidence(*light, N, *(m[strip] for m in maps))

    in_strips(rows, len(use))
    if mixed is not None:
        at_edges = evidence_at_edges(mixed, pixels.image, pixels.plate, model, alpha)
        for own, of_edges in zip((information, pull), at_edges, strict=True):
            own[mixed.edges] = of_edges * pixels.inside[mixed.edges]
    return information, pull


def noise_together(pixels: Pixels, alpha: Floats) -> float:
    """By how much more noise adds up over blocks than if each pixel had its own, 1 or more.

    Beside the streak it shows in the difference of image and plate. Compression leaves other noise
    where something moved than where nothing did; there a line l of colors tells it, by the equation
    that it leaves over, (l × B)·C = 0, in which there is no alpha. A plane leaves none; there the fine
    structure of alpha tells, by how much it is stronger within the streak than beside it. The
    parameters are those of `evidence_of`.
    """
    valid = pixels.image.valid & pixels.plate.valid
    if pixels.model.rank == 2:
        return _of_plane(pixels, alpha, valid)
    together = _beside(pixels, valid & ~pixels.inside)
    if pixels.model.rank == 1:
        together = max(together, _left_over(pixels, alpha, valid & pixels.inside))
    return together


def with_faint_rims(
    streak: Streak, image: LinearImage, plate: LinearImage, model: ColorModel
) -> Streak:
    """The streak, and what belongs to it as far as it is wide, now that the colors are known.

    Rims that are weaker than noise, or before a plate of nearly the object's color, are not found as
    something that moved.
    """
    from scipy.ndimage import binary_propagation, distance_transform_edt, gaussian_filter

    y, x = streak.rows_columns
    half_width = float(distance_transform_edt(np.pad(streak.mask[y, x], 1)).max())
    reach = _LEAST_RIM + half_width
    box = streak.around(int(reach) + 1)
    place = slice(box[1], box[3]), slice(box[0], box[2])
    inside = streak.mask[place]
    away = np.asarray(distance_transform_edt(~inside))
    near = away <= reach
    if model.rank < 3:
        image, plate = image.crop(box), plate.crop(box)
        nothing = np.zeros(near.shape)
        pixels = pixels_of(image, plate, model, near)
        evidence = evidence_of(pixels, nothing)
        together = noise_together(pixels, nothing)
        window = max(_WINDOW * half_width, 1.0)
        information, pull = (gaussian_filter(e, window) for e in evidence)
        alike = (
            4 * np.pi * window**2 / together
        )  # pixels, of as much noise as a mean of this window
        seen = pull * np.sqrt(alike) > _SIGMAS * np.sqrt(information + 1e-9)
        inside = binary_propagation(inside, mask=inside | (near & seen))
        away = np.asarray(distance_transform_edt(~inside))
    mask = np.zeros(streak.mask.shape, bool)
    mask[place] = away <= _LEAST_RIM + _RIM * half_width
    return replace(streak, mask=mask)


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


def _beside(pixels: Pixels, still: Bools) -> float:
    """What noise adds up to beside the streak."""
    C, B, V_C, V_B = (a[still] for a in pixels.with_edges)
    e = np.zeros(pixels.image.rgb.shape, C.dtype)
    e[still] = (C - B) / np.sqrt(np.maximum(V_C + V_B, 1e-14))
    squares = block_squares(e, still, _BLOCK).ravel()
    return _beyond_chance(squares, len(squares))


def _left_over(pixels: Pixels, alpha: Floats, inside: Bools) -> float:
    """What the equation left over adds up to within the streak.

    Of differences of neighboring blocks: a color that is a little wrong leaves something in all.
    """
    from blurmatte.matting.smooth_kernel import left_over  # numba takes half a second

    l, rest = pixels.model.basis[:, 0], np.empty((2, *inside.shape))

    def rows(strip: slice) -> None:
        light = (a[strip] for a in pixels.with_edges)
        left_over(*light, l, alpha[strip], inside[strip], rest[:, strip])

    in_strips(rows, len(inside))
    e, variance, count = (block_sums(m, _BLOCK) for m in (*rest, inside.astype(float)))
    full = count > _BLOCK**2 / 2
    squares = []
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        both = full[a] & full[b]
        squares.append((e[a] - e[b])[both] ** 2 / (variance[a] + variance[b])[both])
    return _beyond_chance(np.concatenate(squares), int(np.count_nonzero(full)))


def _of_plane(pixels: Pixels, alpha: Floats, valid: Bools) -> float:
    """What noise of the one equation of a plane of colors adds up to within the streak.

    Where noise beside it is each pixel's own, so is that within: fine alphas would be taken for it.
    """
    still = replace(pixels, inside=~pixels.inside, use=valid & ~pixels.inside)
    beside = evidence_of(still, np.zeros(alpha.shape))
    variance, sums, count = (_window_sums(m) for m in (*beside, still.use))
    full = (count > _BLOCK**2 / 2) & (variance > 0)
    squares = sums[full] ** 2 / variance[full]
    together = _beyond_chance(squares, len(squares) // _BLOCK**2)
    if together == 1:
        return together
    within, without = (_fine_structure(*e) for e in (evidence_of(pixels, alpha), beside))
    return together * max(within / without, 1.0)


def _window_sums(values: Floats | Bools) -> Array:
    """Sums over blocks around each pixel: those of a grid would change with where it begins."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(float), _BLOCK, mode="constant") * _BLOCK**2)


def _fine_structure(information: Floats, pull: Floats) -> float:
    """Mean square of second differences of second differences of 2 by 2 pixels, over their variance.

    A field that is smooth has hardly any of those. Wherever the picture is cut, it is the same.
    """
    I, p = (m[:-1, :-1] + m[1:, :-1] + m[:-1, 1:] + m[1:, 1:] for m in (information, pull))
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = 1 / I
        e = p * variance
    for _ in range(2):  # down, then across
        e = (e[:-4] - 2 * e[2:-2] + e[4:]).T
        variance = (variance[:-4] + 4 * variance[2:-2] + variance[4:]).T
    known = np.isfinite(variance)
    return _mean_of_kept(e[known] ** 2 / variance[known])


def _beyond_chance(squares: Array, independent: int) -> float:
    """Mean of squares of spread 1 but for a factor; 1 if it may be so by chance.

    The worst of them do not count.
    """
    if independent == 0 or len(squares) == 0:
        return 1.0
    factor = _mean_of_kept(squares)
    return factor if factor > 1 + _CHANCE * np.sqrt(2 / independent) else 1.0


def _mean_of_kept(squares: Array) -> float:
    """Mean of squares of spread 1 but for a factor, the worst left out; 1 if there are none."""
    if len(squares) == 0:
        return 1.0
    last = int(np.ceil(_KEPT * len(squares)))
    return float(np.partition(squares, last - 1)[:last].mean()) / _MEAN_OF_KEPT

"""Smooth: alpha of all pixels together, for objects that no rigid silhouette describes.

The evidence of each pixel (`evidence`) is combined with a prior by which alpha is smooth except at
edges (`smooth_field`). The scale of the prior and the order of its differences minimize Stein's
unbiased estimate of the error on large cells, where this is fast. The fit then proceeds from coarse to
fine. Where the image's file has subsampled chroma, its blur is corrected with a first alpha,
and the fit is repeated.

Luma and chroma are rounded to whole codes. Noise usually dithers the rounding, so that neighbors are
rounded independently. Compression removes noise: pixels of a plain area with the same code have the
same error, which no mean over neighbors or frames reduces. Image and plate share it where nothing
moved, so their difference does not show it. It is simulated: each code of luma and both chromas gets a
uniform error of up to half a code. In fine structure, which has many codes, the errors average out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Box, Floats, Ints32, rows_columns
from blurmatte.color.shadows import MARGIN_PX
from blurmatte.errors import ConvergenceWarning, warn
from blurmatte.matting.averaging import as_fraction
from blurmatte.matting.case import Answer, Case, Solver
from blurmatte.matting.evidence import (
    FirstEstimate,
    PixelPairs,
    information_of,
    min_alpha,
    pixels_of,
    sum_inflation,
    without_fine_structure,
)
from blurmatte.matting.evidence_kernel import add_rounded
from blurmatte.matting.light_priors import with_brightness, with_mixture
from blurmatte.matting.maps import PixelMaps, Quality, alpha_flags, has_flag, in_strips
from blurmatte.matting.object_light import inpaint_light, light_given
from blurmatte.matting.pixelwise import closed_form
from blurmatte.matting.smooth_field import (
    BORDER,
    MIN_ALPHA,
    CellEvidence,
    Field,
    Prior,
    field_changes,
    finer_field,
    fit_field,
    simulated_variance,
    sum_variance,
    upsampled,
)
from blurmatte.matting.stats import SmoothSummary, SolutionStats
from blurmatte.radiometry import YCBCR, Compression, LinearImage, Transfer
from blurmatte.radiometry.compression import BLOCK
from blurmatte.sweep.model.chroma_subsampling import file_of, image_before

MAX_STRENGTH = 1e6  # and its inverse: beyond them alpha is constant, or that of single pixels


# Settings of the choice of the prior, and of the fit from coarse to fine.
_MAX_COARSE_CELLS = 3000  # of the coarsest level, on which all priors are compared
_MAX_SAMPLED_CELLS = 100_000  # of sampled levels; finer cells are close to their neighbors
_MAX_SIMULATED_CELLS = 15_000  # of the level on which the error is simulated
_FIRST_ORDER_SCALE = 1.28  # largest scale of priors of order 1, coarsest cells
_SECOND_ORDER_SCALE = 1.92  # of priors of order 2
_SCALE_COUNT = 7  # compared scales, each half of the one before
_REFINEMENTS = (1.0, 0.5, 0.25)  # factors of the scale on finer levels
_SAMPLES = 2  # of the posterior, while priors are compared
_FINAL_SAMPLES = 8  # of the posterior, for the result
_FIRST_STD_PX = 2.0  # of the Gaussian that smooths the first alpha
_ROUNDING_SAMPLES = 16  # maps of rounding errors that are drawn, with a fixed seed
_TEXTURE_NOISE_POWER = 0.7  # exponent of the noise inflation for a model of rank 3


@dataclass(frozen=True, eq=False)
class SmoothFit:
    """Alpha of all pixels, with the steps of the fit; maps are (h, w)."""

    pixels: PixelPairs
    near: Floats  #: a first alpha, smoothed
    inflation: float  #: of noise by correlation
    noise_factor: float  #: by which the noise variance was raised for it
    levels: list[CellEvidence]  #: from pixels to the largest cells
    coarse: list[tuple[Prior, Field]]  #: from the largest cells to those of the choice of the prior
    prior: Prior
    field: Field  #: in pixels, with a border
    shared: Floats  #: additional variance that neighbors share

    @property
    def finest(self) -> int:
        """Number of levels below those on which the prior was chosen."""
        return len(self.levels) - len(self.coarse)


@dataclass(frozen=True)
class Smooth(Solver):
    """Solve all pixels of the streak together: alpha is smooth, except at edges.

    Alpha is the posterior mean of evidence and prior. Its error is that of simulations with a similar,
    known truth; where it is large, alpha is the mean of a distribution on 0…1 (`as_fraction`). The
    light follows from image and alpha within the model, so that it keeps the camera's noise and full
    detail.

    Parameters
    ----------
    strength : float
        Smoothness relative to the one estimated from the data, 1e-6 to 1e6; 1 has the least error on
        average.
    max_alpha_std : float
        A pixel with a larger standard deviation of alpha is marked PLATE_IN_MODEL, > 0.

    Raises
    ------
    ValueError
        If a number is not positive, or `strength` is beyond its range.

    Examples
    --------
    >>> answer = bm.solve(image, plate, solution.model, bm.Smooth())
    >>> print(answer)
    Solution(128x72, alpha up to 0.33, typical std 0.0038, 0.0% of the streak's pixels flagged)
    """

    strength: float = 1.0
    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        for name in ("strength", "max_alpha_std"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 1 / MAX_STRENGTH <= self.strength <= MAX_STRENGTH:
            raise ValueError(
                f"strength must lie between {1 / MAX_STRENGTH:g} and {MAX_STRENGTH:g}, "
                f"got {self.strength:g}"
            )

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Solve the streak of a case, with its faint rims."""
        fit = self.fitted(case)
        return self.answer_with(case, fit, *self.simulated_error(fit), out)

    def answer_with(
        self,
        case: Case,
        fit: SmoothFit,
        variance: Floats,
        of_sum: float,
        out: PixelMaps | None = None,
    ) -> Answer:
        """Alpha of a fit and its light.

        variance (h, w): of alpha, with the border of the fit. of_sum: variance of the sum of alpha.
        Warns ConvergenceWarning if the last step of the fit still changed alpha.
        """
        _warn_unless_converged(fit.field)
        box, pixels, inside = _box(case), fit.pixels, fit.pixels.inside
        maps = closed_form(case, box, out)
        near, image = maps.within(box), case.image.crop(box)
        raw_std = np.sqrt(_inner(variance))
        alpha, alpha_std = as_fraction(_inner(fit.field.x), raw_std)
        P, P_std, _ = light_given(alpha, alpha_std, pixels.model, image, pixels.wide)
        hidden = has_flag(near.quality, Quality.OCCLUDED)
        P[hidden], P_std[hidden] = 0, np.inf
        for target, values in zip(near, (alpha, alpha_std, P, P_std), strict=False):
            np.copyto(target.T, values.T, "same_kind", inside.T)
        near.quality[inside] &= np.uint8(Quality.SATURATED | Quality.OCCLUDED | Quality.MISFIT)
        near.quality[inside] |= alpha_flags(alpha, raw_std, self.max_alpha_std)[inside]
        inpaint_light(near, image, case.plate.crop(box))
        sum_std = min(float(np.sqrt(of_sum)), float(alpha_std[inside].sum(dtype=float)))
        prior, field = fit.prior, fit.field
        summary = SmoothSummary(prior.order, prior.scale, field.steps, field.converged)
        stats = SolutionStats(sum_alpha_std=sum_std, smooth=summary)
        return Answer(maps, case.model, maps.solved, stats, errors_like="Smooth", assumes="")

    def fitted(self, case: Case) -> SmoothFit:
        """Fit alpha, twice where the image's file has subsampled chroma."""
        box = _box(case)
        image, plate, mixed = case.within(box)
        inside = case.grown_streak.mask[rows_columns(box)]
        pixels = pixels_of(image, plate, case.model, inside, mixed)
        file = file_of(pixels.image)
        if file is not None and case.model.rank == 1:  # of other models colors are too uncertain
            pixels = _before_file(pixels, file, self._fit(pixels).field)
        return self._fit(pixels)

    def _fit(self, pixels: PixelPairs) -> SmoothFit:
        """Fit alpha, from a first estimate to the finest level."""
        near = _smoothed_alpha(information_of(pixels, np.zeros(pixels.inside.shape)))
        inflation, rank = sum_inflation(pixels, near), pixels.model.rank
        # Texture has little information: with the full inflation alpha is smooth, certain, and wrong.
        power = 1.0 if rank < 3 else _TEXTURE_NOISE_POWER
        noise_factor = inflation**power
        if inflation > 1 and rank == 2:
            pixels = without_fine_structure(pixels)
        lower = np.full_like(near, MIN_ALPHA)
        if (
            rank == 2
        ):  # of a line, alpha is more accurate than this bound, which needs neighborhoods
            lower = min_alpha(pixels, inflation)
        own = _bordered(*information_of(pixels, near), pixels.inside, lower)
        levels = own.weaker(noise_factor).levels(_MAX_COARSE_CELLS)
        coarse = _choose_priors(levels)
        prior, field = coarse[-1]
        finest = len(levels) - len(coarse)
        near, variance = (_in_pixels(m, levels[:finest]) for m in (field.x, field.variance))
        renewed, shared = _with_neighbors(pixels, near, variance, noise_factor, lower)
        levels = renewed.levels(_MAX_COARSE_CELLS)
        samples = _FINAL_SAMPLES
        prior, field = self._refined(levels, prior, field, finest, rank, samples)
        return SmoothFit(
            pixels, near, inflation, noise_factor, levels, coarse, prior, field, shared
        )

    def simulated_error(self, fit: SmoothFit) -> tuple[Floats, float]:
        """The variance (h, w) of alpha, with a border, and that of its sum, by simulations."""
        levels, inflation, noise_factor = fit.levels, fit.inflation, fit.noise_factor
        field, cells = fit.field, 4 ** (len(levels) - 1)
        of_sum = inflation / noise_factor * sum_variance(levels[-1], *fit.coarse[0], cells)
        shared = fit.shared
        if inflation > 1:
            of_each, of_all = _of_rounding(fit)
            shared, of_sum = shared + of_each, of_sum + of_all
        # Cells and pixels weight the evidence differently; the difference of sums is a model error.
        fine, coarse = (float(one.x.sum(dtype=float)) for one in (field, fit.coarse[-1][1]))
        of_sum += (fine - 4**fit.finest * coarse) ** 2
        variance, bias_square = self._variance(fit)
        return _with_correlation(fit, variance, shared), of_sum + bias_square

    def _refined(
        self,
        levels: Sequence[CellEvidence],
        prior: Prior,
        field: Field,
        finest: int,
        rank: int,
        samples: int,
        cells: int = 1,
    ) -> tuple[Prior, Field]:
        """Fit the levels from `finest` to the first, of `cells` pixels per cell; with samples there.

        Prior and field are those of the level `finest`, rank that of the color model.
        """
        prior = replace(prior, scale=prior.scale / self.strength)
        for depth in reversed(range(max(finest, 1))):
            level = levels[depth]
            if depth < finest:
                prior, field = prior.finer(), finer_field(field, level.mask.shape, prior.order)
            sampled = depth == 0 and level.count < _MAX_SAMPLED_CELLS
            local = sampled and rank < 3
            field = fit_field(level, prior, field, samples * sampled, cells * 4**depth, local)
        return prior, field

    def _variance(self, fit: SmoothFit) -> tuple[Floats, float]:
        """Variance of each pixel's alpha without lost fine structure, and of the sum's bias."""
        levels, prior, field, rank = fit.levels, fit.prior, fit.field, fit.pixels.model.rank
        limit, samples = _MAX_SIMULATED_CELLS, _SAMPLES
        depth = next(d for d, level in enumerate(levels) if level.count <= limit)
        cells = 4**depth

        def refit(drawn: CellEvidence) -> tuple[Prior, Field]:
            """Prior and field for drawn evidence."""
            levels = drawn.levels(_MAX_COARSE_CELLS)
            found = _choose_priors(levels, cells)
            finest = len(levels) - len(found)
            return self._refined(levels, *found[-1], finest, rank, samples, cells)

        if depth > 0:
            prior, field = refit(levels[depth])
        variance, bias_square = simulated_variance(
            levels[depth], prior, field, lambda drawn: refit(drawn)[1].x, cells
        )
        if rank == 3:  # simulations do not contain the object's own texture
            variance = np.maximum(variance, field.variance)
        for level in reversed(levels[:depth]):
            variance = upsampled(variance, level.mask.shape)
        return variance, 16**depth * bias_square


def _box(case: Case) -> Box:
    """Where alpha may be other than 0, with a margin."""
    return case.grown_streak.around(MARGIN_PX)


def _warn_unless_converged(field: Field) -> None:
    if not field.converged:
        warn(
            f"alpha had not converged after {field.steps} steps and is that of the last one; choose "
            "a smaller region, or less strength",
            ConvergenceWarning,
        )


def _choose_priors(levels: Sequence[CellEvidence], cells: int = 1) -> list[tuple[Prior, Field]]:
    """The prior of the least risk and its field, from the coarsest to the finest sampled level.

    The first level, of `cells` pixels per cell, is left out unless it is the only one.
    """
    top = len(levels) - 1
    priors = [
        Prior(order, scale / 2.0**i)
        for order, scale in ((1, _FIRST_ORDER_SCALE), (2, _SECOND_ORDER_SCALE))
        for i in range(_SCALE_COUNT)
    ]
    found = [_least_risk(levels[top], priors, None, cells * 4**top)]
    for depth in range(top - 1, 0, -1):
        level, (prior, field) = levels[depth], found[-1]
        if level.count >= _MAX_SAMPLED_CELLS:
            break
        prior, start = prior.finer(), finer_field(field, level.mask.shape, prior.order)
        choice = [replace(prior, scale=prior.scale * part) for part in _REFINEMENTS]
        found.append(_least_risk(level, choice, start, cells * 4**depth))
    return found


def _least_risk(
    evidence: CellEvidence, priors: Sequence[Prior], start: Field | None, cells: int
) -> tuple[Prior, Field]:
    """The prior of the least risk and its field; each fit starts from the one before."""
    found: list[tuple[Prior, Field]] = []
    for _, scales in groupby(priors, lambda prior: prior.order):
        field, risks = start, [np.inf]
        for prior in scales:
            field = fit_field(evidence, prior, field, _SAMPLES, cells)
            found.append((prior, field))
            risks.append(field.risk)
            if min(risks[-2:]) > min(risks):  # two in a row above the least: it only increases
                break
    return min(found, key=lambda trial: trial[1].risk)


def _in_pixels(values: Floats, levels: Sequence[CellEvidence]) -> Floats:
    """A map of cells, interpolated from level to level down to pixels, without its border."""
    for level in reversed(levels):
        values = upsampled(values, level.mask.shape)
    return _inner(values)


def _before_file(pixels: PixelPairs, file: Compression, field: Field) -> PixelPairs:
    """Pixels of the image before chroma subsampling, given alpha."""
    alpha = np.asarray(np.clip(_inner(field.x), 0, 1), float)
    image = image_before(pixels.image, pixels.plate, alpha, pixels.model.basis, file)
    return replace(pixels, image=replace(image, rgb=np.ascontiguousarray(image.rgb)))


def _of_rounding(fit: SmoothFit) -> tuple[Floats, float]:
    """Variance of each pixel's alpha and of their sum, from rounding errors that neighbors share."""
    levels = fit.levels
    pulls = rounding_pulls(fit.pixels, np.clip(fit.near, 0, 1), levels)
    if not pulls:
        return np.zeros_like(fit.near), 0.0
    cells, pulls = 4 ** (len(levels) - 1), [p / fit.inflation for p in pulls]
    off = np.stack(field_changes(levels[-1], *fit.coarse[0], pulls, cells))
    of_sum = np.mean((cells * off.sum(axis=(1, 2))) ** 2)
    share = 1 - 1 / fit.inflation  # independent noise of pixels dithers the codes
    return share * _in_pixels(np.mean(off**2, axis=0), levels[:-1]), share * float(of_sum)


def rounding_pulls(
    pixels: PixelPairs, alpha: Floats, levels: Sequence[CellEvidence]
) -> list[Array]:
    """Errors of the pull of each cell of the last level, one map for each sample.

    Empty if the picture does not consist of codes, or the model has rank 3, whose evidence, texture,
    does not depend on errors that neighbors share.

    alpha (h, w): an estimate.
    levels: from pixels on, each of twice the width.
    """
    codes, transfer = pixels.image.meta.levels, pixels.image.meta.transfer
    if codes is None or transfer is None or pixels.model.rank == 3:
        return []
    kind = pixels.image.rgb.dtype
    _, B, V_C, V_B = pixels.arrays
    if pixels.coarse is not None:
        B = pixels.coarse
    N, color = pixels.model.normals, np.linalg.inv(YCBCR)
    (of_image, image), (of_plate, plate) = (
        _codes(picture, codes, transfer) for picture in (pixels.image, pixels.plate)
    )

    def rows(strip: slice) -> None:
        """Convert light per code of red, green and blue into pull per code of luma and chroma."""
        use = pixels.use[strip]
        t = 1 - np.asarray(alpha[strip][use], float)[:, None]
        S = V_C[strip][use] + t**2 * V_B[strip][use]
        covariance, b = np.einsum("nc,ci,cj->nij", S, N, N), B[strip][use] @ N
        of_light = np.linalg.solve(covariance, b[..., None])[..., 0] @ N.T
        for codes, weight in ((image[strip], 1.0), (plate[strip], t)):
            codes[use] = weight * of_light * codes[use] @ color

    in_strips(rows, len(pixels.use))
    off = (
        np.random.default_rng(0).uniform(-0.5, 0.5, (_ROUNDING_SAMPLES, 3, 3 * codes)).astype(kind)
    )
    pulls = np.zeros((_ROUNDING_SAMPLES, *levels[-1].mask.shape))
    width = 2 ** (len(levels) - 1)
    add_rounded(of_image, image, of_plate, plate, pixels.use, off, width, BORDER, pulls)
    return list(pulls)


def _codes(picture: LinearImage, levels: int, transfer: Transfer) -> tuple[Ints32, Floats]:
    """(h, w, 3) codes of luma and chroma, 0 or more, and the light per code of each channel."""
    kind, steps = picture.rgb.dtype, levels - 1
    of_code = (transfer.slope(transfer.table(levels)) / steps).astype(kind)
    codes, light = np.empty(picture.rgb.shape, np.int32), np.empty(picture.rgb.shape, kind)

    def rows(strip: slice) -> None:
        """Fill some rows."""
        values = steps * transfer.encode(picture.rgb[strip])
        light[strip] = of_code[np.clip(np.rint(values), 0, steps).astype(np.intp)]
        chroma = np.rint(values @ YCBCR.T + (0, steps, steps))
        codes[strip] = np.clip(chroma, 0, 3 * levels - 1)

    in_strips(rows, len(codes))
    return codes, light


def posterior_variance(fit: SmoothFit) -> Floats:
    """The variance (h, w) of alpha given the prior, with a border.

    It is quicker than a simulation, which also contains the error by the choice of the prior.
    """
    return _with_correlation(fit, fit.field.variance, fit.shared)


def _with_correlation(fit: SmoothFit, variance: Floats, shared: Floats) -> Floats:
    """A variance with what correlated noise adds to it."""
    lost = (1 - 1 / fit.inflation) * _fine_structure(fit.field.x)
    inflated = variance * fit.inflation / fit.noise_factor
    return np.asarray(inflated + np.pad(shared, BORDER) + lost)


def _fine_structure(x: Floats) -> Floats:
    """Mean square around each pixel of structure finer than a block, which compression removes."""
    fine = (x - scipy.ndimage.uniform_filter(x, BLOCK)) ** 2
    return np.asarray(
        scipy.ndimage.uniform_filter(fine, BLOCK).clip(0)
    )  # running sums may round below 0


def _with_neighbors(
    pixels: PixelPairs, alpha: Floats, variance: Floats, noise_factor: float, lower: Floats
) -> tuple[CellEvidence, Floats]:
    """Evidence given an alpha and its variance, with the prior on light; and the shared variance."""
    near = np.clip(alpha, 0, 1)
    information, pull = (values / noise_factor for values in information_of(pixels, near))
    shared = np.zeros_like(information)
    first = FirstEstimate(pixels, near, variance, noise_factor)
    if pixels.model.rank == 1:
        information, pull = with_brightness(first, information, pull)
    elif pixels.model.rank == 2:
        information, pull, shared = with_mixture(first, information, pull)
    return _bordered(information, pull, pixels.inside, lower), shared


def _smoothed_alpha(evidence: tuple[Floats, Floats]) -> Floats:
    """Alpha of Gaussian neighborhoods."""
    information, pull = (scipy.ndimage.gaussian_filter(e, _FIRST_STD_PX) for e in evidence)
    return np.asarray(np.clip(pull / (information + 1e-9), 0, 1))


def _bordered(information: Floats, pull: Floats, inside: Bools, lower: Floats) -> CellEvidence:
    """Evidence with a border, and with alpha not below the least of all pixels."""
    lower = np.maximum(lower, MIN_ALPHA).astype(information.dtype)
    information, pull, lower = (np.pad(m, BORDER) for m in (information, pull, lower))
    return CellEvidence(information, pull, np.pad(inside, BORDER), lower)


def _inner(values: Floats) -> Floats:
    return np.asarray(values[BORDER:-BORDER, BORDER:-BORDER])

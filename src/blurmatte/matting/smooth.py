"""Smooth: alpha of all pixels together, for whatever no rigid silhouette describes.

Each pixel says what it knows of alpha (`evidence`), with its information as weight; a prior says that
alpha is smooth but for edges (`smooth_prior`). How smooth is found from the data: of several scales and
both orders of differences those for which Stein's unbiased estimate of the error is least, on cells so
large that this takes no time. Then it goes from coarse to fine. Where the image's file says how it let
colors run together, that is undone with a first alpha, and all is done again.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color import ColorModel
from blurmatte.errors import ConvergenceWarning
from blurmatte.matting.evidence import Pixels, coarsely, evidence_of, least_alpha, pixels_of
from blurmatte.matting.light import light_given
from blurmatte.matting.mixed_plate import MixedPlate
from blurmatte.matting.mixture import with_mixture
from blurmatte.matting.noise_inflation import BLOCK, noise_inflation
from blurmatte.matting.pixelwise import PixelMaps
from blurmatte.matting.rounding import rounded_pulls
from blurmatte.matting.shading import Told, with_shading
from blurmatte.matting.smooth_error import simulated_variance
from blurmatte.matting.smooth_prior import (
    BORDER,
    LEAST,
    Evidence,
    Field,
    Prior,
    changes,
    finer,
    map_in_smaller_cells,
    smoothed,
    sum_variance,
)
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import LinearImage
from blurmatte.sweep import Compressed, file_of, image_before, light_of_colors

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_CELLS = 3000  # enough to tell how smooth alpha is
_ENOUGH = (
    100_000  # cells to tell its error: what has more of them changes little from one to the next
)
_TRIED = 15_000  # cells to try it in: some are enough to tell how wrong their neighbors are
_PRIORS = tuple(
    Prior(order, scale / 2.0**i) for order, scale in ((1, 1.28), (2, 1.92)) for i in range(7)
)  # in large cells
_SMOOTHER = 1.0, 0.5, 0.25  # times: noise of smaller cells is stronger
_SAMPLES, _FINAL_SAMPLES = 2, 8
_NEIGHBORHOOD = 2.0  # pixels, over which a first alpha is averaged
_SIGMAS_OUT = 3.0
_ANY_COLORS = 0.7  # power: of any colors, how much of noise that hangs together counts, in trials


@dataclass(frozen=True, eq=False)
class _Found:
    """Alpha of all pixels, and what led to it.

    Parameters
    ----------
    pixels : Pixels
    near : (h, w) float
        Alpha by large cells.
    together, weaker : float
        By how much more noise adds up than if each pixel had its own, and how much of that counts.
    levels : list of Evidence
        From pixels to the largest cells.
    cells : list of (Prior, Field)
        From the largest cells to the smallest that tell how smooth alpha is.
    prior : Prior
    field : Field
        In pixels, with a border.
    shared : (h, w) float
        Variance that neighbors have in common, besides.
    """

    pixels: Pixels
    near: Floats
    together: float
    weaker: float
    levels: list[Evidence]
    cells: list[tuple[Prior, Field]]
    prior: Prior
    field: Field
    shared: Floats

    @property
    def finest(self) -> int:
        """Levels below the smallest of the cells."""
        return len(self.levels) - len(self.cells)


@dataclass(frozen=True)
class Smooth:
    """All pixels of the streak together: alpha is smooth, but for edges.

    Alpha is the mean of what evidence and prior leave possible. Its error is that of trials with a
    known truth like it. The light is what alpha leaves of the image, within the model: its noise stays
    that of the camera, and its details stay sharp.

    Parameters
    ----------
    strength : float
        Times as smooth as the data ask for, > 0; 1 is best on average.
    max_alpha_std : float
        A pixel whose alpha is less certain than this is marked PLATE_IN_MODEL, > 0.

    Raises
    ------
    ValueError
        If a number is not positive.
    """

    strength: float = 1.0
    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        for name in ("strength", "max_alpha_std"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    def __call__(
        self,
        maps: PixelMaps,
        image: LinearImage,
        plate: LinearImage,
        model: ColorModel,
        inside: Bools,
        box: tuple[int, int, int, int],
        mixed: MixedPlate | None = None,
    ) -> dict[str, Any]:
        """Write the answer into maps of the closed form.

        Parameters
        ----------
        maps : PixelMaps
            Of the closed form with the same model; changed in place.
        image, plate : LinearImage
            What is in the box, noise known.
        model : ColorModel
            Of any rank: of any colors, alpha is told by how much of the plate's texture shines through.
        inside : (h, w) bool
            Where in the box alpha may be other than 0.
        box : (int, int, int, int)
            Where to write.
        mixed : MixedPlate, optional
            Where in the box the plate's edges are uncertain.

        Returns
        -------
        dict
            The standard deviation of the sum of alpha, how smooth it is, and how the solution ended.

        Warns
        -----
        ConvergenceWarning
            If the last step still changed the answer; it is the last one then.
        """
        pixels = pixels_of(image, plate, model, inside, mixed)
        file = file_of(pixels.image)
        if file is not None and model.rank == 1:  # what others show is not known well enough
            pixels = _before_file(pixels, file, self._found(pixels).field)
        found = self._found(pixels)
        variance, of_sum = self._with_error(found)
        field, prior = found.field, found.prior
        if not field.converged:
            warnings.warn(
                f"alpha had not settled after {field.steps} steps and is that of the last one; choose "
                "a smaller region, or less strength",
                ConvergenceWarning,
                stacklevel=3,
            )
        alpha, alpha_std = _inner(field.x), np.sqrt(_inner(variance))
        P, P_std, _ = light_given(alpha, alpha_std, model, image, pixels.wide)
        place = slice(box[1], box[3]), slice(box[0], box[2])
        hidden = (maps.quality[place] & np.uint8(Quality.OCCLUDED)) != 0
        P[hidden], P_std[hidden] = 0, np.inf
        for target, values in zip(maps, (alpha, alpha_std, P, P_std), strict=False):
            np.copyto(target[place].T, values.T, "same_kind", inside.T)
        out = np.abs(alpha - 0.5) > 0.5 + _SIGMAS_OUT * alpha_std
        kept = Quality.SATURATED | Quality.OCCLUDED | Quality.MISFIT
        flags = maps.quality[place] & np.uint8(kept)
        flags |= (alpha_std > self.max_alpha_std) * np.uint8(Quality.PLATE_IN_MODEL)
        flags |= out * np.uint8(Quality.OUT_OF_RANGE)
        maps.quality[place][inside] = flags[inside]
        return {
            "sum_alpha_std": float(np.sqrt(of_sum)),
            "smooth": {
                "order": prior.order,
                "scale": prior.scale,
                "steps": field.steps,
                "converged": field.converged,
            },
        }

    def _found(self, pixels: Pixels) -> "_Found":
        """Alpha with a border, and what led to it."""
        near = _local(evidence_of(pixels, np.zeros(pixels.inside.shape)))
        together = noise_inflation(pixels, near)
        # Of any colors too little is known: with the whole weight alpha was smooth, sure, and wrong.
        weaker = together if pixels.model.rank < 3 else together**_ANY_COLORS
        if together > 1 and pixels.model.rank == 2:
            pixels = coarsely(pixels)
        # Of a line alpha is known better than the neighborhoods that this takes.
        least = (
            least_alpha(pixels, together) if pixels.model.rank == 2 else np.full_like(near, LEAST)
        )
        own = _bordered(*evidence_of(pixels, near), pixels.inside, least)
        levels = own.weaker(weaker).levels(_CELLS)
        cells = _chosen(levels)
        prior, field = cells[-1]
        finest = len(levels) - len(cells)
        near, variance = (_in_pixels(m, levels[:finest]) for m in (field.x, field.variance))
        renewed, shared = _renewed(pixels, near, variance, weaker, least)
        levels = renewed.levels(_CELLS)
        prior, field = self._in_detail(levels, prior, field, finest, pixels.model, _FINAL_SAMPLES)
        return _Found(pixels, near, together, weaker, levels, cells, prior, field, shared)

    def _with_error(self, found: "_Found") -> tuple[Floats, float]:
        """The variance of each pixel's alpha, with a border, and that of their sum."""
        levels, together, weaker = found.levels, found.together, found.weaker
        field, cells = found.field, 4 ** (len(levels) - 1)
        of_sum = together / weaker * sum_variance(levels[-1], *found.cells[0], cells)
        unsure = found.shared
        if together > 1:
            of_each, of_all = _of_rounding(found)
            unsure, of_sum = unsure + of_each, of_sum + of_all
        # Cells and pixels weigh what is known differently, and neither is sure to be right.
        of_sum += (_total(field) - 4**found.finest * _total(found.cells[-1][1])) ** 2
        lost = (1 - 1 / together) * _fine(field.x)
        variance, off = self._variance(levels, found.prior, field, found.pixels.model)
        return variance * together / weaker + np.pad(unsure, BORDER) + lost, of_sum + off

    def _in_detail(
        self,
        levels: Sequence[Evidence],
        prior: Prior,
        field: Field,
        finest: int,
        model: ColorModel,
        samples: int,
        cells: int = 1,
    ) -> tuple[Prior, Field]:
        """From the smallest cells that told the prior to the first level, of so many pixels each."""
        prior = replace(prior, scale=prior.scale / self.strength)
        for depth in reversed(range(max(finest, 1))):
            level = levels[depth]
            if depth < finest:
                prior, field = prior.finer(), finer(field, level.mask.shape, prior.order)
            told = depth == 0 and level.count < _ENOUGH
            local = told and model.rank < 3
            field = smoothed(level, prior, field, samples * told, cells * 4**depth, local)
        return prior, field

    def _variance(
        self, levels: Sequence[Evidence], prior: Prior, field: Field, model: ColorModel
    ) -> tuple[Floats, float]:
        """Of each pixel's alpha, as though noise took no detail, and of how the sum is off."""
        depth = next(d for d, level in enumerate(levels) if level.count <= _TRIED)

        def settled(drawn: Evidence) -> tuple[Prior, Field]:
            levels = drawn.levels(_CELLS)
            found = _chosen(levels, 4**depth)
            finest = len(levels) - len(found)
            return self._in_detail(levels, *found[-1], finest, model, _SAMPLES, 4**depth)

        if depth > 0:
            prior, field = settled(levels[depth])
        variance, off = simulated_variance(
            levels[depth], prior, field, lambda drawn: settled(drawn)[1].x, 4**depth
        )
        if model.rank == 3:  # what is painted is no noise that could be drawn
            variance = np.maximum(variance, field.variance)
        for level in reversed(levels[:depth]):
            variance = map_in_smaller_cells(variance, level.mask.shape)
        return variance, 16**depth * off


def _chosen(levels: Sequence[Evidence], cells: int = 1) -> list[tuple[Prior, Field]]:
    """The prior of the least risk and its field, from the largest cells to the smallest that tell.

    Those of the first level are of so many pixels each.

    Of pixels it is not asked for, unless there is nothing larger.
    """
    top = len(levels) - 1
    found = [_least_risk(levels[top], _PRIORS, None, cells * 4**top)]
    for depth in range(top - 1, 0, -1):
        level, (prior, field) = levels[depth], found[-1]
        if level.count >= _ENOUGH:
            break
        prior, start = prior.finer(), finer(field, level.mask.shape, prior.order)
        choice = [replace(prior, scale=prior.scale * part) for part in _SMOOTHER]
        found.append(_least_risk(level, choice, start, cells * 4**depth))
    return found


def _in_pixels(values: Floats, levels: Sequence[Evidence]) -> Floats:
    """A map of cells, from level to level down to pixels, without its border."""
    for level in reversed(levels):
        values = map_in_smaller_cells(values, level.mask.shape)
    return _inner(values)


def _before_file(pixels: Pixels, file: Compressed, field: Field) -> Pixels:
    """With the image as it was before its file let colors run together, if this is alpha."""
    alpha = np.asarray(np.clip(_inner(field.x), 0, 1), float)
    own = light_of_colors(pixels.image, pixels.plate, alpha, pixels.model.basis, file.std)
    image = image_before(pixels.image, pixels.plate, alpha, own, file)
    return replace(pixels, image=replace(image, rgb=np.ascontiguousarray(image.rgb)))


def _total(field: Field) -> float:
    return float(field.x.sum(dtype=float))


def _of_rounding(found: _Found) -> tuple[Floats, float]:
    """Variance of each pixel's alpha and of their sum, of what a file rounded alike in neighbors."""
    levels = found.levels
    pulls = rounded_pulls(found.pixels, np.clip(found.near, 0, 1), levels)
    if not pulls:
        return np.zeros_like(found.near), 0.0
    cells, pulls = 4 ** (len(levels) - 1), [p / found.together for p in pulls]
    off = np.stack(changes(levels[-1], *found.cells[0], pulls, cells))
    of_sum = np.mean((cells * off.sum(axis=(1, 2))) ** 2)
    share = 1 - 1 / found.together  # what noise each pixel has of its own spreads over codes
    return share * _in_pixels(np.mean(off**2, axis=0), levels[:-1]), share * float(of_sum)


def _fine(x: Floats) -> Floats:
    """Mean square around each pixel of structure finer than a block: compression takes such."""
    from scipy.ndimage import uniform_filter

    fine = (x - uniform_filter(x, BLOCK)) ** 2
    return np.asarray(uniform_filter(fine, BLOCK).clip(0))  # running sums may round below 0


def _renewed(
    pixels: Pixels, alpha: Floats, variance: Floats, weaker: float, least: Floats
) -> tuple[Evidence, Floats]:
    """What pixels tell, now that it is known what alpha is about, and of what light neighbors are.

    And the variance that neighbors have in common.
    """
    near = np.clip(alpha, 0, 1)
    information, pull = (values / weaker for values in evidence_of(pixels, near))
    shared, told = np.zeros_like(information), Told(pixels, near, variance, weaker)
    if pixels.model.rank == 1:
        information, pull = with_shading(told, information, pull)
    elif pixels.model.rank == 2:
        information, pull, shared = with_mixture(told, information, pull)
    return _bordered(information, pull, pixels.inside, least), shared


def _least_risk(
    evidence: Evidence, priors: Sequence[Prior], start: Field | None, cells: int
) -> tuple[Prior, Field]:
    """The prior of the least risk, and what comes of it; each is begun where the one before ended."""
    found: list[tuple[Prior, Field]] = []
    for _, scales in groupby(priors, lambda prior: prior.order):
        field, risks = start, [np.inf]
        for prior in scales:
            field = smoothed(evidence, prior, field, _SAMPLES, cells)
            found.append((prior, field))
            risks.append(field.risk)
            if min(risks[-2:]) > min(risks):  # twice more than the least: it only grows from there
                break
    return min(found, key=lambda trial: trial[1].risk)


def _local(evidence: tuple[Floats, Floats]) -> Floats:
    """Alpha of neighborhoods."""
    from scipy.ndimage import gaussian_filter

    information, pull = (gaussian_filter(e, _NEIGHBORHOOD) for e in evidence)
    return np.asarray(np.clip(pull / (information + 1e-9), 0, 1))


def _bordered(information: Floats, pull: Floats, inside: Bools, least: Floats) -> Evidence:
    least = np.maximum(least, LEAST).astype(information.dtype)
    information, pull, least = (np.pad(m, BORDER) for m in (information, pull, least))
    return Evidence(information, pull, np.pad(inside, BORDER), least)


def _inner(values: Floats) -> Floats:
    return np.asarray(values[BORDER:-BORDER, BORDER:-BORDER])

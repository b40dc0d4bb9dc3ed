"""fit_match: the simplest homography and light change that the data do not reject.

Between two pictures the tripod is touched, the lamps drift, the camera changes its white balance. The
models of `alignment` are compared by penalized log likelihood: first geometry (identity, shift,
homography) by the fine structure of the pictures, then light (identity, gain per channel, and offset,
and a quadratic field, and bands of rows or columns) by all of it.
"""

import logging
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import scipy

from blurmatte.background.alignment import (
    GEOMETRIES,
    HOMOGRAPHY,
    LIGHTS,
    SHIFT,
    STILL,
    Alignment,
    ComparedPair,
    first_step,
    fit_level,
    gain_score,
    levels,
    log_likelihood_gain,
    log_likelihood_gains,
    residual_and_image_std,
)
from blurmatte.background.match import (
    Bands,
    Match,
    coordinates_across,
    functions_of_bands,
    median_light,
)
from blurmatte.background.registration import MAX_RELATIVE_RESIDUAL
from blurmatte.background.warp import IDENTITY_LIGHT, to_centered
from blurmatte.checks import Array, check_kind, check_same_size
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, check_same_colors
from blurmatte.radiometry.image import VARIANCE_FLOOR, part_of
from blurmatte.statistics import robust_std
from blurmatte.streaks import find_streaks


class Matching(Enum):
    """Which changes of a plate `fit_match` considers.

    NONE: no change. EXPOSURE: light only. SHIFT: shift, gain and offset. FULL: any homography, a
    smooth field of light, and bands. The least of each is always fitted, more only where the data
    require it.

    Examples
    --------
    >>> bm.background.fit_match(image, plate, bm.background.Matching.EXPOSURE)
    Match(light times 1.000, 1.000, 1.000)
    """

    NONE = "none"
    EXPOSURE = "exposure"
    SHIFT = "shift"
    FULL = "full"


# Smallest and largest models, as indices of GEOMETRIES and LIGHTS.
_MODELS = {
    None: ((0, 0), (2, 3)),
    Matching.EXPOSURE: ((0, 1), (0, 3)),
    Matching.SHIFT: ((1, 0), (1, 2)),
    Matching.FULL: ((2, 1), (2, 3)),
}
_GEOMETRY = STILL, SHIFT, HOMOGRAPHY  # models of fine structure


# Selection of the model, and rejection of foreign plates.
_PARAMETER_PENALTY = 20.0  # log likelihood; large, since compression correlates residuals
_MIN_DISPLACEMENT_PX = 0.01  # smaller changes of both this
_MIN_LIGHT_CHANGE = 0.001  # and this, relative, are not applied
_MAX_OFFSET = 0.1  # of the plate's median light: flare
_MAX_GAIN = 4.0  # of the median light, or its inverse: a brighter or darker image is rejected
_MIN_SIDE_PX = 32  # smaller pictures are not matched
_MIN_POINTS = 100
_MAX_RESIDUAL = 0.1  # of the median light: another scene leaves more
_NOISE_OF_BLACK = 0.002  # of white: a black plate has no other residual
_MIN_OVERLAP = 0.5  # fraction of the image that the plate covers


# The search for bands.
_MIN_PERIODS = 0.75  # in the picture; fewer are a smooth field
_MIN_PERIOD_CELLS = 16  # of the level: four of its points
_PERIOD_STEP = 0.25  # of the numbers of periods that are compared
_MAX_HARMONICS = 4
_BAND_PARTS = 12  # of a picture, across the bands


def match_plate(
    plate: LinearImage, image: LinearImage, matching: Matching | None = None
) -> LinearImage:
    """The plate as it would have been at the moment of the image.

    Parameters
    ----------
    plate, image : LinearImage
        The same size.
    matching : Matching, optional
        Changes to consider; selected from the data by default.

    Returns
    -------
    LinearImage
        `plate` itself if it matches already. `fit_match` returns the change.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, or an argument has another type.
    PlateError
        If the plate shows another place or too different a light.

    Examples
    --------
    >>> darker = bm.LinearImage(0.9 * plate.rgb)
    >>> matched = bm.match_plate(darker, image)
    >>> print(f"{np.median(matched.rgb / plate.rgb):.3f}")
    1.000
    """
    return fit_match(image, plate, matching).apply(plate)


def fit_match(image: LinearImage, plate: LinearImage, matching: Matching | None = None) -> Match:
    """Fit the homography and the light that map a plate to an image.

    Geometry is fitted to fine structure, then light to the pictures, both robustly: a moving object may
    cover up to about a third of the picture. If only the object asks for a displacement, as in two
    shots that both show it before a wall, the camera was at rest.

    Parameters
    ----------
    image, plate : LinearImage
        The same size.
    matching : Matching, optional
        Changes to consider; selected from the data by default.

    Returns
    -------
    Match

    Raises
    ------
    ValueError
        If the sizes differ.
    PlateError
        If the plate shows another place or too different a light, or is of another camera.

    Examples
    --------
    >>> match = bm.background.fit_match(image, plate)
    >>> print(match)
    Match(plate as it is)
    """
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    check_kind("matching", matching, Matching | None, "such as blurmatte.background.Matching.NONE")
    if matching is Matching.NONE or min(image.size) < _MIN_SIDE_PX:
        return Match.nothing(image.size)
    logging.getLogger("blurmatte").info("matching the plate")
    light, structure = next(levels(image, plate)), levels(image, plate, structure=True)
    sharp = next(structure)
    if len(light.xy) < _MIN_POINTS:
        return Match.nothing(image.size)
    if matching is None and _matches(sharp, light, plate):
        return Match.nothing(image.size)
    smallest, largest = _MODELS[matching]
    geometry = _select_geometry(sharp, list(structure), smallest[0], largest[0])
    select = _LightSelection(geometry.h, smallest[1], largest[1], _MAX_OFFSET * median_light(plate))
    best, bands = _select_light(light, select)
    if geometry.model[0] > smallest[0] == 0 and _may_have_bands(light):
        # Bands in both pictures are fine structure too, and look like a displacement.
        still, others = _select_light(light, replace(select, h=np.zeros(8)))
        price = _penalty(geometry.model) - _penalty(STILL)
        if others is not None and log_likelihood_gain(still, best) <= price:
            geometry = fit_level(sharp, sharp.identity, STILL)
            best, bands = still, others
    match = replace(_match_of(geometry, best, image.size), bands=bands)
    _check_same_scene(match, best, plate)
    return _of_camera(match, image, plate) if matching is None else match


def _of_camera(match: Match, image: LinearImage, plate: LinearImage) -> Match:
    """A match without what is negligible, or asked for by the object alone."""
    if _is_negligible(match, plate):
        return Match.nothing(image.size)
    # Shots that show the object before a wall agree everywhere once it is displaced upon itself.
    if match.moves and not find_streaks(image, match.apply(plate)):
        return match_at_rest(image, plate) or match
    return match


def match_at_rest(image: LinearImage, plate: LinearImage) -> Match | None:
    """The match of a camera at rest; None if more than what moved then asks for a displacement."""
    try:
        match = fit_match(image, plate, Matching.EXPOSURE)
    except PlateError:  # the pictures differ everywhere
        return None
    moved = [streak.mask for streak in find_streaks(image, match.apply(plate))]
    rest = np.logical_and.reduce([plate.valid, *(~mask for mask in moved)])
    sharp, *coarse = levels(image, replace(plate, valid=rest), structure=True)
    if len(sharp.xy) < _MIN_POINTS or _select_geometry(sharp, coarse, 0, 2).model[0] > 0:
        return None
    return match


def _is_negligible(match: Match, plate: LinearImage) -> bool:
    return match.reach <= _MIN_DISPLACEMENT_PX and match.light_change(plate) <= _MIN_LIGHT_CHANGE


def _matches(sharp: ComparedPair, light: ComparedPair, plate: LinearImage) -> bool:
    """Whether first steps from the identity gain too little, or change too little, and no bands do."""
    steps = first_step(sharp, HOMOGRAPHY), first_step(light, (0, len(LIGHTS) - 1))
    gained = max(gain for _, gain in steps)
    change = replace(Match.nothing(light.size), h=steps[0][0].h, light=steps[1][0].light)
    if gained > _penalty(SHIFT) - _penalty(STILL) and not _is_negligible(change, plate):
        return False
    return not _may_have_bands(light)


def _may_have_bands(light: ComparedPair) -> bool:
    gain, *_ = _strongest_bands(light.identity)
    return gain > _penalty_of_bands(1)


def _select_geometry(
    fine: ComparedPair, coarse: list[ComparedPair], smallest: int, largest: int
) -> Alignment:
    """Forward selection by penalized likelihood of fine structure, from the smallest geometry."""
    models = _GEOMETRY[smallest : largest + 1]
    best = fit_level(fine, fine.identity, models[0])
    least = _penalty(SHIFT) - _penalty(STILL)
    if largest == 0 or (smallest == 0 and first_step(fine, HOMOGRAPHY)[1] <= least):
        return best
    rough = coarse[-1].identity if coarse else fine.identity
    for level in reversed(coarse):
        for model in _GEOMETRY[1 : largest + 1]:
            rough = fit_level(level, rough, model)
    for model in models:
        h = rough.h * np.isin(np.arange(8), GEOMETRIES[model[0]])
        # What is coarse may be a shadow: the fit from no displacement competes.
        for start in (np.zeros(8), h):
            fit = fit_level(fine, replace(fine.identity, h=start), model)
            if log_likelihood_gain(best, fit) > _penalty(fit.model) - _penalty(best.model):
                best = fit
    return best


@dataclass(frozen=True, eq=False)
class _LightSelection:
    """Forward selection of the light of a plate by penalized likelihood, from the smallest model.

    Fits with a large offset are rejected: on a plain plate a small gain and a large offset would remove
    the plate's noise.
    """

    h: Array  # (8,) of the geometry, which is known
    smallest: int
    largest: int
    max_offset: Array  # (3,) light

    def fit(self, level: ComparedPair, light: int) -> Alignment:
        """Fit of a member of LIGHTS."""
        return fit_level(level, replace(level.identity, h=self.h), (0, light))

    def best(self, level: ComparedPair) -> Alignment:
        """The fit of the likeliest light."""
        best, larger = self.fit(level, self.smallest), range(self.smallest + 1, self.largest + 1)
        fits = [self.fit(level, light) for light in larger]
        fits = [fit for fit in fits if np.all(np.abs(fit.light[1]) <= self.max_offset)]
        while fits:
            gains = [
                log_likelihood_gain(best, fit) - _penalty(fit.model) + _penalty(best.model)
                for fit in fits
            ]
            if max(gains) <= 0:
                break
            best = fits[int(np.argmax(gains))]
            fits = [fit for fit in fits if fit.model > best.model]
        return best


def _select_light(level: ComparedPair, select: _LightSelection) -> tuple[Alignment, Bands | None]:
    """The best fit without bands, or the best one with bands and these, if they are likelier.

    A quadratic field is permitted wherever bands are. With one harmonic the light is selected again:
    bands that are not in the model look like a field. Further harmonics are added as long as they gain.
    """
    plain = select.best(level)
    if select.largest < len(LIGHTS) - 1:
        return plain, None
    found = [_strongest_bands(start) for start in (select.fit(level, 1), plain)]
    expected, axis, frequency = max(found)
    if expected <= _penalty_of_bands(1):
        return plain, None
    start = plain if found[1] > found[0] else select.fit(level, 1)
    place = axis, _refined(level, start, axis, frequency)
    best = select.best(_with_bands(level, *place, 1))
    gained = _gain_of_bands(level, plain, best, axis) + _penalty(plain.model) - _penalty(best.model)
    if gained <= _penalty_of_bands(1):
        return plain, None
    for harmonics in range(2, _MAX_HARMONICS + 1):
        fit = _fit_bands(level, best, *place, harmonics)
        more = _penalty_of_bands(harmonics) - _penalty_of_bands(harmonics - 1)
        if log_likelihood_gain(best, fit) <= more:
            break
        best = fit
    return best, _bands_of(best, *place)


def _penalty_of_bands(harmonics: int) -> float:
    """Of the coefficients, and of the frequency."""
    return _PARAMETER_PENALTY * (6 * harmonics + 1)


def _penalty(model: tuple[int, int]) -> float:
    parameters = len(GEOMETRIES[model[0]]) + 3 * len(LIGHTS[model[1]])
    return _PARAMETER_PENALTY * parameters


def _bands_of(fit: Alignment, axis: int, frequency: float) -> Bands:
    """The bands of a fit on a level with bands."""
    coefficients = fit.light[len(IDENTITY_LIGHT) :]
    per_channel, many = len(fit.rows), len(coefficients)
    covariance = fit.covariance()
    ends = [len(covariance) - k * per_channel for k in (2, 1, 0)]
    blocks = [covariance[end - many : end, end - many : end] for end in ends]
    return Bands(axis, frequency, coefficients, np.stack(blocks))


def _with_bands(level: ComparedPair, axis: int, frequency: float, harmonics: int) -> ComparedPair:
    """A level without bands, and the functions of bands."""
    functions = functions_of_bands(level.basis[:, 2 - axis], frequency, harmonics)
    return replace(level, basis=np.concatenate([level.basis, functions], axis=1))


def _strongest_bands(fit: Alignment) -> tuple[float, int, float]:
    """The most likely bands of one harmonic: log likelihood that they gain, axis, and frequency.

    The gain is that of one step from `fit`, which is without bands, in most parts of the picture.
    """
    level, found, parts = fit.level, (-np.inf, 0, 1.0), np.zeros(_BAND_PARTS)
    scores = gain_score(fit)
    for axis in (0, 1):
        place = level.xy[:, 1 - axis]
        S, A = (np.stack([np.bincount(place, x[:, c]) for c in range(3)]) for x in scores)
        t = coordinates_across(level.size, axis)[: S.shape[1]]
        part = np.arange(len(t)) * _BAND_PARTS // level.size[1 - axis]
        for frequency in _frequencies(level, axis):
            X = np.column_stack([np.ones(len(t)), functions_of_bands(t, frequency, 1)])
            normal = np.einsum("ni,cn,nj->cij", X, A, X) + 1e-9 * np.eye(3)
            step = np.linalg.solve(normal, (S @ X)[..., None])[..., 0] @ X.T
            step -= (S.sum(axis=1) / normal[:, 0, 0])[:, None]  # beyond a mean alone
            gains = np.sum(S * step - A * step**2 / 2, axis=0)
            if gains.sum() > found[0]:
                found = float(gains.sum()), axis, float(frequency)
                parts = np.asarray(np.bincount(part, gains, _BAND_PARTS), float)
    return _of_most(parts), *found[1:]


def _of_most(gains: Array) -> float:
    """Sum of the gains of parts across the bands, if each gained as much as the median one.

    A streak changes some of them, bands change most.
    """
    return float(len(gains) * np.median(gains))


def _frequencies(level: ComparedPair, axis: int) -> Array:
    """ω of all numbers of periods."""
    cells = level.size[1 - axis]
    numbers = np.arange(_MIN_PERIODS, cells / _MIN_PERIOD_CELLS, _PERIOD_STEP)
    return np.asarray(2 * np.pi * numbers / (cells * to_centered(level.size)[0, 0]))


def _refined(level: ComparedPair, start: Alignment, axis: int, frequency: float) -> float:
    """The most likely frequency of one harmonic near another; level and start are without bands."""
    reach = _PERIOD_STEP / _MIN_PERIODS * _frequencies(level, axis)[0]
    rough = _fit_bands(level, start, axis, frequency, 1)

    def cost(omega: float) -> float:
        """Log likelihood at the rough frequency over that at another."""
        fit = _fit_bands(level, rough, axis, omega, 1)
        return float(log_likelihood_gains(fit, rough).sum())

    bounds = frequency - reach, frequency + reach
    found = scipy.optimize.minimize_scalar(
        cost, bounds=bounds, method="bounded", options={"xatol": 0.01 * reach}
    )
    return float(found.x)


def _fit_bands(
    level: ComparedPair, start: Alignment, axis: int, frequency: float, harmonics: int
) -> Alignment:
    """Fit of gain, bands and what else is free in the model of `start`, which may have fewer bands."""
    banded = _with_bands(level, axis, frequency, harmonics)
    light = banded.identity.light
    light[: len(start.light)] = start.light
    first = replace(banded.identity, h=start.h, light=light)
    return fit_level(banded, first, (start.model[0], max(start.model[1], 1)))


def _gain_of_bands(level: ComparedPair, before: Alignment, after: Alignment, axis: int) -> float:
    """Log likelihood gained by bands in most parts of the picture."""
    part = level.xy[:, 1 - axis] * _BAND_PARTS // level.size[1 - axis]
    return _of_most(
        np.bincount(part, log_likelihood_gains(before, after), _BAND_PARTS).astype(float)
    )


def _match_of(geometry: Alignment, light: Alignment, size: tuple[int, int]) -> Match:
    h_std, light_std = np.zeros(8), np.zeros((7, 3))
    free, rows = list(GEOMETRIES[geometry.model[0]]), list(LIGHTS[light.model[1]])
    h_std[free] = np.sqrt(np.diag(geometry.covariance()))[: len(free)]
    std = np.sqrt(np.diag(light.covariance()))
    light_std[rows] = std.reshape(3, len(light.rows)).T[: len(rows)]
    return Match(size, geometry.h, light.light[: len(light_std)], h_std, light_std)


def _check_same_scene(match: Match, fit: Alignment, plate: LinearImage) -> None:
    """Raise PlateError if the plate shows another scene, place or light."""
    residual, image_std = residual_and_image_std(fit)
    light = median_light(plate)
    x, y = match.shift
    if residual > max(
        MAX_RELATIVE_RESIDUAL * image_std,
        _MAX_RESIDUAL * float(light.mean()),
        _NOISE_OF_BLACK,
    ):
        raise PlateError(
            "image and plate do not show the same scene from the same place: after the best match "
            f"(shift {x:+.0f}, {y:+.0f} pixels) they differ by {residual:.2f} of white; take both from "
            "a tripod, one right after the other"
        )
    overlap = float(np.mean(np.isfinite(fit.residuals)))
    if overlap < _MIN_OVERLAP:
        raise PlateError(
            f"the camera moved: the plate is shifted by {x:+.0f}, {y:+.0f} pixels against the image "
            f"and shows only {overlap:.0%} of it; take both from a tripod"
        )
    if min(light) < _NOISE_OF_BLACK:
        return
    brighter = match.light[0] + match.light[1] / light
    if min(brighter) < 1 / _MAX_GAIN or max(brighter) > _MAX_GAIN:
        factors = ", ".join(f"{g:.2f}" for g in brighter)
        raise PlateError(
            f"the light changed too much: the image is {factors} times as bright as the plate "
            "(R, G, B); expose both alike"
        )


def agreement(image: LinearImage, plate: LinearImage) -> tuple[float, float]:
    """Robust standard deviation of image − plate over its noise: everywhere, and at the plate's edges.

    1 if only noise differs, less for rounded or compressed noise. Moving objects are trimmed. Edges are
    the tenth of the pixels with the largest gradient. The pictures have one size and known noise.
    """
    rows = slice(None, None, max(1, round(image.valid.size / 2.5e5)))  # enough pixels
    image, plate = (part_of(picture, rows) for picture in (image, plate))
    d = np.asarray(image.rgb - plate.rgb, float)
    variance = image.variance + plate.variance
    use = image.valid & plate.valid
    if not use.any():
        return float("nan"), float("nan")
    z = d / np.sqrt(np.maximum(variance, VARIANCE_FLOOR))
    energy = sum(np.sum(np.gradient(plate.rgb, axis=axis) ** 2, axis=-1) for axis in (0, 1))
    edges = use & (energy >= np.quantile(energy[use], 0.9))
    return _trimmed_std(z[use]), _trimmed_std(z[edges])


def _trimmed_std(z: Array) -> float:
    """Standard deviation within three of it, corrected for the trimming of a normal distribution.

    A median alone moves in steps where code values do.
    """
    limit = 3 * robust_std(z) + 1e-9
    within = np.abs(z) <= limit
    variance = float(np.mean(z[within] ** 2)) / 0.9733  # of a standard normal within three
    return float(np.sqrt(variance))

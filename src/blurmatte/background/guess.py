"""guess_plate: the scene behind an object, from the surroundings of a region of one picture.

The light of the scene is a Gaussian random field, along each principal axis of the colors around the
region a sum of four: straight lines that cross the region, a plane (universal kriging), a smooth part
with a Matérn covariance, and texture with a spectrum of its own. Lines are continued where both sides
of the region show them. The smooth part is known at cells of several pixels; its order, length and
amplitude have the weight of their restricted likelihood around the region. The texture is what the
surroundings leave; behind the object it is not predicted. Few cells allow any covariance, as a dense
matrix; `sweep.model.color_field` has a banded inverse of it, to be fitted at each step of a search.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product, repeat
from typing import NamedTuple

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from blurmatte.background.lines import Lines
from blurmatte.calibration import measure_noise_within, with_noise
from blurmatte.checks import (
    Array,
    Bools,
    Box,
    Floats,
    box_of,
    check_map,
    check_same_size,
    rows_columns,
)
from blurmatte.errors import NoiseError, PlateError
from blurmatte.radiometry import (
    GuessError,
    LinearImage,
    Noise,
    NoiseModel,
    are_gray,
    check_picture,
    rounding_noise,
)
from blurmatte.statistics import (
    CORRELATED_PX,
    QUANTILE_999_1,
    QUANTILE_999_3,
    block_sums,
    seen_means,
)
from blurmatte.streaks.streak import cells_to_pixels

_SEED = 1
_DRAWS = 4  # of the field: with the mean they give its error in whatever is computed from it
_MAX_CELLS = 196  # around the region: the time of a fit increases with its cube
_MIN_CELLS = 24  # around the region, from which a covariance can be estimated
_MIN_RING_PX = 16  # width of the surroundings; else half that of the region
_ORDERS = 0.5, 1.5, 2.5  # of the Matérn covariance: rough to smooth
_LENGTHS = 7  # of the covariance, from one cell to twice the surroundings
_NUGGETS = np.geomspace(1e-4, 1e4, 13)  # variance of cells that is not smooth, over that which is
_REFINEMENTS = 2  # of what is hidden: a part of the region agrees with the guess
_MAX_REMAINING = 0.9  # of what was hidden: else the guess would hardly change
_DECISIVE_ODDS = 20.0  # that a cell shows the scene
# Around a streak, or what disagrees with a guess, which is not made from its faintest rim.
RIM_PX = 4
# Margin over the width in which a disc's alpha falls from the threshold to zero.
_MARGIN_FACTOR = 1.5
_MAX_GRAINS = 250_000  # of a window: cells of texture that is drawn
_TILE_PX = 16  # width of tiles in which noise is measured
_LEVELS = 4  # of light, and of how even tiles are
# Least part of the variance of a channel that others do not predict; it is more in demosaicked noise
_MAX_OWN_OF_TEXTURE = 0.25
_COVARIANCES = 12  # of each axis, that are averaged
_MIN_VARIANCE = 1e-12  # light²: of 32-bit floats
# Standard deviation of a smooth guess over its light, a third of what a soft shadow takes
_MAX_SMOOTH_ERROR = 0.1


@dataclass(frozen=True, eq=False)
class PlateGuess(LinearImage):
    """A plate that was not photographed.

    Parameters
    ----------
    hidden : (H, W) bool
        Where it is a guess; elsewhere it is the image.
    draws : tuple of (h, w, 3) float
        Other scenes that agree with the surroundings as well, in the bounding box of `hidden`. Errors
        of neighboring pixels are correlated: what is computed from the plate is computed from each of
        them, and its error is their scatter about that of the plate.
    texture : (h, w, 3) float
        A draw of what the surroundings show but the plate does not predict, in that box.
    image_noise : Noise
        Noise of the image that it was made of.
    errors : GuessError, optional
        Covariance of the channels where it is a guess; None of gray pictures, which have one, and
        of bursts.
    region : (H, W) bool, optional
        Where the object may have been, as it was marked; what is hidden if not given.

    Examples
    --------
    >>> region = np.zeros((72, 128), bool)
    >>> region[24:40, 50:70] = True
    >>> guess = bm.background.guess_plate(image, region)
    >>> print(f"{guess.error:.3f} of white")
    0.050 of white
    """

    hidden: Bools = None  # type: ignore[assignment]
    draws: tuple[Floats, ...] = ()
    texture: Floats = None  # type: ignore[assignment]
    image_noise: Noise = None  # type: ignore[assignment]
    errors: GuessError | None = None
    region: Bools = None  # type: ignore[assignment]
    is_guess = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("hidden", "region"):
            given = getattr(self, name)
            mask = self.hidden if given is None else given
            object.__setattr__(self, name, check_map(name, mask, self.rgb.shape[:2], kinds="b"))

    @property
    def plates(self) -> list[LinearImage]:
        """The plate, then each of the draws, as pictures of which nothing is a guess."""
        meta = replace(self.meta, guess_error=self.errors if self.is_rough else None)
        first = LinearImage(self.rgb, self.noise, self.valid, meta)
        place, found = rows_columns(box_of(self.hidden)), [first]
        for draw in self.draws:
            rgb = self.rgb.copy()
            rgb[place] = np.where(self.hidden[place][..., None], draw, rgb[place])
            found.append(replace(first, rgb=rgb))
        return found

    @property
    def with_grain(self) -> LinearImage:
        """The plate with texture and noise, as the image shows them: for the eye.

        The plate itself is a mean, smoother than any scene.
        """
        rng, std = np.random.default_rng(_SEED), np.sqrt(self.image_noise.variance(self.rgb))
        grain = rng.normal(0, 1, std.shape) * std
        grain[rows_columns(box_of(self.hidden))] += self.texture
        rgb = self.rgb + np.where(self.hidden[..., None], grain, 0)
        return replace(self.plates[0], rgb=np.asarray(rgb, self.rgb.dtype))

    @property
    def surroundings(self) -> Box:
        """What is hidden, with the scene around it that it was guessed from."""
        return _window(self.hidden)[0]

    def around_hidden(self, box: Box) -> "PlateGuess":
        """The part in a box that contains what is hidden."""
        part, place = self.crop(box), rows_columns(box)
        return replace(self, **vars(part), hidden=self.hidden[place], region=self.region[place])

    @property
    def error(self) -> float:
        """Root mean square of the standard deviation of the light that is a guess; white is 1."""
        return float(np.sqrt(np.asarray(self.variance)[self.hidden].mean()))

    @property
    def is_rough(self) -> bool:
        """Whether its error is as large as the change of light by a soft shadow."""
        return self.error > _MAX_SMOOTH_ERROR * float(self.rgb[self.hidden].mean())


def guess_plate(image: LinearImage, region: Bools) -> PlateGuess:
    """Guess the scene behind an object from its surroundings, where there is no photograph of it.

    Parameters
    ----------
    image : LinearImage
        The picture with the object. Unknown noise is measured around the region.
    region : (H, W) bool
        Where the object may have been. Around it the scene must be seen: about as wide as the region.

    Returns
    -------
    PlateGuess
        The image with the mean of a random field in the region. Its noise contains the variance of the
        field; `solve` takes the correlation of its errors from the draws.

    Raises
    ------
    TypeError, ValueError
        If the region is no such array, or empty.
    PlateError
        If too little of the scene is seen around the region.

    Examples
    --------
    >>> region = np.zeros((72, 128), bool)
    >>> region[24:40, 50:70] = True
    >>> guess = bm.background.guess_plate(image, region)
    >>> guess.size, int(guess.hidden.sum())
    ((128, 72), 320)
    """
    check_picture("image", image)
    region = check_map("region", region, image.valid.shape, kinds="b")
    if not region.any():
        raise ValueError("the region is empty; mark where the object may have been")
    if not (image.valid & ~region).any():
        raise _too_little()
    noise = noise_around(image, region)
    image = image if image.noise is not None else image.with_noise(noise)
    hidden = region
    with threadpool_limits(1):  # the matrices are small: threads wait longer than they work
        for _ in range(_REFINEMENTS):
            smaller = _AroundRegion.around(image, hidden).covered(image, hidden)
            if np.count_nonzero(smaller) > _MAX_REMAINING * np.count_nonzero(hidden):
                break
            hidden = smaller
        guess = _AroundRegion.around(image, hidden, _DRAWS).guess(image, hidden, noise)
    return replace(guess, region=region)


def guess_behind(image: LinearImage, streak: Bools, grow: int = 0) -> PlateGuess:
    """Guess the scene behind a streak (H, W) bool of a solved picture.

    The guess is not made from the faintest rim of the streak, nor from `grow` pixels more around it.

    Raises
    ------
    ValueError
        If the sizes differ.
    PlateError
        If the streak is empty, or too little of the scene is seen around it.
    """
    check_same_size("the layer", streak.shape[::-1], "the image", image.size)
    if not streak.any():
        raise PlateError("the layer is empty, so there is nothing to guess behind it")
    width = 2 * (grow + RIM_PX) + 1
    return guess_plate(image, scipy.ndimage.maximum_filter(streak, width))


def with_noise_of_guess(image: LinearImage, plate: LinearImage) -> tuple[LinearImage, LinearImage]:
    """Image and plate with known noise, as `with_noise`; of a `PlateGuess` the plate, no guess.

    Around what a guess hides, it is the image: their difference shows no noise.
    """
    if isinstance(plate, PlateGuess):
        image = image if image.noise is not None else image.with_noise(plate.image_noise)
        plate = plate.plates[0]
    return with_noise(image, plate)


def _too_little() -> PlateError:
    return PlateError(
        "too little of the scene is seen around the region to guess what it hides; mark a smaller "
        "region, or photograph the scene without the object (--plate FILE)"
    )


def noise_around(image: LinearImage, region: Bools) -> Noise:
    """Noise of the image where the scene is seen, at least that of rounding.

    The finest texture, such as grass, is everywhere in its surroundings. If it has one hue, channels
    share it, which they do not share noise.
    """
    if isinstance(image.noise, Noise):
        return image.noise
    least, even = rounding_noise(image), _even(image, ~region & image.valid)
    try:
        found = measure_noise_within(image, even).noise
    except NoiseError:
        return least
    own = _own_fraction(image, even)[:, None]
    return NoiseModel.from_coefficients(np.maximum(own * found.coefficients, least.coefficients))


def _own_fraction(image: LinearImage, use: Bools) -> Array:
    """(3,) parts of the variance of the finest light that the other channels do not predict.

    They are 1 where demosaicking may have made noise common, or a file its chroma coarser.
    """
    if image.meta.subsampled or image.meta.compression is not None or are_gray(image, image):
        return np.ones(3)
    light = np.asarray(image.rgb, float)
    finest = light - scipy.ndimage.uniform_filter(light, (3, 3, 1))
    covariance = np.cov(finest[use].T)
    own = 1 / np.maximum(
        np.diag(np.linalg.pinv(covariance, hermitian=True)) * np.diag(covariance), 1
    )
    return own if own.min() < _MAX_OWN_OF_TEXTURE else np.ones(3)


def _even(image: LinearImage, seen: Bools) -> Bools:
    """(H, W) the least structured tiles of all levels of light: the others hold more than noise."""
    light = image.rgb.mean(axis=-1)
    fine = (light - scipy.ndimage.uniform_filter(light, 3)) ** 2
    count = block_sums(seen.astype(float), _TILE_PX)
    whole = count == _TILE_PX**2
    level, rough = (block_sums(np.where(seen, a, 0), _TILE_PX)[whole] for a in (light, fine))
    even = np.zeros(len(level), bool)
    for part in np.array_split(np.argsort(level), _LEVELS):
        even[part[np.argsort(rough[part])[: max(len(part) // _LEVELS, 1)]]] = True
    tiles = np.zeros(whole.shape, bool)
    tiles[whole] = even
    return cells_to_pixels(tiles, _TILE_PX, seen.shape) if even.any() else seen


class _Covariance(NamedTuple):
    """Of the smooth part along one axis, in units of its amplitude, and how likely it is."""

    order: float
    length: float
    nugget: float
    amplitude: float
    log_likelihood: float


@dataclass(frozen=True, eq=False)
class _AroundRegion:
    """The random field around a region: cells in a window, and what was fitted to them."""

    window: Box
    cell: int
    mean: Array  # (rows, columns, 3) of the cells
    std: Array  # (rows, columns, 3)
    drawn: list[Array]  # each (rows, columns, 3): differences from the mean
    axes: Array  # (3, 3) columns
    lines: Lines  # in light along the axes
    texture: Array  # (3,) variance of a pixel along the axes
    grain: int  # width of the cells whose autocovariance is known, pixels
    autocovariance: Array  # (h, w, 3) of their means, at all lags, wrapped

    @classmethod
    def around(cls, image: LinearImage, hidden: Bools, draws: int = 0) -> "_AroundRegion":
        """Of the surroundings of what is hidden, with draws; the noise of the image is known."""
        window, cell = _window(hidden)
        place, image = rows_columns(window), image.crop(window)
        light, seen = np.asarray(image.rgb, float), image.valid & ~hidden[place]
        count = block_sums(seen.astype(float), cell)
        known = count > cell**2 / 2
        if np.count_nonzero(known) < _MIN_CELLS or min(np.ptp(np.argwhere(known), axis=0)) == 0:
            raise _too_little()
        axes = np.linalg.eigh(np.cov(light[seen].T))[1]
        light = light @ axes
        cells = _Cells(seen, known, cell)
        # Cubic interpolation needs two cells around what is hidden.
        unseen = block_sums((~seen).astype(float), cell) > 0
        wanted = scipy.ndimage.binary_dilation(unseen, np.ones((5, 5)))
        kriging = _Kriging.of(known, wanted)
        lines = _likeliest_lines(light, hidden[place], cells, kriging)
        light = light - lines.mean
        mean, std, drawn = kriging.smooth_part(cells.means(light), draws)
        rest = light - _interpolated(mean, light.shape[:2], cell)
        rest = np.where(seen[..., None], rest, 0)
        noise = _noise_along(axes, image, seen)
        texture = np.maximum((rest**2).sum(axis=(0, 1)) / np.count_nonzero(seen) - noise, 0)
        grain = int(np.ceil(np.sqrt(seen.size / _MAX_GRAINS)))
        means, own = seen_means(rest, seen, grain)
        whole = own > grain**2 / 2
        autocovariance = _autocovariance(means * whole[..., None], whole)
        autocovariance[0, 0] = np.maximum(autocovariance[0, 0] - noise / grain**2, 0)
        return cls(window, cell, mean, std, drawn, axes, lines, texture, grain, autocovariance)

    def covered(self, image: LinearImage, hidden: Bools) -> Bools:
        """What of the hidden is near cells that may not show the scene: the object may be there.

        A cell shows the scene if its light is decisively likelier as that of the guess than as any
        light of the region. Where a guess is hardly better than that, agreement says nothing. Pixels
        that are not valid show nothing.
        """
        place, part = rows_columns(self.window), image.crop(self.window)
        light, inside = np.asarray(part.rgb, float), hidden[place] & part.valid
        d, count = seen_means(light @ self.axes - self.lines.mean, inside, self.cell)
        d, inner = d - self.mean, count > self.cell**2 / 2
        if not inner.any():
            return hidden
        noise, threshold = _noise_along(self.axes, part, inside), least_difference(part)
        variance = self.std**2 + self.texture + noise / self.cell**2
        any_light = np.maximum((d[inner] ** 2).mean(axis=0), variance)
        log_odds = np.log(any_light / variance) + d**2 / any_light - d**2 / variance
        may_differ = inner & (0.5 * log_odds.sum(axis=-1) < np.log(_DECISIVE_ODDS))
        z2 = (d**2 / variance).sum(axis=-1)
        differs = (z2 > threshold) & inner
        if not differs.any():
            return hidden
        pixels = inside & cells_to_pixels(differs | may_differ, self.cell, inside.shape)
        margin = faint_rim(z2[differs] / threshold, np.pad(pixels, 1))
        near = np.zeros(hidden.shape, bool)
        near[place] = scipy.ndimage.distance_transform_edt(~pixels) <= margin
        return hidden & (near | ~image.valid)

    def guess(self, image: LinearImage, hidden: Bools, noise: Noise) -> PlateGuess:
        """The plate with what is hidden taken from the field."""
        box, shape = box_of(hidden), hidden[rows_columns(self.window)].shape
        place, inner = rows_columns(box), rows_columns(box, self.window)
        inside = hidden[place][..., None]
        rgb, variance = image.rgb.copy(), np.array(image.variance)

        def in_pixels(cells: Array) -> Array:
            """Values of cells in the pixels of the box."""
            return _interpolated(cells, shape, self.cell)[inner]

        mean = (in_pixels(self.mean) + self.lines.mean[inner]) @ self.axes.T
        rgb[place] = np.where(inside, mean, rgb[place])
        own = in_pixels(self.std) ** 2 + self.texture + self.lines.variance[inner]
        variance[place] = np.where(inside, own @ (self.axes.T**2) + _MIN_VARIANCE, variance[place])
        rng = np.random.default_rng(_SEED)
        draws = []
        for one in self.drawn:
            fine = self._textured(rng, inner) + self.lines.drawn(rng)[inner]
            draws.append((mean + (in_pixels(one) + fine) @ self.axes.T).astype(rgb.dtype))
        meta = replace(image.meta.of_no_file, source="plate guessed from the surroundings")
        texture = (self._textured(rng, inner) @ self.axes.T).astype(rgb.dtype)
        valid = image.valid | hidden
        of_pixels = own[hidden[place]].mean(axis=0) + _MIN_VARIANCE
        of_sums = np.maximum(self._power(max(CORRELATED_PX)), of_pixels)
        errors = None
        if not are_gray(image, image):
            errors = GuessError(*(self.axes * one @ self.axes.T for one in (of_pixels, of_sums)))
        return PlateGuess(rgb, variance, valid, meta, hidden, tuple(draws), texture, noise, errors)

    def _power(self, width: int) -> Array:
        """(3,) variance of sums of errors over squares of a width, pixels, over their area.

        It is that of a pixel if errors are independent. The smooth part is the same in a square.
        """
        cells = max(round(width / self.grain), 1)
        h, w = self.autocovariance.shape[:2]
        rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in (h, w))
        y, x = (np.maximum(1 - lag / cells, 0) for lag in (rows, columns))
        of_texture = np.einsum("y,x,yxc->c", y, x, self.autocovariance) * self.grain**2
        of_texture = np.maximum(of_texture, self.texture)
        seen = self.std.any(axis=-1)
        smooth = (self.std[seen] ** 2).mean(axis=0) if seen.any() else np.zeros(3)
        return np.asarray(of_texture + smooth * width**2)

    def _textured(self, rng: np.random.Generator, place: tuple[slice, slice]) -> Array:
        """(h, w, 3) a draw of the texture along the axes, at some rows and columns of the window."""
        power = np.maximum(scipy.fft.fft2(self.autocovariance, axes=(0, 1)).real, 0)
        # Negative power is noise of the estimate; the variance stays what it is.
        total, variance = power.mean(axis=(0, 1)), self.autocovariance[0, 0]
        power *= np.where(total > 0, variance / np.where(total > 0, total, 1), 0)
        white = scipy.fft.fft2(rng.standard_normal(power.shape), axes=(0, 1))
        drawn = scipy.fft.ifft2(np.sqrt(power) * white, axes=(0, 1)).real
        rows, columns = (np.arange(one.start, one.stop) // self.grain for one in place)
        return np.asarray(drawn[rows][:, columns])


def least_difference(picture: LinearImage) -> float:
    """Squared difference over its variance, summed over the axes of color, that is no noise.

    Gray pictures differ along one axis.
    """
    return QUANTILE_999_1 if are_gray(picture, picture) else QUANTILE_999_3


def channels_share_noise(picture: LinearImage) -> bool:
    """Whether a picture is gray, and its noise does not yet count once (`Meta.one_channel`)."""
    return are_gray(picture, picture) and not picture.meta.one_channel


def _noise_along(axes: Array, picture: LinearImage, where: Bools) -> Array:
    """(3,) mean variance of the noise along axes of color, the columns of (3, 3)."""
    variance = np.asarray(picture.variance, float)[where].mean(axis=0)
    if channels_share_noise(picture):
        return np.asarray((np.sqrt(variance) @ axes) ** 2 + _MIN_VARIANCE)
    return np.asarray(variance @ axes**2)


def faint_rim(z2: Array, differs: Bools) -> float:
    """Width of the rim of what disagrees with a guess, in which it does not do so significantly.

    z2 (n,): squared disagreement over the least that is significant, where it is.
    differs (H, W): the pixels there.

    Alpha of a disc on a path longer than itself falls to zero over its width. A part of it is below the
    threshold: that of the threshold over the largest disagreement.
    """
    part = np.sqrt(1 / np.quantile(z2, 0.95))
    half_width = float(scipy.ndimage.distance_transform_edt(differs).max())
    return float(RIM_PX + _MARGIN_FACTOR * part * 2 * half_width)


def _window(hidden: Bools) -> tuple[Box, int]:
    """The box of what is hidden with its surroundings, whole cells, and the width of a cell."""
    x0, y0, x1, y1 = box_of(hidden)
    deep = scipy.ndimage.distance_transform_edt(np.pad(hidden[y0:y1, x0:x1], 1))
    ring = max(_MIN_RING_PX, int(np.ceil(deep.max())))
    height, width = hidden.shape
    rows, columns = (
        (max(first - ring, 0), min(last + ring, size))
        for first, last, size in ((y0, y1, height), (x0, x1, width))
    )
    seen = np.count_nonzero(~hidden[slice(*rows), slice(*columns)])
    cell = max(2, int(np.ceil(np.sqrt(seen / _MAX_CELLS))))
    for wider in range(cell, 2 * cell + 1):
        down = _whole_cells(rows, (y0, y1), wider)
        right = _whole_cells(columns, (x0, x1), wider)
        if down is not None and right is not None:
            return (right[0], down[0], right[1], down[1]), wider
    raise _too_little()


def _whole_cells(
    window: tuple[int, int], hidden: tuple[int, int], cell: int
) -> tuple[int, int] | None:
    """The span of whole cells that has what is hidden; None if no multiple of a cell has it."""
    rest = (window[1] - window[0]) % cell
    after = min(rest, window[1] - hidden[1])
    first, last = window[0] + rest - after, window[1] - after
    return (first, last) if first <= hidden[0] else None


@dataclass(frozen=True, eq=False)
class _Kriging:
    """Cells of a window: the known ones predict all, with their covariance at the wanted ones."""

    known: Bools  # (rows, columns)
    wanted: Bools
    to_known: Array  # (n, n) distances between known cells, in cells
    to_all: Array  # (n, all)
    to_wanted: Array  # (m, m)
    trend: Array  # (all, 3) functions of the plane at all cells

    @classmethod
    def of(cls, known: Bools, wanted: Bools) -> "_Kriging":
        """Of the cells of a window."""
        at = np.argwhere(np.ones_like(known)).astype(float)
        some, m = (at[mask.ravel()] for mask in (known, wanted))
        cdist = scipy.spatial.distance.cdist
        trend = np.column_stack([np.ones(len(at)), at / (at.max(axis=0) + 1) - 0.5])
        return cls(known, wanted, cdist(some, some), cdist(some, at), cdist(m, m), trend)

    def covariances(self, y: Array, orders: Sequence[float] = _ORDERS) -> list[list[_Covariance]]:
        """For each axis of the light y (n, 3) of the known cells all covariances of some orders, by
        restricted likelihood with the amplitude that maximizes it.
        """
        T = self.trend[self.known.ravel()]
        null = np.linalg.qr(T, mode="complete")[0][:, T.shape[1] :]
        projected = null.T @ y
        found: list[list[_Covariance]] = [[], [], []]
        for order, length in product(
            orders, np.geomspace(1, 2 * float(self.to_known.max()), _LENGTHS)
        ):
            R = _matern(order, self.to_known / length)
            values, vectors = np.linalg.eigh(null.T @ R @ null)
            squares = (vectors.T @ projected) ** 2
            v = np.maximum(values, 0)[:, None] + _NUGGETS
            for axis, each in enumerate(found):
                a = np.maximum(np.mean(squares[:, axis, None] / v, axis=0), _MIN_VARIANCE**2)
                log = -0.5 * (np.log(v).sum(axis=0) + len(v) * np.log(a))
                each += map(_Covariance, repeat(order), repeat(length), _NUGGETS, a, log)
        return found

    def conditional(self, one: _Covariance, y: Array) -> tuple[Array, Array]:
        """Mean (all,) and covariance (m, m) of the smooth part, given the light y (n,)."""
        T, of_wanted = self.trend[self.known.ravel()], self.trend[self.wanted.ravel()]
        R = _matern(one.order, self.to_known / one.length) + one.nugget * np.eye(len(y))
        r = _matern(one.order, self.to_all / one.length)
        at = r[:, self.wanted.ravel()]
        factor = scipy.linalg.cho_factor(R, lower=True)
        Ry, RT, Rr = (scipy.linalg.cho_solve(factor, b) for b in (y, T, at))
        normal = np.linalg.inv(T.T @ RT)
        plane = normal @ (T.T @ Ry)
        mean = self.trend @ plane + r.T @ (Ry - RT @ plane)
        rest = of_wanted - at.T @ RT
        S = _matern(one.order, self.to_wanted / one.length) - at.T @ Rr + rest @ normal @ rest.T
        return mean, one.amplitude * S

    def smooth_part(self, light: Floats, draws: int) -> tuple[Array, Array, list[Array]]:
        """Mean, standard deviation and draws (rows, columns, 3) of the smooth part.

        Averages over the covariances; deviations are 0 at cells that are not wanted.
        """
        y, wanted = np.asarray(light[self.known], float), self.wanted.ravel()
        mean = np.zeros((len(wanted), 3))
        deviations = np.zeros((1 + draws, len(wanted), 3))
        rng = np.random.default_rng(_SEED)
        for axis, each in enumerate(self.covariances(y)):
            log = np.array([one.log_likelihood for one in each])
            # Equal steps of the cumulative weight; the draws are some of them.
            weight = np.cumsum(np.exp(log - log.max()))
            steps = (np.arange(_COVARIANCES) + 0.5) / _COVARIANCES * weight[-1]
            kept, count = np.unique(np.searchsorted(weight, steps), return_counts=True)
            share = count / _COVARIANCES
            fields = [self.conditional(each[k], y[:, axis]) for k in kept]
            means, variances = (
                np.stack(part) for part in ([m for m, _ in fields], [np.diag(S) for _, S in fields])
            )
            mean[:, axis] = share @ means
            off = (means - mean[:, axis])[:, wanted]
            deviations[0, wanted, axis] = np.sqrt(share @ (np.maximum(variances, 0) + off**2))
            steps = np.searchsorted(np.cumsum(share), (np.arange(draws) + 0.5) / max(draws, 1))
            roots = {k: _root(fields[k][1]) for k in set(steps.tolist())}
            for draw, k in zip(deviations[1:], rng.permutation(steps), strict=True):
                draw[wanted, axis] = off[k] + roots[k] @ rng.standard_normal(off.shape[1])
        shape = (*self.known.shape, 3)
        std, *drawn = (one.reshape(shape) for one in deviations)
        return mean.reshape(shape), std, drawn


class _Cells(NamedTuple):
    """Cells of a window, and where it is seen."""

    seen: Bools  # (h, w)
    known: Bools  # (rows, columns): of which enough is seen
    width: int

    def means(self, light: Array) -> Array:
        """(rows, columns, 3) of what is seen of light (h, w, 3)."""
        return seen_means(light, self.seen, self.width)[0]

    def variance_within(self, light: Array) -> Array:
        """(3,) of the pixels about the means of their cells."""
        (means, count), shown = seen_means(light, self.seen, self.width), light[self.seen]
        of_means = (count[..., None] * means**2).sum(axis=(0, 1))
        squares = np.einsum("nc,nc->c", shown, shown)
        return np.asarray(np.maximum(squares - of_means, 0) / count.sum())


def _likeliest_lines(light: Array, hidden: Bools, cells: _Cells, kriging: "_Kriging") -> Lines:
    """Lines that make the surroundings likelier, by the Bayesian information criterion of the cells.

    Cells have a rough smooth part, and pixels are independent within them: each cell counts as one.
    """
    count = np.count_nonzero(cells.known)

    def criterion(lines: Lines) -> float:
        rest = light - lines.mean
        found = kriging.covariances(cells.means(rest)[cells.known], _ORDERS[:1])
        likely = sum(max(one.log_likelihood for one in each) for each in found)
        within = np.log(cells.variance_within(rest) + _MIN_VARIANCE).sum()
        return float(
            likely - 0.5 * count * within - 0.5 * np.log(count) * lines.parameters / cells.width
        )

    best = Lines.none(light.shape)
    more = best.and_next(light, cells.seen, hidden)
    least = criterion(best) if more is not None else 0.0
    while more is not None and (likely := criterion(more)) > least:
        best, least = more, likely
        more = best.and_next(light, cells.seen, hidden)
    return best


def _root(S: Array) -> Array:
    """(m, m) A with A Aᵀ = S, a covariance that may be singular."""
    values, vectors = np.linalg.eigh(S)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)))


def _matern(order: float, d: Array) -> Array:
    """Matérn's correlation of half-integer order at distances over the length."""
    if order == 0.5:
        return np.asarray(np.exp(-d))
    if order == 1.5:
        s = np.sqrt(3) * d
        return np.asarray((1 + s) * np.exp(-s))
    s = np.sqrt(5) * d
    return np.asarray((1 + s + s * s / 3) * np.exp(-s))


def _interpolated(cells: Array, shape: tuple[int, ...], cell: int) -> Array:
    """(h, w, 3) cubic interpolation of values at the centers of cells."""
    rows, columns = (
        _cubic_weights(n, count, cell) for n, count in zip(shape, cells.shape[:2], strict=True)
    )
    return np.asarray(np.einsum("yr,rcp,xc->yxp", rows, cells, columns, optimize=True))


def _cubic_weights(pixels: int, cells: int, cell: int) -> Array:
    """(pixels, cells) of values at the centers of cells in a spline at each pixel of a line."""
    at = ((np.arange(pixels) - (cell - 1) / 2) / cell)[None]
    unit = [
        scipy.ndimage.map_coordinates(one, at, order=3, mode="nearest") for one in np.eye(cells)
    ]
    return np.stack(unit, axis=-1)


def _autocovariance(rest: Array, seen: Bools) -> Array:
    """(2 h, 2 w, 3) autocovariance at all lags, tapered; rest is 0 where nothing is seen."""
    shape = [scipy.fft.next_fast_len(2 * n) for n in seen.shape]
    spectrum = scipy.fft.fft2(rest, shape, axes=(0, 1))
    pairs = scipy.fft.ifft2(np.abs(scipy.fft.fft2(seen.astype(float), shape)) ** 2).real
    products = scipy.fft.ifft2(np.abs(spectrum) ** 2, axes=(0, 1)).real
    found = products / np.maximum(pairs, 1)[..., None]
    lags = [np.minimum(np.arange(n), n - np.arange(n)) for n in shape]
    reach = min(seen.shape) / 4
    taper = [
        np.where(lag < reach, 0.5 + 0.5 * np.cos(np.pi * np.minimum(lag / reach, 1)), 0)
        for lag in lags
    ]
    return np.asarray(found * (taper[0][:, None] * taper[1])[..., None])

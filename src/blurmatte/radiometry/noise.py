"""How well a linear value is known.

In this file `light` is linear (1 = sensor white) and σ² a variance in light². A sensor's noise has a
part that does not depend on light (reading), a part whose variance grows with it (photons), and a
part that is a fixed fraction of it (unequal pixels). Noise that is constant in *code* values, such
as rounding to 8 bits, grows nearly like the last two together: the slope of sRGB is ∝ light^0.58.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from blurmatte.checks import Bools, Floats, check_kind, check_map, check_same_size
from blurmatte.radiometry.transfer import LINEAR, Transfer

if TYPE_CHECKING:
    from blurmatte.radiometry.image import LinearImage

_ENOUGH = 5e5  # pixels to measure noise in

PerChannel = tuple[float, float, float]


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a linear value: read_std² + gain · light + (relative_std · light)².

    Parameters
    ----------
    gain : float or three floats
        Light per photo-electron, >= 0.
    read_std : float or three floats
        Standard deviation of reading, light, >= 0.
    relative_std : float or three floats
        Standard deviation that is a fraction of the light, >= 0.

    Raises
    ------
    ValueError
        If a number is negative, infinite or NaN.
    """

    gain: PerChannel | float = (0.0, 0.0, 0.0)
    read_std: PerChannel | float = (0.0, 0.0, 0.0)
    relative_std: PerChannel | float = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("gain", "read_std", "relative_std"):
            value = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (3,))
            if not np.all(np.isfinite(value) & (value >= 0)):
                raise ValueError(f"{name} must be finite and not negative, got {value.tolist()}")
            object.__setattr__(self, name, tuple(value.tolist()))

    def __repr__(self) -> str:
        middle = np.sqrt(self.variance(np.full(3, 0.2))).mean()
        return f"NoiseModel(std {middle:.2g} at light 0.2)"

    @property
    def coefficients(self) -> Floats:
        """(3 channels, 3) of 1, light and light² in the variance."""
        read, gain, relative = map(np.asarray, (self.read_std, self.gain, self.relative_std))
        return np.stack([read**2, gain, relative**2], axis=1)

    @classmethod
    def from_coefficients(cls, coefficients: Floats) -> NoiseModel:
        """The model with these (3 channels, 3) coefficients of 1, light and light²."""
        constant, linear, quadratic = np.asarray(coefficients, dtype=float).T
        return cls(tuple(linear), tuple(constant**0.5), tuple(quadratic**0.5))

    @classmethod
    def rounding(cls, levels: int, transfer: Transfer) -> NoiseModel:
        """The least noise a file of `levels` code values can have: rounding, to about 10 %."""
        check_kind("transfer", transfer, Transfer, "use blurmatte.named_transfer(name)")
        light = np.geomspace(0.005, 1, 100)
        coefficients = _fit_polynomial(light, rounding_variance(light, levels, transfer))
        black = rounding_variance(np.zeros(1), levels, transfer)[0]
        coefficients[0] = max(coefficients[0], black)
        return cls.from_coefficients(np.tile(coefficients, (3, 1)))

    def variance(self, light: Floats) -> Floats:
        """σ² of linear `light`, shape (..., 3); the dtype of `light`."""
        check_kind("light", light, np.ndarray, "use numpy.asarray(light, float)")
        # Written out for a whole row of pixels: NumPy is several times as fast.
        constant, linear, quadratic = (
            np.array(np.broadcast_to(one, light.shape[-2:]), order="C")
            for one in self.coefficients.T.astype(light.dtype)
        )
        positive = np.maximum(light, 0)
        variance: Floats = quadratic * positive
        variance += linear
        variance *= positive
        variance += constant
        return variance


def rounding_variance(light: Floats, levels: int, transfer: Transfer) -> Floats:
    """Variance, light², that rounding to one of `levels` code values makes at `light`."""
    return (transfer.slope(light) / (levels - 1)) ** 2 / 12


def _fit_polynomial(light: Floats, variance: Floats, weight: Floats | float = 1.0) -> Floats:
    """(3,) non-negative coefficients of 1, light, light² with the least relative error."""
    from scipy.optimize import nnls

    x = np.maximum(light, 0)
    relative = np.broadcast_to(np.asarray(weight) / variance, x.shape)
    coefficients, _ = nnls(
        np.stack([x**0, x, x**2], axis=1) * relative[:, None], relative * variance
    )
    return np.asarray(coefficients)


def fit_noise(
    image: LinearImage, plate: LinearImage, still: Bools | None = None
) -> tuple[NoiseModel, NoiseModel]:
    """Measure the noise of image and plate from their difference where nothing moved.

    The variance of the difference is collected by brightness and fitted by `NoiseModel`. How it
    divides between the two pictures shows in the fine structure: both share the scene's, so what
    the difference has in common with the image's is the image's own noise.

    Parameters
    ----------
    image, plate : LinearImage
        The same size.
    still : (H, W) bool, optional
        Where nothing moved. Without it, differences far outside the scatter of the rest are left
        out, and places where neighbors differ alike, which holds as long as less than about a third
        of the picture changed.

    Returns
    -------
    tuple of NoiseModel
        Of the image and of the plate.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, or `still` is not (H, W) bool.
    """
    _check_pictures(image, plate)
    check_same_size("image", image.size, "plate", plate.size)
    rows = slice(None, None, max(1, round(image.valid.size / _ENOUGH)))
    C, B = (picture.rgb[rows].astype(float) for picture in (image, plate))
    usable = image.valid[rows] & plate.valid[rows]
    least = [rounding_noise(picture).coefficients for picture in (image, plate)]
    if still is not None:
        check_map("still", still, image.valid.shape, kinds="b")
        usable &= still[rows]
    else:
        few = slice(None, None, 4)
        first, _ = _fit_total(B[few], (C - B)[few], usable[few], least[0] + least[1])
        usable &= _quiet(C - B, first.variance(B) + 1e-14, usable)
    model, kept = _fit_total(B, C - B, usable, least[0] + least[1])
    (share, _), total = plate_share(C, B, model.variance(B) + 1e-14, kept), model.coefficients
    return (
        NoiseModel.from_coefficients(np.maximum((1 - share) * total, least[0])),
        NoiseModel.from_coefficients(np.maximum(share * total, least[1])),
    )


def _quiet(d: Floats, s2: Floats, usable: Bools) -> Bools:
    """(H, W) where the mean of d over a neighborhood is no larger than such means usually are."""
    from scipy.ndimage import uniform_filter

    if not usable.any():
        return usable
    z = np.where(usable[..., None], d, 0) / np.sqrt(s2)
    mean = np.abs(uniform_filter(z, size=(7, 7, 1)))
    medians = np.median(np.ascontiguousarray(mean[usable].T), axis=1)  # of rows they are quick
    usual = np.maximum(1.4826 * medians, 1 / 7)  # white noise leaves 1/7
    return np.asarray((mean <= 4 * usual).all(axis=-1))


def _fit_total(
    light: Floats, difference: Floats, usable: Bools, least: Floats
) -> tuple[NoiseModel, Bools]:
    """Noise of the difference, and which of its (H, W, 3) values were believed."""
    total, kept = np.empty((3, 3)), np.zeros(light.shape, bool)
    for c in range(3):
        x, d = light[..., c], difference[..., c]
        cut_off = (x == 0) | (x + d == 0)  # at black, noise can only go up
        lowest = 2.0 if np.mean(cut_off) > 0.01 else 0.0
        total[c], kept[..., c] = _fit_channel(x, d, usable & ~cut_off, least[c], lowest)
    return NoiseModel.from_coefficients(total), kept


def rounding_noise(picture: LinearImage) -> NoiseModel:
    """What the rounding of a picture's file alone makes; none if it held floats."""
    if picture.meta.levels is None:
        return NoiseModel()
    return NoiseModel.rounding(picture.meta.levels, picture.meta.transfer or LINEAR)


def _fit_channel(
    light: Floats, difference: Floats, usable: Bools, least: Floats, lowest: float
) -> tuple[Floats, Bools]:
    """Coefficients of the variance of one channel's difference, and which pixels were believed.

    Light below `lowest` standard deviations of itself is not used if there is any other.
    """
    x, d = light[usable], difference[usable]
    kept = np.zeros(usable.shape, bool)
    if len(x) == 0:
        return least, kept
    order = np.argsort(x)
    x, d = x[order], d[order]
    edges = x[(np.linspace(0, 1, 25)[1:-1] * (len(x) - 1)).astype(int)]
    cuts = np.unique([0, *np.searchsorted(x, edges, side="right"), len(x)])
    inside = np.zeros(len(x), bool)
    level, variance, count = [], [], []
    for start, stop in pairwise(cuts):
        at = max(_middle(x[start:stop]), 0.0)
        believed, scatter = _clipped_scatter(d[start:stop], float(np.polyval(least[::-1], at)))
        inside[order[start:stop][believed]] = True
        level.append(at)
        variance.append(scatter + 1e-14)
        count.append(believed.sum())
    kept[usable] = inside
    # A sample variance errs by √(2/count) of itself, the shape of the model by about a tenth.
    weight = (2 / np.maximum(count, 1) + 0.1**2) ** -0.5
    x, variances = np.array(level), np.array(variance)
    clear = x >= lowest * np.sqrt(variances)
    some = clear if clear.any() else ~clear
    return _fit_polynomial(x[some], variances[some], weight[some]), kept


def _clipped_scatter(d: Floats, least: float) -> tuple[Bools, float]:
    """Second moment about zero of the central part of `d`: within four sigma, in a few rounds."""
    sizes = np.sort(np.abs(d))
    sums = np.cumsum(sizes**2)
    s2, limit = max((1.4826 * _middle(sizes)) ** 2, least), np.inf
    for _ in range(4):
        limit = 4 * float(np.sqrt(s2))
        count = int(np.searchsorted(sizes, limit, side="right"))
        s2 = max(float(sums[count - 1]) / count if count else s2, least)
    return np.asarray(np.abs(d) <= limit), s2


def _middle(values: Floats) -> float:
    """Median of sorted values."""
    return float(values[(len(values) - 1) // 2] + values[len(values) // 2]) / 2


def plate_share(C: Floats, B: Floats, s2: Floats, kept: Bools) -> tuple[float, float]:
    """The plate's part of the variance of C − B, and the standard deviation of that part.

    It comes from E[(C − B) · fine structure of C] = σ_C².
    The scene's own fine structure is what blurs the answer, so pixels count the less the more of it
    the next row shows (that row's noise is another one), and a blurred answer is drawn to one half.
    """
    of_C, of_B = _fine_structure(C), _fine_structure(B)
    scene = np.roll((of_C + of_B) / 2, 1, axis=0)
    weight = np.where(kept[:, 1:-1], 1 / (s2[:, 1:-1] + scene**2), 0)
    d = (C - B)[:, 1:-1] * weight
    of_image, of_plate = d * of_C, -d * of_B
    both = float(np.sum(of_image + of_plate))
    if not both > 0.1 * float(np.sum(s2[:, 1:-1] * weight)):
        return 0.5, 0.3  # noise too smooth, or none, to tell from the scene
    share = float(np.sum(of_plate)) / both
    variance = float(np.sum(((1 - share) * of_plate - share * of_image) ** 2)) / both**2
    prior = 0.3**2
    mean = (share * prior + 0.5 * variance) / (prior + variance)
    return float(np.clip(mean, 0, 1)), (prior * variance / (prior + variance)) ** 0.5


def _fine_structure(x: Floats) -> Floats:
    fine: Floats = x[:, :-2] + x[:, 2:]
    fine *= -0.5
    fine += x[:, 1:-1]
    return fine


def with_noise(image: LinearImage, plate: LinearImage) -> tuple[LinearImage, LinearImage]:
    """Image and plate with their noise known: measured by `fit_noise` if either's is not."""
    _check_pictures(image, plate)
    if image.noise is not None and plate.noise is not None:
        return image, plate
    of_image, of_plate = fit_noise(image, plate)
    return (
        image if image.noise is not None else image.with_noise(of_image),
        plate if plate.noise is not None else plate.with_noise(of_plate),
    )


def _check_pictures(image: LinearImage, plate: LinearImage) -> None:
    from blurmatte.radiometry.image import check_picture  # which imports this module

    check_picture("image", image)
    check_picture("plate", plate)

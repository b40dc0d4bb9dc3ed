"""What a response curve is estimated from: a bracket of exposures, and a prior of curves.

Grossberg and Nayar (*Modeling the Space of Camera Response Functions*, PAMI 2004) found that the curves
of 201 films and cameras lie near a space of few dimensions. The samples of the prior are formulas:
curves of standards and logarithms, with and without the S-shaped tone curves of cameras and films. The
space is that of the log slope h(v) = log dg/dv, where g(v) is the light of code value v: every h
belongs to an increasing curve. h is constant between the codes of an 8-bit file, in CELLS cells.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from blurmatte.checks import Array, Bools, Floats, check_same_size
from blurmatte.errors import ResponseError
from blurmatte.radiometry import REC709, SRGB, LinearImage, gamma
from blurmatte.radiometry.transfer import Curve
from blurmatte.statistics import UNIFORM_VARIANCE, robust_std

CELLS = 255  # of a curve: the steps between code values of 8 bits
# How many places are chosen and needed.
_MAX_PIXELS = 1_000_000  # evenly spaced pixels from which places are chosen
_PER_LEVEL = 40  # places for each of 256 levels and each channel
_PER_CHANNEL = 1000  # places of a channel that has few levels
MIN_SHARED = 30  # places that two pictures must share


@dataclass(frozen=True, eq=False)
class Bracket:
    """Pictures sorted by exposure time."""

    pictures: tuple[LinearImage, ...]
    names: tuple[str, ...]
    times: Array  # (N,) float: seconds
    time_std: float  # relative standard deviation of the times

    @classmethod
    def of(
        cls,
        pictures: Sequence[LinearImage],
        exposure_times: Sequence[float] | None,
        time_std: float,
    ) -> "Bracket":
        """The pictures, checked and sorted; see `fit_response`."""
        pictures = tuple(pictures)
        if len(pictures) < 2:
            raise ValueError(f"pictures must be two or more, got {len(pictures)}")
        for picture in pictures:
            if not isinstance(picture, LinearImage):
                raise TypeError(f"pictures must be LinearImages, got {type(picture).__name__}")
        names = tuple(p.meta.source or f"picture {i}" for i, p in enumerate(pictures, 1))
        for name, picture in zip(names, pictures, strict=True):
            check_same_size(names[0], pictures[0].size, name, picture.size)
            _check_codes(name, picture)
        times = _times(pictures, names, exposure_times)
        if np.log(times.max() / times.min()) <= max(3 * time_std, 1e-6):
            raise ValueError(
                f"the exposure times are all about {times[0]:.4g} s; take pictures whose times "
                "differ by factors of two or more"
            )
        order = np.argsort(times, kind="stable")
        sorted_pictures = tuple(pictures[i] for i in order)
        sorted_names = tuple(names[i] for i in order)
        return cls(sorted_pictures, sorted_names, times[order], time_std)

    @property
    def rounding(self) -> float:
        """Standard deviation of rounding to code values, a fraction of full scale."""
        step = max(1 / ((p.meta.levels or 65536) - 1) for p in self.pictures)
        return float(step * np.sqrt(UNIFORM_VARIANCE))

    def places(self) -> "list[Places]":
        """Places of each channel, or of one if the pictures are gray."""
        gray = all(p.meta.gray for p in self.pictures)
        step = max(1, round((self.pictures[0].valid.size / _MAX_PIXELS) ** 0.5))
        values, contrast = [], np.zeros(1)
        for picture in self.pictures:
            rgb = picture.rgb[..., :1] if gray else picture.rgb
            windows = sliding_window_view(rgb, (3, 3), axis=(0, 1))[::step, ::step]
            around = np.delete(windows.reshape(*windows.shape[:3], 9), 4, axis=-1)
            values.append((windows[..., 1, 1], around.mean(axis=-1), np.ptp(around, axis=-1)))
            contrast = contrast + around.mean(axis=2)
        channels = np.transpose(values, (4, 1, 2, 3, 0))
        flat = channels.reshape(*channels.shape[:2], -1, len(values))
        detail = np.ptp(contrast, axis=-1).ravel()
        return [Places(channel).chosen(detail) for channel in flat]


@dataclass(frozen=True, eq=False)
class Places:
    """Pixels of one channel or several, in all pictures."""

    # (3, N, pictures) float, 0…1: code values, mean and range of the eight neighbors. Places are
    # selected by the latter: selection by a value's own noise would bias the curve
    values: Floats

    @property
    def codes(self) -> Floats:
        """(N, pictures) code values, 0…1."""
        return np.asarray(self.values[0])

    def chosen(self, detail: Floats) -> "Places":
        """Places of every level in equal number, from the half of them with the least detail."""
        around = self.values[1]
        level = np.rint(around.mean(axis=1) * 255).astype(int)
        inside = np.count_nonzero((around > 0) & (around < 1), axis=1) >= 2
        groups = [np.flatnonzero(inside & (level == brightness)) for brightness in range(256)]
        levels = max(1, sum(group.size > 0 for group in groups))
        each = max(_PER_LEVEL, _PER_CHANNEL // levels)
        picked = []
        for group in groups:
            plain = np.sort(group[np.argsort(detail[group], kind="stable")][: -(-len(group) // 2)])
            picked.append(plain[np.linspace(0, len(plain) - 1, min(each, len(plain))).astype(int)])
        return Places(self.values[:, np.concatenate(picked)].astype(float))

    @classmethod
    def joined(cls, several: "Sequence[Places]") -> "Places":
        """The places of several."""
        return cls(np.concatenate([places.values for places in several], axis=1))

    def some(self, count: int) -> "Places":
        """About `count` of them, evenly spaced."""
        return Places(self.values[:, :: max(1, self.values.shape[1] // count)])

    @property
    def scatter(self) -> float:
        """Upper bound of the noise's standard deviation, from differences to neighbors."""
        apart = np.abs(self.values[0] - self.values[1])[self._inside]
        return robust_std(apart) / (9 / 8) ** 0.5 if apart.size else 0.0

    def usable(self, margin: float) -> Bools:
        """(N, pictures) neither clipped nor within `margin` of it, nor their neighbors."""
        _, around, spread = self.values
        low, high = around - spread, around + spread
        return np.asarray(self._inside & (low > margin) & (high < 1 - margin))

    def shared(self) -> bool:
        """True if enough of them are usable in two pictures."""
        shared = np.count_nonzero(self.usable(1 / CELLS), axis=1) >= 2
        return int(np.sum(shared)) >= MIN_SHARED

    @property
    def _inside(self) -> Bools:
        return np.asarray((self.codes > 0) & (self.codes < 1))

    def check_shared(self, bracket: Bracket) -> None:
        """Raise ResponseError unless successive pictures share places and get brighter."""
        inside = self.usable(1 / CELLS)
        for first, second in pairwise(range(len(bracket.names))):
            names = f"{bracket.names[first]} and {bracket.names[second]}"
            both = inside[:, first] & inside[:, second]
            if np.count_nonzero(both) < MIN_SHARED:
                raise ResponseError(
                    f"{names} have no code values in common: where one is neither black nor "
                    "clipped the other is; take pictures with exposures in between"
                )
            rise = float(np.median(self.codes[both, second] - self.codes[both, first]))
            if rise < 1 / CELLS and bracket.times[second] > 1.05 * bracket.times[first]:
                raise ResponseError(
                    f"{names} are equally bright, or the second darker, although it was exposed "
                    "longer; check the exposure times, and that aperture, ISO and light stayed"
                )


def _check_codes(name: str, picture: LinearImage) -> None:
    transfer = picture.meta.transfer
    if transfer is not None and transfer.name != "linear":
        raise ValueError(
            f"{name} was decoded as {transfer.name}; its code values are needed without decoding: "
            "read it with blurmatte.read(path, blurmatte.LINEAR)"
        )
    if picture.meta.converted:
        raise ResponseError(
            f"{name}: its color profile or tags state other primaries than sRGB, which mixes the "
            "channels; save it without them"
        )


def _times(
    pictures: Sequence[LinearImage], names: Sequence[str], given: Sequence[float] | None
) -> Array:
    if given is None:
        missing = [n for n, p in zip(names, pictures, strict=True) if p.meta.exposure_time is None]
        if missing:
            raise ValueError(
                f"{missing[0]} has no exposure time; give exposure_times "
                "(--exposures 1/60,1/15), one for each picture"
            )
        given = [p.meta.exposure_time or 0.0 for p in pictures]
    times = np.asarray(given, dtype=float)
    if times.shape != (len(pictures),):
        raise ValueError(f"exposure_times must be {len(pictures)} numbers, got {len(given)}")
    if not np.all(np.isfinite(times) & (times > 0)):
        raise ValueError(f"exposure_times must be positive seconds, got {times.tolist()}")
    return times


@dataclass(frozen=True, eq=False)
class ResponsePrior:
    """h = mean + basis @ z, where the z are independent and have the variance 1."""

    mean: Array  # (CELLS,) float
    basis: Array  # (CELLS, rank) float
    members: Array  # (N, rank) float: z of each curve of the family


@lru_cache(maxsize=1)
def response_prior() -> ResponsePrior:
    """Mean, principal components and members of the family.

    To their covariance that of a smooth deviation is added: slopes off by 10 %, correlated over 8 % of
    the range. Components that change light by less than 0.1 % of full scale are dropped.
    """
    slopes = np.array([_log_slope(curve) for curve in _family()])
    mean = slopes.mean(axis=0)
    v = (np.arange(CELLS) + 0.5) / CELLS
    deviation = 0.1**2 * np.exp(-(((v[:, None] - v) / 0.08) ** 2) / 2)
    covariance = np.cov(slopes.T) + deviation
    # Components are ranked by their effect on light, which is proportional to the slope.
    weight = np.sqrt(np.mean(np.exp(2 * slopes), axis=0))
    values, vectors = np.linalg.eigh(weight[:, None] * covariance * weight)
    kept = values > 1e-3**2 * CELLS
    scale = np.sqrt(values[kept])
    members = (slopes - mean) * weight @ vectors[:, kept] / scale
    return ResponsePrior(mean, vectors[:, kept] * scale / weight[:, None], members)


def _family() -> Iterator[Curve]:
    """Standard, power and log curves; these with tone curves of some contrasts; curves of film."""
    bases = [SRGB.decode, REC709.decode]
    bases += [gamma(exponent).decode for exponent in np.arange(1.0, 3.01, 0.2)]
    logs = [_logarithmic(reach) for reach in 10.0 ** np.arange(1, 4.1, 0.5)]
    yield from (*bases, *logs)
    for base in bases[::2] + logs[:3]:
        for contrast, middle in product((2.0, 3.5, 5.0, 6.5), (0.3, 0.45, 0.6)):
            yield _with_logistic(base, contrast, middle)
        for power in (1.2, 1.5):
            yield _with_power_s(base, power)
    for exponent, half in product((1.0, 1.3, 1.6), (0.15, 0.4, 1.0)):
        yield _film(exponent, half)


def _log_slope(curve: Curve) -> Array:
    """(CELLS,) h of a curve."""
    light = np.asarray(curve(np.arange(CELLS + 1) / CELLS), dtype=float)
    rise = np.diff(light) / (light[-1] - light[0])
    return np.asarray(np.log(np.maximum(rise * CELLS, 1e-6)))


def _logarithmic(reach: float) -> Curve:
    """Code value ∝ log(1 + reach · light); `reach` is white over the light where the toe ends."""
    return lambda v: np.expm1(v * np.log1p(reach)) / reach


def _with_logistic(base: Curve, contrast: float, middle: float) -> Curve:
    """A base curve followed by a logistic tone curve, steepest at code value `middle`."""
    low, high = (1 / (1 + np.exp(-contrast * (end - middle))) for end in (0, 1))

    def decode(v: Array) -> Array:
        """Light of codes in the middle part of a logistic curve."""
        s = low + v * (high - low)
        inner = middle + np.log(s / (1 - s)) / contrast
        return np.asarray(base(np.clip(inner, 0, 1)))

    return decode


def _with_power_s(base: Curve, power: float) -> Curve:
    """A base curve followed by the tone curve v^p / (v^p + (1 − v)^p), flat at both ends."""

    def decode(u: Array) -> Array:
        """Light of codes of an S-shaped curve."""
        above, below = u ** (1 / power), (1 - u) ** (1 / power)
        return np.asarray(base(above / (above + below)))

    return decode


def _film(exponent: float, half: float) -> Curve:
    """Code value ∝ E^n / (E^n + half^n): saturation of film (Naka and Rushton)."""
    top = 1 / (1 + half**exponent)
    return lambda v: half * (v * top / (1 - v * top)) ** (1 / exponent)

"""Pictures of one still scene with different exposures, and pixels to compare in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from blurmatte.checks import Array, Bools, Floats, check_same_size
from blurmatte.errors import ResponseError
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import robust_std

_STEP = 1 / 255  # of full scale: a code value of 8 bits
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
        return float(max(1 / ((p.meta.levels or 65536) - 1) for p in self.pictures) / 12**0.5)

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
        shared = np.count_nonzero(self.usable(_STEP), axis=1) >= 2
        return int(np.sum(shared)) >= MIN_SHARED

    @property
    def _inside(self) -> Bools:
        return np.asarray((self.codes > 0) & (self.codes < 1))

    def check_shared(self, bracket: Bracket) -> None:
        """Raise ResponseError unless successive pictures share places and get brighter."""
        inside = self.usable(_STEP)
        for first, second in pairwise(range(len(bracket.names))):
            names = f"{bracket.names[first]} and {bracket.names[second]}"
            both = inside[:, first] & inside[:, second]
            if np.count_nonzero(both) < MIN_SHARED:
                raise ResponseError(
                    f"{names} have no code values in common: where one is neither black nor "
                    "clipped the other is; take pictures with exposures in between"
                )
            rise = float(np.median(self.codes[both, second] - self.codes[both, first]))
            if rise < _STEP and bracket.times[second] > 1.05 * bracket.times[first]:
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

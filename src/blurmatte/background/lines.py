"""Straight lines that cross a region: horizons, edges of tables, skirting boards, stripes.

Light that is constant along parallel lines is a profile, a function of the position across them. Each
side of the region shows the profile once. Where lines continue behind the region the two agree; their
covariance across the lines is the variance of the profile, their difference twice that of its error.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Indices
from blurmatte.statistics import seen_means

_MAX_DIRECTIONS = 3  # of lines in one window
_CELLS = 96  # of the longer side of a window, in which directions are sought first
_BEST = 3  # directions that are refined
# Of the correlation of both sides: by chance in one window of two; then evidence decides.
_MIN_Z = 2.5
_MIN_SHARE = 0.25  # of the line of a side, relative to the median line, that is seen
_SMOOTH_PX = 8  # differences of both sides over more pixels are left to the smooth field
_CHANCE = 4.0  # standard deviations of a variance by chance
_TINY = np.finfo(float).tiny
_NEAR_PX = 3  # over which the error of the profile is averaged


class LineProfile(NamedTuple):
    """Light across parallel lines of one direction."""

    position: Array  # (h, w) of the pixels, in bins of a pixel
    light: Array  # (n, 3)
    variance: Array  # (n, 3)
    parameters: float  # that the data determine

    def of_pixels(self, across: Array) -> Array:
        """(h, w, 3) of values (n, 3) across the lines."""
        found = _interpolated(self.position.ravel(), np.arange(len(across)), across)
        return found.reshape(*self.position.shape, 3)


@dataclass(frozen=True, eq=False)
class Lines:
    """All lines through a window of (h, w) pixels."""

    profiles: tuple[LineProfile, ...]
    mean: Array  # (h, w, 3)

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> "Lines":
        """No lines, in a window of (h, w, 3)."""
        return cls((), np.zeros(shape))

    def and_next(self, light: Array, seen: Bools, hidden: Bools) -> "Lines | None":
        """With lines of one more direction of the light (h, w, 3), if there are any.

        They continue behind what is hidden; where the light is seen, it is known.
        """
        if len(self.profiles) == _MAX_DIRECTIONS:
            return None
        rest = np.where(seen[..., None], light - self.mean, 0)
        found = _likeliest(rest, seen, hidden)
        if found is None:
            return None
        return Lines((*self.profiles, found), self.mean + found.of_pixels(found.light))

    @property
    def parameters(self) -> float:
        """Number of values across the lines, in bins of a pixel, that the data determine."""
        return sum(one.parameters for one in self.profiles)

    @property
    def variance(self) -> Array:
        """(h, w, 3) of the mean."""
        return sum(
            (one.of_pixels(one.variance) for one in self.profiles), np.zeros(self.mean.shape)
        )

    def drawn(self, rng: np.random.Generator) -> Array:
        """(h, w, 3) a difference from the mean, constant along each line."""
        drawn = np.zeros(self.mean.shape)
        for one in self.profiles:
            drawn += one.of_pixels(np.sqrt(one.variance) * rng.standard_normal(one.light.shape))
        return drawn


@dataclass(frozen=True, eq=False)
class _VisibleCells:
    """Pixels, or cells, where the scene is seen, about the center of what is hidden."""

    x: Array  # (n,)
    y: Array
    light: Array  # (n, 3) less its mean
    reach: int  # no pixel is farther from the center

    @classmethod
    def of(cls, light: Array, seen: Bools, center: Array, cell: int) -> "_VisibleCells":
        means, count = seen_means(light, seen, cell)
        whole = count > cell**2 / 2
        means = means[whole] - means[whole].mean(axis=0)
        y, x = np.argwhere(whole).T - (center[:, None] - (cell - 1) / 2) / cell
        reach = int(np.ceil(np.hypot(x, y).max())) + 1 if len(x) else 1
        return cls(x, y, means, reach)

    def across(self, angle: float) -> tuple[Array, Array]:
        """Number of pixels (2, n) and mean light (2, n, 3) of both sides in bins across lines."""
        c, s, bins = np.cos(angle), np.sin(angle), 2 * self.reach + 1
        at = np.rint(self.y * c - self.x * s).astype(int) + self.reach
        at += bins * (self.x * c + self.y * s >= 0)
        count, means = _binned(at, self.light, 2 * bins)
        return count.reshape(2, bins), means.reshape(2, bins, 3)

    def agreement(self, angle: float) -> tuple[float, float]:
        """How well both sides agree, and z of the correlation of their steps across the lines.

        The former is z times the share of the light's variance that lines explain: periodic lines also
        agree in directions that connect each with the next one.
        """
        count, means = self.across(angle)
        explained = float((count[..., None] * means**2).sum() / self._squares)
        z = self._z(count, means)
        return explained * z, z

    @cached_property
    def _squares(self) -> float:
        """Of all light, summed."""
        return float(np.maximum((self.light**2).sum(), _TINY))

    def best(self, angles: Iterable[float]) -> list[float]:
        """The directions in which both sides agree best."""
        return sorted(angles, key=self.agreement, reverse=True)[:_BEST]

    def _z(self, count: Array, means: Array) -> float:
        both = _in_both(count)
        steps = both[1:] & both[:-1]
        if np.count_nonzero(steps) < _SMOOTH_PX:
            return 0.0
        left, right = np.diff(means, axis=1)[:, steps]
        scale = np.sqrt((left**2).sum() * (right**2).sum())
        if scale == 0:
            return 0.0
        correlated = sum(_common_correlation(left, right))
        return float((left * right).sum() / scale * np.sqrt(len(left) / (1 + 2 * correlated)))


def _in_both(count: Array) -> Bools:
    """(n,) lines of which enough is seen on both sides."""
    least = count.min(axis=0)
    positive = least[least > 0]
    return np.asarray(least >= _MIN_SHARE * np.median(positive)) if len(positive) else least > 0


def _common_correlation(left: Array, right: Array) -> Iterator[float]:
    """Products of the autocorrelations of two series (n, 3) by lag, until one is not positive."""
    for lag in range(1, len(left) // 2):
        own = [float((a[lag:] * a[:-lag]).sum() / (a**2).sum()) for a in (left, right)]
        if min(own) <= 0:
            return
        yield own[0] * own[1]


def _likeliest(light: Array, seen: Bools, hidden: Bools) -> LineProfile | None:
    """The profile of the direction in which both sides agree best; None if in none they do."""
    center = np.argwhere(hidden).mean(axis=0)
    cell = max(1, -(-max(seen.shape) // _CELLS))
    cells = _VisibleCells.of(light, seen, center, cell)
    step = 0.5 / max(cells.reach, 2)  # both ends of a line stay within one cell
    angles = np.arange(0, np.pi, step)
    best = cells.best(angles)
    while cell > 1:
        cell, step = cell // 2, step / 2
        cells = _VisibleCells.of(light, seen, center, cell)
        best = cells.best({a + k * step for a in best for k in (-1, 0, 1)})
    angle = cells.best([best[0] + k * step / 2 for k in range(-2, 3)])[0]
    return (
        _profile(cells, angle, center, seen.shape) if cells.agreement(angle)[1] > _MIN_Z else None
    )


def _interpolated(at: Array, known: Array | Indices, across: Array) -> Array:
    """(n, 3) values at some positions of values across the lines that are known at others."""
    return np.stack([np.interp(at, known, column) for column in across.T], axis=-1)


def _binned(at: Indices, values: Array, bins: int) -> tuple[Array, Array]:
    """Number (bins,) of values (n, 3) in each bin, and their means (bins, 3)."""
    count = np.bincount(at, minlength=bins).astype(float)
    sums = [np.bincount(at, column, minlength=bins) for column in values.T]
    return count, np.stack(sums, axis=-1) / np.maximum(count, 1)[:, None]


def _scatter(cells: _VisibleCells, angle: float, light: Array, both: Bools) -> Array:
    """(n, 3) variance along each line beyond that of most: an edge is sharper than a bin."""
    at = cells.y * np.cos(angle) - cells.x * np.sin(angle) + cells.reach
    rest = cells.light - _interpolated(at, np.arange(len(light)), light)
    rest = rest - rest.mean(axis=0)
    count, variance = _binned(np.rint(at).astype(int), rest**2, len(light))
    most = np.median(variance[both], axis=0)
    by_chance = most * (1 + _CHANCE * np.sqrt(2 / np.maximum(count, 1)[:, None]))
    return np.where((variance > by_chance) & both[:, None], variance - most, 0)


def _profile(
    cells: _VisibleCells, angle: float, center: Array, shape: tuple[int, ...]
) -> LineProfile:
    """The profile of lines of one direction, by what both sides show."""
    count, means = cells.across(angle)
    both = _in_both(count)
    weight = count[:, both]
    sides = means - (weight[..., None] * means[:, both]).sum(axis=1, keepdims=True) / weight.sum(
        axis=1
    ).reshape(2, 1, 1)
    bins = np.arange(count.shape[1], dtype=float)
    known = bins[both]
    difference = sides[0, both] - sides[1, both]
    rough = difference - scipy.ndimage.gaussian_filter1d(difference, _SMOOTH_PX, axis=0)
    error = scipy.ndimage.gaussian_filter1d(rough**2, _NEAR_PX, axis=0) / 4  # of the sides' mean
    mean = sides[:, both].mean(axis=0)
    signal = np.maximum((mean**2).mean(axis=0) - error.mean(axis=0), 0)
    share = signal / np.maximum(signal + error, _TINY)
    light, own = (_interpolated(bins, known, across) for across in (share * mean, share * error))
    variance = own + _scatter(cells, angle, light, both)
    variance[~both] += signal
    y, x = np.indices(shape, float) - center[:, None, None]
    position = y * np.cos(angle) - x * np.sin(angle) + cells.reach
    return LineProfile(position, light, variance, float(share.sum()))

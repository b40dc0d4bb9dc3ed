"""RobustCurve: numbers of an object as one curve over time, each frame predicted from the others.

Frames measure the state of a smoothing spline (`smoothing`), with the errors that they state.
Compression and other causes that frames have in common add one error to all numbers of a kind. These
errors and the intensity of the spline's noise are those for which the frames are likeliest when each is
predicted from all others, with Student's t as the distribution of errors: mistakes have little weight.
The errors given of single frames are at least those that make the reduced χ² of predictions 1
[Paule and Mandel 1982].

Each track has a curve of its own. A frame that differs from its prediction by more than noise does
predicts nothing, and gets a doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools, Indices
from blurmatte.motion.clip.detections import FrameMotion, Sighting, parts_of_tracks
from blurmatte.motion.clip.smoothing import (
    MIN_OUTLIER_PROBABILITY,
    MIN_STD_PX,
    Estimate,
    Measurements,
    least_decades,
    noise_scale,
    student_cost,
    student_weights,
)

MIN_FRAMES = 5  # in which a mistake can be distinguished from its neighbors
_ROUNDS = 3  # of errors and curve at most
_REWEIGHTINGS = 3  # in a round
# Powers of ten: of the intensity of the noise, pixels² per interval to the power 2p − 1, where its
# search begins, and of the errors beyond the stated ones, pixels
_INTENSITY_DECADES = (-8.0, 4.0)
_START_DECADES = (-8.0, 0.0)
_ADDED_DECADES = (-3.0, 2.0)
_MIN_FRAMES = 3  # of a track that determine errors: each is predicted from two others


@dataclass(frozen=True, eq=False)
class RobustCurve:
    """A curve over time, and the errors of the frames about it.

    Parameters
    ----------
    frames : tuple of FrameMotion
        Of one object, in order of time.
    rows : Measurements
        What they measured of the state of the curve, with the errors that they state. The numbers of a
        row are of one kind or several, of the same count, one kind after the other.
    part : (n,) int
        Number of the part of the curve of each row; parts have nothing in common.
    used : (n,) bool
        Rows that predict others: at first those that a whole disc explains.
    added : tuple of float
        Error added to the numbers of each kind, pixels, when the state is predicted.
    intensity : float
        Of the noise of the derivative that is not in the state.
    student_weights : (n,) float, optional
        Of the rows, where they predict others.
    """

    frames: tuple[FrameMotion, ...]
    rows: Measurements
    part: npt.NDArray[np.int_]
    used: Bools
    added: tuple[float, ...]
    intensity: float = 0.0
    student_weights: Array | None = None

    def fitted(self) -> Self:
        """With the likeliest constants, if they can be determined, and without outliers."""
        if np.bincount(self.part, weights=self.used, minlength=1).max() < _MIN_FRAMES:
            return self
        return self.with_noise().converged().broken().without_outliers().converged()

    def revised(self) -> Self:
        """With what rows measure of the state by the curve found so far."""
        return self

    def broken(self) -> Self:
        """With the parts that the frames show."""
        return self

    def converged(self) -> Self:
        """With weights and constants that agree."""
        fit = self
        for _ in range(_ROUNDS):
            before, fit = fit, fit.reweighted().revised().with_noise()
            if (fit.intensity, fit.added) == (before.intensity, before.added):
                break
        return fit

    def with_noise(self) -> Self:
        """With the intensity and the added errors for which the frames are likeliest.

        At first from a smooth and from an uneven curve: errors explain what noise of the curve does.
        """
        ranges = _INTENSITY_DECADES, *(_ADDED_DECADES for _ in self.added)
        if self.intensity:
            starts = [np.log10([self.intensity, *self.added])]
        else:
            starts = [np.array([q, *(0.0 for _ in self.added)]) for q in _START_DECADES]
        return self._with_decades(
            least_decades(lambda x: self._with_decades(x).cost(), starts, ranges)
        )

    def _with_decades(self, x: Array) -> Self:
        """With an intensity and added errors, powers of ten."""
        intensity, *added = (10.0**x).tolist()
        return replace(self, intensity=intensity, added=tuple(added))

    def reweighted(self) -> Self:
        """With Student-t weights of the rows, from their residuals about the others."""
        fit = self
        for _ in range(_REWEIGHTINGS):
            chi2 = fit._compared()[0].sum(axis=1)
            known = fit.used & np.isfinite(chi2)
            weights = np.ones(len(chi2))
            weights[known] = student_weights(chi2[known], fit.measured[known].sum(axis=1))
            fit = replace(fit, student_weights=weights)
        return fit

    def without_outliers(self) -> Self:
        """Without frames that differ from their prediction by more than noise does."""
        large = self.used & self._in_large_parts
        return replace(self, used=self.used & (self._excess(self._compared()[0], large) <= 1))

    def cost(self, of: Bools | None = None) -> float:
        """Negative log likelihood of rows, if not given of those in use, from the others."""
        known = (self.used if of is None else of) & self.states.known
        if not known.any():
            return np.inf
        chi2, logs = (values[known].sum(axis=1) for values in self._compared())
        return student_cost(chi2, logs, self.measured[known].sum(axis=1))

    @property
    def as_stated(self) -> Self:
        """The same curve if no errors were added."""
        return replace(self, added=tuple(0.0 for _ in self.added))

    @property
    def predicting(self) -> Measurements:
        """The measurements that predict others, with their weights."""
        found = self._with_added(self.used, self.added)
        if self.student_weights is None:
            return found
        return replace(found, weights=found.weights * self.student_weights[:, None, None])

    @cached_property
    def states(self) -> Estimate:
        """Of each row from the other rows of its part; errors include the added ones."""
        return self.smoothed(self.predicting)

    def smoothed(self, rows: Measurements, with_own: bool = False) -> Estimate:
        """The state in each row from others of its part, and perhaps from itself."""
        n, s = self.rows.H.shape[0], self.rows.H.shape[2]
        mean, covariance = np.full((n, s), np.nan), np.full((n, s, s), np.nan)
        for part in np.unique(self.part):
            mine = np.flatnonzero(self.part == part)
            L, v = rows.taken(mine).left_out(self.intensity)
            own = rows.taken(mine).information if with_own else (0.0, 0.0)
            found = Estimate.of((L + own[0], v + own[1]))
            mean[mine], covariance[mine] = found.mean, found.covariance
        return Estimate(mean, covariance)

    @cached_property
    def chi2(self) -> Array:
        """(n, kinds) of each row, with its own error, about the prediction; NaN without one."""
        return self._compared(tuple(0.0 for _ in self.added))[0]

    @cached_property
    def residuals(self) -> Array:
        """(n, kinds) norms of the differences from the prediction, pixels; NaN without one."""
        z = self.rows.y - np.einsum("kms,ks->km", self.rows.H, self.states.mean)
        return np.asarray(np.linalg.norm(z.reshape(len(z), len(self.added), -1), axis=2))

    @cached_property
    def contradicts(self) -> Bools:
        """(n,) whole or sound rows that differ from the prediction by more than noise does."""
        sound = _which(self.frames, lambda one: one.is_sound)
        sound &= self._of_moments & self._in_large_parts
        excess = self._excess(self._compared(self.added_to_moments)[0], sound)
        return (whole_rows(self.frames) & ~self.used) | (excess > 1)

    @cached_property
    def added_to_discs(self) -> tuple[float, ...]:
        """Errors beyond the stated ones, pixels, of frames that a disc explains."""
        return tuple(map(max, self.added, self._added_to(self.used)))

    @cached_property
    def added_to_moments(self) -> tuple[float, ...]:
        """The same of frames measured by the moments of alpha, which share the causes."""
        return tuple(map(max, self.added_to_discs, self._added_to(self._of_moments)))

    def factors_of(self, sighting: Sighting, variances: Sequence[float]) -> tuple[float, ...]:
        """By which errors of these variances of a detection become those here, for each kind."""
        added = self.added_to_discs if sighting.motion.has_shape else self.added_to_moments
        least = MIN_STD_PX**2
        ratios = (a**2 / max(v, least) for a, v in zip(added, variances, strict=True))
        return tuple(float(np.sqrt(1 + ratio)) for ratio in ratios)

    @property
    def measured(self) -> Array:
        """(n, kinds) numbers that a row measured."""
        first = [self.rows.weights[:, of.start, of.start] > 0 for of in self._kinds]
        return np.asarray(np.stack(first, axis=1) * (self.rows.y.shape[1] / len(self.added)))

    @property
    def _of_moments(self) -> Bools:
        """(n,) rows measured by the moments of alpha."""
        return _which(self.frames, lambda one: not one.motion.has_shape)

    @property
    def _in_large_parts(self) -> Bools:
        """(n,) where a part has enough rows in use to find a mistake."""
        counts = np.bincount(self.part, weights=self.used, minlength=1)
        return np.asarray(counts[self.part] >= MIN_FRAMES)

    @property
    def _kinds(self) -> list[slice]:
        """Of the numbers of a row."""
        size = self.rows.y.shape[1] // len(self.added)
        return [slice(size * k, size * (k + 1)) for k in range(len(self.added))]

    def _with_added(self, which: Bools, added: Sequence[float]) -> Measurements:
        """What some rows measured, with errors added to each kind."""
        weights = np.zeros_like(self.rows.weights)
        for of, std in zip(self._kinds, added, strict=True):
            stated = self.rows.weights[which, of, of]
            scale = np.eye(stated.shape[1]) + std**2 * stated
            weights[which, of, of] = np.linalg.solve(scale, stated)
        return replace(self.rows, weights=weights)

    def _compared(self, added: Sequence[float] | None = None) -> tuple[Array, Array]:
        """χ² of kinds about predictions and log determinants, (n, kinds); NaN without."""
        known, added = self.states.known, self.added if added is None else added
        chi2, logs = np.full((2, len(known), len(added)), np.nan)
        chi2[known], logs[known] = 0, 0
        rows = self._with_added(known, added)
        for kind, of in enumerate(self._kinds):
            use, z, S = self._differences(rows, of)
            chi2[use, kind] = np.einsum("ki,ki->k", z, np.linalg.solve(S, z[..., None])[..., 0])
            logs[use, kind] = np.linalg.slogdet(S)[1]
        return chi2, logs

    def _differences(self, rows: Measurements, of: slice) -> tuple[Indices, Array, Array]:
        """The rows that measured a kind, its differences from predictions, and their covariances."""
        use = np.flatnonzero(rows.weights[:, of.start, of.start])
        H, states = rows.H[use, of], self.states
        z = rows.y[use, of] - np.einsum("kms,ks->km", H, states.mean[use])
        R = np.linalg.inv(rows.weights[use, of, of])
        return use, z, R + H @ states.covariance[use] @ H.swapaxes(1, 2)

    def _added_to(self, which: Bools) -> list[float]:
        """Errors of some rows beyond their own that make the reduced χ² of their predictions 1."""
        found, rows = [], self._with_added(which & self.states.known, [0.0 for _ in self.added])
        for of in self._kinds:
            _, z, S = self._differences(rows, of)
            values, vectors = np.linalg.eigh(S)
            z2 = np.einsum("kmi,km->ki", vectors, z) ** 2
            found.append(_added_std(z2, values))
        return found

    def _excess(self, chi2: Array, which: Bools) -> Array:
        """(n,) χ² of some rows over the limit of noise, of the scale of their median; 0 of others."""
        total, freedom = chi2.sum(axis=1), self.measured.sum(axis=1)
        known = which & np.isfinite(total)
        if not known.any():
            return np.zeros(len(total))
        scale = noise_scale(total[known], freedom[known])
        limit = MIN_OUTLIER_PROBABILITY / int(known.sum())
        noise = scale * scipy.special.chdtri(np.maximum(freedom, 1.0), limit)
        return np.where(known, total / noise, 0)


def whole_rows(frames: Sequence[FrameMotion]) -> Bools:
    """(n,) rows that a whole disc explains, without doubts."""
    return _which(frames, lambda one: one.is_whole)


def comparable_rows(frames: Sequence[FrameMotion]) -> Bools:
    """(n,) whole rows; all sound ones if no track has enough of those to compare any."""
    whole, part = whole_rows(frames), parts_of_tracks(frames)
    if np.bincount(part, weights=whole, minlength=1).max() >= _MIN_FRAMES:
        return whole
    return _which(frames, lambda one: one.is_sound)


def _which(frames: Sequence[FrameMotion], test: Callable[[Sighting], bool]) -> Bools:
    """(n,) rows whose detection passes a test."""
    return np.array([row.sighting is not None and test(row.sighting) for row in frames], bool)


def _added_std(z2: Array, variance: Array) -> float:
    """The added error that makes the mean of squared residuals over variances 1; 0 if it is less."""

    def exceeds(added: float) -> bool:
        """Whether the mean is larger with an error added."""
        return bool(z2.size and np.mean(z2 / np.maximum(variance + added**2, 1e-12)) > 1)

    if not exceeds(0.0):
        return 0.0
    low, high = MIN_STD_PX, max(float(np.sqrt(z2.max())), MIN_STD_PX)
    for _ in range(10):  # to a hundredth
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if exceeds(middle) else (low, middle)
    return high

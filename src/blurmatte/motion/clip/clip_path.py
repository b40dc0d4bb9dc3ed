"""ClipPath: the path of an object as one curve over time, of which each frame sees its exposure.

Frame k is exposed from t_k to t_k + d, times in intervals between frames, with one d for the clip. With
c, c′, c″ the curve and its derivatives in the middle of the exposure, frame k alone measures

    its mean position     c + d² c″ / 24,
    its displacement      d c′,

both with their covariance. c is the smoothing spline whose third derivative is white noise
(`smoothing`): a parabola for a fall. Compression and other causes that frames have in common add one
error to all positions, and one to all displacements, the likeliest with Student's t as the distribution
of errors: mistakes have little weight. The errors stated of positions and displacements are at least
those that make the reduced χ² of predictions 1.

Each track has a curve of its own; two other frames determine it, if three of a track have determined d.
The velocity may jump, at a bounce. The curve is broken where that makes the frames decisively likelier,
each predicted from the others of its part, and more so than a mistake in a frame next to the jump does.
A frame that differs from its prediction by more than noise does predicts nothing, and gets a doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from blurmatte.motion.clip.detections import (
    FrameMotion,
    Sighting,
    in_intervals,
    parts_of_tracks,
)
from blurmatte.motion.clip.smoothing import (
    Estimate,
    Measurements,
    SmoothingSettings,
    added_std,
    excess_over_noise,
    factor_of_added,
    in_large_parts,
    least_decades,
    likeliest_intensity,
    student_cost,
    student_inflation,
    student_weights,
    transition,
)
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.model.motion_prior import PathPrior

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_ORDER, _AXES = 3, 2  # value, velocity and acceleration; x and y
_MEDIAN_CHI2 = 3.357  # of four degrees of freedom
_ROUNDS = 3  # of errors and curve at most
_REWEIGHTINGS = 3  # in a round
_BATCHES = 8  # of frames, whose displacements are compared
_MIN_FRAMES = 3  # of a track that determine d: a parabola through their positions


@dataclass(frozen=True, eq=False)
class ClipPath:
    """Path of an object in the frames of a clip, each predicted from the others.

    Parameters
    ----------
    exposure, exposure_std : float
        d and its error, intervals between frames.
    added, added_to_moments : (float, float)
        Errors of positions and of displacements, pixels, beyond those that frames state: of frames
        that a disc explains, and of those measured by the moments of alpha.
    freedom : int
        Degrees of freedom of the frames about the curve.
    states : Estimate
        Of each row from the other rows: position, velocity and acceleration in the middle of its
        exposure, per interval; errors include the added ones.
    chi2 : (n, 2) float
        Of position and displacement of each row, with its own error, about the prediction from the
        others; NaN without one.
    used : (n,) bool
        Rows that predict others.
    contradicts : (n,) bool
        Rows without doubts that differ from the prediction of the others by more than noise does.
    residuals : (n, 2) float
        Norms of position and displacement about that prediction, pixels; NaN without one.
    breaks : tuple of int
        Rows at which a part of the path begins, with a track or after a bounce.
    """

    exposure: float
    exposure_std: float
    added: tuple[float, float]
    added_to_moments: tuple[float, float]
    freedom: int
    states: Estimate
    chi2: Array
    used: Bools
    contradicts: Bools
    residuals: Array
    breaks: tuple[int, ...] = ()

    @classmethod
    def of(cls, rows: Sequence[FrameMotion]) -> ClipPath:
        """The path of the rows of one object, in order of time."""
        fit, seen = _Fit.of(rows), [row.sighting for row in rows]
        whole = fit.used
        if np.bincount(fit.part, weights=fit.used, minlength=1).max() >= _MIN_FRAMES:
            fit = fit.with_noise().converged().broken().without_outliers().converged()
        states, _ = fit.left_out()
        own = replace(fit, added=(0.0, 0.0)).measurements(np.ones(len(rows), bool))
        chi2, _ = _compared(own, states)
        moments = np.array([s is not None and s.source == "moments" for s in seen], bool)
        of_discs = _larger(fit.added, fit.added_to(fit.used))
        of_moments = _larger(of_discs, fit.added_to(moments))  # causes they share
        sound = np.array([s is not None and s.is_sound for s in seen], bool)
        sound &= in_large_parts(fit.used, fit.part)
        of_rest = replace(fit, added=of_moments).measurements(moments & sound)
        excess = fit.excess(_compared(of_rest, states)[0], moments & sound)
        contradicts = (whole & ~fit.used) | (excess > 1)
        return cls(
            fit.exposure, fit.exposure_std, of_discs, of_moments, fit.freedom, states, chi2, fit.used,
            contradicts, _norms_of_residuals(own, states),
            tuple(int(k) for k in np.flatnonzero(np.diff(fit.part)) + 1),
        )  # fmt: skip

    @property
    def birge_ratio(self) -> float:
        """Root of the reduced χ² of the rows that predict others, with their own errors; at least 1."""
        chi2 = self.chi2[self.used]
        known = chi2[np.isfinite(chi2) & (chi2 > 0)]
        return max(float(np.sqrt(known.mean() / 2)), 1.0) if known.size and self.freedom else 1.0

    def factors(self, sighting: Sighting) -> tuple[float, float]:
        """By which the errors of position and of displacement of a detection become those here."""
        place, move = self.added_to_moments if sighting.source == "moments" else self.added
        of_place = factor_of_added(float(np.trace(sighting.covariance)) / 2, place)
        of_move = factor_of_added((sighting.vx_std**2 + sighting.vy_std**2) / 2, move)
        return of_place, of_move

    def doubt(self, row: int) -> str:
        """Why the position or the displacement of a row that contradicts the others may be wrong."""
        kind = int(np.nanargmax(self.chi2[row]))
        return (
            f"Its {('position', 'displacement')[kind]} is {self.residuals[row, kind]:.2g} px off the "
            "path through the other frames: more than noise explains."
        )

    def prior(self, row: int) -> PathPrior | None:
        """Begin, middle and end of the path in a row, as the other rows predict them."""
        if not (self.exposure > 0 and self.states.known[row]):
            return None
        d, x, V = self.exposure, self.states.mean[row], self.states.covariance[row]
        times = (-d / 2, 0.0, d / 2)
        J = np.concatenate([np.eye(2, 6) @ transition(t, _ORDER, _AXES) for t in times])
        by_exposure = np.concatenate([np.sign(t) * (x[2:4] + t * x[4:]) / 2 for t in times])
        covariance = student_inflation(4) * J @ V @ J.T
        covariance += self.exposure_std**2 * np.outer(by_exposure, by_exposure)
        covariance += SmoothingSettings.min_std_px**2 * np.eye(6)
        return PathPrior((J @ x).reshape(3, 2), covariance)


@dataclass(frozen=True, eq=False)
class _Fit:
    """What each row measured, and the curve's constants.

    `part` (n,) numbers the parts between breaks; `used` (n,) are the rows that predict others. Weights
    are inverse covariances, 0 for what was not measured.
    """

    times: Array
    places: Array
    place_weights: Array
    moves: Array  # displacements, in the direction of time
    move_weights: Array
    used: Bools
    part: npt.NDArray[np.int_]
    exposure: float = 0.0
    exposure_std: float = 0.0
    intensity: float = 0.0
    added: tuple[float, float] = (0.0, 0.0)  # standard deviations of positions, displacements
    student_weights: Array | None = None  # (n,) of the rows, where they predict others

    @classmethod
    def of(cls, rows: Sequence[FrameMotion]) -> _Fit:
        """The measurements of rows, those that are whole in use."""
        n, least = len(rows), SmoothingSettings.min_std_px**2 * np.eye(2)
        places, moves = np.zeros((2, n, 2))
        place_weights, move_weights = np.zeros((2, n, 2, 2))
        for k, row in enumerate(rows):
            if (one := row.stated) is not None:
                places[k], moves[k] = one.place, (one.vx, one.vy)
                place_weights[k] = np.linalg.inv(one.covariance + least)
                if one.moved:
                    move_weights[k] = np.linalg.inv(_displacement_covariance(one) + least)
        used = np.array([row.sighting is not None and row.sighting.is_whole for row in rows], bool)
        times, part = np.array(in_intervals(rows), float), parts_of_tracks(rows)
        return cls(times, places, place_weights, moves, move_weights, used, part)

    def measurements(self, used: Bools) -> Measurements:
        """Of the state in the middle of each exposure; without displacements until d is known."""
        n, d = len(self.times), self.exposure
        H, W = np.zeros((n, 4, 6)), np.zeros((n, 4, 4))
        H[:, :2] = np.hstack([np.eye(2), np.zeros((2, 2)), d**2 / 24 * np.eye(2)])
        H[:, 2:, 2:4] = d * np.eye(2)
        W[used, :2, :2] = _with_added(self.place_weights[used], self.added[0])
        if d > 0:
            W[used, 2:, 2:] = _with_added(self.move_weights[used], self.added[1])
        return Measurements(self.times, H, np.hstack([self.places, self.moves]), W, _AXES)

    @property
    def predicting(self) -> Measurements:
        """The measurements that predict others, with their weights."""
        found = self.measurements(self.used)
        if self.student_weights is None:
            return found
        return replace(found, weights=found.weights * self.student_weights[:, None, None])

    def left_out(self) -> tuple[Estimate, Array]:
        """The state in each row from the others of its part, and χ² of its measurements (n, 2)."""
        return self._left_out(self.intensity)[:2]

    def _left_out(self, intensity: float) -> tuple[Estimate, Array, Array]:
        """The same for an intensity of the noise, and the logs of the determinants (n, 2)."""
        n = len(self.times)
        mean, covariance = np.full((n, 6), np.nan), np.full((n, 6, 6), np.nan)
        used = self.predicting
        for part in np.unique(self.part):
            mine = np.flatnonzero(self.part == part)
            found = Estimate.of(used.taken(mine).left_out(intensity))
            mean[mine], covariance[mine] = found.mean, found.covariance
        states = Estimate(mean, covariance)
        return states, *_compared(self.measurements(np.ones(n, bool)), states)

    def with_intensity(self) -> _Fit:
        """With the intensity for which the frames are likeliest when the others predict them."""
        return replace(self, intensity=likeliest_intensity(self._cost))

    def with_noise(self) -> _Fit:
        """With the intensity and the added errors for which the frames are likeliest."""
        settings = SmoothingSettings
        ranges = settings.intensity_decades, settings.added_decades, settings.added_decades
        start = np.log10(
            np.maximum([self.intensity or 1.0, *(a or 1.0 for a in self.added)], 1e-30)
        )
        return self._with_decades(
            least_decades(lambda x: self._with_decades(x)._cost(scaled=False), start, ranges)
        )

    def _with_decades(self, x: Array) -> _Fit:
        """With an intensity and added errors, powers of ten."""
        intensity, place, move = (10.0**x).tolist()
        return replace(self, intensity=intensity, added=(place, move))

    def reweighted(self) -> _Fit:
        """With Student-t weights of the rows, from their residuals about the others."""
        fit = self
        for _ in range(_REWEIGHTINGS):
            chi2 = fit.left_out()[1].sum(axis=1)
            known = fit.used & np.isfinite(chi2)
            weights = np.ones(len(chi2))
            weights[known] = student_weights(chi2[known], fit._measured[known].sum(axis=1))
            fit = replace(fit, student_weights=weights)
        return fit

    def converged(self) -> _Fit:
        """With weights, d and noise that agree."""
        fit = self
        for _ in range(_ROUNDS):
            before, fit = fit, fit.reweighted().with_exposure().with_noise()
            if (fit.intensity, fit.added) == (before.intensity, before.added):
                break
        return fit

    def _cost(
        self, intensity: float | None = None, of: Bools | None = None, scaled: bool = True
    ) -> float:
        """Negative log likelihood of rows, if not given of those in use, from the others."""
        states, chi2, logs = self._left_out(self.intensity if intensity is None else intensity)
        known = (self.used if of is None else of) & states.known
        if not known.any():
            return np.inf
        freedom = self._measured[known].sum(axis=1)
        return student_cost(chi2[known].sum(axis=1), logs[known].sum(axis=1), freedom, scaled)

    @property
    def _measured(self) -> Array:
        """(n, 2) numbers that a row measured of position and displacement."""
        moved = (self.move_weights[:, 0, 0] > 0) & (self.exposure > 0)
        return np.stack([2.0 * (self.place_weights[:, 0, 0] > 0), 2.0 * moved], axis=1)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the frames about the curve."""
        used = self.used & self.left_out()[0].known
        fitted = 6 * len(np.unique(self.part[used])) + 2  # states; d and the intensity
        return max(int(self._measured[used].sum()) - fitted, 0)

    def added_to(self, which: Bools) -> tuple[float, float]:
        """Errors of positions and displacements of some rows beyond their own [Paule, Mandel 1982]."""
        states, found = self.left_out()[0], []
        rows = replace(self, added=(0.0, 0.0)).measurements(which & states.known)
        for kind in range(2):
            use = np.flatnonzero(rows.weights[:, 2 * kind, 2 * kind])
            z, S = _residuals(rows, states, use, slice(2 * kind, 2 * kind + 2))
            values, vectors = np.linalg.eigh(S)
            z2 = np.einsum("kmi,km->ki", vectors, z) ** 2
            found.append(
                added_std(partial(_mean_ratio, z2, values), float(z2.max(initial=0)) ** 0.5)
            )
        return found[0], found[1]

    def with_exposure(self) -> _Fit:
        """With the likeliest d, and displacements in the direction of the curve."""
        places_alone = replace(self, move_weights=np.zeros_like(self.move_weights))
        L, v = places_alone.predicting.information
        others = [np.zeros_like(L), np.zeros_like(v)]
        for part in np.unique(self.part):
            mine = np.flatnonzero(self.part == part)
            kept = places_alone.predicting.taken(mine)
            for total, found in zip(others, kept.left_out(self.intensity), strict=True):
                total[mine] = found
        states = Estimate.of((L + others[0], v + others[1]))
        known = self.used & states.known & (self.move_weights[:, 0, 0] > 0)
        if not known.any():
            return self
        velocity, V = states.mean[known, 2:4], states.covariance[known, 2:4, 2:4]
        forward = np.sign(np.einsum("ki,ki->k", self.moves[known], velocity))
        moves = self.moves.copy()
        moves[known] *= np.where(forward == 0, 1, forward)[:, None]
        own = np.linalg.inv(_with_added(self.move_weights[known], self.added[1]))
        d = self.exposure or float(np.median(_norms(moves[known]) / _norms(velocity)))
        weights = np.linalg.inv(own + d**2 * V)
        if self.student_weights is not None:
            weights *= self.student_weights[known, None, None]
        curvature = np.einsum("ki,kij,kj->k", velocity, weights, velocity)
        slope = np.einsum("ki,kij,kj->k", velocity, weights, moves[known])
        d, std = _from_batches(slope, curvature)
        return replace(self, moves=moves, exposure=d, exposure_std=std)

    def broken(self) -> _Fit:
        """With parts between jumps of the velocity: those that make the frames decisively likelier.

        A mistake next to a jump explains it too: the likelier one is taken.
        """
        fit, part, rows = self, 0, np.arange(len(self.times))
        while part <= fit.part.max():
            at = fit._largest_jump(part)
            if at is not None:
                later = (fit.part > part) | ((fit.part == part) & (rows >= at))
                found = [replace(fit, part=fit.part + later).reweighted().with_intensity()]
                if fit._gain(found[0]) > DECISIVE_LOG_BAYES_FACTOR:
                    found += [fit._without(row) for row in fit._beside(at)]
                    fit = max(found, key=fit._gain)
                    continue
            part += 1
        return fit

    def _gain(self, other: _Fit) -> float:
        """By how much the rows in use are likelier by another fit, log."""
        return self._cost(self.intensity) - other._cost(other.intensity, self.used)

    def _without(self, row: int) -> _Fit:
        """With a row that predicts nothing."""
        used = self.used.copy()
        used[row] = False
        return replace(self, used=used).reweighted().with_intensity()

    def _beside(self, at: int) -> list[int]:
        """The rows in use before and after the beginning of a row."""
        before, after = (np.flatnonzero(self.used[part]) for part in (slice(at), slice(at, None)))
        return [int(before[-1]), int(at + after[0])]

    def _largest_jump(self, part: int) -> int | None:
        """The row within a part before which the rows on both sides differ most about the state."""
        mine = np.flatnonzero((self.part == part) & self.used)
        least = SmoothingSettings.min_frames
        if len(mine) < 2 * least:
            return None
        one = self.predicting.taken(mine)
        before, after = one.from_each_side(self.intensity)
        jumps = np.full(len(mine), -np.inf)
        for k in range(least, len(mine) - least + 1):
            if before.known[k] and after.known[k]:
                jump = before.mean[k] - after.mean[k]
                V = before.covariance[k] + after.covariance[k]
                jumps[k] = float(jump @ np.linalg.solve(V, jump))
        return int(mine[np.argmax(jumps)])

    def without_outliers(self) -> _Fit:
        """Without frames that differ from their prediction by more than noise does."""
        large = self.used & in_large_parts(self.used, self.part)
        excess = self.excess(self.left_out()[1], large)
        return replace(self, used=self.used & (excess <= 1))

    def excess(self, chi2: Array, which: Bools) -> Array:
        """(n,) χ² of some rows over the limit of noise; 0 of others."""
        freedom = self._measured.sum(axis=1)
        return excess_over_noise(chi2.sum(axis=1), freedom, which, _MEDIAN_CHI2)


def _displacement_covariance(one: Sighting) -> Array:
    """(2, 2) from the errors of length and angle."""
    c, s, L = np.cos(one.angle), np.sin(one.angle), one.length
    J = np.array([[c, -L * s], [s, L * c]])
    return np.asarray((J * np.array([one.length_std, one.angle_std]) ** 2) @ J.T)


def _compared(rows: Measurements, states: Estimate) -> tuple[Array, Array]:
    """χ² of positions and displacements about predictions and log determinants, (n, 2); NaN without."""
    chi2, logs = np.full((2, len(rows.times), 2), np.nan)
    chi2[states.known], logs[states.known] = 0, 0
    for kind, m in enumerate((slice(0, 2), slice(2, 4))):
        use = np.flatnonzero(states.known & (rows.weights[:, m, m][:, 0, 0] > 0))
        z, S = _residuals(rows, states, use, m)
        chi2[use, kind] = np.einsum("ki,ki->k", z, np.linalg.solve(S, z[..., None])[..., 0])
        logs[use, kind] = np.linalg.slogdet(S)[1]
    return chi2, logs


def _norms_of_residuals(rows: Measurements, states: Estimate) -> Array:
    """Of positions and displacements about predictions, (n, 2); NaN without."""
    z = rows.y - np.einsum("kms,ks->km", rows.H, states.mean)
    return np.asarray(np.linalg.norm(z.reshape(-1, 2, 2), axis=2))


def _residuals(
    rows: Measurements, states: Estimate, use: npt.NDArray[np.intp], of: slice
) -> tuple[Array, Array]:
    """Of some numbers of some rows about predictions (k, 2), and their covariances (k, 2, 2)."""
    H = rows.H[use, of]
    z = rows.y[use, of] - np.einsum("kms,ks->km", H, states.mean[use])
    R = np.linalg.inv(rows.weights[use, of, of])
    return z, R + H @ states.covariance[use] @ H.swapaxes(1, 2)


def _mean_ratio(z2: Array, variance: Array, added: float) -> float:
    """Mean of squared residuals over their variances with an error added; 0 without any."""
    return float(np.mean(z2 / np.maximum(variance + added**2, 1e-12))) if z2.size else 0.0


def _larger(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return max(one[0], other[0]), max(one[1], other[1])


def _norms(vectors: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(vectors, axis=1), 1e-9))


def _with_added(weights: Array, std: float) -> Array:
    """Inverse covariances (n, 2, 2) with an error added to both axes; 0 where they were 0."""
    scale = np.eye(2) + std**2 * weights
    return np.asarray(np.linalg.solve(scale, weights))


def _from_batches(slope: Array, curvature: Array) -> tuple[float, float]:
    """The mean of slope / curvature and its error, from batches of frames if they scatter more.

    Errors of the displacements correlate in time, as the speed does.
    """
    d, std = float(slope.sum() / curvature.sum()), float(curvature.sum() ** -0.5)
    edges = np.linspace(0, len(slope), _BATCHES + 1).astype(int)[:-1]
    if len(slope) < 2 * _BATCHES:
        return d, std
    slopes, curvatures = (np.add.reduceat(values, edges) for values in (slope, curvature))
    chi2 = float(np.sum(curvatures * (slopes / curvatures - d) ** 2)) / (_BATCHES - 1)
    return d, std * max(chi2, 1.0) ** 0.5

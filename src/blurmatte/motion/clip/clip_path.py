"""ClipPath and ClipRadius: path and radius of an object as curves over time, seen by each exposure.

Frame k is exposed from t_k to t_k + d, times in intervals between frames, with one d for the clip. With
c, c′, c″ the curve and its derivatives in the middle of the exposure, frame k alone measures

    its mean position     c + d² c″ / 24,
    its displacement      d c′,

both with their covariance. c (`robust_curve`) has white noise as its third derivative: it is a parabola
for a fall. Two other frames of a track determine it, if three of a track have determined d.

The velocity may jump, at a bounce. The curve is broken where that makes the frames decisively likelier,
each predicted from the others of its part, and more so than a mistake in a frame next to the jump does.

The radius is a curve with white noise as its second derivative: a line for an object that comes nearer
at a constant speed. Two other frames of a track determine it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blurmatte.checks import Array, Bools
from blurmatte.motion.clip.detections import FrameMotion, Sighting, in_intervals, parts_of_tracks
from blurmatte.motion.clip.robust_curve import MIN_FRAMES, RobustCurve, whole_rows
from blurmatte.motion.clip.smoothing import MIN_STD_PX, Measurements, student_inflation, transition
from blurmatte.motion.picture.motion import Motion
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.model.priors import MotionPrior, PathPrior

_ORDER, _AXES = 3, 2  # value, velocity and acceleration; x and y
_RADIUS_ORDER = 2  # value and slope
_BATCHES = 8  # of frames, whose displacements are compared


@dataclass(frozen=True, eq=False)
class ClipPath(RobustCurve):
    """Path of an object in the frames of a clip, each predicted from the others.

    Rows measure position and displacement; the state is position, velocity and acceleration in the
    middle of the exposure, per interval.

    Parameters
    ----------
    exposure, exposure_std : float
        d and its error, intervals between frames; 0 as long as it is not known.
    move_weights : (n, 2, 2) float
        Inverse covariances of displacements, 0 for what was not measured; in `rows` if d is known.
    """

    exposure: float = 0.0
    exposure_std: float = 0.0
    move_weights: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))

    @classmethod
    def of(cls, frames: Sequence[FrameMotion], used: Bools | None = None) -> ClipPath:
        """The path of the rows of one object, in order of time; if not given, whole discs predict."""
        n, least = len(frames), MIN_STD_PX**2 * np.eye(2)
        y, H = np.zeros((n, 4)), np.tile(np.eye(4, 6), (n, 1, 1))
        W, move_weights = np.zeros((n, 4, 4)), np.zeros((n, 2, 2))
        for k, row in enumerate(frames):
            if (one := row.stated) is not None:
                y[k] = *one.motion.center, *one.velocity
                W[k, :2, :2] = np.linalg.inv(one.motion.center_covariance + least)
                if one.moved:
                    move_weights[k] = np.linalg.inv(_displacement_covariance(one.motion) + least)
        rows = Measurements(np.array(in_intervals(frames), float), H, y, W, _AXES)
        part, used = parts_of_tracks(frames), whole_rows(frames) if used is None else used
        curve = cls(tuple(frames), rows, part, used, (0.0, 0.0), move_weights=move_weights)
        return curve.fitted()

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the frames about the curve."""
        used = self.used & self.states.known
        fitted = 6 * len(np.unique(self.part[used])) + 2  # states; d and the intensity
        return max(int(self.measured[used].sum()) - fitted, 0)

    @property
    def birge_ratio(self) -> float:
        """Root of the reduced χ² of the rows that predict others, with their own errors; at least 1."""
        chi2 = self.chi2[self.used]
        known = chi2[np.isfinite(chi2) & (chi2 > 0)]
        return max(float(np.sqrt(known.mean() / 2)), 1.0) if known.size and self.freedom else 1.0

    def factors(self, sighting: Sighting) -> tuple[float, float]:
        """By which the errors of position and of displacement of a detection become those here."""
        of_place = float(np.trace(sighting.motion.center_covariance)) / 2
        of_move = float(np.sum(sighting.velocity_std**2)) / 2
        place, move = self.factors_of(sighting, [of_place, of_move])
        return place, move

    def doubt(self, row: int) -> str:
        """Why the position or the displacement of a row that contradicts the others may be wrong."""
        kind = int(np.nanargmax(self.chi2[row]))
        return (
            f"Its {('position', 'displacement')[kind]} is {self.residuals[row, kind]:.2g} px off the "
            "path through the other frames: more than noise explains."
        )

    def prior(self, row: int, delay_std: float = 0.0) -> PathPrior | None:
        """Begin, middle and end of the path in a row, as the other rows predict them.

        delay_std: error of the time of the row, intervals between frames.
        """
        if not (self.exposure > 0 and self.states.known[row]):
            return None
        d, x, V = self.exposure, self.states.mean[row], self.states.covariance[row]
        times = (-d / 2, 0.0, d / 2)
        J = np.concatenate([np.eye(2, 6) @ transition(t, _ORDER, _AXES) for t in times])
        by_exposure = np.concatenate([np.sign(t) * (x[2:4] + t * x[4:]) / 2 for t in times])
        covariance = student_inflation(4) * J @ V @ J.T
        covariance += self.exposure_std**2 * np.outer(by_exposure, by_exposure)
        by_time = np.concatenate([x[2:4] + t * x[4:] for t in times])
        covariance += delay_std**2 * np.outer(by_time, by_time)
        covariance += MIN_STD_PX**2 * np.eye(6)
        return PathPrior((J @ x).reshape(3, 2), covariance)

    def revised(self) -> ClipPath:
        """With the likeliest d, and displacements in the direction of the curve."""
        places = self.predicting
        places.weights[:, 2:, 2:] = 0
        states = self.smoothed(places, with_own=True)
        known = self.used & states.known & (self.move_weights[:, 0, 0] > 0)
        if not known.any():
            return self
        velocity, V = states.mean[known, 2:4], states.covariance[known, 2:4, 2:4]
        y = self.rows.y.copy()
        forward = np.sign(np.einsum("ki,ki->k", y[known, 2:], velocity))
        y[known, 2:] *= np.where(forward == 0, 1, forward)[:, None]
        moves = y[known, 2:]
        own = np.linalg.inv(self.move_weights[known]) + self.added[1] ** 2 * np.eye(2)
        d = self.exposure or float(np.median(_norms(moves) / _norms(velocity)))
        weights = np.linalg.inv(own + d**2 * V)
        if self.student_weights is not None:
            weights *= self.student_weights[known, None, None]
        curvature = np.einsum("ki,kij,kj->k", velocity, weights, velocity)
        slope = np.einsum("ki,kij,kj->k", velocity, weights, moves)
        d, std = _from_batches(slope, curvature)
        H, W = self.rows.H.copy(), self.rows.weights.copy()
        H[:, :2, 4:], H[:, 2:, 2:4] = d**2 / 24 * np.eye(2), d * np.eye(2)
        W[:, 2:, 2:] = self.move_weights
        rows = replace(self.rows, H=H, y=y, weights=W)
        return replace(self, rows=rows, exposure=d, exposure_std=std)

    def broken(self) -> ClipPath:
        """With parts between jumps of the velocity: those that make the frames decisively likelier.

        A mistake next to a jump explains it too: the likelier one is taken.
        """
        fit, part, rows = self, 0, np.arange(len(self.part))
        while part <= fit.part.max():
            at = fit._largest_jump(part)
            if at is not None:
                later = (fit.part > part) | ((fit.part == part) & (rows >= at))
                found = [replace(fit, part=fit.part + later).reweighted().with_noise()]
                if fit._gain(found[0]) > DECISIVE_LOG_BAYES_FACTOR:
                    found += [fit._without(row) for row in fit._beside(at)]
                    fit = max(found, key=fit._gain)
                    continue
            part += 1
        return fit

    def _gain(self, other: ClipPath) -> float:
        """By how much the rows in use are likelier by another fit, log."""
        return self.cost() - other.cost(self.used)

    def _without(self, row: int) -> ClipPath:
        """With a row that predicts nothing."""
        used = self.used.copy()
        used[row] = False
        return replace(self, used=used).reweighted().with_noise()

    def _beside(self, at: int) -> list[int]:
        """The rows in use before and after the beginning of a row."""
        before, after = (np.flatnonzero(self.used[of]) for of in (slice(at), slice(at, None)))
        return [int(before[-1]), int(at + after[0])]

    def _largest_jump(self, part: int) -> int | None:
        """The row within a part before which the rows on both sides differ most about the state."""
        mine = np.flatnonzero((self.part == part) & self.used)
        if len(mine) < 2 * MIN_FRAMES:
            return None
        one = self.predicting.taken(mine)
        before, after = one.from_each_side(self.intensity)
        jumps = np.full(len(mine), -np.inf)
        for k in range(MIN_FRAMES, len(mine) - MIN_FRAMES + 1):
            if before.known[k] and after.known[k]:
                jump = before.mean[k] - after.mean[k]
                V = before.covariance[k] + after.covariance[k]
                jumps[k] = float(jump @ np.linalg.solve(V, jump))
        return int(mine[np.argmax(jumps)])


def _displacement_covariance(one: Motion) -> Array:
    """(2, 2) from the errors of length and angle."""
    c, s, L = np.cos(one.angle), np.sin(one.angle), one.length
    J = np.array([[c, -L * s], [s, L * c]])
    return np.asarray((J * np.array([one.length_std, one.angle_std]) ** 2) @ J.T)


def _norms(vectors: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(vectors, axis=1), 1e-9))


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


@dataclass(frozen=True, eq=False)
class ClipRadius(RobustCurve):
    """Radius of an object in the frames of a clip, each predicted from the others."""

    @classmethod
    def of(cls, frames: Sequence[FrameMotion]) -> ClipRadius:
        """The radius in the rows of one object, in order of time."""
        n = len(frames)
        radii, weights = np.zeros((n, 1)), np.zeros((n, 1, 1))
        for k, row in enumerate(frames):
            if (one := row.stated) is not None:
                radii[k] = one.motion.radius
                weights[k] = 1 / (one.motion.radius_std**2 + MIN_STD_PX**2)
        H = np.tile(np.eye(1, _RADIUS_ORDER), (n, 1, 1))
        rows = Measurements(np.array(in_intervals(frames), float), H, radii, weights, 1)
        used = whole_rows(frames)
        return cls(tuple(frames), rows, parts_of_tracks(frames), used, (0.0,)).fitted()

    @property
    def common_std(self) -> float:
        """Error of one frame, pixels, which all may have in common.

        Compression and lens may shift all radii alike.
        """
        variances = 1 / self.rows.weights[self.used, 0, 0] + self.added_to_discs[0] ** 2
        return float(np.sqrt(np.median(variances))) if variances.size else np.inf

    def factor(self, sighting: Sighting) -> float:
        """By which the error of the radius of a detection becomes that here."""
        return self.factors_of(sighting, [sighting.motion.radius_std**2])[0]

    def doubt(self, row: int) -> str:
        """Why the radius of a row that contradicts the others may be wrong."""
        return (
            f"Its radius is {self.residuals[row, 0]:.2g} px off a smooth change through the other "
            "frames: more than noise explains."
        )

    def predicted(self, row: int) -> tuple[float, float] | None:
        """The radius in a row and its error, pixels, as the other rows predict them."""
        radius, variance = self.states.mean[row, 0], self.states.covariance[row, 0, 0]
        std = float(np.sqrt(student_inflation(1) * variance + self.common_std**2))
        return (float(radius), std) if radius > 0 and np.isfinite(std) else None


def with_priors(
    rows: Sequence[FrameMotion], delay_std: float = 0.0
) -> tuple[list[FrameMotion], Bools]:
    """The rows of one object, each with what the others predict; and whether it predicts others.

    A prior has the radius and the path; None if too few rows predict them.

    delay_std: error of the times of the rows, intervals between frames.
    """
    path, size, found = ClipPath.of(rows), ClipRadius.of(rows), list[FrameMotion]()
    for k, row in enumerate(rows):
        prior, radius = None, size.predicted(k)
        if radius is not None:
            prior = MotionPrior(*radius, path.prior(k, delay_std), scatter=path.birge_ratio)
        found.append(replace(row, prior=prior))
    return found, path.used


def mistake_probability(seen: Sequence[Sighting]) -> float:
    """That a detection that seems to show a whole disc misleads: as often as they have doubts.

    By the rule of succession, so that it is neither 0 nor 1.
    """
    discs = [one for one in seen if one.motion.has_shape and not one.motion.at_border]
    return (sum(bool(one.motion.doubts) for one in discs) + 1) / (len(discs) + 2)

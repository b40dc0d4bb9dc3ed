"""ClipRadius: the radius of an object as a curve over time, each frame predicted from the others.

The curve is the smoothing spline whose second derivative is white noise (`smoothing`): a line for an
object that comes nearer at a constant speed. Each track has a curve of its own, which two other frames
determine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    likeliest_intensity,
    student_cost,
)

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_ORDER = 2  # value and slope
_MEDIAN_CHI2 = 0.4549  # of one degree of freedom
_ROUNDS = 3  # of error and curve at most


@dataclass(frozen=True, eq=False)
class ClipRadius:
    """Radius of an object in the frames of a clip, each predicted from the others.

    Parameters
    ----------
    added, added_to_moments : float
        Error, pixels, beyond those that frames state: of frames that a disc explains, and of those
        measured by the moments of alpha.
    common_std : float
        Error of one frame, pixels, which all may have in common: compression and lens may shift all
        radii alike.
    mean, std : (n,) float
        In each row from the other rows, and its error without the common one; NaN without others.
    chi2 : (n,) float
        Of each row, with its own error, about the prediction from the others; NaN without one.
    used : (n,) bool
        Rows that predict others.
    contradicts : (n,) bool
        Rows without doubts that differ from the prediction of the others by more than noise does.
    residuals : (n,) float
        From that prediction, pixels; NaN without one.
    """

    added: float
    added_to_moments: float
    common_std: float
    mean: Array
    std: Array
    chi2: Array
    used: Bools
    contradicts: Bools
    residuals: Array

    @classmethod
    def of(cls, rows: Sequence[FrameMotion]) -> ClipRadius:
        """The radius in the rows of one object, in order of time."""
        fit, seen = _Fit.of(rows).with_intensity(), [row.sighting for row in rows]
        whole = fit.used
        fit = fit.without_outliers()
        for _ in range(_ROUNDS):
            before, fit = fit, fit.with_added()
            if fit.added == before.added:
                break
            fit = fit.with_intensity()
        states = fit.left_out()
        chi2, _ = replace(fit, added=0.0).compared(states)
        moments = np.array([s is not None and s.source == "moments" for s in seen], bool)
        of_moments = max(fit.added, fit.added_to(moments))
        sound = np.array([s is not None and s.is_sound for s in seen], bool)
        sound &= moments & in_large_parts(fit.used, fit.part)
        of_rest = replace(fit, added=of_moments).compared(states)[0]
        contradicts = (whole & ~fit.used) | (fit.excess(of_rest, sound) > 1)
        common = float(np.median(fit.variances[fit.used])) if fit.used.any() else np.inf
        return cls(
            fit.added, of_moments, float(np.sqrt(common)), states.mean[:, 0],
            np.sqrt(states.covariance[:, 0, 0]), chi2, fit.used, contradicts,
            fit._residuals,
        )  # fmt: skip

    def factor(self, sighting: Sighting) -> float:
        """By which the error of the radius of a detection becomes that here."""
        added = self.added_to_moments if sighting.source == "moments" else self.added
        return factor_of_added(sighting.radius_std**2, added)

    def doubt(self, row: int) -> str:
        """Why the radius of a row that contradicts the others may be wrong."""
        return (
            f"Its radius is {self.residuals[row]:.2g} px off a smooth change through the other "
            "frames: more than noise explains."
        )

    def predicted(self, row: int) -> tuple[float, float] | None:
        """The radius in a row and its error, pixels, as the other rows predict them."""
        radius, std = float(self.mean[row]), float(np.hypot(self.std[row], self.common_std))
        return (radius, std) if radius > 0 and np.isfinite(std) else None


@dataclass(frozen=True, eq=False)
class _Fit:
    """What each row measured, and the curve's constants; `used` (n,) are the rows that predict others.

    Weights are inverse variances, 0 for what was not measured.
    """

    times: Array
    radii: Array
    weights: Array
    used: Bools
    part: npt.NDArray[np.int_]
    intensity: float = 0.0
    added: float = 0.0  # standard deviation

    @classmethod
    def of(cls, rows: Sequence[FrameMotion]) -> _Fit:
        """The measurements of rows, those that are whole in use."""
        radii, weights = np.zeros((2, len(rows)))
        for k, row in enumerate(rows):
            if (one := row.stated) is not None:
                radii[k] = one.radius
                weights[k] = 1 / (one.radius_std**2 + SmoothingSettings.min_std_px**2)
        used = np.array([row.sighting is not None and row.sighting.is_whole for row in rows], bool)
        times = np.array(in_intervals(rows), float)
        return cls(times, radii, weights, used, parts_of_tracks(rows))

    @property
    def variances(self) -> Array:
        """(n,) with the added error; infinite for what was not measured."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.weights + self.added**2)

    def left_out(self, intensity: float | None = None) -> Estimate:
        """The state in each row from the others of its part."""
        n, q = len(self.times), self.intensity if intensity is None else intensity
        mean, covariance = np.full((n, _ORDER), np.nan), np.full((n, _ORDER, _ORDER), np.nan)
        H = np.tile(np.eye(1, _ORDER), (n, 1, 1))
        weights = np.where(self.used, 1 / self.variances, 0)[:, None, None]
        rows = Measurements(self.times, H, self.radii[:, None], weights, 1)
        for part in np.unique(self.part):
            mine = np.flatnonzero(self.part == part)
            found = Estimate.of(rows.taken(mine).left_out(q))
            mean[mine], covariance[mine] = found.mean, found.covariance
        return Estimate(mean, covariance)

    def compared(self, states: Estimate) -> tuple[Array, Array]:
        """(n,) χ² of radii about predictions, and logs of their variances; NaN without."""
        variance = self.variances + states.covariance[:, 0, 0]
        variance[~np.isfinite(variance)] = np.nan
        return (self.radii - states.mean[:, 0]) ** 2 / variance, np.log(variance)

    def with_intensity(self) -> _Fit:
        """With the intensity for which the frames are likeliest when the others predict them."""
        return replace(self, intensity=likeliest_intensity(self._cost))

    def _cost(self, intensity: float) -> float:
        """Negative log likelihood of the rows in use from the others."""
        chi2, logs = self.compared(self.left_out(intensity))
        known = self.used & np.isfinite(chi2)
        if not known.any():
            return np.inf
        return student_cost(chi2[known], logs[known], np.ones(int(known.sum())))

    def with_added(self) -> _Fit:
        """With the error by which the rows in use scatter beyond their own [Paule, Mandel 1982].

        It is an error of the predictions too.
        """
        largest = float(np.nanmax(self._residuals[self.used], initial=0.0))
        return replace(self, added=added_std(self._reduced_chi2, largest))

    def _reduced_chi2(self, added: float) -> float:
        """Of the rows in use with another added error."""
        fit = replace(self, added=added)
        chi2 = fit.compared(fit.left_out())[0][self.used]
        chi2 = chi2[np.isfinite(chi2)]
        return float(chi2.mean()) if chi2.size else 0.0

    @property
    def _residuals(self) -> Array:
        """(n,) of the radii from their predictions, pixels."""
        return np.abs(self.radii - self.left_out().mean[:, 0])

    def added_to(self, which: Bools) -> float:
        """Error of the radii of rows that are not in use, beyond their own."""
        variance = replace(self, added=0.0).variances + self.left_out().covariance[:, 0, 0]
        known, residuals = which & np.isfinite(variance), self._residuals
        if not known.any():
            return 0.0

        def reduced_chi2(added: float) -> float:
            """With this error."""
            return float(np.mean(residuals[known] ** 2 / (variance[known] + added**2)))

        return added_std(reduced_chi2, float(residuals[known].max()))

    def without_outliers(self) -> _Fit:
        """Without frames that differ from their prediction by more than noise does."""
        fit = self
        for _ in range(int(self.used.sum())):
            large = fit.used & in_large_parts(fit.used, fit.part)
            excess = fit.excess(fit.compared(fit.left_out())[0], large)
            worst = int(np.argmax(excess))
            if excess[worst] < 1:
                break
            used = fit.used.copy()
            used[worst] = False
            fit = replace(fit, used=used).with_intensity()
        return fit

    def excess(self, chi2: Array, which: Bools) -> Array:
        """(n,) χ² of some rows over the limit of noise; 0 of others."""
        return excess_over_noise(chi2, np.ones(len(chi2)), which, _MEDIAN_CHI2)

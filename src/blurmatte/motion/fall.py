"""fit_fall: do the places of a clip lie on the parabola of a free flight?

x(t) = x₀ + v t + a t² / 2 for both coordinates, by least squares, each place weighted by its inverse
covariance. A mean place over an exposure lies a T² / 24 beside the place in its middle, T the
exposure time, which is alike in all frames and changes x₀ alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.errors import MotionError
from blurmatte.motion.linking import FrameMotion, main_track
from blurmatte.motion.sightings import Sighting
from blurmatte.motion.units import Scale

Array = npt.NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # m/s² [3rd CGPM, 1901]
_LEAST = 4  # places: with three any parabola fits
_BEST = 1e-3  # pixels: no center is known better
_UNLIKELY = 1e-3  # of χ²: noise alone does that in one of a thousand clips


@dataclass(frozen=True, eq=False)
class FreeFall:
    """A parabola in time through the places of one track.

    Parameters
    ----------
    place, velocity, acceleration : (2,) float
        At `time`; pixels, per second and second².
    acceleration_covariance : (2, 2) float
    time : float
        Middle of the times, seconds.
    chi2 : float
        Sum of the squared residuals over their errors.
    freedom : int
        How many of them are free.
    likely : float
        How often noise alone would leave as much.
    scale : Scale, optional
        Meters per pixel where it flew.
    """

    place: Array
    velocity: Array
    acceleration: Array
    acceleration_covariance: Array
    time: float
    chi2: float
    freedom: int
    likely: float
    scale: Scale | None = None

    @property
    def fits(self) -> bool:
        """Whether a parabola explains the places within their errors."""
        return self.likely > _UNLIKELY

    @property
    def size(self) -> float:
        """Of the acceleration, pixels per second²."""
        return float(np.linalg.norm(self.acceleration))

    @property
    def size_std(self) -> float:
        """Its standard deviation."""
        u = self.acceleration / max(self.size, 1e-12)
        return float(np.sqrt(u @ self.acceleration_covariance @ u))

    def numbers(self) -> dict[str, float | int | bool | None]:
        """All by name, flat; with a scale in m/s² too."""
        std = np.sqrt(np.diag(self.acceleration_covariance))
        told: dict[str, float | int | bool | None] = {
            "acceleration_x": float(self.acceleration[0]),
            "acceleration_x_std": float(std[0]),
            "acceleration_y": float(self.acceleration[1]),
            "acceleration_y_std": float(std[1]),
            "acceleration": self.size,
            "acceleration_std": self.size_std,
            "chi2": self.chi2,
            "degrees_of_freedom": self.freedom,
            "likely": self.likely,
            "fits": self.fits,
        }
        if self.scale is not None:
            g, std_g = self.in_meters(self.scale)
            told |= {"acceleration_in_m_per_s2": g, "acceleration_in_m_per_s2_std": std_g}
        return told

    def in_meters(self, scale: Scale) -> tuple[float, float]:
        """The acceleration's size and its error, m/s²."""
        g = self.size * scale.meters_per_pixel
        relative = np.hypot(
            self.size_std / max(self.size, 1e-12), scale.std / scale.meters_per_pixel
        )
        return g, float(g * relative)


def fit_fall(rows: Sequence[FrameMotion], scale: Scale | None = None) -> FreeFall:
    """Fit a parabola in time to the longest track, as a check: a free flight is one.

    Parameters
    ----------
    rows : sequence of FrameMotion
        Of `measure_clip` or `link_sightings`; frames of the flight alone.
    scale : Scale, optional
        For an acceleration in m/s² too.

    Returns
    -------
    FreeFall

    Raises
    ------
    MotionError
        If it has fewer than four frames, or their times are not known.
    """
    from scipy.stats import chi2 as of_noise

    track = main_track(rows)
    if len(track) < _LEAST:
        raise MotionError(f"a fall needs {_LEAST} frames of one track, got {len(track)}")
    times = np.array([np.nan if row.time is None else row.time for row in track])
    if not np.all(np.isfinite(times)):
        raise MotionError("the frames do not tell their times; give the rate, frames per second")
    middle = float(times.mean())
    t = times - middle
    H, g = np.zeros((6, 6)), np.zeros(6)
    for row, moment in zip(track, t, strict=True):
        assert row.sighting is not None
        J = np.kron(np.array([1, moment, moment**2 / 2]), np.eye(2))
        W = np.linalg.inv(_known(row.sighting))
        H, g = H + J.T @ W @ J, g + J.T @ W @ row.sighting.place
    found = np.asarray(np.linalg.solve(H, g), float)
    left = _left(track, t, found)
    freedom = 2 * len(track) - 6
    return FreeFall(
        found[:2],
        found[2:4],
        found[4:],
        np.asarray(np.linalg.inv(H)[4:, 4:], float),
        middle,
        left,
        freedom,
        float(of_noise.sf(left, freedom)),
        scale,
    )


def _known(sighting: Sighting) -> Array:
    return np.asarray(sighting.covariance + _BEST**2 * np.eye(2))


def _left(track: Sequence[FrameMotion], t: Array, found: Array) -> float:
    """χ²."""
    total = 0.0
    for row, moment in zip(track, t, strict=True):
        assert row.sighting is not None
        r = row.sighting.place - (found[:2] + found[2:4] * moment + found[4:] * moment**2 / 2)
        total += float(r @ np.linalg.solve(_known(row.sighting), r))
    return total


def fall_in_words(fall: FreeFall) -> list[str]:
    """Whether it was a free fall, in sentences."""
    times = fall.chi2 / fall.freedom
    left = f"a parabola in time through its places leaves {times:.2g} times their variance"
    if not fall.fits:
        return [
            f"It is not as a free fall would be: {left}. It was held, hit or slowed by air, it came "
            "nearer, or errors are larger than stated."
        ]
    degrees = np.degrees(np.arctan2(*fall.acceleration[::-1]))
    said = [
        f"It is as a free fall would be: {left}, as noise does. Its acceleration is {fall.size:.4g} ± "
        f"{fall.size_std:.2g} px/s², at {degrees:.1f}° (from right towards down)."
    ]
    if fall.scale is not None:
        g, std = fall.in_meters(fall.scale)
        share = g / STANDARD_GRAVITY
        said.append(f"That is {g:.3g} ± {std:.2g} m/s², {share:.2f} of standard gravity.")
    return said

"""Match: the homography and the light that map a plate to the moment of an image.

An electronic shutter reads one row after the other, and lamps on the mains flicker at twice its
frequency. So each row sees the lamps in another phase, and the ratio of two such pictures is a periodic
function of the row; of the column, if the camera was held upright. With the centered coordinate t
across the bands and the angular frequency ω

    g(t) = Σⱼ aⱼ cos jωt + bⱼ sin jωt,    j = 1 … J,

per channel, is added to the gain.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from blurmatte.background import warp
from blurmatte.checks import Array, Floats, check_same_size
from blurmatte.radiometry import LinearImage, check_picture

UNCHANGED = "plate as it is"  # in words


@dataclass(frozen=True, eq=False)
class Bands:
    """A periodic part of the gain of a plate.

    Parameters
    ----------
    axis : int
        0 if the light changes from row to row, 1 if from column to column.
    frequency : float
        ω, radians per unit of the centered coordinate.
    coefficients : (2 J, 3) float
        a₁, b₁, a₂, b₂, … per channel.
    covariance : (3, 2 J, 2 J) float
        Of the coefficients of each channel.
    """

    axis: int
    frequency: float
    coefficients: Array
    covariance: Array

    def gain(self, size: tuple[int, int]) -> Array:
        """(n, 3) their part of the gain in the rows or columns of a picture of `size`."""
        return np.asarray(self._functions(size) @ self.coefficients)

    def gain_std(self, size: tuple[int, int]) -> Array:
        """(n, 3) standard deviation of `gain`."""
        functions = self._functions(size)
        variance = np.einsum("ni,cij,nj->nc", functions, self.covariance, functions)
        return np.asarray(np.sqrt(np.maximum(variance, 0)))

    def across(self, profile: Array) -> Array:
        """(n, 1, 3) or (1, n, 3): a profile (n, 3) over rows or columns, to multiply pictures with."""
        return np.asarray(profile[:, None] if self.axis == 0 else profile[None])

    def period(self, size: tuple[int, int]) -> float:
        """Pixels from one band to the next in a picture of `size`."""
        return float(2 * np.pi / self.frequency / warp.to_centered(size)[0, 0])

    @property
    def amplitude(self) -> float:
        """Half of the range of the gain, of the channel in which it is largest."""
        t = np.linspace(0, 2 * np.pi, 200) / self.frequency
        gain = (
            functions_of_bands(t, self.frequency, len(self.coefficients) // 2) @ self.coefficients
        )
        return float(np.ptp(gain, axis=0).max() / 2)

    def in_words(self, size: tuple[int, int]) -> str:
        """Their kind, period and amplitude."""
        kind = ("rows", "columns")[self.axis]
        return f"in bands of {self.period(size):.0f} {kind} by ±{self.amplitude:.1%}"

    def _functions(self, size: tuple[int, int]) -> Array:
        t = coordinates_across(size, self.axis)
        return functions_of_bands(t, self.frequency, len(self.coefficients) // 2)


def functions_of_bands(t: Array, frequency: float, harmonics: int) -> Array:
    """(n, 2 J) cosines and sines at coordinates t (n,)."""
    angle = np.outer(t, frequency * np.arange(1, harmonics + 1))
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(t), -1)


def coordinates_across(size: tuple[int, int], axis: int) -> Array:
    """(n,) t of the rows or columns of a picture."""
    to, k = warp.to_centered(size), 1 - axis
    return np.asarray(np.arange(size[k]) * to[k, k] + to[k, 2])


@dataclass(frozen=True, eq=False)
class Match:
    """Homography and light field that map a plate to an image.

    Parameters
    ----------
    size : (int, int)
        (width, height) of both, pixels.
    h : (8,) float
        Parameters of the homography from image to plate in centered coordinates (0 in the center, ±1 at
        the ends of the longer side): its difference from the identity.
    light : (7, 3) float
        Per channel: gain, offset, and the coefficients of x, y, x², xy, y² in the gain, in centered
        coordinates.
    h_std, light_std : as h and light
        Standard deviations; 0 for parameters that were not fitted.
    bands : Bands, optional
        A periodic part of the gain.

    Raises
    ------
    ValueError
        If an array has another shape.

    Examples
    --------
    >>> darker = bm.LinearImage(0.9 * plate.rgb)
    >>> match = bm.background.fit_match(image, darker)
    >>> print(match)
    Match(light times 1.111, 1.111, 1.111)
    >>> [round(factor, 2) for factor in match.gain]
    [1.11, 1.11, 1.11]
    """

    size: tuple[int, int]
    h: Array
    light: Array
    h_std: Array
    light_std: Array
    bands: Bands | None = None

    def __post_init__(self) -> None:
        for name, shape in (("h", (8,)), ("light", (7, 3))):
            for field in (name, f"{name}_std"):
                actual = np.shape(getattr(self, field))
                if actual != shape:
                    raise ValueError(f"{field} must have the shape {shape}, got {actual}")

    @classmethod
    def nothing(cls, size: tuple[int, int]) -> "Match":
        """The identity, for pictures of `size` (width, height)."""
        return cls(size, np.zeros(8), warp.IDENTITY_LIGHT, np.zeros(8), np.zeros((7, 3)))

    def __repr__(self) -> str:
        return f"Match({self.in_words})"

    @property
    def moves(self) -> bool:
        """Whether the homography differs from the identity."""
        return bool(self.h.any())

    @property
    def changes_light(self) -> bool:
        """Whether gain, offset, field or bands differ from the identity."""
        return self.bands is not None or bool((self.light != warp.IDENTITY_LIGHT).any())

    @property
    def homography(self) -> Array:
        """(3, 3) from pixels of the image to pixels of the plate, homogeneous."""
        to = warp.to_centered(self.size)
        return np.asarray(np.linalg.inv(to) @ warp.homography(self.h) @ to)

    @property
    def shift(self) -> tuple[float, float]:
        """(x, y) position in the plate minus position in the image, of the image's center; pixels."""
        center = (np.array([self.size]) - 1) / 2
        ((x, y),) = self._warp.points(center) - center
        return float(x), float(y)

    @property
    def shift_std(self) -> tuple[float, float]:
        """Standard deviation of the shift, pixels."""
        half = max(self.size) / 2
        return float(self.h_std[2] * half), float(self.h_std[5] * half)

    @property
    def angle(self) -> float:
        """Rotation of the plate against the image about the center, radians, from x towards y."""
        return float(np.arctan2(self.h[3] - self.h[1], 2 + self.h[0] + self.h[4]))

    @property
    def reach(self) -> float:
        """Largest displacement of a corner of the picture, pixels."""
        width, height = self.size
        corners = np.array(list(product((0.0, width - 1.0), (0.0, height - 1.0))))
        return float(np.hypot(*(self._warp.points(corners) - corners).T).max())

    @property
    def gain(self) -> tuple[float, float, float]:
        """Factor of the plate's light in the center, per channel."""
        r, g, b = self.light[0]
        return float(r), float(g), float(b)

    def light_change(self, plate: LinearImage) -> float:
        """Bound of the relative change of the plate's median light, over channels and corners."""
        if not self.changes_light:
            return 0.0
        corners = np.abs(self.light[2:]).sum(axis=0)
        offset = np.abs(self.light[1]) / median_light(plate)
        bands = 0.0 if self.bands is None else self.bands.amplitude
        return float(np.max(np.abs(self.light[0] - 1) + offset + corners)) + bands

    @property
    def in_words(self) -> str:
        """One line: shift, rotation, gain, offset, field and bands."""
        parts = []
        if self.moves:
            x, y = self.shift
            parts.append(f"shifted by {x:+.2f}, {y:+.2f} px")
            if self.h[[0, 1, 3, 4, 6, 7]].any():
                turned = f"turned by {np.degrees(self.angle):+.2f}°"
                parts.append(f"{turned}, up to {self.reach:.2f} px at the corners")
        if self.changes_light:
            gain = ", ".join(f"{g:.3f}" for g in self.gain)
            parts.append(f"light times {gain}")
            if np.abs(self.light[1]).max() >= 5e-5:  # not 0 in four decimals
                parts.append("plus " + ", ".join(f"{o:+.4f}" for o in self.light[1]))
            if self.light[2:].any():
                parts.append("changing smoothly over the picture")
            if self.bands is not None:
                parts.append(self.bands.in_words(self.size))
        return ", ".join(parts) or UNCHANGED

    def apply(self, plate: LinearImage) -> LinearImage:
        """The plate under this homography and light, interpolated by cubic splines.

        Parameters
        ----------
        plate : LinearImage
            Of this match's size.

        Returns
        -------
        LinearImage
            `plate` itself for the identity. Pixels outside the plate are not `valid`.

        Raises
        ------
        ValueError
            If the plate has another size.
        """
        check_picture("plate", plate)
        check_same_size("plate", plate.size, "the match", self.size)
        if self.moves:
            plate = self._warped(plate)
        if not self.changes_light:
            return plate
        gain = self._gain_field(plate.rgb.dtype)
        noise = None if plate.noise is None else plate.variance * gain**2
        if self.bands is not None and noise is not None:
            std = self.bands.across(self.bands.gain_std(self.size))
            noise = noise + (plate.rgb * std).astype(plate.rgb.dtype) ** 2
        rgb = plate.rgb * gain + self.light[1].astype(plate.rgb.dtype)
        return replace(plate, rgb=rgb, noise=noise)

    @property
    def _warp(self) -> warp.Warp:
        return warp.Warp(self.h, self.size)

    def _warped(self, plate: LinearImage) -> LinearImage:
        noise = None
        if plate.noise is not None:
            kept = warp.interpolated_variance(self._warp.points(self._sample()))
            noise = warp.warped_linearly(plate.variance, self._warp) * plate.rgb.dtype.type(kept)
        valid = warp.warped_mask(plate.valid, self._warp)
        return replace(plate, rgb=warp.warped(plate.rgb, self._warp), noise=noise, valid=valid)

    def _sample(self) -> Array:
        """(n, 2) about ten thousand pixels over the picture."""
        width, height = self.size
        at = np.arange(0, width * height, max(1, width * height // 10_000))
        return np.stack([at % width, at // width], axis=1).astype(float)

    def _gain_field(self, dtype: np.dtype[np.floating]) -> Floats:
        """The factor of the plate's light, as an array that broadcasts to (H, W, 3)."""
        bands = 0.0 if self.bands is None else self.bands.across(self.bands.gain(self.size))
        if not self.light[2:].any():
            return np.asarray(self.light[0] + bands, dtype=dtype)
        v, u = (coordinates_across(self.size, axis) for axis in (0, 1))
        u, v = u[None, :, None], v[:, None, None]
        a, _, x, y, xx, xy, yy = self.light
        field = a + x * u + y * v + xx * u * u + xy * u * v + yy * v * v
        return np.asarray(field + bands, dtype=dtype)


def median_light(plate: LinearImage) -> Array:
    """(3,) median of the plate's light in about a hundred rows, above 0."""
    rows = slice(None, None, max(1, len(plate.rgb) // 100))
    return np.asarray(np.maximum(np.median(plate.rgb[rows].astype(float), axis=(0, 1)), 1e-6))

"""ColorModel: the colors that an object may have.

In this file a color is a point of linear RGB, `l` the unit direction of a line of colors, `n` the
unit normal of a plane of colors. Line and plane pass through black, as they hold every shade of a
paint. The unit vector l or n that determines them is called the pole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import Array, Floats
from blurmatte.errors import ColorModelError
from blurmatte.radiometry.transfer import Matrix3, hex_of_light, light_in_srgb, light_of_hex
from blurmatte.statistics import robust_std

MAX_ANGLE_VARIANCE = (np.pi / 2) ** 2  # radians², of a direction of which nothing is known


@dataclass(frozen=True, eq=False)
class ColorModel:
    """All colors that the object may have: a subspace of linear RGB.

    Rank 1 is a line (one paint and its shades), rank 2 a plane (two paints, or one paint with
    highlights or under two illuminants), rank 3 all colors. Sections 2.2 and 3.3 of [GC07].

    Parameters
    ----------
    basis : (3, rank) float
        Orthonormal columns that span the colors; rank 1, 2 or 3.
    covariance : (3, 3) float
        Of the pole, radians²; zeros for a given model. Larger standard deviations than a right angle,
        the largest between two lines, are reduced to that.
    evidence : mapping of str to float
        Standard deviation of the pole, degrees, from each kind of evidence alone.
    to_srgb : 3 x 3 floats, optional
        Linear RGB of a camera → linear sRGB (`Meta.to_srgb`), for a model in the colors of a camera.
        Used by `color`, `hex` and `srgb` only.
    mean : (3,) float, optional
        Mean light of the object, 1 = white, in the primaries of the basis; None if it was not
        measured. Used by `color` only: fits do not depend on it.

    Raises
    ------
    ValueError
        If the basis is not orthonormal, the covariance not (3, 3), or the mean not (3,).

    Examples
    --------
    >>> model = bm.ColorModel.from_hex("#ffc032")
    >>> model.rank, model.hex
    (1, ('#ffc032',))
    >>> orange_and_blue = np.array([[0.9, 0.5, 0.1], [0.1, 0.2, 0.8]])
    >>> two_paints = bm.ColorModel.from_samples(orange_and_blue, rank=2, std=0.01)
    >>> print(two_paints)
    ColorModel(#bca0b3, rank 2, between #0077ff and #ffc100, ±0.77°)
    """

    basis: Array
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    evidence: Mapping[str, float] = field(default_factory=dict)
    to_srgb: Matrix3 | None = None
    mean: Array | None = None

    def __post_init__(self) -> None:
        basis = np.asarray(self.basis, dtype=float)
        if basis.ndim != 2 or basis.shape[0] != 3 or basis.shape[1] not in (1, 2, 3):
            raise ValueError(
                f"basis must have the shape (3, 1), (3, 2) or (3, 3), got {basis.shape}"
            )
        if not np.allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-6):
            raise ValueError("basis must have orthonormal columns; use ColorModel.from_samples")
        covariance = np.asarray(self.covariance, dtype=float)
        if covariance.shape != (3, 3) or not np.all(np.isfinite(covariance)):
            raise ValueError(f"covariance must be finite, (3, 3), got {covariance.shape}")
        if np.trace(covariance) > MAX_ANGLE_VARIANCE:
            values, axes = np.linalg.eigh(covariance)
            covariance = axes * np.minimum(values, MAX_ANGLE_VARIANCE) @ axes.T
        if self.to_srgb is not None and np.shape(self.to_srgb) != (3, 3):
            raise ValueError(f"to_srgb must be 3 x 3 numbers, got {self.to_srgb}")
        if self.mean is not None:
            mean = np.asarray(self.mean, dtype=float)
            if mean.shape != (3,) or not np.all(np.isfinite(mean)):
                raise ValueError(f"mean must be three finite numbers, got {self.mean}")
            object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "basis", basis)
        object.__setattr__(self, "covariance", covariance)

    def __repr__(self) -> str:
        sure = f", ±{self.angle_std:.2g}°" if self.rank < 3 else ""
        return f"ColorModel({self.in_words}{sure})"

    @property
    def rank(self) -> int:
        """1 for a line of colors, 2 for a plane, 3 for all."""
        return int(self.basis.shape[1])

    @property
    def normals(self) -> Array:
        """(3, 3 − rank) orthonormal directions perpendicular to the colors."""
        return np.asarray(np.linalg.svd(self.basis)[0][:, self.rank :])

    @property
    def pole(self) -> Array:
        """(3,) the line's direction l (rank 1) or the plane's normal n (rank 2).

        Raises
        ------
        ValueError
            For rank 3.
        """
        if self.rank == 3:
            raise ValueError("a model of any colors has no pole; rank 1 and 2 have")
        return self.basis[:, 0] if self.rank == 1 else self.normals[:, 0]

    @property
    def angle_std(self) -> float:
        """Standard deviation of the pole along its least certain direction, degrees."""
        return float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(self.covariance)[-1], 0))))

    @property
    def rgb(self) -> Array:
        """(rank, 3) colors that span the model, linear, each with brightest channel 1.

        Rank 2: the two extreme colors of the plane without negative light; all others lie between them.
        Rank 3: red, green and blue.
        """
        if self.rank == 3:
            return np.eye(3)
        colors = self.basis.T if self.rank == 1 else _extremes(self.pole)
        return np.asarray(colors / np.abs(colors).max(axis=1, keepdims=True))

    @property
    def srgb(self) -> Array:
        """(rank, 3) the colors of `rgb` in linear sRGB, clipped to 0…1."""
        colors = np.maximum(light_in_srgb(self.rgb, self.to_srgb), 0)
        if self.to_srgb is not None:
            colors = colors / np.maximum(colors.max(axis=1, keepdims=True), 1e-9)
        return np.asarray(np.minimum(colors, 1))

    @property
    def hex(self) -> tuple[str, ...]:
        """The colors of `srgb` as sRGB-coded #rrggbb."""
        return tuple(hex_of_light(color) for color in self.srgb)

    @property
    def color(self) -> str:
        """The color by which the object is named, sRGB-coded #rrggbb; "" if it is not known.

        Rank 1: that of the line, its brightest channel 1. Rank 2 and 3: the mean light of the object.
        """
        if self.rank == 1:
            return self.hex[0]
        if self.mean is None:
            return ""
        return hex_of_light(np.clip(light_in_srgb(self.mean, self.to_srgb), 0, 1))

    @property
    def in_words(self) -> str:
        """The color that names the object, if it is known, the rank, and the ends of a plane."""
        kinds = "", f"between {' and '.join(self.hex)}", "any colors"
        return ", ".join(filter(None, (self.color, f"rank {self.rank}", kinds[self.rank - 1])))

    def numbers(self) -> dict[str, Any]:
        """All of it by name, with its color, for reports."""
        return {
            "rank": self.rank,
            "color": self.color,
            "mean": self.mean,
            "hex": self.hex,
            "rgb": self.rgb,
            "to_srgb": self.to_srgb,
            "basis": self.basis,
            "covariance": self.covariance,
            "angle_std_degrees": self.angle_std,
            "evidence_degrees": self.evidence,
        }

    @property
    def possible(self) -> tuple[ColorModel, ...]:
        """The model, and eight models on the boundary of its 95 % confidence region.

        The first and the fifth of them are at the ends of the major axis. Only the model if its
        covariance is zero.
        """
        if not self.covariance.any():
            return (self,)
        values, axes = np.linalg.eigh(self.covariance)
        around = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        circle = np.stack([np.cos(around), np.sin(around)], axis=1)
        reach = 2.45 * np.sqrt(np.maximum(values[:0:-1], 0))  # 2.45² = -2 log 0.05
        steps = (circle * np.minimum(reach, 1)) @ axes[:, :0:-1].T
        return (self, *(self._with_pole(self.pole + step) for step in steps))

    def _with_pole(self, pole: Array) -> ColorModel:
        if self.rank == 1:  # colors are not negative
            pole = unit(np.maximum(pole, 0))
        return ColorModel(_basis_of(pole, self.rank), to_srgb=self.to_srgb)

    @classmethod
    def any(cls) -> ColorModel:
        """All colors: alpha then follows from shape and motion only."""
        return cls(np.eye(3))

    @classmethod
    def from_hex(cls, *colors: str, to_srgb: Matrix3 | None = None) -> ColorModel:
        """A model of rank 1 or 2 from as many sRGB-coded colors, such as "#d8ff3c".

        Parameters
        ----------
        *colors : str
            Six hexadecimal digits each.
        to_srgb : 3 x 3 floats, optional
            `Meta.to_srgb` of a camera RAW: the model is then in the camera's colors.

        Raises
        ------
        ValueError
            If a color is not six hexadecimal digits, is black, or both have one hue.
        """
        light = light_of_hex(*colors)
        if to_srgb is not None:  # light is not negative
            light = np.maximum(light @ np.linalg.inv(np.array(to_srgb)).T, 0)
        if len(light) not in (1, 2) or np.any(light.max(axis=1) == 0):
            raise ValueError("give one or two colors, neither of them black")
        basis = np.linalg.svd(light.T, full_matrices=False)[0]
        if len(light) == 2 and _angle(*light) < 1:
            raise ValueError(f"{' and '.join(colors)} are shades of one color; rank 2 needs two")
        return cls(_bright(basis), to_srgb=to_srgb)

    @classmethod
    def from_samples(
        cls, colors: Floats, rank: int = 1, std: float | None = None, robust: bool = False
    ) -> ColorModel:
        """The line or plane nearest to sampled colors of the object ([GC07 §3.3]).

        Parameters
        ----------
        colors : (n, 3) float
            Linear light of pixels of the object alone.
        rank : int
            1 or 2.
        std : float, optional
            Noise of one sample, light. By default from the scatter of the samples.
        robust : bool
            Reject samples further than four standard deviations from a robust fit (Cauchy loss); up to
            about 40 % may be outliers.

        Raises
        ------
        ValueError
            For another rank, colors that are not finite, or an invalid standard deviation.
        ColorModelError
            If there are too few samples, they are black, or have one hue for rank 2.
        """
        samples = np.asarray(colors, dtype=float).reshape(-1, 3)
        if not np.isfinite(samples).all():
            raise ValueError("colors must be finite light, got NaN or infinity")
        if rank not in (1, 2):
            raise ValueError(f"rank must be 1 or 2, got {rank}")
        if std is not None and not (np.isfinite(std) and std >= 0):
            raise ValueError(f"std must be finite and not negative, got {std}")
        needed = rank if std is not None else rank + 1
        if len(samples) < needed:
            raise ColorModelError(
                f"a model of rank {rank} needs {needed} or more color samples, got {len(samples)}; "
                "pick more pixels or a larger radius"
            )
        if not samples.any():
            raise ColorModelError(f"all {len(samples)} samples are black; pick others")
        if robust:
            samples = _inliers(samples, rank)
        pole = _pole_of(samples, rank)
        residual = _residual(samples, pole, rank)
        freedom = max(len(residual) - 2, 1)
        scatter = std if std is not None else float(np.sqrt(np.sum(residual**2) / freedom))
        covariance = _sample_covariance(samples, pole, rank, scatter)
        model = cls(_basis_of(pole, rank), covariance)
        if not model.angle_std < 20 or (rank == 2 and _one_hue(samples, scatter)):
            raise ColorModelError(
                f"the {len(samples)} samples determine the {'line' if rank == 1 else 'plane'} of "
                f"colors only to {model.angle_std:.0f}°; rank 2 needs two clearly different colors, "
                "and no sample may be black"
            )
        mean = np.maximum(samples.mean(axis=0), 0)
        return cls(model.basis, covariance, {"samples": model.angle_std}, mean=mean)


def fuse_colors(models: Sequence[ColorModel]) -> ColorModel:
    """The mean of the colors of one object in several frames, weighted by inverse covariance.

    All are lines, or all are planes. If they differ by more than their covariances predict, the
    result's covariance is inflated.
    """
    if len(models) == 1:
        return models[0]
    first = models[0].pole
    poles = [model.pole if model.pole @ first > 0 else -model.pole for model in models]
    mean = np.mean(poles, axis=0)
    for _ in range(3):
        mean = unit(mean)
        T = perpendicular(mean)
        offsets = [T.T @ pole / (mean @ pole) for pole in poles]
        smallest = 1e-5**2 * np.eye(2)  # radians²: no color is known better
        weights = [np.linalg.inv(T.T @ model.covariance @ T + smallest) for model in models]
        covariance = np.linalg.inv(sum(weights))
        step = covariance @ sum(w @ t for w, t in zip(weights, offsets, strict=True))
        mean = mean + T @ step
    excess = sum(t @ w @ t for w, t in zip(weights, offsets, strict=True)) / (2 * len(models) - 2)
    covariance = covariance * max(float(excess), 1.0)
    std = float(np.degrees(np.sqrt(np.trace(covariance) / 2)))
    basis = _basis_of(unit(mean), models[0].rank)
    means = [model.mean for model in models if model.mean is not None]
    light = np.mean(means, axis=0) if means else None
    return ColorModel(basis, T @ covariance @ T.T, {"frames": std}, models[0].to_srgb, light)


def _bright(basis: Array) -> Array:
    """Columns with signs that make their sums positive."""
    return np.asarray(basis * np.where(basis.sum(axis=0) < 0, -1, 1))


def _basis_of(pole: Array, rank: int) -> Array:
    """(3, rank) orthonormal basis of the line or plane of a pole."""
    return _bright(pole[:, None] if rank == 1 else perpendicular(pole))


def unit(v: Array) -> Array:
    """The vector scaled to length 1."""
    return np.asarray(v / np.linalg.norm(v))


def perpendicular(v: Array) -> Array:
    """(3, 2) orthonormal vectors perpendicular to a vector."""
    return np.asarray(np.linalg.svd(v[:, None])[0][:, 1:])


def _angle(a: Array, b: Array) -> float:
    """Angle of two vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _extremes(n: Array) -> Array:
    """(2, 3) intersections of the plane of normal n with the boundary of non-negative colors."""
    edges = np.array([[0, n[2], -n[1]], [n[2], 0, -n[0]], [n[1], -n[0], 0]])
    edges = edges * np.where(edges.sum(axis=1) < 0, -1, 1)[:, None]
    length = np.linalg.norm(edges, axis=1)
    inside = (edges.min(axis=1) >= -1e-9) & (length > 1e-9)
    rays = edges[inside] / length[inside, None]
    if len(rays) < 2:  # the plane has no non-negative color but black
        return np.asarray(np.abs(perpendicular(n).T))
    pair = np.unravel_index(np.argmin(rays @ rays.T), (len(rays), len(rays)))
    return np.asarray(rays[list(pair)])


def _pole_of(samples: Array, rank: int) -> Array:
    """The pole of the least-squares line or plane."""
    directions = np.linalg.svd(samples, full_matrices=True)[2]
    return np.asarray(directions[0 if rank == 1 else 2])


def _residual(samples: Array, pole: Array, rank: int) -> Array:
    """(m,) coordinates of the samples perpendicular to the line (two each) or plane (one)."""
    normals = perpendicular(pole) if rank == 1 else pole[:, None]
    return np.asarray((samples @ normals).ravel())


def _inliers(samples: Array, rank: int) -> Array:
    """Samples within four standard deviations of the best of several robust fits."""
    strong = samples[np.argsort(-np.linalg.norm(samples, axis=1))]
    picks = strong[np.linspace(0, len(strong) - 1, min(12, len(strong))).astype(int)]
    poles = list(picks) if rank == 1 else [np.cross(a, b) for a, b in combinations(picks, 2)]
    starts = [_pole_of(samples, rank), *(pole for pole in poles if np.linalg.norm(pole) >= 1e-9)]
    fits = [_robust_residual(samples, unit(start), rank) for start in starts]
    best = min(fits, key=lambda residual: float(np.median(np.abs(residual))))
    distance = np.abs(best).reshape(len(samples), -1).max(axis=1)
    return np.asarray(samples[distance <= 4 * robust_std(best) + 1e-12])


def _robust_residual(samples: Array, start: Array, rank: int) -> Array:
    """Residuals of the samples from the line or plane near a pole of least Cauchy loss.

    SciPy's search differentiates them numerically; `descent` needs the curvature.
    """
    tangent = perpendicular(start)

    def residual(step: Array) -> Array:
        """Distances of the samples after a step of the pole."""
        return _residual(samples, unit(start + tangent @ step), rank)

    still = np.zeros(2)
    spread = max(float(np.median(np.abs(residual(still)))), 1e-9)
    return residual(scipy.optimize.least_squares(residual, still, loss="cauchy", f_scale=spread).x)


def _one_hue(samples: Array, scatter: float) -> bool:
    """True if the samples deviate from a line by no more than noise.

    The second moment perpendicular to the line is n · scatter² for noise alone, times 1 ± √(2/n);
    singular values are exact to rounding of the largest one.
    """
    n = len(samples)
    largest, second, *_ = np.linalg.svd(samples, compute_uv=False)
    noise = np.hypot(scatter, np.finfo(float).eps * largest)
    return bool(second**2 <= (1 + 6 * np.sqrt(2 / n)) * n * noise**2)


def _sample_covariance(samples: Array, pole: Array, rank: int, scatter: float) -> Array:
    """Covariance of the pole: scatter² over the samples' second moment, in its tangent plane."""
    tangent = perpendicular(pole)
    if rank == 1:
        moment = np.eye(2) * np.sum((samples @ pole) ** 2)
    else:
        moment = tangent.T @ (samples.T @ samples) @ tangent
    # Samples of one hue leave a direction undetermined: its moment is rounding, which may be negative.
    moment += 4 * np.finfo(float).eps * np.trace(moment) * np.eye(2)
    covariance = scatter**2 * np.linalg.inv(moment)
    return np.asarray(tangent @ covariance @ tangent.T)

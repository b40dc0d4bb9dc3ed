"""The farthest mixture: what the colors of a streak say about the object's color, and about alpha.

Each color of a streak is a mixture of the object's color and the plate's, so the object's color lies at
least as far from the plate as the farthest mixture [GC07 §3.1]. In the middle of a swing an object hides
the plate all the time, and the farthest mixture is its color.

A hypothesis is impossible where mixtures lie beyond its color, so that alpha would exceed 1, or where
its alpha leaves more of the plate's light than there is. Its *certain error* is by how much, root mean
square over the streak.

In this file C is the image's light, B the plate's, V_C and V_B their noise variances, each the mean of
a window, and l the unit direction of a line of colors.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Box
from blurmatte.color.evidence import SLACK
from blurmatte.color.model import ColorModel
from blurmatte.matting.case import Case
from blurmatte.radiometry.color_space import Matrix3

_WINDOW_PX = 3  # width of windows: single pixels decide nothing
_MIN_WINDOWS = 12  # of a streak whose mixtures are compared
_MAX_WINDOWS = 1500  # compared
_MAX_CANDIDATES = 150  # colors of windows, farthest from the plate
_MAX_CHI = 5.0  # standard deviations that one window counts at most
_MIN_CHI = 3.0  # standard deviations by which a window must exceed a bound


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Colors of the windows of a streak."""

    C: Array  #: (n, 3)
    B: Array  #: (n, 3)
    V_C: Array  #: (n, 3)
    V_B: Array  #: (n, 3)
    at: tuple[Array, Array]  #: rows and columns of the middles of the windows

    @classmethod
    def of(cls, case: Case) -> "Mixtures":
        """Windows that lie within the streak of a case, and whose light is known."""
        from scipy.ndimage import minimum_filter, uniform_filter

        y, x = case.streak.rows_columns
        image, plate = (p.crop((x.start, y.start, x.stop, y.stop)) for p in (case.image, case.plate))
        inside = case.streak.mask[y, x] & image.valid & plate.valid
        size = _WINDOW_PX
        whole = minimum_filter(inside, size, mode="constant")
        rows, columns = np.nonzero(whole)
        apart = (rows % size == 0) & (columns % size == 0)
        rows, columns = rows[apart], columns[apart]
        step = max(1, -(-len(rows) // _MAX_WINDOWS))
        rows, columns = rows[::step], columns[::step]

        def means(values: Array) -> Array:
            """Means of the windows."""
            return np.asarray(uniform_filter(values, (size, size, 0))[rows, columns], float)

        # Errors of the pixels of a window are independent, or, in a compressed file, the same.
        count = 1 if case.is_compressed else size**2
        variances = (means(p.variance) / count + 1e-12 for p in (image, plate))
        return cls(
            means(image.rgb), means(plate.rgb), *variances, (rows + y.start, columns + x.start)
        )

    def excess(self, l: Array) -> float:
        """The certain error of a line of colors l (3,): alpha beyond 1."""
        if len(self.C) < _MIN_WINDOWS:
            return 0.0
        alpha, std, _ = self._closed_form(l[None])
        return _root_mean_square(alpha - 1 - np.maximum(_MIN_CHI * std, SLACK))

    def shortage(self, alpha: Array, box: Box) -> float:
        """The certain error of an alpha (h, w) in a box around the streak: light of the object below 0.

        A shadow takes as much of all channels, so that only what the plate lost beyond the least loss of
        a channel counts.
        """
        from scipy.ndimage import uniform_filter

        if len(self.C) < _MIN_WINDOWS:
            return 0.0
        lit = np.clip(np.max(self.C / np.maximum(self.B, 1e-6), axis=1), 1e-6, 1)[:, None]
        noise = np.sqrt(self.V_C + self.V_B)
        least = 1 - (self.C + _MIN_CHI * noise) / np.maximum(lit * self.B, 1e-6)
        rows, columns = self.at
        own = uniform_filter(np.nan_to_num(alpha), _WINDOW_PX)[rows - box[1], columns - box[0]]
        return _root_mean_square(least.max(axis=1) - own - SLACK)

    def farthest(self, to_srgb: Matrix3 | None) -> ColorModel | None:
        """The line through the farthest mixture, if the others are mixtures of it; else None.

        Of the windows' colors it is the mean of those that explain all others, weighted by likelihood.
        The residual from the plane of l and B is a normal variable, and alpha does not exceed 1.
        """
        if len(self.C) < _MIN_WINDOWS:
            return None
        moved = np.sum((self.C - self.B) ** 2 / (self.V_C + self.V_B), axis=1)
        chosen = np.argsort(moved)[::-1][:_MAX_CANDIDATES]
        colors = np.maximum(self.C[chosen], 0)
        length = np.linalg.norm(colors, axis=1)
        l = colors / np.maximum(length, 1e-9)[:, None]
        alpha, std, chi = self._closed_form(l)
        beyond = np.maximum(alpha - 1 - SLACK, 0) / std
        below = np.maximum(-alpha - SLACK, 0) / std
        cost = sum(np.minimum(x, _MAX_CHI) ** 2 for x in (chi, beyond, below)).sum(axis=1)
        typical = max(float(cost.min()) / len(self.C), 1.0)
        weight = np.exp(-0.5 * (cost - cost.min()) / typical)
        weight /= weight.sum()
        pole = weight @ l
        pole /= np.linalg.norm(pole)
        if self.excess(pole) > SLACK:
            return None
        off = l - pole
        noise = weight @ (self.V_C[chosen].mean(axis=1) / np.maximum(length, 1e-9) ** 2)
        across = np.eye(3) - np.outer(pole, pole)
        covariance = across @ ((weight[:, None] * off).T @ off + noise * np.eye(3)) @ across
        return ColorModel(pole[:, None], covariance, to_srgb=to_srgb)

    def _closed_form(self, l: Array) -> tuple[Array, Array, Array]:
        """Alpha, its standard deviation, and the standardized residual, each (lines, windows).

        l (lines, 3): unit directions.
        """
        B_l, C_l = l @ self.B.T, l @ self.C.T
        length2 = np.sum(self.B**2, axis=1) - B_l**2 + 1e-12
        alpha = 1 - (np.sum(self.B * self.C, axis=1) - C_l * B_l) / length2
        t2 = (1 - np.clip(alpha, 0, 1)) ** 2
        V_C, V_B = self.V_C.mean(axis=1), self.V_B.mean(axis=1)
        variance = V_C + t2 * V_B
        residual = l @ np.cross(self.B, self.C).T / np.sqrt(length2)
        return alpha, np.sqrt(variance / length2), np.abs(residual) / np.sqrt(variance)


def _root_mean_square(beyond: Array) -> float:
    """Of what exceeds 0, over all windows."""
    return float(np.sqrt(np.mean(np.maximum(beyond, 0) ** 2)))

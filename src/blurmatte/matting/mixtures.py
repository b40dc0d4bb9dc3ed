"""The farthest mixture: what the colors of a streak say about the object's color, and about alpha.

Each color of a streak is a mixture of the object's color and the plate's, so the object's color lies
at least as far from the plate as the farthest mixture [GC07 §3.1]. Where an object hides the plate all
the time, as near the point about which it turns, the farthest mixture is its color.

A hypothesis is impossible where mixtures lie beyond its color, so that alpha would exceed 1, or where
its alpha leaves more of the plate's light than there is. Its *certain error* is by how much, root mean
square over the streak.

In this file C is the image's light, B the plate's, V_C and V_B their noise variances, each the mean of
a window, and l the unit direction of a line of colors.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from blurmatte.checks import Array, Box, Floats, Indices
from blurmatte.color.evidence import SLACK
from blurmatte.color.model import ColorModel
from blurmatte.matting.calibration import GRADE_LIMITS
from blurmatte.matting.case import Case
from blurmatte.matting.maps import Grade
from blurmatte.radiometry.transfer import Matrix3
from blurmatte.statistics import UNIFORM_VARIANCE

_WINDOW_PX = 3  # width of windows: single pixels decide nothing
_MIN_WINDOWS = 12  # of a streak whose mixtures are compared
_MAX_WINDOWS = 1500  # compared
_MAX_CANDIDATES = 150  # colors of windows, farthest from the plate
_MAX_CHI = 5.0  # standard deviations that one window counts at most
_MIN_CHI = 3.0  # standard deviations by which a window must exceed a bound


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Colors of the windows of a streak: columns of means, and no `PixelBox`, which has whole rows."""

    C: Array  #: (n, 3)
    B: Array  #: (n, 3)
    V_C: Array  #: (n, 3)
    V_B: Array  #: (n, 3)
    at: tuple[Indices, Indices]  #: rows and columns of the middles of the windows

    @classmethod
    def of(cls, case: Case) -> "Mixtures":
        """Windows that lie within the streak of a case, and whose light is known."""
        y, x = case.streak.rows_columns
        image, plate = (
            p.crop((x.start, y.start, x.stop, y.stop)) for p in (case.image, case.plate)
        )
        inside = case.streak.mask[y, x] & image.valid & plate.valid
        size = _WINDOW_PX
        whole = scipy.ndimage.minimum_filter(inside, size, mode="constant")
        rows, columns = np.nonzero(whole)
        apart = (rows % size == 0) & (columns % size == 0)
        rows, columns = rows[apart], columns[apart]
        step = max(1, -(-len(rows) // _MAX_WINDOWS))
        rows, columns = rows[::step], columns[::step]

        def means(values: Floats) -> Array:
            """Means of the windows."""
            return np.asarray(
                scipy.ndimage.uniform_filter(values, (size, size, 0))[rows, columns], float
            )

        # Errors of the pixels of a window are independent, or, in a compressed file, the same.
        count = 1 if case.is_compressed else size**2
        V_C, V_B = (means(p.variance) / count + 1e-12 for p in (image, plate))
        at = rows + y.start, columns + x.start
        return cls(means(image.rgb), means(plate.rgb), V_C, V_B, at)

    def reach(self, l: Array) -> bool:
        """Whether no mixtures lie beyond a line of colors l (3,), to the error of a confirmed alpha."""
        return self.excess(l) <= GRADE_LIMITS[Grade.CONFIRMED][0]

    def permit(self, alpha: Floats, box: Box) -> bool:
        """Whether an alpha (h, w) in a box around the streak is possible.

        It is not if its certain error exceeds that of a plausible answer.
        """
        return self.shortage(alpha, box) <= GRADE_LIMITS[Grade.PLAUSIBLE][0]

    def excess(self, l: Array) -> float:
        """The certain error of a line of colors l (3,): alpha beyond 1."""
        if len(self.C) < _MIN_WINDOWS:
            return 0.0
        alpha, std, _ = self._closed_form(l[None])
        return _root_mean_square(alpha - 1 - np.maximum(_MIN_CHI * std, SLACK))

    def shortage(self, alpha: Floats, box: Box) -> float:
        """The certain error of an alpha (h, w) in a box around the streak: light below 0.

        Where that alpha is 0 something else may have moved. A shadow takes as much of all channels, so
        that only what the plate lost beyond the least loss of a channel counts.
        """
        if len(self.C) < _MIN_WINDOWS:
            return 0.0
        lit = np.clip(np.max(self.C / np.maximum(self.B, 1e-6), axis=1), 1e-6, 1)[:, None]
        noise = np.sqrt(self.V_C + self.V_B)
        least = 1 - (self.C + _MIN_CHI * noise) / np.maximum(lit * self.B, 1e-6)
        rows, columns = self.at
        own = scipy.ndimage.uniform_filter(np.nan_to_num(alpha), _WINDOW_PX)[
            rows - box[1], columns - box[0]
        ]
        there = own > SLACK
        return _root_mean_square((least.max(axis=1) - own - SLACK)[there])

    def farthest(self, to_srgb: Matrix3 | None) -> ColorModel | None:
        """The line through the farthest mixture, if the others are mixtures of it; else None.

        Of the windows' colors it is the mean of those that explain all others, weighted by likelihood:
        the residual from the plane of l and B is a normal variable, and alpha does not exceed 1. If no
        mixtures accumulate there, the object's color may be farther, and the line is between both.
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
        off = np.minimum(np.stack([chi, beyond, below]), _MAX_CHI)
        cost = np.sum(off**2, axis=(0, 2))
        typical = max(float(cost.min()) / len(self.C), 1.0)
        weight = np.exp(-0.5 * (cost - cost.min()) / typical)
        weight /= weight.sum()
        noise = weight @ (self.V_C[chosen].mean(axis=1) / np.maximum(length, 1e-9) ** 2)
        farther = self._farther(weight @ colors)
        pole = farther.mean(axis=0)
        pole /= np.linalg.norm(pole)
        if not self.reach(pole):
            return None
        apart, step = l - pole, np.diff(farther, axis=0)
        scatter = (weight[:, None] * apart).T @ apart + UNIFORM_VARIANCE * (step.T @ step)
        across = np.eye(3) - np.outer(pole, pole)
        covariance = across @ (scatter + noise * np.eye(3)) @ across
        model = ColorModel(pole[:, None], covariance, to_srgb=to_srgb)
        return replace(model, evidence={"mixtures": model.angle_std})

    def _farther(self, color: Array) -> Array:
        """(2, 3) unit directions of the nearest and the farthest color of an object.

        color (3,): the farthest mixture. Both are its color if mixtures accumulate there, as they do
        where the object hides the plate for a while. Else the farthest has no light in a channel.
        """
        l = color / np.linalg.norm(color)
        (alpha,), (std,), _ = self._closed_form(l[None])
        width = max(_MIN_CHI * float(np.median(std)), SLACK)
        core = np.count_nonzero(alpha > 1 - width)
        if core > np.count_nonzero((alpha > 1 - 3 * width) & (alpha <= 1 - width)):
            return np.array([l, l])
        away = color - self.B.mean(axis=0)
        lost = away < 0
        if not lost.any():
            return np.array([l, l])
        end = np.maximum(color + np.min(color[lost] / -away[lost]) * away, 0)
        return np.array([l, end / np.linalg.norm(end)])

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
    return float(np.sqrt(np.mean(np.maximum(beyond, 0) ** 2))) if beyond.size else 0.0

"""The size at which a streak is fitted: a wide one on means over cells of pixels, then enlarged.

Light is linear, so that the model of a pixel holds for means of light and of alpha too. A streak of
many pixels determines path, outline and colors far better than the model is true. So of a wide streak
these, the weights of hypotheses and all errors follow from pictures in which every pixel is the mean
over a square cell, and in which codecs left less error. At full size alpha of a shape is that of its
parameters, which scale exactly; alpha without a shape is interpolated. The light keeps the grain of the
picture.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from blurmatte.calibration import fit_noise
from blurmatte.checks import Array, Bools, Box, Floats, rows_columns
from blurmatte.radiometry import LinearImage, Noise, NoiseModel
from blurmatte.radiometry.image import VARIANCE_FLOOR
from blurmatte.statistics import cell_means
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.model_selection import Hypotheses
from blurmatte.sweep.fit.multistart import half_width_of
from blurmatte.sweep.model.lighting import Lighting
from blurmatte.sweep.sweep import Sweep

S = TypeVar("S", bound=np.generic)

MAX_FITTED_WIDTH_PX = 100.0  # width of a streak in the pixels on which it is fitted
_MARGIN_HALF_WIDTHS = 3.0  # of the picture around the streak: more than a search uses
_MARGIN_CELLS = 32  # in addition


@dataclass(frozen=True)
class FittingSize:
    """Square cells over a part of a picture; the pixels of the pictures on which a streak is fitted."""

    cell: int  # width, pixels; 2 or more
    box: Box  # the part of the picture, whole cells
    size: tuple[int, int]  # (width, height) of the picture

    @classmethod
    def of(cls, streak: Streak, max_width: float = MAX_FITTED_WIDTH_PX) -> "FittingSize | None":
        """The size for a streak; None if it is narrow enough to be fitted as it is.

        max_width: of a streak in the pixels on which it is fitted.
        """
        half_width = half_width_of(streak)
        cell = int(np.ceil(2 * half_width / max_width))
        if cell < 2:
            return None
        height, width = streak.mask.shape
        margin = _MARGIN_HALF_WIDTHS * half_width + _MARGIN_CELLS * cell
        x0, y0, x1, y1 = streak.around(int(margin))
        box = x0, y0, x0 + (x1 - x0) // cell * cell, y0 + (y1 - y0) // cell * cell
        return cls(cell, box, (width, height))

    @cached_property
    def origin(self) -> tuple[float, float]:
        """Center (x, y) of the first cell, in pixels of the picture."""
        middle = (self.cell - 1) / 2
        return self.box[0] + middle, self.box[1] + middle

    def streak(self, streak: Streak) -> Streak:
        """A streak of the picture in cells."""
        mask = self._means(streak.mask) >= 0.5
        return Streak(mask, evidence=streak.evidence, cell=max(1, round(streak.cell / self.cell)))

    def sweep(self, sweep: Sweep) -> Sweep:
        """A sweep of the picture in cells."""
        x0, y0, x1, y1 = self.box
        cells = (x1 - x0) // self.cell, (y1 - y0) // self.cell
        x, y = self.origin
        return sweep.enlarged(1 / self.cell, (-x / self.cell, -y / self.cell), cells)

    def in_picture(self, values: Floats) -> Array:
        """A map (h, w, ...) of all cells in the picture, interpolated; 0 elsewhere."""
        whole, (width, height) = (0, 0, *values.shape[1::-1]), self.size
        found = np.zeros((height, width, *values.shape[2:]))
        place = rows_columns(self.enlarged_box(whole))
        for at in np.ndindex(values.shape[2:]):
            found[(*place, *at)] = self.interpolated(values[(..., *at)], whole)
        return found

    def touched(self, mask: Bools) -> Bools:
        """Cells of which a pixel is True."""
        return np.asarray(self._means(mask) > 0)

    def pictures(
        self, image: LinearImage, plate: LinearImage, streak: Streak, measured: bool
    ) -> tuple[LinearImage, LinearImage]:
        """Means of image and plate over cells, with the noise of the means.

        Codecs correlate the noise of pixels. So if the pixels' noise was measured from the difference
        of these pictures, that of the means is measured again, where nothing moved. There the blocks of
        two files may be equal, while they differ in the streak: so that noise is at least the noise of
        means of independent pixels.
        """
        image, plate = self._picture(image), self._picture(plate)
        still = ~self.touched(streak.mask)
        if not (measured and still.any()):
            return image, plate
        of_image, of_plate = fit_noise(image, plate, still)
        return _at_least(image, of_image), _at_least(plate, of_plate)

    def _picture(self, picture: LinearImage) -> LinearImage:
        """Means over cells, with the noise of means of independent pixels."""
        part = picture.crop(self.box)
        noise: Noise | Floats
        if isinstance(part.noise, Noise):
            noise = part.noise.times(1 / self.cell**2)
        else:
            noise = cell_means(part.variance, self.cell) / self.cell**2
        # Means have neither the steps nor the blocks of the file.
        meta = replace(part.meta, levels=None, compression=None, coding=None)
        valid = cell_means(part.valid.astype(np.float32), self.cell) == 1
        return LinearImage(cell_means(part.rgb, self.cell), noise, np.asarray(valid), meta)

    def _means(self, mask: Bools) -> Floats:
        return cell_means(mask[rows_columns(self.box)].astype(np.float32), self.cell)

    def enlarged_box(self, box: Box) -> Box:
        """A box of cells in the picture; with the rest of less than a cell at its far borders."""
        x0, y0 = (a + self.cell * b for a, b in zip(self.box[:2], box[:2], strict=True))
        ends = (a + self.cell * b for a, b in zip(self.box[:2], box[2:], strict=True))
        x1, y1 = (
            side if side - end < self.cell else end
            for end, side in zip(ends, self.size, strict=True)
        )
        return x0, y0, x1, y1

    def repeated(self, values: npt.NDArray[S], box: Box) -> npt.NDArray[S]:
        """A map of a box of cells in the pixels of `enlarged_box`, constant over each cell."""
        rows, columns = (np.clip(np.rint(at), 0, None) for at in self._positions(box))
        last_row, last_column = (n - 1 for n in values.shape[:2])
        y, x = (
            np.minimum(at, last).astype(int)
            for at, last in ((rows, last_row), (columns, last_column))
        )
        return np.asarray(values[y[:, None], x])

    def interpolated(self, values: Floats, box: Box) -> Array:
        """A map (h, w) of a box of cells in the pixels of `enlarged_box`, bilinear, of the same sum."""
        rows, columns = self._positions(box)
        return _linear(_linear(np.asarray(values, float), rows).T, columns).T

    def _positions(self, box: Box) -> tuple[Array, Array]:
        """Rows and columns of the pixels of `enlarged_box` in a box of cells."""
        x0, y0, x1, y1 = self.enlarged_box(box)
        rows, columns = (
            (np.arange(start, end) - first) / self.cell - before
            for start, end, first, before in (
                (y0, y1, self.origin[1], box[1]),
                (x0, x1, self.origin[0], box[0]),
            )
        )
        return rows, columns

    def hypotheses(
        self,
        fitted: Hypotheses,
        plates: tuple[LinearImage, LinearImage],
        streaks: tuple[Streak, Streak],
    ) -> Hypotheses:
        """Hypotheses about means in the picture; their observation remains that of the means.

        plates, streaks: on which they were fitted, and those of the picture.
        """
        sweeps = tuple(sweep.enlarged(self.cell, self.origin, self.size) for sweep in fitted.sweeps)
        (before, plate), (found, streak) = plates, streaks
        if fitted.plate is not before:
            plate = self._lighting(before, fitted.plate).on(plate)
        if fitted.streak is not found:
            whole = 0, 0, *fitted.plate.size
            mask = np.zeros(streak.mask.shape, bool)
            mask[rows_columns(self.enlarged_box(whole))] = self.repeated(fitted.streak.mask, whole)
            cell = self.cell * fitted.streak.cell
            streak = Streak(mask, evidence=fitted.streak.evidence, cell=cell)
        return replace(fitted, sweeps=sweeps, plate=plate, streak=streak)

    def _lighting(self, before: LinearImage, after: LinearImage) -> Lighting:
        """The change of light between two plates of means."""
        B, lit = (np.asarray(p.rgb, float) for p in (before, after))
        changes = np.where(B > 0, lit / np.where(B > 0, B, 1) - 1, 0)
        change = changes.mean(axis=-1)
        hue = np.tensordot(change, changes, 2) / max(float((change**2).sum()), VARIANCE_FLOOR)
        added = np.maximum(after.variance - before.variance, 0).sum(axis=-1)
        light = np.maximum(((hue * B) ** 2).sum(axis=-1), VARIANCE_FLOOR)
        std = np.sqrt(added / light)
        return Lighting(change, std, 0.0, hue, self.origin, float(self.cell))


def _at_least(means: LinearImage, measured: NoiseModel) -> LinearImage:
    """Means with measured noise, at least their own."""
    if not isinstance(means.noise, NoiseModel):
        return means.with_noise(np.maximum(measured.variance(means.rgb), means.variance))
    coefficients = np.maximum(measured.coefficients, means.noise.coefficients)
    return means.with_noise(NoiseModel.from_coefficients(coefficients))


def _linear(values: Array, at: Array) -> Array:
    """Rows of a map (n, m) interpolated at positions (k,); constant beyond the first and the last."""
    at = np.clip(at, 0, len(values) - 1)
    before = np.minimum(at.astype(int), max(len(values) - 2, 0))
    after = np.minimum(before + 1, len(values) - 1)
    weight = (at - before)[:, None]
    return np.asarray((1 - weight) * values[before] + weight * values[after])

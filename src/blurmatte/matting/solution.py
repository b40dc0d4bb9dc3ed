"""Solution: alpha and color of every pixel, each with its error and quality flags."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.checks import (
    Bools,
    Box,
    Floats,
    box_of,
    check_kind,
    check_light,
    check_map,
    rows_columns,
)
from blurmatte.color.model import ColorModel
from blurmatte.layer import Layer
from blurmatte.matting.maps import Grade, PixelMaps, Quality
from blurmatte.matting.stats import SolutionStats
from blurmatte.notebook import Displayed
from blurmatte.radiometry import light_in_srgb
from blurmatte.sweep.sweep import Sweep


@dataclass(frozen=True, eq=False)
class Solution(Displayed):
    """Alpha and premultiplied light of a moving object, with errors.

    Parameters
    ----------
    alpha, alpha_std : (H, W) float
        Fraction of the exposure the object covered the pixel, and its standard deviation; the raw
        estimate, not clipped, so that sums stay unbiased. Measure on these.
    premultiplied, premultiplied_std : (H, W, 3) float
        Light of the object, alpha times its color, linear, and its standard deviation.
    quality : (H, W) uint8
        `Quality` bits.
    model : ColorModel
        The colors the object was allowed.
    solver : str
        How it was solved, e.g. "Pixelwise(max_alpha_std=0.5)".
    stats : SolutionStats
        Numbers about the solve: the streak's box and pixels, the sum of alpha, the noise, changes of
        the plate, the sweep, the calibrated errors.
    sweep : Sweep, optional
        The fitted shape on a path, if one explains the streak.

    Raises
    ------
    TypeError, ValueError
        For arrays of another kind or shape.

    Examples
    --------
    >>> print(solution)
    Solution(128x72, alpha up to 0.34, typical std 0.0011, 0.0% of the streak's pixels flagged)
    >>> solution.grade
    <Grade.CONFIRMED: 'confirmed'>
    >>> total = solution.alpha[solution.streak & solution.known].sum()
    >>> print(f"{total:.0f} ± {solution.stats.sum_alpha_std:.0f} pixels")
    314 ± 3 pixels
    """

    alpha: Floats
    alpha_std: Floats
    premultiplied: Floats
    premultiplied_std: Floats
    quality: npt.NDArray[np.uint8]
    model: ColorModel
    solver: str
    stats: SolutionStats = field(default_factory=SolutionStats)
    sweep: Sweep | None = None

    def __post_init__(self) -> None:
        light = check_light("premultiplied", self.premultiplied)
        object.__setattr__(self, "premultiplied", light)
        one, three = light.shape[:2], light.shape
        shapes = {"alpha": one, "alpha_std": one, "premultiplied_std": three, "quality": one}
        for name, shape in shapes.items():
            kinds = "u" if name == "quality" else "f"
            object.__setattr__(self, name, check_map(name, getattr(self, name), shape, kinds))
        check_kind("stats", self.stats, SolutionStats, "use blurmatte.matting.SolutionStats")

    def __repr__(self) -> str:
        width, height = self.size
        inside = self.streak & self.known
        if not inside.any():
            return f"Solution({width}x{height}, nothing known)"
        name, values, std = "alpha", self.alpha[inside], self.alpha_std[inside]
        if self.stats.only_adds_light:
            name, values = "light", self.premultiplied[inside].max(axis=-1)
            std = self.premultiplied_std[inside]
        if std.any():  # 0 is where there is certainly nothing
            std = std[std > 0]
        flagged = np.mean(self.quality[self.streak] != 0)
        return (
            f"Solution({width}x{height}, {name} up to {np.percentile(values, 99.5):.2f}, "
            f"typical std {np.median(std):.2g}, {flagged:.1%} of the streak's pixels flagged)"
        )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.alpha.shape
        return width, height

    def in_picture(self, box: Box, size: tuple[int, int]) -> "Solution":
        """The solution of a part of a picture in that picture.

        Parameters
        ----------
        box : (x0, y0, x1, y1)
            The part, pixels.
        size : (width, height)
            Of the picture.
        """
        width, height = size
        maps = PixelMaps.zeros(height, width, self.alpha.dtype)
        maps.quality[...] = Quality.OUTSIDE
        own = self.alpha, self.alpha_std, self.premultiplied, self.premultiplied_std, self.quality
        maps.write(box, PixelMaps._make(own))
        x, y = box[:2]
        stats = self.stats.moved(x, y)
        sweep = None if self.sweep is None else self.sweep.in_picture((x, y), size)
        return Solution(*maps, model=self.model, solver=self.solver, stats=stats, sweep=sweep)

    def with_errors_times(self, factor: float) -> "Solution":
        """The solution with its errors multiplied, and the grade that belongs to them.

        Raises
        ------
        ValueError
            If the factor is less than 1.
        """
        if not factor >= 1:
            raise ValueError(f"factor must be 1 or more, got {factor}")
        total = max(float(self.alpha[self.streak & self.known].sum()), 1e-9)
        stats = self.stats.with_errors_times(factor, total)
        scaled = np.asarray(factor * self.alpha_std, self.alpha_std.dtype)
        return replace(self, alpha_std=scaled, stats=stats)

    @property
    def sum_std_without_factor(self) -> float:
        """Standard deviation of the sum of alpha without that of a factor common to all of alpha."""
        stats = self.stats
        by_factor = (stats.sum_alpha or 0.0) * (stats.alpha_scale_std or 0.0)
        square = (stats.sum_alpha_std or 0.0) ** 2 - by_factor**2
        return float(np.sqrt(max(square, 0.0)))

    @property
    def grade(self) -> Grade:
        """How well alpha is known; `ASSUMED` if `stats` has no grade."""
        return self.stats.grade or Grade.ASSUMED

    @cached_property
    def streak(self) -> Bools:
        """(H, W) True where something moved; read only."""
        inside = np.asarray((self.quality & Quality.OUTSIDE) == 0)
        inside.setflags(write=False)
        return inside

    @cached_property
    def streak_place(self) -> tuple[slice, slice]:
        """Rows and columns of the bounding box of the streak; all if nothing moved."""
        if not self.streak.any():
            return slice(0, self.size[1]), slice(0, self.size[0])
        return rows_columns(box_of(self.streak))

    @cached_property
    def known(self) -> Bools:
        """(H, W) True where alpha is known: its error is finite and not too large; read only."""
        certain = (self.quality & Quality.PLATE_IN_MODEL) == 0
        known = np.asarray(certain & np.isfinite(self.alpha_std))
        known.setflags(write=False)
        return known

    @property
    def layer(self) -> Layer:
        """The object as a picture, to composite with; measure on `alpha` instead.

        Alpha is clipped to [0, 1] and light is not negative. Both are 0 where the object is occluded,
        nothing moved, or alpha is unknown and not a fraction. An unknown fraction, the mean of what is
        possible, is kept, for a hole is a larger error. Of an object that only adds light alpha is 0,
        and the light is the estimate, not clipped. The light of a camera RAW is converted to linear
        sRGB.
        """
        place = self.streak_place
        part = self.within(place)
        is_fraction = np.isfinite(part.alpha_std) & (np.abs(part.alpha - 0.5) <= 0.5)
        lit = (part.known | is_fraction) & np.isfinite(part.premultiplied_std).all(axis=-1)
        alpha = np.where(part.streak & lit, np.clip(part.alpha, 0, 1), 0)
        seen = light_in_srgb(part.premultiplied, self.model.to_srgb)
        if self.stats.only_adds_light:
            light = np.where((part.streak & lit)[..., None], seen, 0)
        else:
            light = np.where(alpha[..., None] > 0, np.maximum(seen, 0), 0)
        rows, columns = place
        return Layer(alpha, light).embedded(self.size, (columns.start, rows.start))

    def within(self, place: tuple[slice, slice]) -> "Solution":
        """The same with the maps of some rows and columns; statistics and sweep are not changed."""
        names = ("alpha", "alpha_std", "premultiplied", "premultiplied_std", "quality")
        return replace(self, **{name: getattr(self, name)[place] for name in names})


def check_solution(name: str, value: object) -> None:
    """Raise TypeError unless it is a Solution."""
    check_kind(name, value, Solution, "use blurmatte.solve(image, plate)")

"""Solutions to be explained."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color.model import ColorModel
from blurmatte.matting import Quality, SolutionStats
from blurmatte.matting.solution import Solution


@pytest.fixture
def solution():
    """A function: 200 pixels of a streak, of which 20 do not fit, with some stats."""

    def of(**stats):
        alpha = np.full((20, 30), 0.3)
        light = np.ones((20, 30, 3))
        quality = np.full((20, 30), Quality.OUTSIDE, np.uint8)
        quality[5:15, 5:25] = 0
        quality[5, 5:25] = Quality.MISFIT
        model = ColorModel.from_hex("#ffffff")
        return Solution(
            alpha, alpha, light, light, quality, model, "Pixelwise()", SolutionStats(**stats)
        )

    return of


@pytest.fixture
def changed(solution):
    """A function: a sound solution with other values in some of the 200 pixels of its streak."""

    def of(**values):
        sound = solution(sum_alpha=60.0, sum_alpha_std=1.0)
        maps = {name: getattr(sound, name).copy() for name in ("alpha", "alpha_std", "quality")}
        maps["alpha_std"][:] = 0.02
        for name, (rows, value) in values.items():
            maps[name][5 : 5 + rows, 5:25] = value
        return replace(sound, **maps)

    return of

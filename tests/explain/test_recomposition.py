"""Whether it is said that an assumed layer is usable over its plate."""

from dataclasses import replace

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.explain.recomposition import usable_all_the_same
from blurmatte.matting.maps import PixelMaps

NOISE = bm.NoiseModel(gain=1e-5, read_std=2e-3)


@pytest.fixture
def case():
    """Image, plate of one gray, and a solution of twice the alpha with a color nearer to the plate."""
    rng = np.random.default_rng(0)
    alpha = np.zeros((40, 60))
    alpha[10:30, 10:50] = 0.3
    plate = np.full((40, 60, 3), 0.2)
    light = 0.3 * np.array([0.9, 0.5, 0.1]) * (alpha > 0)[..., None]
    clean = light + (1 - alpha)[..., None] * plate
    image = clean + 2e-3 * rng.standard_normal(clean.shape)
    maps = PixelMaps.zeros(40, 60, np.float32)
    maps.alpha[...] = 2 * alpha
    maps.premultiplied[...] = light + alpha[..., None] * plate
    maps.quality[alpha == 0] = bm.Quality.OUTSIDE
    stats = bm.matting.SolutionStats(grade=bm.Grade.ASSUMED, image_noise=NOISE, plate_noise=NOISE)
    solution = bm.Solution(*maps, model=bm.ColorModel.any(), solver="", stats=stats)
    return bm.LinearImage(image), bm.LinearImage(plate), solution


def test_wrong_factor_of_alpha_does_not_matter_over_the_same_plate(case):
    (line,) = usable_all_the_same(*case)
    assert "`remove`" in line
    assert "off by that factor" in line


def test_layer_that_does_not_give_back_the_image_is_not_called_usable(case):
    image, plate, solution = case
    half = replace(solution, premultiplied=0.5 * solution.premultiplied)
    assert usable_all_the_same(image, plate, half) == []


@pytest.mark.parametrize("change", [{"grade": bm.Grade.PLAUSIBLE}, {"may_be_shadow": True}])
def test_nothing_is_said_of_better_grades_and_shadows(case, change):
    image, plate, solution = case
    stats = replace(solution.stats, **change)
    assert usable_all_the_same(image, plate, replace(solution, stats=stats)) == []

"""Evidence of motion, and single pixels that are none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm
from blurmatte.streaks import evidence as module
from blurmatte.streaks.evidence import in_cells, outliers

NOISE = bm.NoiseModel(read_std=0.003)
SHAPE = (60, 80, 3)


@pytest.mark.parametrize("cell", [2, 3, 7])
def test_cells_are_means_up_to_the_border(cell):
    values = np.random.default_rng(0).uniform(size=(10, 13, 3))
    cells = in_cells(values, cell)
    assert cells.shape == (-(-10 // cell), -(-13 // cell), 3)
    assert_allclose(cells[0, 0], values[:cell, :cell].mean(axis=(0, 1)))
    assert_allclose(in_cells(np.ones((10, 13, 1)), cell), 1)


def pictures(seed=0):
    """Image and plate, as arrays: a smooth streak of contrast 0.4 over an uneven plate."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(SHAPE[:2])
    plate = 0.3 + 0.1 * np.sin(x / 7)[..., None] * np.ones(3)
    alpha = np.clip((9 - np.hypot(np.maximum(np.abs(x - 40) - 15, 0), y - 30)) / 3, 0, 1)[..., None]
    image = plate + alpha * np.array([0.4, 0.1, -0.2])
    return [light + rng.normal(0, 0.003, SHAPE) for light in (image, plate)]


def of(image, plate):
    return outliers(*(bm.LinearImage(light, NOISE) for light in (image, plate)))


@pytest.mark.parametrize("white", [5, 50, 500])
def test_fireflies_are_outliers_alone_in_pairs_and_in_the_streak(white):
    image, plate = pictures()
    places = [(8, 8), (30, 40), (50, 20), (50, 21)]
    for y, x in places:
        image[y, x] = white * np.array([1, 0.8, 0.7])
    assert sorted(map(tuple, np.argwhere(of(image, plate)).tolist())) == places


def test_dead_pixels_of_image_and_plate_are_outliers():
    image, plate = pictures()
    image[8, 8], plate[50, 20] = 0, 0
    assert sorted(map(tuple, np.argwhere(of(image, plate)).tolist())) == [(8, 8), (50, 20)]


@pytest.mark.parametrize("peak", [0.5, 5, 500])
@pytest.mark.parametrize("at", [(0, 0), (0.3, 0.5), (0.5, 0.5)])
def test_stars_are_no_outliers(peak, at):
    """A point spread of 0.45 pixels, integrated over pixels, at several places in a pixel."""
    from scipy.special import ndtr

    image, plate = pictures()
    y, x = (
        np.diff(ndtr((np.arange(n + 1) - 0.5 - c) / 0.45))
        for n, c in zip(SHAPE[:2], np.array([10, 10]) + at, strict=True)
    )
    image += peak * np.multiply.outer(y, x)[..., None]
    assert not of(image, plate).any()


def test_noise_and_a_streak_are_no_outliers():
    assert not of(*pictures(3)).any()


def test_search_finds_the_streak_and_not_a_firefly():
    image, plate = pictures()
    clean = bm.find_streaks(*(bm.LinearImage(light, NOISE) for light in (image, plate)))
    image[8, 8] = 500
    (found,) = bm.find_streaks(*(bm.LinearImage(light, NOISE) for light in (image, plate)))
    assert found.box == clean[0].box


def test_firefly_does_not_change_alpha_and_is_flagged():
    image, plate = (bm.LinearImage(light, NOISE) for light in pictures())
    box = bm.streaks.Streak.from_box((15, 15, 65, 45), image.size)
    model = bm.ColorModel.from_samples(np.array([[0.72, 0.42, 0.12]]), std=1e-6)
    clean = bm.solve(image, plate, model, bm.Pixelwise(), streak=box)
    light = image.rgb.copy()
    light[30, 40] = 50
    solution = bm.solve(replace(image, rgb=light), plate, model, bm.Pixelwise(), streak=box)
    assert solution.quality[30, 40] & bm.matting.Quality.SATURATED
    others = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE[:2]) != 30 * SHAPE[1] + 40
    assert np.allclose(solution.alpha[others], clean.alpha[others], equal_nan=True)


def test_neighbors_are_compared_for_strong_pixels_only(monkeypatch):
    """The cost of the comparison is that of the streak, whatever the size of the picture."""
    seen = []
    compare = module._exceed_neighbors
    monkeypatch.setattr(
        module, "_exceed_neighbors", lambda z, yx: seen.append(len(yx)) or compare(z, yx)
    )
    counts = []
    for times in (1, 8):
        image, plate = (np.pad(p, [(0, 60 * (times - 1)), (0, 0), (0, 0)]) for p in pictures())
        seen.clear()
        of(image, plate)
        counts.append(sum(seen))
    assert counts[0] == counts[1]
    assert 0 < counts[0] < 0.3 * SHAPE[0] * SHAPE[1]

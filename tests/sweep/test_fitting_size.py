"""The size at which a wide streak is fitted, and its solution in the pixels of the picture."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import on_line

from blurmatte.color.model import ColorModel
from blurmatte.matting import Averaged, solve
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, colorful_plate
from blurmatte.statistics import cell_means
from blurmatte.streaks import Streak
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.sweep.sweep import Sweep

CELL = 3
SIZE = FittingSize(CELL, (2, 4, 2 + 20 * CELL, 4 + 16 * CELL), (70, 60))
PATHS = {
    LINE: [5, 6, 14, 9],
    ARC: [5, 6, 14, 9, 1.5],
    CUBIC: [5, 6, 8, 8, 11, 9, 14, 8],
    BOUNCE: [5, 6, 9, 10, 14, 6, 0.4],
    FROM_REST: [5, 6, 14, 9, 0.3],
}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def sweep_of(family, silhouette, shape, cast=None):
    parameters = len(PATHS[family]) + len(shape)
    size, model = (20, 16), ColorModel.from_samples(np.array([0.8, 0.4, 0.1]), std=0)
    path, covariance = np.array(PATHS[family], float), 1e-4 * np.eye(parameters)
    return Sweep(family, path, silhouette, np.array(shape), model, covariance, size, cast=cast)


@pytest.fixture(scope="module")
def wide():
    """Scene with a streak of 34 pixels, and its pictures with noise."""
    plate = colorful_plate((200, 130), 3, tile=24)
    truth = on_line(plate, (60.3, 60.2), (142.1, 70.4), Ball(17.0, (0.75, 0.4, 0.06)))
    rng, camera = np.random.default_rng(0), Camera(code_std=1.5 / 255)
    return truth, [camera.photograph(one.rgb, rng) for one in (truth.image, truth.plate)]


@pytest.mark.parametrize("family", PATHS, ids=lambda family: family.name)
def test_a_sweep_in_cells_is_the_inverse_of_the_enlarged_one(family):
    small = sweep_of(family, Silhouette(2, soft=True), [3.0, 0.2, -0.1, 0.5])
    again = SIZE.sweep(small.enlarged(CELL, SIZE.origin, SIZE.size))
    assert again.size == small.size
    assert_allclose(again.path, small.path, atol=1e-9)
    assert_allclose(again.shape, small.shape)
    assert_allclose(again.covariance, small.covariance)


def test_a_map_in_the_picture_has_the_sum_of_its_cells(rng):
    cells = rng.uniform(0, 1, (16, 20, 3))
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    found = SIZE.in_picture(cells)
    assert found.shape == (60, 70, 3)
    assert_allclose(found.sum(axis=(0, 1)), CELL**2 * cells.sum(axis=(0, 1)))


@pytest.mark.parametrize("family", PATHS, ids=lambda family: family.name)
def test_an_enlarged_sweep_has_the_alpha_of_the_small_one_on_cells(family):
    small = sweep_of(family, Silhouette(2, soft=True), [3.0, 0.2, -0.1, 0.5])
    large = small.enlarged(CELL, SIZE.origin, SIZE.size)
    x, y = SIZE.origin
    on_cells = large.silhouette.sweep(
        family, large.path, large.shape, Pixels((16, 20), (x, y), CELL)
    )
    assert_allclose(on_cells.alpha, small.within((0, 0, 20, 16))[0], atol=1e-9)
    assert_allclose(large.area_std(), CELL**2 * small.area_std(), rtol=0.01)
    assert_allclose(large.radius, CELL * small.radius)
    assert_allclose(large.radius_std, CELL * small.radius_std)
    assert_allclose(large.length, CELL * small.length)


def test_an_enlarged_shadow_is_as_dark_on_cells():
    cast = CastShadow((2.0, 1.0), 1.2, (0.5, 0.5, 0.4))
    small = sweep_of(LINE, Silhouette(), [3.0], cast)
    large = small.enlarged(CELL, SIZE.origin, SIZE.size)
    assert large.cast is not None
    cells = Pixels((16, 20), SIZE.origin, CELL)
    expected = cast.missing(LINE, small.path, 3.0, Pixels((16, 20)))
    assert_allclose(large.cast.missing(LINE, large.path, 9.0, cells), expected, atol=1e-6)


def test_interpolation_of_cells_preserves_their_sum_and_a_slope(rng):
    values, box = np.zeros((16, 20)), (0, 0, 20, 16)
    values[2:-2, 2:-2] = rng.random((12, 16))
    found = SIZE.interpolated(values, box)
    assert found.shape == (16 * CELL, 20 * CELL)
    assert_allclose(found.sum(), CELL**2 * values.sum())
    slope = np.add.outer(2.0 * np.arange(16), 3.0 * np.arange(20))
    assert_allclose(cell_means(SIZE.interpolated(slope, box), CELL)[1:-1, 1:-1], slope[1:-1, 1:-1])


def test_repeated_cells_are_constant_and_reach_the_border_of_the_picture(rng):
    values, box = rng.random((16, 20)), (0, 0, 20, 16)
    assert_array_equal(cell_means(SIZE.repeated(values, box), CELL).round(12), values.round(12))
    at_border = replace(SIZE, size=(64, 53))
    assert at_border.enlarged_box(box) == (2, 4, 64, 53)
    assert at_border.repeated(values, box).shape == (49, 62)
    assert at_border.interpolated(values, box).shape == (49, 62)


def test_a_narrow_streak_is_fitted_as_it_is():
    assert FittingSize.of(Streak.from_box((50, 50, 150, 140), (200, 200))) is None


def test_a_wide_streak_is_fitted_on_no_more_than_the_given_width():
    streak = Streak.from_box((500, 50, 900, 290), (1000, 400))
    size = FittingSize.of(streak)
    assert size is not None
    assert size.cell == 3
    assert size.box == (44, 0, 44 + 318 * 3, 399)
    assert size.streak(streak).mask.sum() == pytest.approx(streak.mask.sum() / 9, rel=0.02)


def test_noise_of_means_is_that_of_independent_pixels_if_it_is_given():
    picture = LinearImage(np.full((60, 70, 3), 0.25, np.float32), NoiseModel(read_std=0.03))
    streak = Streak.from_box((20, 20, 40, 40), (70, 60))
    image, plate = SIZE.pictures(picture, picture, streak, measured=False)
    assert image.size == (20, 16)
    assert_allclose(np.sqrt(image.variance), 0.01, rtol=1e-5)
    assert_allclose(np.sqrt(plate.variance), 0.01, rtol=1e-5)


def test_noise_of_means_is_measured_again_if_pixels_are_correlated(rng):
    size = FittingSize(CELL, (0, 0, 300, 240), (300, 240))
    light = np.linspace(0.1, 0.6, 300)[:, None] * np.ones((240, 1, 3))
    pair = []
    for _ in range(2):
        blocks = 0.02 * np.kron(rng.standard_normal((120, 150, 3)), np.ones((2, 2, 1)))
        pair.append(LinearImage((light + blocks).astype(np.float32), NoiseModel(read_std=0.02)))
    streak = Streak.from_box((20, 20, 50, 50), (300, 240))
    image, plate = size.pictures(*pair, streak, measured=True)
    std = float(np.sqrt(np.mean(image.variance + plate.variance) / 2))
    true = float(np.std(cell_means(pair[0].rgb - light, CELL)))
    assert std == pytest.approx(true, rel=0.1)
    assert std > 1.5 * 0.02 / CELL


def test_noise_of_means_is_at_least_that_of_independent_pixels(rng):
    """Blocks of two JPEG files are equal where nothing moved, and differ where something did."""
    size = FittingSize(CELL, (0, 0, 240, 180), (240, 180))
    streak = Streak.from_box((60, 60, 150, 120), (240, 180))
    plate = rng.uniform(0.2, 0.4, (180, 240, 3)).astype(np.float32)
    change = 0.02 * rng.standard_normal(plate.shape) * streak.mask[..., None]
    noise = NoiseModel((1e-4,) * 3, (0.01,) * 3)
    image, plate = (LinearImage(rgb, noise) for rgb in ((plate + change).astype(np.float32), plate))
    for means, pixels in zip(
        size.pictures(image, plate, streak, True), (image, plate), strict=True
    ):
        independent = cell_means(pixels.variance, CELL) / CELL**2
        assert (means.variance >= 0.99 * independent).all()


@pytest.mark.parametrize("width", [20.0, 12.0])  # cells of 2 and of 3 pixels
def test_the_sum_of_alpha_is_the_same_at_every_size_within_its_error(wide, width):
    class OnCells(Averaged):
        fitted_width = width

    truth, (image, plate) = wide
    solution = solve(image, plate, solver=OnCells())
    total, error = solution.stats.sum_alpha, solution.stats.sum_alpha_std
    scale = solution.stats.alpha_scale_std
    true = truth.layer.alpha
    assert abs(total - true.sum()) < 3 * np.hypot(error, scale * total)
    assert np.hypot(error / total, scale) < 0.05
    inside = true > 0
    rmse = np.sqrt(np.mean((solution.alpha - true)[inside] ** 2))
    assert rmse < 2 * solution.stats.alpha_error
    assert solution.sweep is not None
    assert abs(solution.sweep.radius - 17.0) < 4 * solution.sweep.radius_std
    assert abs(solution.sweep.length - 82.4) < 1.0

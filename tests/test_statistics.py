"""Noise correlation from sums over blocks, robust scale, χ² quantiles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from scipy.optimize import nnls
from scipy.stats import chi2, norm

from blurmatte.statistics import (
    BLOCK_SIZES,
    MAD_TO_STD,
    MEDIAN_3,
    QUANTILE_999_3,
    block_squares,
    block_sums,
    cell_means,
    chi_square_quantile,
    core_mean_square,
    larger_covariance,
    nonnegative_least_squares,
    relative_difference,
    robust_std,
    scaled_inverse,
    significant_inflation,
    variance_inflation,
)

SHAPE = (61, 83)


def some(seed=0, share=0.7):
    """Noise of three channels, and which pixels to use; more of some blocks than of others."""
    rng = np.random.default_rng(seed)
    use = rng.uniform(size=SHAPE) < share
    use[:20, :30] = False
    return rng.normal(size=(*SHAPE, 3)), use


@pytest.mark.parametrize("size", [1, 2, 3, 8, 16])
def test_block_squares_equal_a_loop_over_blocks(size):
    """Oracle: one block after the other."""
    e, use = some()
    expected = []
    for y in range(0, SHAPE[0] - size + 1, size):
        for x in range(0, SHAPE[1] - size + 1, size):
            inside = use[y : y + size, x : x + size]
            if inside.sum() > size**2 / 2:
                total = e[y : y + size, x : x + size][inside].sum(axis=0)
                expected.append(total**2 / inside.sum())
    assert_allclose(block_squares(e, use, size), expected, rtol=1e-12)


@pytest.mark.parametrize("size", [1, 3, 8])
def test_block_sums_equal_a_loop_over_blocks(size):
    """Oracle: one block after the other."""
    e, _ = some(2)
    rows = range(0, SHAPE[0] - size + 1, size)
    columns = range(0, SHAPE[1] - size + 1, size)
    expected = [[e[y : y + size, x : x + size].sum(axis=(0, 1)) for x in columns] for y in rows]
    assert_allclose(block_sums(e, size), expected, rtol=1e-10, atol=1e-12)
    assert_allclose(block_sums(e[..., 0], size), np.array(expected)[..., 0], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("size", [4, 8, 16])
def test_block_squares_of_moved_axes_equal_those_of_planes(size):
    """Oracle: sums of planes, one by one."""
    e, use = some(1)
    h, w = (side // size * size for side in use.shape)

    def sums(x):
        return x[:h, :w].reshape(h // size, size, w // size, size).sum((1, 3))

    count = sums(use.astype(float))
    full = count > size**2 / 2
    planes = np.moveaxis(e, -1, 0)
    expected = [sums(np.where(use, x, 0))[full] ** 2 / count[full] for x in planes]
    assert_allclose(block_squares(np.moveaxis(planes, 0, -1), use, size).T, expected, rtol=1e-9)


def test_inflation_is_one_without_usable_blocks():
    """Exact."""
    e, use = some()
    assert block_squares(e, np.zeros_like(use), 4).shape == (0, 3)
    assert block_squares(e[:10], use[:10], 16).shape == (0, 3)
    assert_allclose(variance_inflation(e, np.zeros_like(use)), 1)
    assert_allclose(variance_inflation(0 * e, use), 1)


def test_inflation_of_white_noise_is_one_and_of_equal_pixels_their_number():
    """Exact: 1 for white noise, but for chance; all pixels of a block where they are the same."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=(640, 640, 3))
    use = np.ones((640, 640), bool)
    assert_allclose(variance_inflation(white, use), 1, atol=0.1)
    same = white[::4, ::4].repeat(4, 0).repeat(4, 1)
    assert_allclose(variance_inflation(same, use), np.tile([4, 16, 16, 16], (3, 1)), rtol=0.1)


def test_inflation_of_smoothed_noise_is_the_area_of_its_filter():
    """Oracle: white noise smoothed by a Gaussian of 1 pixel adds up over 4π pixels."""
    rng = np.random.default_rng(0)
    smooth = gaussian_filter(rng.normal(size=(800, 800, 3)), (1, 1, 0))
    found = variance_inflation(smooth, np.ones((800, 800), bool))
    assert np.all(np.diff(found, axis=1) > 0)
    edge = 1 - 1 / np.sqrt(np.pi) * 2 / BLOCK_SIZES[-1]  # boundary effect of each side of a block
    assert_allclose(found[:, -1], 4 * np.pi * edge**2, rtol=0.08)


def test_inflation_does_not_depend_on_scale():
    """Invariant: noise of twice the size is correlated as much."""
    e, use = some()
    assert_allclose(variance_inflation(2 * e, use), variance_inflation(e, use), rtol=1e-12)


@pytest.mark.parametrize("side", [1, 2, 3, 7])
@pytest.mark.parametrize("more", [(), (3,)])
def test_cell_means_equal_a_loop_over_cells(side, more):
    # oracle
    values = np.random.default_rng(side).normal(size=(23, 31, *more))
    cells = cell_means(values, side)
    assert cells.shape == (23 // side, 31 // side, *more)
    for i, j in np.ndindex(cells.shape[:2]):
        block = values[i * side : (i + 1) * side, j * side : (j + 1) * side]
        assert_allclose(cells[i, j], block.mean(axis=(0, 1)), atol=1e-12)


def test_cell_means_of_a_constant_are_exact_and_keep_the_dtype():
    ones = np.ones((12, 18, 1), np.float32)
    assert_array_equal(cell_means(ones, 6), 1)
    assert cell_means(ones, 6).dtype == np.float32


@pytest.mark.parametrize("inflation", [1.0, 4.0])
def test_core_mean_square_is_the_variance_despite_outliers(inflation):
    """Oracle: normal numbers of known variance; a tenth of large ones changes little."""
    squares = inflation * np.random.default_rng(3).normal(size=400_000) ** 2
    assert_allclose(core_mean_square(squares), inflation, rtol=0.01)
    squares[::40] = 1e6
    assert_allclose(core_mean_square(squares), inflation, rtol=0.2)
    assert core_mean_square(squares[:0]) == 1


def test_inflation_is_one_unless_significant():
    """Exact: normal numbers are no evidence, nor are few larger ones; many are."""
    squares = np.random.default_rng(4).normal(size=4000) ** 2
    assert significant_inflation(squares, 100) == 1
    assert significant_inflation(1.3 * squares, 10) == 1
    assert significant_inflation(1.3 * squares, 4000) > 1.2
    assert significant_inflation(squares, 0) == 1


def test_factor_is_that_of_the_normal_distribution():
    """Oracle: Φ⁻¹(3/4) of SciPy, to the digits printed."""
    assert_allclose(MAD_TO_STD, 1 / norm.ppf(0.75), atol=5e-5)


def test_std_of_normal_numbers_despite_outliers():
    """Exact, but for chance: outliers on both sides hardly change it."""
    x = 0.3 * np.random.default_rng(0).normal(size=20_000)
    assert_allclose(robust_std(x), 0.3, rtol=0.03)
    x[:400] = 1e9
    x[400:800] = -1e9
    assert_allclose(robust_std(x), 0.3, rtol=0.08)


@pytest.mark.parametrize("probability", [0.01, 0.25, 0.5, 1 - 6e-5])
def test_quantiles_are_those_of_scipy(probability):
    """Oracle."""
    dof = np.array([1, 2, 1.5, 3, 300])
    assert_allclose(chi_square_quantile(probability, dof), chi2.ppf(probability, dof), rtol=1e-9)


def test_constants_are_the_quantiles():
    """Oracle: to the digits printed."""
    assert_allclose(MEDIAN_3, chi2.ppf(0.5, 3), atol=5e-4)
    assert_allclose(QUANTILE_999_3, chi2.ppf(0.999, 3), atol=5e-3)


def test_scaled_inverse_does_not_depend_on_units():
    """Invariant: parameters of very different units; fixed ones stay 0."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 3))
    M, units = A.T @ A, np.array([1e-16, 1.0, 1e9])
    found = scaled_inverse(M * units * units[:, None])
    assert_allclose(found * units * units[:, None], np.linalg.inv(M), rtol=1e-9)
    fixed = np.zeros((4, 4))
    fixed[:3, :3] = M
    assert_allclose(scaled_inverse(fixed)[:3, :3], np.linalg.inv(M), rtol=1e-9)
    assert not scaled_inverse(fixed)[3].any()


def test_scaled_inverse_is_zero_without_information():
    """Exact: two parameters of which only the sum is known."""
    inverse = scaled_inverse(np.array([[4.0, 4.0], [4.0, 4.0]]))
    assert_allclose(inverse @ [1, -1], 0, atol=1e-15)
    assert_allclose(inverse @ [1, 1], 1 / 8)


def test_nonnegative_least_squares_are_those_of_scipy():
    """Oracle: for one to three columns, of very different size, with 0 to 3 active bounds."""
    rng = np.random.default_rng(5)
    active = set()
    for columns in (1, 2, 3):
        for _ in range(100):
            A = rng.normal(size=(20, columns)) * [1e-3, 1.0, 1e3][:columns]
            y = rng.normal(size=20)
            found = nonnegative_least_squares(A, y)
            known, _ = nnls(A, y)
            assert_allclose(
                found * np.linalg.norm(A, axis=0), known * np.linalg.norm(A, axis=0), atol=1e-12
            )
            active.add((columns, int(np.count_nonzero(found))))
    assert active == {(n, k) for n in (1, 2, 3) for k in range(n + 1)}


def test_nonnegative_least_squares_of_equal_columns_and_of_none():
    y = np.arange(1.0, 5)
    assert_allclose(nonnegative_least_squares(np.stack([y, y, 0 * y], axis=1), 2 * y).sum(), 2)
    assert_array_equal(nonnegative_least_squares(np.zeros((4, 2)), y), 0)


def test_the_larger_covariance_has_the_larger_variance_in_each_direction():
    """exact: of two with common axes; of one and nothing; whatever the units."""
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    one, other = np.array([1.0, 4, 9, 0]), np.array([2.0, 1, 0, 0])
    both = ((axes * values) @ axes.T for values in (one, other, np.maximum(one, other)))
    one, other, larger = both
    assert_allclose(larger_covariance(one, other), larger, atol=1e-9)
    assert_allclose(larger_covariance(other, one), larger, atol=1e-9)
    assert_allclose(larger_covariance(one, 0 * one), one, atol=1e-9)
    units = np.outer(*2 * [np.array([1.0, 1e3, 1e-3, 1])])
    assert_allclose(larger_covariance(units * one, units * other) / units, larger, atol=1e-8)


def test_relative_difference_is_of_the_larger_map():
    """exact"""
    a, b = np.array([1.0, 2.0, 0.0]), np.array([1.0, 3.0, 1.0])
    expected = np.sqrt(2 / 11)
    assert_allclose([relative_difference(a, b), relative_difference(b, a)], expected)
    assert relative_difference(a, a) == 0

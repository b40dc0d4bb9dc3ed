"""Mask: a silhouette of any form as the parts of cells that it covers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.model import mask_kernel as kernel
from blurmatte.sweep.model.mask import Mask
from blurmatte.sweep.model.path import ARC, LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import shape_kind

PIXELS = Pixels((40, 56), (3.0, 2.0))
ARCH = np.array([14.3, 16.2, 44.1, 30.4, 6.0])  # a path on an arc
RADIUS = np.array([8.0])


def washer(n=24, width=1.0):
    """A disc with a hole, in n x n cells, by counting points; the radius is RADIUS."""
    at = (np.arange(8 * n) + 0.5) / 8 - n / 2
    far = width * np.hypot(at, at[:, None])
    inside = (far < 8) & (far > 4)
    cells = inside.reshape(n, 8, n, 8).mean(axis=(1, 3))
    return Mask(tuple(map(tuple, cells.tolist())), width / RADIUS[0])


def test_alpha_is_the_time_that_cells_cover_a_pixel():
    """Oracle: points of cells, pixels and moments, counted."""
    mask, parts, times = washer(), 10, 400
    width, cells = mask.width * RADIUS[0], np.asarray(mask.cells)
    h, w = PIXELS.shape
    y, x = ((np.arange(n * parts) + 0.5) / parts - 0.5 for n in (h, w))
    seen = np.zeros((h * parts, w * parts))
    for cx, cy in LINE.at(ARCH[:4], (np.arange(times) + 0.5) / times)[0] - PIXELS.origin:
        i = np.floor((y - cy) / width + len(cells) / 2).astype(int)
        j = np.floor((x - cx) / width + len(cells) / 2).astype(int)
        ok = ((i >= 0) & (i < len(cells)))[:, None] & (j >= 0) & (j < len(cells))
        seen += np.where(ok, cells[i.clip(0, len(cells) - 1)][:, j.clip(0, len(cells) - 1)], 0)
    expected = seen.reshape(h, parts, w, parts).mean(axis=(1, 3)) / times
    assert_allclose(mask.sweep(LINE, ARCH[:4], RADIUS, PIXELS).alpha, expected, atol=4e-3)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_derivatives_are_those_of_alpha(scale):
    mask, pixels = washer(20, 1.3), PIXELS.coarser(int(scale))
    step = 1e-4 * np.eye(6)
    values = np.concatenate([ARCH, RADIUS])

    def alpha(p):
        return mask.sweep(ARC, p[:5], p[5:], pixels).alpha

    J = mask.sweep(ARC, ARCH, RADIUS, pixels).by_parameters
    for k in range(6):
        slope = (alpha(values + step[k]) - alpha(values - step[k])) / 2e-4
        assert_allclose(J[..., k], slope, atol=2e-3 * np.abs(J).max())


def test_spread_cells_are_the_sweep_of_a_mask_whose_cells_are_pixels():
    """Oracle: the exact overlap; to rounding."""
    mask = washer(21)
    t = (np.arange(60) + 0.5) / 60
    xy, D = LINE.at(ARCH[:4], t)
    at, weights = xy - PIXELS.origin, np.full(60, 1 / 60)
    alpha, J = np.zeros(PIXELS.shape), np.zeros((*PIXELS.shape, 5))
    kernel.sweep(mask.covered, 1.0, at, D, weights, alpha, J)
    first = np.floor(at.min(axis=0) - 10)
    spent = kernel.dwell(at - 10, D, weights, first, (40, 50))
    rows, columns = np.nonzero(np.abs(spent).sum(axis=0))
    offsets = np.stack([rows + int(first[1]), columns + int(first[0])], axis=1)
    spent = np.ascontiguousarray(spent[:, rows, columns].T)
    moved = np.zeros((5, *PIXELS.shape))
    kernel.moved(mask.covered, offsets, spent, moved)
    assert_allclose(moved[0], alpha, atol=1e-12)
    assert_allclose(np.moveaxis(moved[1:], 0, -1), J[..., :4], atol=1e-12)


def test_gathered_is_the_adjoint_of_moved():
    rng = np.random.default_rng(0)
    offsets, spent = rng.integers(-3, 20, (30, 2)), rng.uniform(size=(30, 1))
    x, y = rng.normal(size=(9, 7)), rng.normal(size=(1, 25, 22))
    moved, gathered = np.zeros(y.shape), np.zeros((1, *x.shape))
    kernel.moved(x, offsets, spent, moved)
    kernel.gathered(y, offsets, spent, gathered)
    assert_allclose((moved * y).sum(), (gathered[0] * x).sum())


def test_normal_matrix_is_that_of_moved_and_gathered():
    """Oracle: column by column."""
    rng = np.random.default_rng(1)
    offsets, spent = rng.integers(0, 9, (12, 2)), rng.uniform(size=(12, 1))
    offsets = np.unique(offsets, axis=0)
    spent = spent[: len(offsets)]
    q, number = rng.uniform(size=(14, 13)), np.full((5, 4), -1)
    number[1:4, :3] = np.arange(9).reshape(3, 3)
    H = kernel.normal_matrix(q, offsets, spent, number, 9)
    for k in range(9):
        one, moved, back = (number == k) * 1.0, np.zeros((1, *q.shape)), np.zeros((1, 5, 4))
        kernel.moved(one, offsets, spent, moved)
        kernel.gathered(q * moved, offsets, spent, back)
        assert_allclose(H[k], back[0][number >= 0])


def test_size_reach_center_and_outline_are_those_of_the_silhouette():
    mask = washer()
    assert mask.area(RADIUS) == pytest.approx(np.pi * (64 - 16), rel=0.01)
    assert mask.radius(2 * RADIUS) == pytest.approx(2 * np.sqrt(48), rel=0.01)
    assert_allclose(mask.center(RADIUS), 0, atol=1e-12)
    assert_allclose(np.hypot(*mask.outline(RADIUS, 90).T), 8, atol=0.4)
    assert 8 <= mask.reach(RADIUS) < 10


def test_center_of_a_part_is_its_centroid():
    """Exact: the right half of the cells."""
    mask = Mask(((0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 1.0, 1.0)), 0.5)
    assert_allclose(mask.center(np.array([4.0])), [2, 0])


def test_price_is_that_of_one_of_all_rims_of_its_length():
    """exact: of squares, at any size of the cells; a hole has a rim, too."""
    for side in (1, 4):
        square = Mask(((1.0,) * side,) * side, 0.3)
        length = 4 * side - 2 + np.sqrt(2)  # a cell at the corner has one step, along a diagonal
        assert square.price(np.array([7.0])) == pytest.approx(np.log(3) * length)
    full = np.ones((5, 5))
    hollow = full.copy()
    hollow[2, 2] = 0
    solid, holed = (Mask(tuple(map(tuple, one.tolist())), 0.3) for one in (full, hollow))
    assert holed.price(RADIUS) > solid.price(RADIUS) + np.log(3)


def test_distances_are_those_from_both_rims():
    lattice, x0, y0, h, polygon = washer().rim(RADIUS)
    rows, columns = lattice.shape[:2]
    far = np.hypot(x0 + h * np.arange(columns), (y0 + h * np.arange(rows))[:, None])
    near = np.minimum(np.abs(far - 8), np.abs(far - 4)) < 1
    true = np.minimum(8 - far, far - 4)
    assert_allclose(lattice[..., 0][near], true[near], atol=0.2)
    assert np.abs(polygon).max() < 16


@pytest.mark.parametrize(
    ("cells", "message"),
    [(((1.0,), (1.0, 0.5)), "one length"), (((0.0, 0.0),), "cover at least one cell")],
)
def test_cells_that_are_no_mask_are_refused(cells, message):
    with pytest.raises(ValueError, match=message):
        Mask(cells, 0.1)


def test_its_kind_in_files_is_known():
    assert shape_kind("mask") is Mask

"""The loops of `Smooth`: against matrices written out, and each other."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.matting import evidence_kernel
from blurmatte.matting import smooth_kernel as compiled
from blurmatte.matting.pixelwise import Pixelwise

SHAPE = 11, 13
BORDER = 2


@pytest.fixture(params=[1, 2], ids=["first", "second"])
def order(request):
    """Of the differences."""
    return request.param


def packed(matrices):
    """The lower triangles, row by row, as maps."""
    rows, columns = np.tril_indices(matrices.shape[-1])
    return np.ascontiguousarray(np.moveaxis(matrices[..., rows, columns], -1, 0))


def unpacked(maps, order):
    """(h, w, d, d) lower triangles."""
    matrices = np.zeros((*maps.shape[1:], order + 1, order + 1))
    rows, columns = np.tril_indices(order + 1)
    matrices[..., rows, columns] = np.moveaxis(maps, 0, -1)
    return matrices


@pytest.fixture
def mask():
    """A ragged region within the border."""
    mask = np.zeros(SHAPE, bool)
    inner = np.random.default_rng(0).uniform(size=(SHAPE[0] - 4, SHAPE[1] - 4)) < 0.8
    mask[BORDER:-BORDER, BORDER:-BORDER] = inner
    return mask


@pytest.fixture
def known(mask, order):
    """Information within the mask, and the Cholesky factor of the precision at each place."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(*SHAPE, order + 1, order + 1))
    precisions = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(order + 1)
    return rng.uniform(0.1, 2, SHAPE) * mask, packed(np.linalg.cholesky(precisions))


def differences(x, order):
    t = np.zeros((3, *SHAPE))
    compiled.forward(x, order, t)
    return t


def product(x, known, order, mask):
    y, t = np.zeros(SHAPE), np.zeros((3, *SHAPE))
    compiled.product(x, *known, order, mask, t, y)
    return y


def matrix(known, order, mask):
    """A + DᵀΓD, of the mask's pixels, by its columns from differences alone."""
    information, root = known
    L = unpacked(root, order)
    full = L @ np.swapaxes(L, -1, -2)
    D = []
    for place in np.argwhere(mask):
        unit = np.zeros(SHAPE)
        unit[tuple(place)] = 1
        D.append(np.moveaxis(differences(unit, order)[: order + 1], 0, -1))
    weighed = [np.einsum("hwij,hwj->hwi", full, d) for d in D]
    smooth = [[np.sum(a * b) for a in weighed] for b in D]
    return np.diag(information[mask]) + np.array(smooth)


def test_backward_is_the_adjoint_of_forward(order, mask):
    rng = np.random.default_rng(2)
    x = rng.normal(size=SHAPE) * mask
    t = rng.normal(size=(3, *SHAPE))
    t[order + 1 :] = 0
    y = np.zeros(SHAPE)
    compiled.backward(t, order, mask, y)
    inner = slice(1, -1)  # differences exclude the outermost ring
    expected = np.sum(differences(x, order)[:, inner, inner] * t[:, inner, inner])
    assert_allclose(np.sum(x * y), expected, rtol=1e-12)


def test_first_differences_of_a_ramp_and_second_of_a_bowl():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    inside = (slice(None), slice(1, -1), slice(1, -1))
    ramp = differences(2 * x - 3 * y, 1)[inside]
    assert_allclose(ramp[0], 2)
    assert_allclose(ramp[1], -3)
    bowl = differences(x**2 - 2 * y**2 + 3 * x * y, 2)[inside]
    assert_allclose(bowl[0], 2)
    assert_allclose(bowl[1], -4)
    assert_allclose(bowl[2], 3 * np.sqrt(2))


def test_product_and_diagonal_are_those_of_the_matrix(known, order, mask):
    H = matrix(known, order, mask)
    x = np.random.default_rng(3).normal(size=SHAPE) * mask
    y = product(x, known, order, mask)
    assert_allclose(y[mask], H @ x[mask], rtol=1e-10, atol=1e-12)
    assert np.all(y[~mask] == 0)
    assert_allclose(compiled.diagonal(*known, order, mask)[mask], np.diag(H), rtol=1e-12)


def test_conjugate_gradients_solve_the_equations(known, order, mask):
    b, x = np.random.default_rng(4).normal(size=SHAPE) * mask, np.zeros(SHAPE)
    compiled.conjugate_gradients(*known, order, mask, b, x, 500, 0.0)
    expected = np.linalg.solve(matrix(known, order, mask), b[mask])
    assert_allclose(x[mask], expected, rtol=1e-6, atol=1e-9)
    assert np.all(x[~mask] == 0)


def test_steps_beyond_convergence_do_not_change_the_solution(order, mask):
    """Invariant: well-conditioned equations, iterated past machine precision."""
    easy = (
        np.ones(SHAPE) * mask,
        0.03 * packed(np.broadcast_to(np.eye(order + 1), (*SHAPE, order + 1, order + 1))),
    )
    x = np.zeros(SHAPE)
    assert compiled.conjugate_gradients(*easy, order, mask, np.ones(SHAPE), x, 5000, 0.0) < 50
    assert_allclose(product(x, easy, order, mask)[mask], 1, rtol=1e-9)


def test_precisions_and_their_roots_are_those_of_the_matrices(order):
    """Oracle: NumPy's inverse and Cholesky factor."""
    t = np.random.default_rng(7).normal(size=(5, 3, *SHAPE))
    squares = np.zeros((3 * order, *SHAPE))
    for differing in t:
        compiled.outer(differing, order, 0.5, squares)
    inner = np.s_[1:-1, 1:-1]
    d = np.moveaxis(t[:, : order + 1], 1, -1)
    expected = 0.5 * np.einsum("nhwi,nhwj->hwij", d, d)
    assert_allclose(unpacked(squares, order)[inner], np.tril(expected)[inner], rtol=1e-12)
    root = np.zeros(squares.shape)
    least = np.random.default_rng(8).uniform(0.2, 0.4, SHAPE)
    compiled.precision(squares, order, least, 2.0, root)
    inverse = 2.0 * np.linalg.inv(expected + least[..., None, None] * np.eye(order + 1))
    L = np.linalg.cholesky(inverse)
    assert_allclose(unpacked(root, order)[inner], L[inner], rtol=1e-8, atol=1e-10)
    n, spread = t[0], np.zeros((3, *SHAPE))
    compiled.spread(root, order, n, spread)
    expected = np.einsum("hwij,jhw->ihw", L, n[: order + 1])
    assert_allclose(
        spread[: order + 1][(..., *inner)], expected[(..., *inner)], rtol=1e-8, atol=1e-9
    )


def test_solution_as_start_takes_no_step(known, order, mask):
    x = np.zeros(SHAPE)
    assert compiled.conjugate_gradients(*known, order, mask, np.zeros(SHAPE), x, 50, 1e-5) == 0
    assert np.all(x == 0)


@pytest.mark.parametrize("rank", [1, 2])
def test_evidence_for_a_plate_without_noise_is_the_closed_form(rank):
    rng = np.random.default_rng(5)
    model = ColorModel(np.linalg.qr(rng.uniform(0.1, 1, (3, rank)))[0])
    B = rng.uniform(0.2, 1, (*SHAPE, 3))
    C = (
        rng.uniform(0.2, 0.8, (*SHAPE, 1)) * B
        + 0.2 * rng.uniform(0, 1, (*SHAPE, rank)) @ model.basis.T
    )
    V_C, V_B = rng.uniform(1, 2, B.shape) * 1e-4, np.zeros(B.shape)
    information, pull = np.zeros((2, *SHAPE))
    evidence_kernel.evidence(
        C, B, V_C, V_B, np.ascontiguousarray(model.normals), np.zeros(SHAPE),
        np.ones(SHAPE, bool), information, pull,
    )  # fmt: skip
    maps = Pixelwise()(C, B, model, V_C, V_B)
    assert_allclose(pull / information, maps.alpha, rtol=1e-6)
    trust = information * maps.alpha_std**2  # equal weights of pixels that fit
    assert_allclose(trust, 1.2 if rank == 1 else 1.0, rtol=1e-6)


def test_noise_of_the_plate_does_not_bias_the_evidence():
    """A faint plate in noise: the mean alpha of many pixels is correct."""
    rng, shape = np.random.default_rng(6), (400, 400)
    l = np.array([0.8, 0.5, 0.33])
    N = np.linalg.svd(l[:, None])[0][:, 1:]
    B, alpha, V = np.array([0.05, 0.06, 0.08]), 0.3, np.full(3, 4e-4)
    C = alpha * l + (1 - alpha) * B + rng.normal(0, np.sqrt(V), (*shape, 3))
    plate = B + rng.normal(0, np.sqrt(V), (*shape, 3))
    information, pull = np.zeros((2, *shape))
    full = np.broadcast_to(V, C.shape).copy()
    evidence_kernel.evidence(
        C, plate, full, full, np.ascontiguousarray(N), np.full(shape, alpha), np.ones(shape, bool),
        information, pull,
    )  # fmt: skip
    b = B @ N
    sure = b @ np.linalg.inv(N.T @ np.diag(V + 0.49 * V) @ N) @ b
    # Noise in the plate seems to inform, too; what it pulls to is alpha all the same.
    assert abs(pull.sum() / information.sum() - alpha) < 0.02
    assert information.mean() > sure


def test_cells_of_half_the_width_lie_where_they_did():
    """Exact: of a field that is linear; at its rim it ends level."""
    y, x = np.mgrid[:9, :8].astype(float)
    coarse = np.pad(2 * x - 3 * y, BORDER)
    fine = np.zeros((17 + 2 * BORDER, 16 + 2 * BORDER))
    compiled.doubled(coarse, BORDER, fine)
    y, x = (np.mgrid[:17, :16] - 0.5) / 2  # centers, in cells of twice the width
    inner = fine[BORDER:-BORDER, BORDER:-BORDER]
    assert_allclose(inner[1:-1, 1:-1], (2 * x - 3 * y)[1:-1, 1:-1], rtol=1e-12)
    assert not fine[:BORDER].any()


def test_float32_agrees_with_float64(known, order, mask):
    """Oracle: the same equations in float64."""
    b, found = np.random.default_rng(4).normal(size=SHAPE) * mask, []
    for kind in (np.float32, np.float64):
        x = np.zeros(SHAPE, kind)
        given = [np.asarray(a, kind) for a in (*known, b)]
        compiled.conjugate_gradients(given[0], given[1], order, mask, given[2], x, 500, 1e-9)
        found.append(x)
    assert_allclose(found[0], found[1], atol=2e-3 * np.abs(found[1]).max())

"""Residuals: the compiled sums against the formulas written out, and their derivatives.

In this file N is across a model of colors and M within it, C and B are image and plate with the
variances V_C and V_B, all in small pictures of nothing in particular.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep import residuals as compiled
from blurmatte.sweep.frame import Frame

SHAPE = 6, 7
STEP = 1e-5


@dataclass(frozen=True)
class Picture:
    """Light, its noise, alpha, and a model of colors that all of it is compared with."""

    C: np.ndarray
    B: np.ndarray
    V_C: np.ndarray
    V_B: np.ndarray
    alpha: np.ndarray
    weights: np.ndarray
    frame: Frame
    coordinates: np.ndarray  # of the main color, within the frame
    most: float = 1e3  # light along the main color

    @property
    def light(self):
        return self.C, self.B, self.V_C, self.V_B

    @property
    def P(self):
        return self.C - (1 - self.alpha)[..., None] * self.B

    @property
    def V(self):
        return self.V_C + (1 - self.alpha)[..., None] ** 2 * self.V_B

    def residuals(self, alpha, frame):
        e = np.empty((3, *alpha.shape))
        compiled.residuals(
            *self.light, alpha, frame.across, frame.within @ self.coordinates, self.most, e
        )
        return e

    def cost(self, alpha, frame, K):
        """Half the weighted sum of squares, less what a turn gains by noise alone."""
        feigned = compiled.feigned_by_noise(
            *self.light, self.alpha, self.weights, self.frame.across, self.frame.within, K,
            self.frame.within @ self.coordinates, self.most, frame.across,
        )  # fmt: skip
        return (np.sum(self.weights * self.residuals(alpha, frame) ** 2) + feigned) / 2

    def normal_equations(self, J, K, bend=None):
        bend = 0 * self.alpha if bend is None else bend
        return compiled.normal_equations(
            J, *self.light, self.alpha, self.weights, bend, self.frame.across, self.frame.within, K,
            self.frame.within @ self.coordinates, self.most,
        )  # fmt: skip


def any_picture(rank, seed=0):
    """Bright pixels: light is nowhere negative."""
    rng = np.random.default_rng(seed)
    frame = Frame.of(rng.uniform(0.1, 1, (3, rank)))
    main = frame.within.T @ np.ones(3)
    return Picture(
        C=rng.uniform(0.5, 0.95, (*SHAPE, 3)),
        B=rng.uniform(0.05, 0.4, (*SHAPE, 3)),
        V_C=rng.uniform(1e-4, 1e-3, (*SHAPE, 3)),
        V_B=rng.uniform(1e-4, 1e-3, (*SHAPE, 3)),
        alpha=rng.uniform(0.05, 0.95, SHAPE),
        weights=rng.uniform(0.2, 1, SHAPE),
        frame=frame,
        coordinates=main / np.linalg.norm(main),
    )


def dark_picture(rank):
    """Light is negative in about half of the pixels; their noise is that of the image alone."""
    p = any_picture(rank, 1)
    rng = np.random.default_rng(2)
    C = (1 - p.alpha)[..., None] * p.B + rng.uniform(-0.5, 0.5, SHAPE)[..., None]
    even = np.full_like(p.V_C, 4e-4)
    return Picture(C, p.B, even, 0 * even, p.alpha, p.weights, p.frame, p.coordinates)


def bright_picture(rank):
    """Light is more than it can be in about half of the pixels."""
    p = any_picture(rank, 3)
    even = np.full_like(p.V_C, 4e-4)
    most = float(np.median(p.P @ (p.frame.within @ p.coordinates) / p.alpha))
    return replace(p, V_C=even, V_B=0 * even, most=most)


def padded(K):
    return np.pad(K, (0, 2 - len(K)))


def all_kept(rank):
    """Moments of colors so bright that noise is nothing."""
    return padded(1e9 * np.eye(rank))


def faint(rank):
    """Moments of colors about as strong as the noise."""
    root = np.random.default_rng(3).uniform(0, 0.03, (rank, rank))
    return padded(root @ root.T)


def by_differences(p, J, K):
    """Gradient by the parameters of J and both turns, by central differences."""
    zero, turns = np.zeros(2), STEP * np.eye(2)
    by_alpha = [
        p.cost(p.alpha + STEP * j, p.frame, K) - p.cost(p.alpha - STEP * j, p.frame, K)
        for j in np.moveaxis(J, 2, 0)
    ]
    by_turns = [
        p.cost(p.alpha, p.frame.turned(zero + t), K) - p.cost(p.alpha, p.frame.turned(zero - t), K)
        for t in turns
    ]
    return np.array([*by_alpha, *by_turns]) / (2 * STEP)


@pytest.fixture
def J():
    """Derivatives of alpha by three parameters, many of them 0."""
    J = np.random.default_rng(4).uniform(-1, 1, (*SHAPE, 3))
    return np.where(np.abs(J) < 0.5, 0, J)


@pytest.mark.parametrize("rank", [1, 2])
def test_chi2_agrees_with_matrices_written_out(rank):
    p = any_picture(rank)
    N, expected = p.frame.across, np.empty(SHAPE)
    for place in np.ndindex(*SHAPE):
        across = N.T @ p.P[place]
        covariance = N.T @ np.diag(p.V[place]) @ N
        expected[place] = across @ np.linalg.inv(covariance) @ across
    e = p.residuals(p.alpha, p.frame)
    assert_allclose((e**2).sum(axis=0), expected, rtol=1e-10)
    assert np.all(e[2] == 0)
    if rank == 2:
        assert np.all(e[1] == 0)


@pytest.mark.parametrize("rank", [1, 2])
def test_residuals_of_noise_have_unit_variance(rank):
    rng = np.random.default_rng(5)
    p = any_picture(rank)
    V, alpha = np.array([4e-4, 1e-4, 9e-4]), np.full((200, 200), 0.4)
    B = np.full((200, 200, 3), 0.3)
    C = 0.6 * B + 0.4 * p.frame.within @ p.coordinates + rng.normal(0, np.sqrt(V), B.shape)
    e = np.empty((3, 200, 200))
    main = p.frame.within @ p.coordinates
    compiled.residuals(C, B, V + 0 * B, 0 * B, alpha, p.frame.across, main, 1e3, e)
    noisy = e[: 3 - rank].reshape(3 - rank, -1)
    assert_allclose(noisy @ noisy.T / 200**2, np.eye(3 - rank), atol=0.03)


@pytest.mark.parametrize("rank", [1, 2])
def test_light_counts_as_negative_only_beyond_noise(rank):
    p = dark_picture(rank)
    main = p.frame.within @ p.coordinates
    in_deviations = (p.P @ main) / np.sqrt(p.V @ main**2)
    e = p.residuals(p.alpha, p.frame)[2]
    assert np.all(e[in_deviations > -3] == 0)
    assert np.all(e[in_deviations < -5] < -1)
    assert np.any(in_deviations < -5)


@pytest.mark.parametrize("rank", [1, 2])
def test_light_counts_as_too_much_only_beyond_noise(rank):
    """What an alpha allows grows with it; where nothing was, there is no light at all."""
    p = bright_picture(rank)
    main = p.frame.within @ p.coordinates
    for alpha in (p.alpha, np.zeros(SHAPE)):
        P = p.C - (1 - alpha)[..., None] * p.B
        in_deviations = (P @ main - alpha * p.most) / np.sqrt(p.V_C @ main**2)
        e = p.residuals(alpha, p.frame)[2]
        assert np.all(e[in_deviations < 3] == 0)
        assert np.all(e[in_deviations > 5] > 1)
        assert np.any(in_deviations > 5)


@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize("picture", [any_picture, dark_picture, bright_picture])
@pytest.mark.parametrize("moments", [all_kept, faint])
def test_gradient(rank, picture, moments, J):
    p, K = picture(rank), moments(rank)
    _, g = p.normal_equations(J, K)
    assert_allclose(g, by_differences(p, J, K), rtol=1e-5, atol=1e-7 * np.abs(g).max())


@pytest.mark.parametrize("rank", [1, 2])
def test_noise_alone_says_nothing_about_a_color(rank):
    """Where there is hardly any object, neither gradient nor curvature by turns; else there is."""
    rng, p, big = np.random.default_rng(6), any_picture(rank), (60, 60)
    B = np.full((*big, 3), 0.3)
    V = np.array([4e-4, 1e-4, 9e-4]) + 0 * B
    noise = rng.uniform(-1, 1, B.shape) * np.sqrt(3 * V)
    alpha = np.full(big, 0.01)
    p = Picture(0.99 * B + noise, B, V, 0 * B, alpha, 1 + 0 * alpha, p.frame, p.coordinates)
    J = np.zeros((*big, 0))
    H_kept, g_kept = p.normal_equations(J, all_kept(rank))
    H, g = p.normal_equations(J, padded(1e-3 * np.eye(rank)))
    assert np.abs(g).max() < 0.01 * np.abs(g_kept).max()
    assert np.abs(H).max() < 0.01 * np.abs(H_kept).max()


@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize(
    ("picture", "moments"),
    [
        (any_picture, all_kept),
        (any_picture, faint),
        (dark_picture, all_kept),
        (dark_picture, faint),
        (bright_picture, all_kept),
        (bright_picture, faint),
    ],
)
def test_curvature_is_symmetric_and_nowhere_negative(rank, picture, moments, J):
    p = picture(rank)
    chi2 = (p.residuals(p.alpha, p.frame) ** 2).sum(axis=0)
    for part in (0, 1):  # of the curvature along residuals, what is taken off
        H, _ = p.normal_equations(J, moments(rank), part / chi2)
        assert_allclose(H, H.T, rtol=1e-14)
        values = np.linalg.eigvalsh(H)
        assert values[0] > -1e-10 * values[-1]


@pytest.mark.parametrize("rank", [1, 2])
def test_bent_curvature_is_less_by_the_squares_of_gradients(rank, J):
    p, K, bend = any_picture(rank), all_kept(rank), np.random.default_rng(10).uniform(0, 1, SHAPE)
    H, _ = p.normal_equations(J, K)
    less, _ = p.normal_equations(J, K, bend)
    expected = np.zeros_like(H)
    for y, x in np.ndindex(SHAPE):
        one = replace(p, weights=np.zeros(SHAPE))
        one.weights[y, x] = 1
        _, g = one.normal_equations(J, K)
        expected += p.weights[y, x] * bend[y, x] * np.outer(g, g)
    assert_allclose(H - less, expected, atol=1e-10 * np.abs(H).max())


@pytest.mark.parametrize("rank", [1, 2])
def test_curvature_where_the_model_is_right(rank, J):
    """With nothing left over, the second differences of the cost."""
    p = any_picture(rank)
    k = p.coordinates + np.random.default_rng(7).uniform(-0.3, 0.3, (*SHAPE, rank))
    C = p.alpha[..., None] * (k @ p.frame.within.T) + (1 - p.alpha)[..., None] * p.B
    little = np.full_like(C, 1e-9)
    p = Picture(C, p.B, little, little, p.alpha, p.weights, p.frame, p.coordinates)
    H, g = p.normal_equations(J, all_kept(rank))

    def cost(x):
        return p.cost(p.alpha + J @ x[:3], p.frame.turned(x[3:]), all_kept(rank))

    d = STEP * np.eye(5)
    expected = [
        [(cost(a + b) - cost(a - b) - cost(b - a) + cost(-a - b)) / (4 * STEP**2) for b in d]
        for a in d
    ]
    assert_allclose(H, expected, atol=1e-5 * np.abs(H).max())
    assert_allclose(g, 0, atol=1e-9 * np.abs(H).max())


@pytest.mark.parametrize("rank", [1, 2])
def test_second_moments_of_colors_seen_without_noise(rank):
    p = any_picture(rank)
    k = np.random.default_rng(8).uniform(0.2, 1, (*SHAPE, rank))
    C = p.alpha[..., None] * (k @ p.frame.within.T) + (1 - p.alpha)[..., None] * p.B
    little = np.full_like(C, 1e-14)
    counts = p.weights * p.alpha**4
    expected = np.einsum("hw,hwi,hwj->ij", counts, k, k) / counts.sum()
    K = compiled.second_moments(
        C, p.B, little, little, p.alpha, p.weights, p.frame.across, p.frame.within
    )
    assert_allclose(K, padded(expected), rtol=1e-8)


@pytest.mark.parametrize("rank", [1, 2])
def test_second_moments_have_no_bias_by_noise(rank):
    """A faint object in noise whose squares are about as large as the object's."""
    rng, frame, big = np.random.default_rng(9), any_picture(rank).frame, (300, 300)
    alpha = rng.uniform(0, 0.1, big)
    k = rng.uniform(0.2, 0.6, (*big, rank))
    B = np.full((*big, 3), 0.3)
    V_C, V_B = (np.array(v) + 0 * B for v in ([1e-3, 2e-3, 5e-4], [4e-4, 1e-4, 9e-4]))
    C = alpha[..., None] * (k @ frame.within.T) + rng.normal(0, np.sqrt(V_C))
    C += (1 - alpha)[..., None] * (B + rng.normal(0, np.sqrt(V_B)))
    K = compiled.second_moments(C, B, V_C, V_B, alpha, np.ones(big), frame.across, frame.within)
    expected = np.einsum("hw,hwi,hwj->ij", alpha**4, k, k) / np.sum(alpha**4)
    assert_allclose(K, padded(expected), atol=0.03)

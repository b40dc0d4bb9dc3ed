"""Silhouettes on a path: alpha against counted points, derivatives against small steps.

A pixel at the rim is taken for cut by a straight edge, so that single pixels are off by about a
thousandth and derivatives by some percent, but sums over a rim are right.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm
from scipy.signal import fftconvolve
from tests.sweep.scenes import wrong_derivatives

from blurmatte.rendering.coverage import disc_coverage
from blurmatte.sweep.model.path import ARC, BOUNCE, FROM_REST, LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette, moments

SIZE = W, H = 40, 30
STRAIGHT, ROUND = np.array([12.3, 11.4, 26.1, 18.8]), np.array([12.3, 17.4, 26.1, 16.8, -5])
OUTLINE, TURNING, SPINNING = Silhouette(5), Silhouette(2, turns=True), Silhouette(4, turns=True)

SHAPES = {
    DISC: np.array([6.2]),
    ELLIPSE: np.array([6, 0.3, -0.2]),
    OUTLINE: np.array([6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -0.02, 0.01]),
    TURNING: np.array([6, 0.3, 0.1, 1.2]),
    SPINNING: np.array([6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -1.5]),
}
SOFT = {
    Silhouette(1, soft=True): np.array([6.2, 1.2]),
    Silhouette(4, turns=True, soft=True): np.array(
        [6, 0.2, 0.1, 0.06, -0.04, 0.03, 0.02, -1.5, 0.8]
    ),
}
every_soft_kind = pytest.mark.parametrize("silhouette", SOFT, ids=lambda s: s.name)
every_kind = pytest.mark.parametrize("silhouette", SHAPES, ids=lambda silhouette: silhouette.name)


def canvas(width=W, height=H, origin=(0.0, 0.0)):
    return Pixels((height, width), origin)


def swept(silhouette, family=ARC, path=ROUND, pixels=None):
    return silhouette.sweep(family, path, SHAPES[silhouette], pixels or canvas())


def counted(silhouette, family, path, shape, n=8, times=160):
    """Count n × n points of every pixel at many times."""
    return of_pixels(points(silhouette, family, path, shape, n, times), n)


def of_pixels(fine, n):
    return fine.reshape(H, n, W, n).mean(axis=(1, 3))


def points(silhouette, family, path, shape, n=8, times=160):
    """The fraction of the exposure for which each of n × n points of every pixel was inside."""
    x, y = ((np.arange(n * side) + 0.5) / n - 0.5 for side in SIZE)
    a, b = shape[1:3] if silhouette.order > 1 else (0, 0)
    (p, q), (r, s) = np.linalg.inv(shape[0] * expm(np.array([[a, b], [b, -a]])))
    waves = shape[3 : 2 * silhouette.order - 1].reshape(-1, 2) @ [1, -1j]
    inside = np.zeros((len(y), len(x)))
    for t in (np.arange(times) + 0.5) / times:
        cx, cy = family.at(path, np.array([t]))[0][0]
        turn = shape[-1] * (t - 0.5) if silhouette.turns else 0
        z = (x - cx + 1j * (y - cy)[:, None]) * np.exp(-1j * turn)
        round_star = p * z.real + q * z.imag + 1j * (r * z.real + s * z.imag)
        distance = np.abs(round_star)
        unit = round_star / distance
        log_rim = (np.polyval([*waves[::-1], 0, 0, 0], unit)).real
        inside += distance < np.exp(log_rim)
    return inside / times


def block_means(alpha, by):
    return alpha.reshape(H // by, by, W // by, by).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("silhouette", "family", "path"),
    [(DISC, LINE, STRAIGHT), *((s, ARC, ROUND) for s in (ELLIPSE, OUTLINE, TURNING, SPINNING))],
    ids=lambda value: getattr(value, "name", ""),
)
def test_alpha_agrees_with_counting_points(silhouette, family, path):
    alpha = swept(silhouette, family, path).alpha
    expected = counted(silhouette, family, path, SHAPES[silhouette])
    assert_allclose(alpha, expected, rtol=0, atol=3e-3)
    assert np.sqrt(np.mean((alpha - expected) ** 2)) < 3e-4


@pytest.mark.parametrize("radius", [0.8, 2, 7])
def test_a_resting_disc_covers_pixels_as_a_disc_does(radius):
    x, y = 17.3, 12.8
    alpha = DISC.sweep(LINE, np.array([x, y, x, y]), np.array([radius]), canvas()).alpha
    exact = disc_coverage(np.arange(W + 1) - 0.5 - x, np.arange(H + 1) - 0.5 - y, radius)
    assert_allclose(alpha, exact, rtol=0, atol=0.1 / radius**2 + 5e-3)
    assert_allclose(alpha.sum(), exact.sum(), rtol=2e-2 if radius < 1 else 5e-3)


@every_kind
def test_alpha_sums_to_the_area(silhouette):
    alpha = swept(silhouette).alpha
    assert_allclose(alpha.sum(), silhouette.area(SHAPES[silhouette]), rtol=1e-4)
    assert alpha.min() == 0
    assert alpha.max() < 1 + 1e-9


@pytest.mark.parametrize(
    ("family", "path"),
    [
        (BOUNCE, np.array([12, 12, 20, 18, 27, 12, 0.7])),
        (FROM_REST, np.array([12, 12, 27, 17, 0.6])),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_alpha_is_weighted_by_the_time_spent(family, path):
    """Its center of mass is the mean of the path."""
    alpha = swept(OUTLINE, family, path).alpha
    still = OUTLINE.sweep(LINE, np.array([20.0, 15, 20, 15]), SHAPES[OUTLINE], canvas()).alpha
    off = centroid(still) - (20, 15)
    mean = family.at(path, (np.arange(1000) + 0.5) / 1000)[0].mean(axis=0)
    assert_allclose(centroid(alpha), mean + off, rtol=0, atol=0.01)


def centroid(alpha):
    y, x = np.indices(alpha.shape)
    return np.array([np.sum(x * alpha), np.sum(y * alpha)]) / alpha.sum()


@every_kind
def test_derivatives_are_those_of_small_steps(silhouette):
    for i, off in enumerate(wrong_derivatives(silhouette, ROUND, SHAPES[silhouette], canvas())):
        is_fourier = i >= len(ROUND) + 1 and silhouette.order > 2
        assert off < (0.05 if is_fourier else 0.02)


@every_kind
def test_derivatives_add_up_to_that_of_the_area(silhouette):
    """Path, stretch and rotation leave the area unchanged; a shift of a pixel moves its rim."""
    J, shape, step = swept(silhouette).by_parameters, SHAPES[silhouette], 1e-5
    n, rim = len(ROUND), 2 * np.pi * shape[0]
    assert_allclose(J[..., :n].sum(axis=(0, 1)), 0, atol=1e-3 * rim)
    for i, along in enumerate(step * np.eye(len(shape))):
        slope = (silhouette.area(shape + along) - silhouette.area(shape - along)) / (2 * step)
        size = rim * (1 if i == 0 else shape[0])
        assert_allclose(J[..., n + i].sum(), slope, rtol=0, atol=5e-3 * size)


@every_kind
def test_alpha_is_cropped_at_the_border(silhouette):
    whole, part = swept(silhouette), swept(silhouette, pixels=canvas(11, 9, (14.0, 10.0)))
    assert_allclose(part.alpha, whole.alpha[10:19, 14:25], rtol=0, atol=1e-12)
    assert_allclose(part.by_parameters, whole.by_parameters[10:19, 14:25], rtol=0, atol=1e-11)
    nowhere = swept(silhouette, pixels=canvas(8, 9, (200.0, 10.0)))
    assert not nowhere.alpha.any()
    assert not nowhere.by_parameters.any()


@pytest.mark.parametrize("by", [2, 5])
@every_kind
def test_alpha_on_coarse_pixels_is_the_mean_of_blocks(silhouette, by):
    fine, coarse = swept(silhouette), swept(silhouette, pixels=canvas().coarser(by))
    assert_allclose(
        coarse.alpha, block_means(fine.alpha, by), rtol=0, atol=0.01 if by == 2 else 0.03
    )
    assert_allclose(coarse.alpha.sum() * by**2, fine.alpha.sum(), rtol=1e-3 if by == 2 else 0.02)
    for i in range(len(ROUND) + 1):  # of the path and the radius, in pixels of the picture
        means = block_means(fine.by_parameters[..., i], by)
        off = np.linalg.norm(coarse.by_parameters[..., i] - means)
        assert off < 0.15 * np.linalg.norm(means)


def test_shifted_centers_shift_alpha():
    shifted = swept(SPINNING, path=ROUND + np.array([3, -2, 3, -2, 0])).alpha
    assert_allclose(shifted[:-2, 3:], swept(SPINNING).alpha[2:, :-3], rtol=0, atol=1e-9)


def mirrored(silhouette, shape):
    """The mirrored shape, x and y exchanged: the angle φ becomes π/2 − φ."""
    swapped = shape.copy()
    swapped[1] *= -1
    for k in range(3, silhouette.order + 1):
        c, s = shape[2 * k - 3 : 2 * k - 1]
        angle = k * np.pi / 2
        swapped[2 * k - 3] = c * np.cos(angle) + s * np.sin(angle)
        swapped[2 * k - 2] = c * np.sin(angle) - s * np.cos(angle)
    if silhouette.turns:
        swapped[-1] *= -1
    return swapped


@pytest.mark.parametrize("silhouette", [ELLIPSE, OUTLINE, SPINNING], ids=lambda s: s.name)
def test_a_mirrored_picture_has_a_mirrored_alpha(silhouette):
    path, pixels = np.array([*ROUND[[1, 0, 3, 2]], -ROUND[4]]), canvas(H, W)
    mirror = silhouette.sweep(ARC, path, mirrored(silhouette, SHAPES[silhouette]), pixels).alpha
    assert_allclose(mirror.T, swept(silhouette).alpha, rtol=0, atol=1e-9)


def test_extreme_outlines_are_recognized():
    assert not DISC.extreme(np.array([300.0]))
    star, long = np.zeros(2 * 6 - 1), np.array([9.0, 1.2, 1.2])  # a rod, 30 times as long as wide
    star[[0, 7]] = 9, 0.5  # five points, e times as far from the center as the notches
    assert not Silhouette(6).extreme(star)
    assert not ELLIPSE.extreme(long)
    star[3:] = 0.4
    assert Silhouette(6).extreme(star)
    assert ELLIPSE.extreme(1.2 * long)


def test_alpha_is_the_same_in_both_directions_of_time():
    back = np.array([*ROUND[2:4], *ROUND[:2], -ROUND[4]])
    for silhouette, shape in SHAPES.items():
        reversed_shape = np.array([*shape[:-1], -shape[-1]]) if silhouette.turns else shape
        alpha = silhouette.sweep(ARC, back, reversed_shape, canvas()).alpha
        assert_allclose(alpha, swept(silhouette).alpha, rtol=0, atol=1e-9)


def test_every_kind_contains_the_disc():
    disc = swept(DISC)
    for silhouette in (ELLIPSE, OUTLINE, TURNING, SPINNING):
        shape = silhouette.like(DISC, SHAPES[DISC])
        assert_array_equal(shape, silhouette.start(6.2))
        same = silhouette.sweep(ARC, ROUND, shape, canvas())
        n = len(ROUND)
        assert_allclose(same.alpha, disc.alpha, rtol=0, atol=1e-4)
        assert_allclose(
            same.by_parameters[..., : n + 1], disc.by_parameters[..., : n + 1], rtol=0, atol=3e-3
        )


def test_like_keeps_the_common_parameters():
    for poor, rich in ((ELLIPSE, OUTLINE), (ELLIPSE, TURNING), (OUTLINE, Silhouette(6, True))):
        shape = rich.like(poor, SHAPES[poor])
        assert shape.shape == (rich.size,)
        assert_allclose(
            rich.sweep(ARC, ROUND, shape, canvas()).alpha, swept(poor).alpha, rtol=0, atol=1e-9
        )
    assert_array_equal(OUTLINE.like(OUTLINE, SHAPES[OUTLINE]), SHAPES[OUTLINE])
    assert_array_equal(ELLIPSE.like(SPINNING, SHAPES[SPINNING]), [6, 0.2, 0.1])
    assert_array_equal(TURNING.like(SPINNING, SHAPES[SPINNING]), [6, 0.2, 0.1, -1.5])
    assert_array_equal(DISC.like(TURNING, SHAPES[TURNING]), [6])


@every_kind
def test_outline_area_radius_and_reach_agree(silhouette):
    shape = SHAPES[silhouette]
    x, y = silhouette.outline(shape, 4000).T
    area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2
    assert_allclose(silhouette.area(shape), area, rtol=1e-5)
    assert_allclose(np.pi * silhouette.radius(shape) ** 2, area, rtol=1e-5)
    assert_allclose(silhouette.reach(shape), np.hypot(x, y).max(), rtol=1e-3)


def test_a_stretch_preserves_the_area_and_has_its_axes():
    shape = np.array([6, 0.3 * np.cos(0.8), 0.3 * np.sin(0.8)])
    assert_allclose(ELLIPSE.area(shape), np.pi * 6**2)
    assert_allclose(ELLIPSE.reach(shape), 6 * np.exp(0.3), rtol=1e-4)
    x, y = ELLIPSE.outline(shape, 3600).T
    i = np.argmax(np.hypot(x, y))
    assert_allclose(np.arctan2(y[i], x[i]) % np.pi, 0.4, atol=2e-3)
    assert_allclose(np.hypot(x, y).min(), 6 * np.exp(-0.3), rtol=1e-4)


@pytest.mark.parametrize("silhouette", [ELLIPSE, OUTLINE, SPINNING], ids=lambda s: s.name)
def test_mapped_maps_every_point_of_the_rim(silhouette):
    """exact, except for the rotation, which is unchanged."""
    shape, by = SHAPES[silhouette], np.array([[1.4, 0.7], [0.1, 1.3]])
    new = silhouette.mapped(shape, by)
    assert_allclose(silhouette.turn(new), silhouette.turn(shape))
    wanted = silhouette.outline(shape, 60) @ by.T
    rim = silhouette.outline(new, 20_000)
    off = np.linalg.norm(wanted[:, None] - rim, axis=2).min(axis=1)
    assert off.max() < 2e-3
    assert_allclose(silhouette.area(new), np.linalg.det(by) * silhouette.area(shape))


def test_a_mapped_disc_has_the_mapped_area():
    assert_allclose(DISC.mapped(np.array([6.0]), np.diag([4.0, 1])), [12])


def test_fourier_coefficients_are_those_of_the_log_radius():
    shape = OUTLINE.start(6)
    shape[4] = 0.1  # sin 3φ
    x, y = OUTLINE.outline(shape, 360).T
    phi = 2 * np.pi * np.arange(360) / 360
    assert_allclose(np.hypot(x, y), 6 * np.exp(0.1 * np.sin(3 * phi)))
    assert_allclose(np.arctan2(y, x) % (2 * np.pi), phi, atol=1e-12)


@every_soft_kind
def test_soft_rim_is_a_blurred_rim(silhouette):
    """Oracle: points of the sharp one, many in each pixel, averaged over a circle of confusion."""
    shape, n = SOFT[silhouette], 8
    sharp = Silhouette(silhouette.order, silhouette.turns)
    alpha = silhouette.sweep(ARC, ROUND, shape, canvas()).alpha
    fine = points(sharp, ARC, ROUND, shape[:-1], n)
    radius = 2 * n * shape[-1]
    edges = np.arange(-np.ceil(radius), np.ceil(radius) + 2) - 0.5
    disc = disc_coverage(edges, edges, radius) / (np.pi * radius**2)
    blurred, fine = (of_pixels(x, n) for x in (fftconvolve(fine, disc, mode="same"), fine))
    assert_allclose(alpha, blurred, rtol=0, atol=1e-2)
    assert np.sqrt(np.mean((alpha - blurred) ** 2)) < 1e-3
    assert_allclose(alpha.sum(), silhouette.area(shape), rtol=2e-3)
    assert np.abs(fine - blurred).max() > 0.05  # it is seen


@every_soft_kind
def test_derivatives_of_soft_rims_are_those_of_small_steps(silhouette):
    for i, off in enumerate(wrong_derivatives(silhouette, ROUND, SOFT[silhouette], canvas())):
        assert off < (0.2 if i >= len(ROUND) + 1 and silhouette.order > 2 else 0.04)


def test_softness_is_bounded():
    soft = Silhouette(2, soft=True)
    assert_array_equal(soft.possible(np.array([4.0, 0.1, 0.2, 5]), (2, 8)), [4, 0.1, 0.2, 2])
    assert_allclose(soft.possible(np.array([90.0, 0.1, 0.2, 50]), (2, 80)), [80, 0.1, 0.2, 24])
    assert soft.possible(np.array([1.0, 0.1, 0.2, -1]), (2, 8))[0] == 2
    assert 0 < soft.possible(np.array([1.0, 0.1, 0.2, -1]), (2, 8))[-1] < 0.5
    assert_array_equal(ELLIPSE.possible(np.array([9.0, 0.1, 0.2]), (2, 8)), [8, 0.1, 0.2])
    assert_array_equal(soft.like(ELLIPSE, SHAPES[ELLIPSE]), [6, 0.3, -0.2, 0])
    spinning = Silhouette(4, turns=True, soft=True)
    assert_array_equal(TURNING.like(spinning, SOFT[spinning]), [6, 0.2, 0.1, -1.5])
    assert spinning.softness(SOFT[spinning]) == 0.8
    assert spinning.turn(SOFT[spinning]) == -1.5
    assert ELLIPSE.softness(SHAPES[ELLIPSE]) == 0


def test_moments_cover_the_exposure_in_short_steps():
    path = np.array([10, 10, 30, 10, 33, 25, 0.7])
    far = path * [20, 20, 20, 20, 20, 20, 1]
    t, weights = moments(BOUNCE, path, 1.0)
    assert_allclose(weights.sum(), 1)
    assert_allclose(t, np.cumsum(weights) - weights / 2)
    assert np.linalg.norm(np.diff(BOUNCE.at(path, t)[0], axis=0), axis=1).max() < 1
    assert len(moments(BOUNCE, far, 1.0)[0]) > 5 * len(t)
    assert_array_equal(moments(BOUNCE, far, 20.0)[0], t)
    assert len(moments(BOUNCE, path, 1.0, rim_motion=200)[0]) > 3 * len(t)
    assert_array_equal(moments(BOUNCE, path + 1e-7, 1.0)[0], t)


def test_parameters_have_names():
    assert [s.name for s in SHAPES] == [
        "disc", "ellipse", "outline of order 5", "turning ellipse", "turning outline of order 4",
    ]  # fmt: skip
    for silhouette, shape in SHAPES.items():
        assert silhouette.size == len(shape)


@pytest.mark.parametrize(
    ("order", "turns", "words"),
    [
        (0, False, "order must be 1 or more, got 0"),
        (-3, True, "order must be 1 or more, got -3"),
        (1, True, "that turns must be of order 2 or more, got a disc"),
    ],
)
def test_a_wrong_order_raises(order, turns, words):
    with pytest.raises(ValueError, match=words):
        Silhouette(order, turns)


def test_the_truncation_error_is_the_last_order():
    outline = Silhouette(4, turns=True)
    shape = outline.start(12.0)
    shape[5:7] = 0.03, -0.04
    assert_allclose(outline.left_out(shape), 12 * 0.05)
    assert ELLIPSE.left_out(ELLIPSE.start(9.0)) == 0


@pytest.mark.parametrize("soft", [False, True])
def test_stretch_of_the_camera_is_that_of_an_ellipse(soft):
    """Exact: a disc that the camera stretches, and an outline of which it does a part."""
    blur = [0.9] * soft
    ellipse = Silhouette(2, soft=soft).sweep(ARC, ROUND, np.array([6, 0.3, -0.2, *blur]), canvas())
    disc = Silhouette(1, soft=soft, camera_stretch=(0.3, -0.2))
    seen = disc.sweep(ARC, ROUND, np.array([6.0, *blur]), canvas())
    assert_allclose(seen.alpha, ellipse.alpha, atol=1e-12)
    n = len(ROUND)
    kept = [*range(n + 1), *range(n + 3, n + 3 + soft)]
    assert_allclose(seen.by_parameters, ellipse.by_parameters[..., kept], atol=1e-9)
    part = Silhouette(2, soft=soft, camera_stretch=(0.1, -0.1))
    rest = part.sweep(ARC, ROUND, np.array([6, 0.2, -0.1, *blur]), canvas())
    assert_allclose(rest.alpha, ellipse.alpha, atol=1e-12)
    assert disc.area(np.array([6, *blur])) == pytest.approx(np.pi * 36)


def test_opacity_is_a_factor_of_alpha_but_not_of_coverage():
    """Exact."""
    opaque, thin = Silhouette(1), Silhouette(1, opacity=0.3)
    full, part = (one.sweep(ARC, ROUND, np.array([6.0]), canvas()) for one in (opaque, thin))
    assert_allclose(part.alpha, 0.3 * full.alpha, atol=1e-15)
    assert_allclose(part.by_parameters, 0.3 * full.by_parameters, atol=1e-15)
    assert_allclose(*(one.coverage(np.array([6.0]), canvas()) for one in (opaque, thin)))


@pytest.mark.parametrize("opacity", [-0.1, 1.1, np.nan])
def test_impossible_opacity_is_refused(opacity):
    with pytest.raises(ValueError, match="opacity must be from 0 to 1, got"):
        Silhouette(1, opacity=opacity)

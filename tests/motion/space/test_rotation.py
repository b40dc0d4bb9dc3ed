"""measure_rotation: rotation about a point, from alpha around it."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import rendered, solution_of

import blurmatte as bm
from blurmatte.motion.space.rotation import _check_same, _Trial
from blurmatte.motion.space.rotation_fit import Blades, RingPixels, ramp
from blurmatte.rendering import colorful_plate
from blurmatte.rendering.coverage import cell_edges, polygon_coverage
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import Change
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import Silhouette

SIZE, CENTER = (120, 116), np.array([61.3, 57.8])
STICK = np.array([[0, -3.0], [52, -3], [52, 3], [0, 3]])
WEDGE = np.array([[9.0, -4], [46, -10], [50, 0], [46, 10], [9, 4]])
HOOK = np.array([[9.0, -4], [30, 2], [50, -3], [50, 8], [30, 11], [9, 4]])
FANS = {
    "stick": (STICK, 2, 0.35),
    "blade": (WEDGE, 1, 1.5),
    "fan": (WEDGE, 3, 0.5),
    "hook": (HOOK, 1, 0.7),
    "beyond half": (STICK, 2, np.radians(190)),
    "half": (STICK, 2, np.pi),
}


@cache
def alpha_of(name, steps=150):
    blade, count, angle = FANS[name]
    x, y = (cell_edges(np.arange(n)) - c for n, c in zip(SIZE, CENTER, strict=True))
    total = np.zeros(SIZE[::-1])
    for t in (np.arange(steps) + 0.5) / steps:
        for k in range(count):
            turn = 0.3 + angle * t + 2 * np.pi * k / count
            c, s = np.cos(turn), np.sin(turn)
            total += polygon_coverage(x, y, blade @ np.array([[c, s], [-s, c]])) / steps
    return np.minimum(total, 1)


def with_errors(alpha, std, seed):
    """A solution whose alpha has independent errors."""
    errors = std * np.random.default_rng(seed).standard_normal(alpha.shape)
    return solution_of(alpha + errors, std, alpha > 0)


@pytest.mark.parametrize("name", [name for name in FANS if name != "half"])
def test_finds_center_and_angle(name):
    """exact: with little noise, from alpha alone."""
    found = bm.motion.measure_rotation(with_errors(alpha_of(name), 0.01, 0), exposure_time=0.02)
    angle = FANS[name][2]
    assert abs(found.angle - angle) < max(4 * found.angle_std, 1e-3)
    assert np.all(np.abs(found.center - CENTER) < np.maximum(4 * found.center_std, 0.02))
    assert found.angle_std < 0.01 * angle
    assert found.blades == FANS[name][1]
    assert_allclose(found.speed, found.angle / 0.02)


def test_errors_of_angles_have_unit_z_scores_and_those_of_centers_are_conservative():
    """honest: a fan of three blades and a stick, with a known and an unknown center."""
    z, of_center = [], []
    for seed in range(4):
        for name in ("fan", "stick"):
            solution = with_errors(alpha_of(name), 0.04, seed)
            for center in (None, CENTER):
                found = bm.motion.measure_rotation(solution, center)
                z.append((found.angle - FANS[name][2]) / found.angle_std)
                if center is None:
                    of_center.append((found.center - CENTER) / found.center_std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert 0.5 < np.sqrt(np.mean(np.square(of_center))) < 0.8  # conservative


def test_ramp_is_mean_over_turn_and_pixel():
    """oracle: means over a box of angles and one of pixels; derivatives are differences."""
    u, omega, pixel = np.linspace(-2, 2, 41), 0.9, np.full(41, 0.3)
    F, by_u, by_omega = ramp(u, omega, pixel)
    a, b = ((np.arange(400) + 0.5) / 400 - 0.5 for _ in range(2))
    angles = u[:, None, None] + omega * a[:, None] + 0.3 * b
    assert_allclose(F - F[0], np.mean(angles > 0, axis=(1, 2)), atol=3e-3)
    assert_allclose(by_u, (ramp(u + 1e-6, omega, pixel)[0] - F) / 1e-6, atol=1e-5)
    assert_allclose(by_omega, (ramp(u, omega + 1e-6, pixel)[0] - F) / 1e-6, atol=1e-5)


@pytest.mark.parametrize("center", [None, CENTER], ids=["free", "known"])
def test_derivatives_match_differences(center):
    """oracle: differences, of a bent blade."""
    rng = np.random.default_rng(0)
    xy = CENTER + rng.uniform(-40, 40, (200, 2))
    pixels = RingPixels(*xy.T, np.zeros(200), np.ones(200))
    model = Blades(center, (10.0, 45.0), [(0.4, 0.5)])
    p = np.concatenate([CENTER if center is None else [], [0.8], 0.1 * rng.normal(size=10)])
    _, J = model._alpha(p, pixels)
    for i, d in enumerate(1e-6 * np.eye(len(p))):
        up, down = model._alpha(p + d, pixels)[0], model._alpha(p - d, pixels)[0]
        # The width of a pixel, 1/ρ, depends on the center too; its derivative is neglected.
        assert_allclose(
            J[:, i], (up - down) / 2e-6, atol=2e-3 if center is None and i < 2 else 1e-5
        )


def test_rotation_from_rendered_pictures():
    """honest: rendered, photographed, solved pixel by pixel; a stick that turns about its middle."""
    stick = Sheet(84, 9, (0.85, 0.4, 0.06))
    rest = bm.Trajectory.line(CENTER, CENTER)
    scene = bm.rendering.Scene(
        colorful_plate(SIZE, 3, tile=25), rest, stick, Change(spin=(0, 0, 0.4))
    )
    truth, camera = rendered(scene, 100), bm.rendering.Camera(code_std=1 / 255)
    image, plate = (camera.photograph(p.rgb, k) for k, p in enumerate((truth.image, truth.plate)))
    found = bm.motion.measure_rotation(bm.solve(image, plate, truth.model, bm.Pixelwise()))
    assert abs(found.angle - 0.4) < 4 * found.angle_std
    assert found.angle_std < 0.008
    assert np.all(np.abs(found.center - CENTER) < 4 * found.center_std)
    assert found.blades == 2


def test_rotation_of_sweep():
    """exact: the last parameter of an outline that turns."""
    silhouette, path = Silhouette(2, turns=True), np.array([10.0, 20, 50, 30])
    shape = np.array([8.0, 0.3, 0, -0.6])
    model = bm.ColorModel.from_samples(np.array([0.5, 0.4, 0.3]), std=0)
    sweep = bm.sweep.Sweep(LINE, path, silhouette, shape, model, 0.04 * np.eye(8) / 4, (80, 60))
    found = bm.motion.measure_rotation(sweep, exposure_time=0.1, exposure_std=0.01)
    assert_allclose([*found.center, found.angle], [30, 25, 0.6])
    assert_allclose([*found.center_std, found.angle_std], [0.1 / 2**0.5, 0.1 / 2**0.5, 0.1])
    assert_allclose(found.speed_std, 6 * np.hypot(0.1 / 0.6, 0.1))
    words = " ".join(bm.explain(found))
    assert "turns a minute" in words
    assert "does not determine the sense of rotation" in words


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("changes", [False, True])
@pytest.mark.parametrize("order", [2, 3])
def test_error_of_a_sweep_is_that_of_its_turn(order, changes, soft):
    """Exact: whatever parameters follow the turn."""
    silhouette = Silhouette(order, turns=True, changes=changes, soft=soft)
    shape = silhouette.start(8.0)
    at = int(np.flatnonzero(silhouette.turn_slope()).item())
    shape[at] = -0.6
    assert silhouette.turn(shape) == -0.6
    variances = np.arange(1.0, 5 + len(shape)) ** 2 * 1e-4
    model = bm.ColorModel.from_samples(np.array([0.5, 0.4, 0.3]), std=0)
    path = np.array([10.0, 20, 50, 30])
    sweep = bm.sweep.Sweep(LINE, path, silhouette, shape, model, np.diag(variances), (80, 60))
    found = bm.motion.measure_rotation(sweep)
    assert_allclose([found.angle, found.angle_std], [0.6, np.sqrt(variances[4 + at])])


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("changes", [False, True])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_sweep_that_does_not_turn_has_no_rotation(order, changes, soft):
    """Door: whatever its last parameter is."""
    silhouette = Silhouette(order, changes=changes, soft=soft)
    shape = silhouette.start(8.0)
    shape[-1] = 0.7
    model = bm.ColorModel.from_samples(np.array([0.5, 0.4, 0.3]), std=0)
    covariance = 1e-4 * np.eye(4 + len(shape))
    sweep = bm.sweep.Sweep(
        LINE, np.array([10.0, 20, 50, 30]), silhouette, shape, model, covariance, (80, 60)
    )
    assert not silhouette.turn_slope().any()
    with pytest.raises(bm.errors.MotionError, match="without rotation"):
        bm.motion.measure_rotation(sweep)


def test_undetermined_rotation_is_rejected():
    """door: a disc, full turns, nothing, a line of motion."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    disc = np.clip(40 - np.hypot(x - CENTER[0], y - CENTER[1]), 0, 1)
    for alpha in (0.4 * disc, 0 * disc):
        for center in (None, CENTER):
            with pytest.raises(bm.errors.MotionError):
                bm.motion.measure_rotation(with_errors(alpha, 0.01, 0), center)
    straight = np.clip((x - 20) / 40, 0, 1) * np.clip((100 - x) / 40, 0, 1) * (abs(y - 50) < 9)
    with pytest.raises(bm.errors.MotionError):
        bm.motion.measure_rotation(with_errors(straight, 0.01, 0))


def test_half_turn_of_stick_is_rejected():
    """door: alpha is constant along circles; the message lists the possible turns."""
    with pytest.raises(bm.errors.MotionError, match="of 180° if it is a stick with two ends"):
        bm.motion.measure_rotation(with_errors(alpha_of("half"), 0.01, 0))


@pytest.mark.battery
def test_a_turn_beyond_half_is_not_mistaken_for_a_longer_one():
    """honest: noisy alpha of a stick; by a turn of 376° it looks much the same."""
    angle, z = FANS["beyond half"][2], []
    for seed in range(1, 17):
        found = bm.motion.measure_rotation(with_errors(alpha_of("beyond half"), 0.04, seed))
        z.append((found.angle - angle) / found.angle_std)
    assert np.abs(z).max() < 4
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_fits_are_compared_over_the_pixels_of_both():
    """Exact: one has a smaller mean residual, but not where the other was fitted."""
    rotation, nan = bm.motion.Rotation(CENTER, 0.3, np.eye(3)), np.nan
    one = _Trial(0.0, rotation, np.array([[1.0, 2.0, nan, 0.0]]))
    other = _Trial(0.0, rotation, np.array([[nan, 1.0, 3.0, 0.5]]))
    assert_allclose(other.gain_over(one), 4 - 1 + 0 - 0.25)
    assert_allclose(one.gain_over(other), -2.75)


def test_ambiguous_angles_are_named():
    """door: unless they agree within their errors."""
    one, same, other = (
        bm.motion.Rotation(CENTER, np.radians(angle), np.diag([0.01, 0.01, 1e-4]))
        for angle in (188.3, 189.0, 371.2)
    )
    _check_same(one, same)
    with pytest.raises(
        bm.errors.MotionError, match=r"by 188\.3° or by 371\.2°: both explain alpha equally"
    ):
        _check_same(other, one)


def test_invalid_input_is_rejected():
    """door: other types, and a center of three coordinates."""
    with pytest.raises(TypeError, match="thing must be a Solution or a Sweep, got int"):
        bm.motion.measure_rotation(3)
    with pytest.raises(ValueError, match=r"center must be a point \(x, y\)"):
        bm.motion.measure_rotation(with_errors(alpha_of("fan"), 0.01, 0), [1, 2, 3])

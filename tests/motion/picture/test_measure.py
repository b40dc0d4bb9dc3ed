"""measure_motion from sweeps and from moments: values and errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter
from tests.scenes import photographed, solution_of

from blurmatte.color.model import ColorModel
from blurmatte.errors import MotionError
from blurmatte.explain import explain
from blurmatte.files.solutions import read_solution
from blurmatte.files.writing import write
from blurmatte.matting import solve
from blurmatte.motion import end_silhouettes
from blurmatte.motion.picture.measure import measure_motion, motion_of_sweep
from blurmatte.motion.picture.motion import QUANTITIES
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette
from blurmatte.sweep.sweep import Diagnostics
from blurmatte.trajectory import Trajectory

MODEL = ColorModel.from_hex("#d8ff3c")
SIZE = (96, 72)
PATHS = [
    (LINE, [20, 30, 70, 42]),
    (PARABOLA, [20, 30, 48, 20, 70, 42]),
    (CUBIC, [20, 30, 34, 22, 52, 24, 70, 42]),
    (ARC, [20, 30, 70, 42, 8]),
    (BOUNCE, [20, 30, 45, 55, 70, 42, 0.4]),
    (FROM_REST, [20, 30, 70, 42, 0.3]),
]
SHAPE = (60, 110)
START, SHIFT = np.array([28.0, 24.0]), np.array([50.0, 12.0])


def sweep_of(family, path, silhouette=DISC, shape=(9.0,), std=0.05, residual_excess=1.0, size=SIZE):
    n = len(path) + len(shape)
    mixed = np.eye(n) + 0.3 * np.sin(np.arange(n * n)).reshape(n, n)
    covariance = std**2 * mixed @ mixed.T
    return Sweep(
        family,
        np.array(path, float),
        silhouette,
        np.array(shape, float),
        MODEL,
        covariance,
        size,
        Diagnostics(residual_excess=residual_excess),
    )


def of_sweep(sweep):
    return measure_motion(solution_of(sweep.alpha, sweep=sweep))


def test_a_path_from_rest_that_departs_at_once_is_a_line_at_constant_speed():
    # exact
    motion = of_sweep(sweep_of(FROM_REST, [20, 30, 70, 42, 0.0]))
    said = " ".join(explain(motion))
    assert "a straight line at constant speed" in said
    assert "at rest" not in said
    assert "Its speed was between" not in said


def drawn(angle=0.3, length=30.0, radius=7.0, size=SIZE, at=(48.2, 35.7)):
    """Exact alpha of a disc on a line."""
    shift = length * np.array([np.cos(angle), np.sin(angle)])
    path = np.concatenate([np.array(at) - shift / 2, np.array(at) + shift / 2])
    return sweep_of(LINE, path, shape=(radius,), size=size).alpha


def values(motion):
    return dict(zip(QUANTITIES, motion.values, strict=True))


def test_line_has_the_quantities_of_its_parameters():
    """Exact."""
    motion = of_sweep(sweep_of(*PATHS[0]))
    assert_allclose(motion.center, [45, 36], atol=1e-9)
    assert motion.length == pytest.approx(np.hypot(50, 12), abs=1e-9)
    assert motion.angle == pytest.approx(np.arctan2(12, 50), abs=1e-9)
    assert motion.radius == pytest.approx(9, abs=1e-9)
    assert motion.width == pytest.approx(18, abs=1e-3)
    assert motion.area == pytest.approx(np.pi * 81, rel=1e-9)
    assert motion.top_speed == pytest.approx(motion.length, rel=1e-6)
    assert_allclose(motion.speeds, motion.length, rtol=1e-9)
    assert motion.acceleration is None
    assert (motion.source, motion.path, motion.silhouette) == ("sweep", "line", "disc")


def test_parabola_has_its_acceleration():
    """Exact: x(t) = a + v t + g t²/2."""
    a, v, g = np.array([15.0, 40]), np.array([60.0, -50]), np.array([5.0, 90])
    nodes = np.array([a + t * v + t * t * g / 2 for t in (0, 0.5, 1)])
    motion = of_sweep(sweep_of(PARABOLA, nodes.ravel()))
    assert_allclose(motion.acceleration, g, atol=1e-5)
    t = (motion.trajectory.t[1:] + motion.trajectory.t[:-1]) / 2
    assert_allclose(motion.speeds, np.hypot(*(v + t[:, None] * g).T), rtol=1e-3)


def test_path_from_rest_has_its_rest():
    """Exact: at rest for 0.3 of the exposure, then faster by 1/0.7."""
    motion = of_sweep(sweep_of(*PATHS[5]))
    assert motion.resting == pytest.approx(0.3)
    assert motion.resting_std > 0
    assert motion.top_speed == pytest.approx(motion.length / 0.7, rel=1e-6)
    assert motion.center[0] == pytest.approx(20 + 25 * 0.7, abs=0.1)  # it was longer at the start


@pytest.mark.parametrize(("family", "path"), PATHS, ids=[p[0].name for p in PATHS])
def test_covariance_matches_draws(family, path):
    """Oracle: parameters drawn from the sweep's covariance, measured one by one."""
    sweep, rng = sweep_of(family, path, std=0.02), np.random.default_rng(1)
    motion = of_sweep(sweep)
    n = len(sweep.path)
    draws = rng.multivariate_normal(
        np.concatenate([sweep.path, sweep.shape]), sweep.covariance, 200
    )
    drawn = (motion_of_sweep(replace(sweep, path=d[:n], shape=d[n:]), None) for d in draws)
    seen = np.array([one.values for one in drawn])
    assert_allclose(seen.std(axis=0), np.sqrt(np.diag(motion.covariance)), rtol=0.2)


def test_center_is_centroid_of_outline():
    """Oracle: the mean of alpha itself, for an outline of order 3 that turns."""
    shape = (12.0, 0.1, 0.05, 0.25, 0.1, 0.8)
    sweep = sweep_of(LINE, [30, 30, 60, 40], Silhouette(3, turns=True), shape)
    alpha = sweep.alpha
    y, x = np.indices(alpha.shape)
    mean = np.array([np.sum(alpha * x), np.sum(alpha * y)]) / alpha.sum()
    assert_allclose(of_sweep(sweep).center, mean, atol=0.02)
    assert of_sweep(sweep).area == pytest.approx(alpha.sum(), rel=1e-3)


@pytest.mark.parametrize("angle", [0.3, -1.2, 1.5])
def test_moments_of_exact_alpha(angle):
    """Exact, but for pixels: the moments of a disc on a line."""
    motion = measure_motion(solution_of(drawn(angle)))
    assert motion.source == "moments"
    assert_allclose(motion.center, [48.2, 35.7], atol=5e-3)
    assert motion.length == pytest.approx(30, abs=0.03)
    assert motion.angle == pytest.approx(angle, abs=1e-3)
    assert motion.radius == pytest.approx(7, abs=5e-3)
    assert motion.width == pytest.approx(14, abs=0.03)


@pytest.mark.parametrize(
    ("softness", "least"),
    [(0, 0.8), (1.5, 0.7)],
    ids=["independent", "conservative for correlated"],
)
def test_errors_of_moments_match_scatter(softness, least):
    """Honest: with independent and, as in `Smooth`, with correlated errors of pixels."""
    from scipy.ndimage import gaussian_filter

    rng, alpha, std = np.random.default_rng(3), drawn(), 0.02
    streak = gaussian_filter((alpha > 0).astype(float), 2) > 0.05
    z = []
    for _ in range(120):
        noise = rng.normal(size=alpha.shape)
        if softness:
            noise = gaussian_filter(noise, softness) * np.sqrt(4 * np.pi) * softness
        together = max(4 * np.pi * softness**2, 1) * streak.sum() * std**2
        solution = solution_of(alpha + std * noise, std, streak, sum_alpha_std=np.sqrt(together))
        motion = measure_motion(solution)
        true = np.array([48.2, 35.7, 0.3, 30, 14, 7, np.pi * 49, 30])
        z.append((motion.values - true) / np.sqrt(np.diag(motion.covariance)))
    z = np.array(z)
    assert np.abs(z.mean(axis=0)).max() < 0.4
    assert np.all((least < z.std(axis=0)) & (z.std(axis=0) < 1.25))


@pytest.mark.battery
def test_errors_of_sweeps_contain_scatter():
    """Honest: small balls, from the pictures to the motion.

    Stated errors are calibrated on scenes of two renderers and hold for both, so those of place and
    length are larger than the scatter with the camera of one of them. The radius is mostly too small:
    its error is about the stated one.
    """
    z = []
    for seed in range(48):
        rng = np.random.default_rng(seed)
        start, radius = rng.uniform(14, 22, 2), rng.uniform(5, 8)
        path = Trajectory.line(start, start + rng.uniform(10, 26, 2))
        ball = Ball(radius, (0.8, 0.35, 0.06))
        scene = Scene(colorful_plate((64, 64), seed, tile=14), path, ball)
        image, plate = photographed(scene, Camera(code_std=1 / 255), seed, plate_frames=1)
        image = replace(image, meta=replace(image.meta, exposure_time=0.02))
        motion = measure_motion(solve(image, plate))
        assert (motion.source, motion.exposure_time) == ("sweep", 0.02)
        true = np.array([*path.at(0.5), path.length, radius])
        found = np.array([*motion.center, motion.length, motion.radius])
        std = np.array([*motion.center_std, motion.length_std, motion.radius_std])
        z.append((found - true) / std)
    ratios = np.sqrt(np.mean(np.square(z), axis=0)) / [0.72, 0.72, 0.56, 1]
    assert np.all((ratios > 0.8) & (ratios < 1.25))
    assert np.mean(np.abs(z) <= 2) >= 0.95


def test_rotated_picture_rotates_the_angle():
    """Invariant: a quarter turn, from +x towards +y."""
    alpha = drawn(0.3)
    first = measure_motion(solution_of(alpha))
    turned = measure_motion(solution_of(np.rot90(alpha, -1).copy()))  # (x, y) → (71 − y, x)
    assert turned.angle == pytest.approx(first.angle + np.pi / 2 - np.pi, abs=1e-9) or (
        turned.angle == pytest.approx(first.angle + np.pi / 2, abs=1e-9)
    )
    assert_allclose(turned.center, [71 - first.center[1], first.center[0]], atol=1e-9)
    for name in ("length", "width", "radius", "length_std", "angle_std"):
        assert getattr(turned, name) == pytest.approx(getattr(first, name), rel=1e-9)


@pytest.mark.parametrize(("family", "path"), PATHS, ids=[p[0].name for p in PATHS])
def test_reversed_twice_is_the_identity(family, path):
    """Invariant: reversed twice; the outlines at both ends are exchanged."""
    motion = of_sweep(sweep_of(family, path))
    back = motion.reversed
    assert abs(abs(back.angle - motion.angle) - np.pi) < 1e-9
    assert_allclose(back.outline_at(0), motion.outline_at(1))
    assert_allclose(back.trajectory.at(0.25), motion.trajectory.at(0.75), atol=1e-9)
    again = back.reversed
    assert_allclose(again.values, motion.values)
    assert_allclose(again.trajectory.xy, motion.trajectory.xy)


def test_motion_is_given_to_the_right():
    """Invariant: for both directions of the fitted path."""
    there, back = (of_sweep(sweep_of(LINE, p)) for p in ([20, 30, 70, 42], [70, 42, 20, 30]))
    assert there.angle == pytest.approx(back.angle)
    assert_allclose(there.outline_at(0), back.outline_at(0))
    assert_allclose(there.place_covariance(0).shape, (2, 2))


def test_motion_from_file_is_identical(tmp_path):
    """Exact: measured from the file, to the last digit."""
    sweep = sweep_of(ARC, PATHS[3][1], ELLIPSE, (9.0, 0.1, -0.05))
    solution = solution_of(sweep.alpha, sweep=sweep, exposure_time=0.02)
    write(tmp_path / "layer.exr", solution)
    back = measure_motion(read_solution(tmp_path / "layer.exr"))
    assert back.numbers() == measure_motion(solution).numbers()
    assert back.exposure_time == 0.02


def test_position_covariance_at_ends_and_middle():
    """Exact: the ends of a line are parameters, and the middle of moments is the center."""
    sweep = sweep_of(*PATHS[0])
    motion = of_sweep(sweep)
    assert_allclose(motion.place_covariance(0), sweep.covariance[:2, :2])
    moments = measure_motion(solution_of(drawn()))
    assert_allclose(moments.place_covariance(0.5), moments.covariance[:2, :2])
    assert np.trace(moments.place_covariance(0)) > np.trace(moments.place_covariance(0.5))


def test_unmeasurable_solution_is_rejected():
    """Door."""
    rng = np.random.default_rng(0)
    with pytest.raises(MotionError, match="which is less than 3 times its error: no"):
        measure_motion(solution_of(0.01 * rng.normal(size=(40, 40)), 0.01))
    with pytest.raises(MotionError, match="no pixel of the streak has a known alpha"):
        measure_motion(solution_of(drawn(), np.inf))
    with pytest.raises(TypeError, match="solution must be a Solution, got ndarray"):
        measure_motion(drawn())


def test_moments_have_no_outline():
    """Door."""
    with pytest.raises(MotionError, match="no rigid outline explains this streak"):
        measure_motion(solution_of(drawn())).outline_at(0)


def test_object_at_rest_has_not_moved():
    """Exact: a disc that stays."""
    rng = np.random.default_rng(1)
    alpha = drawn(length=1e-6) + 0.02 * rng.normal(size=(72, 96))
    streak = drawn(length=1e-6, radius=10) > 0
    assert not measure_motion(solution_of(alpha, 0.02, streak)).moved


@pytest.mark.parametrize("at", [(12.0, 35.7), (48.2, 35.7)])
def test_at_border_is_true_for_cut_streaks(at):
    """Exact: from sweeps and from moments."""
    alpha = drawn(at=at)
    sweep = sweep_of(LINE, [at[0] - 14, 32, at[0] + 14, 40], shape=(7.0,))
    for motion in (measure_motion(solution_of(alpha)), of_sweep(sweep)):
        assert motion.at_border == (at[0] < 20)


@pytest.mark.parametrize(
    ("length", "std", "moved"),
    [
        (239.0, 39.0, True),  # 6 standard deviations of a long path
        (239.0, 70.0, False),
        (2.0, 0.4, False),  # of a short one 5, which are 2.5 of its square
        (2.0, 0.25, True),
    ],
)
def test_significant_length_has_moved(length, std, moved):
    """Exact: 3.5 standard deviations of the streak's extent."""
    sweep = sweep_of(LINE, [100, 60, 100 + length, 60], shape=(27.7,), size=(500, 120))
    covariance = np.zeros((5, 5))
    covariance[2, 2] = std**2
    assert of_sweep(replace(sweep, covariance=covariance)).moved == moved


def test_noise_alone_seldom_moves():
    """Honest: lengths that a disc at rest seems to have by moments, with noise; 1 of 500."""
    rng, r = np.random.default_rng(0), 7.0
    noise = rng.normal(0, 30.0, (20000, 2))  # of xx − yy and 2 xy, whose root is the length squared
    squares = np.hypot(*noise.T)
    errors = 30.0 / (2 * np.sqrt(squares))
    base = motion_of_sweep(sweep_of(*PATHS[0], shape=(r,)), None)
    count = 0
    for square, error in zip(squares, errors, strict=True):
        values, covariance = base.values.copy(), base.covariance.copy()
        at = QUANTITIES.index("length")
        values[at], covariance[at, at] = np.sqrt(square), error**2
        count += replace(base, values=values, covariance=covariance, source="moments").moved
    assert count / len(squares) == pytest.approx(1 / 458, rel=0.35)


def test_border_is_reached_by_the_outline_not_by_a_circle_around_it():
    """Exact: a stick that moves along itself, and the same across the border; also if it turns."""
    long = np.log(84 / 14) / 2
    radius = np.sqrt(42 * 7)
    for y, reached in ((14.0, False), (6.0, True)):
        stick = sweep_of(LINE, [45, y, 51, y], ELLIPSE, [radius, long, 0])
        assert of_sweep(stick).at_border == reached
    turning = Silhouette(2, turns=True)
    for turn, reached in ((0.1, False), (1.5, True)):  # its ends rise by 2 and by 29 pixels
        stick = sweep_of(LINE, [45, 25, 51, 25], turning, [radius, long, 0, turn])
        assert of_sweep(stick).at_border == reached


def test_readout_of_the_image_is_kept():
    """Exact: from its statistics; also of moments."""
    sweep = sweep_of(*PATHS[0])
    for solution in (solution_of(sweep.alpha, sweep=sweep), solution_of(sweep.alpha)):
        assert measure_motion(solution).readout == "down"
        turned = replace(solution, stats=replace(solution.stats, readout="left"))
        assert measure_motion(turned).readout == "left"
        assert measure_motion(turned).reversed.readout == "left"


def test_separate_parts_and_large_residuals_give_doubts():
    """Exact: two separate discs, and a sweep with a large residual."""
    alpha = drawn(0.3, 8, 5, at=(20, 30)) + drawn(0.3, 8, 5, at=(70, 30))
    assert "has 2 separate parts" in measure_motion(solution_of(alpha)).doubts[0]
    assert measure_motion(solution_of(drawn())).doubts == ()
    doubted = of_sweep(sweep_of(*PATHS[0], residual_excess=2.5))
    assert "residuals 2.5 times as correlated as noise" in doubted.doubts[0]


def test_curved_path_gives_doubt_in_moments():
    """Exact: half a circle is wider than a disc of its area."""
    bent = sweep_of(ARC, [20, 20, 76, 20, 25], shape=(6.0,))
    assert "the path bends" in measure_motion(solution_of(bent.alpha)).doubts[0]


def silhouette(at, x, y):
    """A rounded cross, as long as it is wide."""
    dx, dy = x - at[0], y - at[1]
    return np.clip(10.5 - np.hypot(dx, dy) - 2 * np.cos(4 * np.arctan2(dy, dx)), 0, 1)


def streak(shift=SHIFT, moments=400):
    """Alpha of the cross along a straight path, and its first and last silhouette."""
    y, x = np.indices(SHAPE).astype(float)
    places = [START + shift * t for t in (np.arange(moments) + 0.5) / moments]
    alpha = np.mean([silhouette(place, x, y) for place in places], axis=0)
    return alpha, silhouette(START, x, y), silhouette(START + shift, x, y)


def around(alpha, std, **stats):
    """A solution that is known where alpha is, and a few pixels around."""
    return solution_of(alpha, std, gaussian_filter(alpha, 2) >= 0.002, **stats)


def test_change_is_first_minus_last_silhouette():
    """Oracle: both silhouettes drawn and smoothed by the same Gaussian."""
    alpha, first, last = streak()
    solution = around(alpha, 1e-4)
    motion = measure_motion(solution)
    ends = end_silhouettes(solution, motion)
    assert ends.scale == 1
    soft_first, soft_last = (gaussian_filter(s, ends.scale) for s in (first, last))
    assert motion.length == pytest.approx(np.hypot(*SHIFT), rel=0.002)
    for found, true in ((ends.first, soft_first), (ends.last, soft_last)):
        assert np.abs(found - true).max() < 0.12  # at edges, because of the pixel grid
        assert np.sqrt(np.mean((found - true)[true > 0.01] ** 2)) < 0.03


def test_change_is_zero_in_overlap():
    """Exact: a shift by less than its size leaves 0 in the middle."""
    alpha, first, last = streak(np.array([8.0, 2.0]))
    ends = end_silhouettes(*_measured(alpha))
    both = (gaussian_filter(first, 1) > 0.99) & (gaussian_filter(last, 1) > 0.99)
    assert both.sum() > 20
    assert np.abs(ends.change[both]).max() < 0.03
    assert ends.change.max() > 0.5


def _measured(alpha):
    solution = around(alpha, 1e-4)
    return solution, measure_motion(solution)


@pytest.mark.parametrize("softness", [0, 2.0])
def test_error_matches_scatter(softness):
    """Honest: independent and correlated noise of pixels."""
    rng, std = np.random.default_rng(0), 0.01
    alpha, _, _ = streak()
    motion = measure_motion(around(alpha, 1e-4))
    exact = end_silhouettes(around(alpha, 1e-4), motion)
    z = []
    for _ in range(20):
        noise = rng.normal(size=SHAPE)
        if softness:
            noise = gaussian_filter(noise, softness) * np.sqrt(4 * np.pi) * softness
        inside = around(alpha, std).streak
        together = max(4 * np.pi * softness**2, 1) * inside.sum() * std**2
        own = {"sum_alpha_std": float(np.sqrt(together))}
        noisy = around(alpha + np.where(inside, std * noise, 0), std, **own)
        ends = end_silhouettes(noisy, motion)
        smooth = gaussian_filter(exact.change, np.sqrt(ends.scale**2 - 1))
        middle = gaussian_filter(inside.astype(float), 4) > 0.99
        z.append((ends.change - smooth)[middle] / ends.change_std[middle])
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.2)


def test_error_is_infinite_where_alpha_is_unknown():
    """Exact: infinite errors where alpha is not known."""
    alpha, _, _ = streak()
    solution = around(alpha, 0.001)
    motion = measure_motion(solution)
    unknown = solution.alpha_std.copy()
    unknown[30, 50] = np.inf
    solution = replace(solution, alpha_std=unknown)
    ends = end_silhouettes(solution, motion)
    assert np.isinf(ends.change_std[30, 50])
    assert np.isfinite(ends.change_std).sum() == alpha.size - 1
    assert "EndSilhouettes(110x60, ± " in repr(ends)


@pytest.mark.parametrize("side", ["left", "above", "middle"])
def test_errors_of_moments_cover_alpha_that_is_unknown(side):
    """Honest: a part of the streak is hidden; with its alpha 0 the place is many errors off."""
    alpha, _, _ = streak()
    solution, (y, x) = around(alpha, 1e-3), np.indices(SHAPE)
    middle = START + SHIFT / 2
    hidden = {
        "left": x < middle[0] - 20,
        "above": y < middle[1] - 4,
        "middle": np.abs(x - middle[0]) < 6,
    }[side]
    known = measure_motion(solution)
    unknown = np.where(hidden, np.inf, solution.alpha_std)
    motion = measure_motion(replace(solution, alpha_std=unknown))
    assert np.abs((motion.center - known.center) / motion.center_std).max() < 2
    assert abs(motion.length - known.length) < 2 * motion.length_std
    assert any("alpha is unknown" in doubt for doubt in motion.doubts)


def test_object_at_rest_is_rejected():
    """Door."""
    y, x = np.indices(SHAPE).astype(float)
    solution = around(np.clip(10.5 - np.hypot(x - 50.3, y - 30.1), 0, 1), 0.02)
    with pytest.raises(MotionError, match="first and the last silhouette cannot be distinguished"):
        end_silhouettes(solution, measure_motion(solution))

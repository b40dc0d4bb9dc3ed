"""measure_ball, fit_ball: position and speed of a ball of known size before a calibrated camera."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from benchmarks.rendered import outline_of, render_flight
from numpy.testing import assert_allclose

import blurmatte as bm
from blurmatte.motion.space.perspective_ball import (
    PerspectiveBall,
    at_nodes,
    outline,
    positions_of_discs,
)
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import colorful_plate
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.sweep import Diagnostics

SIZE = (190, 120)
LENS = bm.Intrinsics(300, 303, 80, 55, np.array([-0.1, 0.05, 1e-3, -5e-4]))
WIDE = bm.Intrinsics(90, 90, 80, 55)
RADIUS, EXPOSURE = 0.02, 1 / 50
START, END = np.array([-0.06, -0.02, 0.47]), np.array([0.13, 0.05, 0.43])
ORANGE = np.array([0.8, 0.35, 0.06])
MIDDLES = ((np.arange(120) + 0.5) / 120)[:, None]
SAG = np.array([0, 0.12, 0.0])  # meters per exposure²: large, to be significant


@cache
def truth(sag):
    plate = colorful_plate(SIZE, 4, tile=25)
    X = START + MIDDLES * (END - START) + sag * (MIDDLES**2 - MIDDLES) / 2 * SAG
    return render_flight(plate, LENS, X, RADIUS, ORANGE)[0].rgb, plate


def photographed(seed, sag=0.0, noise=0.004):
    """Image and plate with noise, and a rough sweep."""
    rng = np.random.default_rng(seed)
    known = NoiseModel(read_std=noise)
    image, plate = (
        LinearImage(light + noise * rng.standard_normal(light.shape), noise=known)
        for light in truth(sag)
    )
    ends = LENS.project(np.array([START, END])).ravel() + 0.8
    model = bm.ColorModel.from_samples(ORANGE, std=0)
    path = PARABOLA.starts(LINE.at(ends, np.linspace(0, 1, 9))[0])[0] if sag else ends
    family = PARABOLA if sag else LINE
    n = len(path) + 1
    return image, plate, bm.sweep.Sweep(
        family, path, DISC, np.array([14.2]), model, 0.01 * np.eye(n), SIZE
    )  # fmt: skip


def true_positions(sag=0.0):
    return np.array([START, (START + END) / 2 - sag * SAG / 8, END])


def without_light(shape, origin):
    """An observation of pixels alone."""
    nothing, one = 4 * [np.zeros((*shape, 0))], np.ones(shape)
    everywhere = one > 0
    return Observation(
        *nothing, everywhere, origin, 1.0, weight=one, streak=everywhere, near=everywhere, size=SIZE
    )


@pytest.mark.parametrize("lens", [LENS, WIDE], ids=["lens", "wide"])
def test_alpha_is_fraction_of_time_that_rays_meet_the_ball(lens):
    """oracle: rays within each pixel at 60 moments."""
    data = without_light((30, 44), (12.0, 8.0))
    path, shape = np.array([22.0, 20, 45, 27]), np.array([7.0, 0.3])
    ball = PerspectiveBall.in_observation(lens, data)
    alpha = ball.sweep(LINE, path, shape, data.pixels).alpha
    nodes, _ = at_nodes(lens, path, shape)
    cells = 12
    at = (np.arange(cells) + 0.5) / cells - 0.5
    x, y = ((np.arange(n)[:, None] + at).ravel() for n in (44, 30))
    rays = lens.rays(np.stack(np.meshgrid(x + 12, y + 8), axis=-1))
    total = np.zeros((30, 44))
    for t in (np.arange(60) + 0.5) / 60:
        X = (1 - t) * nodes[0] + t * nodes[1]
        hit = rays @ X > np.sqrt(X @ X - 1)
        total += hit.reshape(30, cells, 44, cells).mean(axis=(1, 3)) / 60
    assert_allclose(alpha, total, atol=6e-3)
    assert_allclose(alpha.sum(), total.sum(), rtol=1e-3)


def test_derivatives_match_differences():
    """oracle: differences, summed over patches, because edges within pixels are taken as straight."""
    data = without_light((70, 120), (20.0, 5.0))
    ball = PerspectiveBall.in_observation(LENS, data)
    p = np.array([50.0, 35, 85, 45, 115, 40, 14.0, 0.1, 0.05])
    swept = ball.sweep(PARABOLA, p[:6], p[6:], data.pixels)
    x = np.linspace(-1, 1, 120)[None] + np.linspace(-0.5, 1, 70)[:, None] ** 2
    for i in range(9):
        d = 1e-4 * np.eye(9)[i]
        up, down = (ball.sweep(PARABOLA, q[:6], q[6:], data.pixels).alpha for q in (p + d, p - d))
        numeric = np.sum(x * (up - down)) / 2e-4
        assert_allclose(np.sum(x * swept.by_parameters[..., i]), numeric, rtol=0.01, atol=0.02)


@pytest.mark.parametrize("X", [[0, 0, 20], [9, -4, 12], [-2, 30, 16]])
def test_outline_is_tangent_and_gives_position(X):
    """exact: tangents of the sphere; and the position from center and area of the ellipse."""
    X, lens = np.array(X, float), bm.Intrinsics(700, 700, 320, 240)
    points = outline(X[None], 64)[0]
    assert_allclose(np.linalg.norm(points - X, axis=1), 1, atol=1e-12)
    assert_allclose(np.sum(points * (points - X), axis=1), 0, atol=1e-9)
    assert_allclose(outline_of(0.3 * X, 0.3, 4) @ X, 0.3 * (X @ X - 1) * np.ones(4), rtol=1e-12)
    d, square = X / np.linalg.norm(X), 1 - 1 / (X @ X)
    Q = np.linalg.inv(np.outer(d, d) - square * np.eye(3))  # the dual of the cone's conic
    center = Q[:2, 2] / Q[2, 2]
    spread = np.outer(center, center) - Q[:2, :2] / Q[2, 2]
    radius = 700 * np.linalg.det(spread) ** 0.25
    found = positions_of_discs(lens, 700 * center[None] + [320, 240], radius)[0]
    assert_allclose(found, X, rtol=1e-9)


@pytest.mark.parametrize("sag", [0.0, 1.0], ids=["line", "thrown"])
def test_fit_ball_finds_positions(sag):
    """exact: with little noise, to a thousandth of the depth."""
    image, plate, sweep = photographed(0, sag, 2e-4)
    motion = bm.motion.fit_ball(image, plate, LENS, RADIUS, EXPOSURE, sweep=sweep)
    assert motion.path == ("parabola" if sag else "line")
    assert_allclose(motion.positions, true_positions(sag), atol=5e-4)
    assert_allclose(
        motion.speed, np.linalg.norm(END - START) / EXPOSURE, rtol=0.02 if sag else 1e-3
    )
    if sag:
        off = (motion.acceleration - SAG / EXPOSURE**2) / motion.acceleration_std
        assert np.abs(off).max() < 4
    assert_allclose(motion.reversed.velocity, -motion.velocity)
    assert_allclose(motion.reversed.positions_std, motion.positions_std[::-1])


def test_errors_of_positions_have_unit_z_scores_and_that_of_the_length_is_conservative():
    """honest: of nine coordinates, depth and length; radius 13 px, noise of a code value."""
    z, of_length, within = [], [], []
    for seed in range(24):
        image, plate, sweep = photographed(seed)
        motion = bm.motion.fit_ball(image, plate, LENS, RADIUS, EXPOSURE, sweep=sweep)
        off = motion.positions - true_positions()
        z.append(off / motion.positions_std)
        of_length.append((motion.length - np.linalg.norm(END - START)) / motion.length_std)
        within.append(abs(off[1, 2]) / START[2])
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25
    assert np.abs(np.mean(z, axis=0)).max() < 0.7
    assert 0.65 < np.sqrt(np.mean(np.square(of_length))) < 0.9
    assert max(within) < 0.02


def test_measure_ball_assumes_constant_distance():
    """exact: the closed form, and the errors of each source."""
    _, _, sweep = photographed(0)
    known = replace(LENS, covariance=np.diag([9.0, 9, 4, 4, 0, 0, 0, 0]))
    motion = bm.motion.measure_ball(
        sweep, known, RADIUS, EXPOSURE, radius_std=2e-4, exposure_std=1e-3
    )
    X = RADIUS * positions_of_discs(LENS, LINE.at(sweep.path, np.array([0, 0.5, 1]))[0], 14.2)
    assert_allclose(motion.positions, X)
    assert_allclose(motion.parts["radius"], 0.01)
    assert_allclose(motion.parts["exposure time"], 0.05)
    assert motion.dominant == "exposure time"
    assert_allclose(motion.depth_parts["picture"], 0.1 / 14.2, rtol=0.02)
    assert_allclose(motion.depth_parts["camera"], np.sqrt(2) / 2 * 3 / 300, rtol=0.1)
    relative = motion.speed_std / motion.speed
    assert_allclose(relative, np.linalg.norm(list(motion.parts.values())), rtol=1e-6)
    words = " ".join(bm.explain(motion))
    assert "nothing of speed along the line of sight" in words
    assert "does not determine the direction of time" in words
    assert "comes mostly from the exposure time (5.0% alone)" in words


def test_invalid_input_is_rejected():
    """door: ranges, missing numbers, rejected sweeps, and other cameras."""
    image, plate, sweep = photographed(0)
    with pytest.raises(ValueError, match="radius must be finite and above 0, got -1"):
        bm.motion.measure_ball(sweep, LENS, -1)
    with pytest.raises(ValueError, match="exposure_std must be finite and not negative"):
        bm.motion.measure_ball(sweep, LENS, 1, 1, exposure_std=-1)
    with pytest.raises(TypeError, match="sweep must be a Sweep, got Trajectory"):
        bm.motion.measure_ball(sweep.trajectory, LENS, 1)
    with pytest.raises(bm.errors.MotionError, match="a velocity needs the exposure_time"):
        _ = bm.motion.measure_ball(sweep, LENS, RADIUS).speed
    for diagnostics, said in (
        (
            Diagnostics(residual_excess=3.0),
            "does not explain the streak: the fit leaves residuals 3 times as correlated",
        ),
        (Diagnostics("leaves the streak"), "streak: the fit leaves the streak; give a ball"),
        (Diagnostics(converged=False), "streak: the fit did not converge"),
    ):
        with pytest.raises(bm.errors.MotionError, match=said):
            bm.motion.measure_ball(replace(sweep, diagnostics=diagnostics), LENS, RADIUS)
    other = replace(LENS, size=(640, 480))
    with pytest.raises(ValueError, match="pictures of 640x480 pixels, and this has 190x120"):
        bm.motion.measure_ball(sweep, other, RADIUS)
    barrel = bm.Intrinsics(100, 100, 0, 0, np.array([-0.3, 0, 0, 0]))
    with pytest.raises(bm.errors.MotionError, match="distortion can"):
        bm.motion.measure_ball(sweep, barrel, RADIUS)
    with pytest.raises(bm.errors.MotionError, match="the camera's distortion can be undone"):
        bm.motion.fit_ball(image, plate, barrel, RADIUS, sweep=sweep)

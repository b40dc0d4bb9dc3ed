"""fit_patterns: discs with a pattern, in gray pictures, in which shading looks like another place."""

from dataclasses import replace

import numpy as np
import scipy
from tests.scenes import on_line, rendered
from tests.sweep.scenes import BOUNDS, NEUTRAL

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel
from blurmatte.motion.picture.measure import motion_of_sweep
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel, decode
from blurmatte.radiometry.image import counted_once
from blurmatte.rendering import Ball, Scene
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import plain_plate, textured_plate
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep.discs import fit_disc
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.multistart import start_along
from blurmatte.sweep.fit.pattern import _functions, _PatternFit, _swept, fit_patterns
from blurmatte.sweep.fit_sweep import fit_sweep
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.pattern_kernel import swept
from blurmatte.sweep.model.silhouette import moments
from blurmatte.trajectory import Trajectory

SIZE, RADIUS, NOISE = (96, 64), 9.0, 0.004  # light
TRUE = np.array([32.0, 30, 62, 36])  # parameters of the line
WALL = plain_plate(SIZE, (0.4, 0.4, 0.4), 2)


def pattern_on(line, radius, order=2):
    """(h, w, k) integrals of the functions φ of a sharp disc on a line at constant speed."""
    t, weights = moments(LINE, line, 1.0)
    T = _functions(order)[0]
    S = np.zeros((SIZE[1], SIZE[0], len(T)))
    swept(LINE.at(line, t)[0], weights, radius, 0.0, order, S)
    return S @ T


def shaded(rng, noise=NOISE):
    """Gray image and plate, of known noise, of a disc with a random pattern of order 2."""
    S, light = pattern_on(TRUE, RADIUS), np.array([0.9, *rng.normal(0, 0.1, 8)])
    light[3:6] *= 0.3
    image = (1 - S[..., 0]) * WALL[..., 0] + S @ light
    pictures = []
    for exact in (image, WALL[..., 0]):
        gray = exact + noise * rng.standard_normal(exact.shape)
        picture = LinearImage(np.repeat(gray[..., None], 3, axis=2), NoiseModel(read_std=noise))
        pictures.append(counted_once(picture))
    return pictures


def disc_without(image, plate):
    """The fit of a disc of varying brightness."""
    streak = Streak(np.abs(image.rgb - plate.rgb)[..., 0] > 0.02)
    observation = replace(observation_around(streak, 16, image, plate, NEUTRAL), grain=RADIUS / 4)
    return minimize(start_along(observation, LINE, TRUE, RADIUS), BOUNDS)


def test_functions_are_integrals_over_the_exposure():
    """oracle: means over fine points of pixels and moments."""
    line, radius, order = np.array([12.0, 13, 24, 18]), 8.0, 2
    S = pattern_on(line, radius, order)
    fine = (np.arange(10) + 0.5) / 10 - 0.5
    x, y = (np.add.outer(np.arange(40), fine).ravel() for _ in range(2))
    total = np.zeros((40, 40, S.shape[-1]))
    for t in (np.arange(100) + 0.5) / 100:
        center = line[:2] + t * (line[2:] - line[:2])
        u, v = np.meshgrid((x - center[0]) / radius, (y - center[1]) / radius)
        inside = u**2 + v**2 < 1
        z = np.sqrt(np.maximum(1 - u**2 - v**2, 0))
        functions = np.stack([u**0, u, v, u * u, u * v, v * v, z, z * u, z * v], axis=-1)
        values = functions * inside[..., None]
        total += values.reshape(40, 10, 40, 10, -1).mean(axis=(1, 3)) / 100
    assert np.abs(S[:40, :40] - total @ _functions(order)[0]).max() < 0.04


def test_functions_are_orthonormal_on_a_disc():
    """exact, but for z, z u and z v"""
    rng = np.random.default_rng(0)
    T, exponents = _functions(5)
    u, v = rng.uniform(-1, 1, (2, 400_000))
    u, v = (x[u**2 + v**2 < 1] for x in (u, v))
    powers = np.stack([u ** (n - m) * v**m for n in range(6) for m in range(n + 1)], axis=1)
    values = powers @ T[:21, :21]
    assert np.abs(values.T @ values / len(u) - np.eye(21)).max() < 0.03
    assert exponents.tolist() == [0, 0, 0, 1, 1, 1, *4 * [2], *5 * [3], *6 * [4], 0, 1, 1]


def test_derivatives_of_light_are_differences():
    """oracle, but for pixels where the rim is just reached: there z has an infinite slope."""
    step = 1e-4
    disc = disc_without(*shaded(np.random.default_rng(1)))
    for soft, off in ((False, 0.02), (True, 1e-3)):  # the turn of a sharp rim is left out
        state = disc.of_kind(replace(disc.silhouette, soft=soft))
        at = np.array([*disc.path, RADIUS, *([0.8] if soft else [])])
        fit = _PatternFit.of(state, BOUNDS, at, 5)
        exact = []
        for change in step * np.eye(len(at)):
            ahead, behind = (_swept(state, fit.use, 5, at + x) for x in (change, -change))
            S = (ahead - behind) / (2 * step)
            exact.append(S @ fit.patterns[0].coefficients - S[:, 0] * fit._plate(0))
        wrong = np.abs(fit._by_parameters(0) - np.array(exact).T) / np.abs(exact).max(axis=1)
        assert np.quantile(wrong.max(axis=1), 0.99) < off


def parameters(state):
    """Path and radius of a state."""
    return np.append(state.path, state.radius)


def test_place_and_size_of_a_pattern_are_exact_without_noise():
    """exact"""
    disc = disc_without(*shaded(np.random.default_rng(0), 1e-5))
    best = fit_patterns(disc, BOUNDS)[-1].state
    off, without = (np.abs(parameters(s) - np.append(TRUE, RADIUS)).max() for s in (best, disc))
    assert off < 1e-3 < without / 10


def test_errors_of_a_pattern_explain_the_scatter():
    """honest"""
    z = []
    for seed in range(12):
        best = fit_patterns(disc_without(*shaded(np.random.default_rng(seed))), BOUNDS)[-1]
        std = np.sqrt(np.diag(best.covariance))[: len(TRUE) + 1]
        z.append((parameters(best.state) - np.append(TRUE, RADIUS)) / std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


def in_eight_bits(values, rng):
    """The picture that a file has of encoded light (h, w) or (h, w, 3), with noise of one code."""
    codes = np.rint(np.clip(255 * values + rng.normal(0, 1, values.shape), 0, 255)).astype(np.uint8)
    return decode(codes if codes.ndim == 3 else np.repeat(codes[..., None], 3, axis=2), SRGB)


def before_wall(seed):
    """Gray image and plate of 8 bits, and path and radius, of a ball in the light of a lamp aside."""
    rng = np.random.default_rng(seed)
    wall = plain_plate((120, 90), np.full(3, rng.uniform(0.2, 0.7)), rng)
    middle, radius, turn = (60.0, 45.0), rng.uniform(6, 11), rng.uniform(0, 2 * np.pi)
    half = rng.uniform(0.7, 2.2) * radius * np.array([np.cos(turn), 0.6 * np.sin(turn)])
    paint = np.full(3, rng.choice([rng.uniform(0.03, 0.1), rng.uniform(0.8, 0.95)]))
    aside = rng.uniform(0, 2 * np.pi)
    lamp = Lamp((np.cos(aside), np.sin(aside), rng.uniform(0.5, 1.5)))
    gloss = rng.choice([0.0, 0.3])
    ball = Ball(radius, paint, ambient=0.4, lamps=(lamp,), highlight=gloss)
    light = on_line(wall, middle - half, middle + half, ball, 64).image.rgb
    pictures = (in_eight_bits(SRGB.encode(exact[..., 1]), rng) for exact in (light, wall))
    return with_noise(*pictures), np.array([*middle, 2 * np.hypot(*half), radius])


def glossy_before_wall(seed):
    """Image and plate, and place and radius, of a ball whose gloss has the hue of the wall."""
    rng = np.random.default_rng(seed)
    wall = plain_plate((120, 90), np.full(3, rng.uniform(0.2, 0.7)), rng)
    middle, radius = np.array([60.0, 45.0]), rng.uniform(6, 11)
    half = rng.uniform(0.7, 2.2) * radius * np.array([1.0, rng.uniform(-0.5, 0.5)])
    aside = rng.uniform(0, 2 * np.pi)
    lamp = Lamp((np.cos(aside), np.sin(aside), rng.uniform(0.5, 1.5)))
    paint = rng.permutation([0.7, 0.3, 0.1])
    ball = Ball(radius, paint, ambient=0.4, lamps=(lamp,), highlight=0.5)
    light = on_line(wall, middle - half, middle + half, ball, 64).image.rgb
    pictures = (in_eight_bits(SRGB.encode(exact), rng) for exact in (light, wall))
    return with_noise(*pictures), np.array([*middle, radius])


def test_glossy_balls_before_gray_walls_are_within_their_errors():
    """honest: place and radius in color."""
    z = []
    for seed in range(12):
        (image, plate), truth = glossy_before_wall(seed)
        streak = require_streaks(image, plate)[0]
        motion = motion_of_sweep(fit_disc(image, plate, streak, ColorModel.any()), None)
        std = np.sqrt(np.diag(motion.covariance))[[0, 1]]
        found = np.array([*motion.center, motion.radius])
        z.append((found - truth) / [*std, motion.radius_std])
    assert np.mean(np.abs(z) < 3) >= 0.95


def test_shaded_balls_before_plain_walls_are_within_their_errors():
    """honest: place, length and radius in gray."""
    z = []
    for seed in range(16):
        (image, plate), truth = before_wall(seed)
        motion = motion_of_sweep(fit_disc(image, plate, require_streaks(image, plate)[0]), None)
        found = np.array([*motion.center, motion.length, motion.radius])
        std = np.sqrt(np.diag(motion.covariance))[[0, 1]]
        z.append((found - truth) / [*std, motion.length_std, motion.radius_std])
    z = np.abs(z)
    assert np.mean(z[:, :2] < 3) >= 0.95
    assert np.mean(z[:, 2:] < 3) >= 0.97


def test_a_band_of_another_paint_does_not_move_the_rim():
    """exact, but for the noise of 8 bits: a pattern of order 7 is .27 px off."""
    rng = np.random.default_rng(1)
    texture, middle = textured_plate((120, 90), rng), np.array([60.0, 45.0])
    radius = rng.uniform(8, 11)
    half = rng.uniform(0.5, 1) * radius * np.array([1.0, rng.uniform(-0.5, 0.5)])
    dark, light = np.full(3, 0.1), np.full(3, 0.9)
    ball = Ball(radius, dark, second_color=light, band=0.4, axis=tuple(rng.normal(size=3)))
    moved = on_line(texture, middle - half, middle + half, ball, 64).image.rgb
    pictures = (in_eight_bits(SRGB.encode(exact[..., 1]), rng) for exact in (moved, texture))
    image, plate = with_noise(*pictures)
    motion = motion_of_sweep(fit_disc(image, plate, require_streaks(image, plate)[0]), None)
    off = np.array([*motion.center, motion.radius]) - [*middle, radius]
    assert np.abs(off).max() < 0.1


def test_a_band_before_a_wall_is_not_taken_for_a_blurred_rim():
    """honest: paint with sharp edges looks like a blurred rim of a smaller disc, and gloss too"""
    rng, path, wall = np.random.default_rng(20), Trajectory.line((60, 50), (130, 65)), 0.4
    banded = Ball(13, np.full(3, 0.8), second_color=np.full(3, 0.05), band=0.3)
    glossy = Ball(13, (0.85, 0.16, 0.05), highlight=0.6)
    for ball, blur in ((banded, 0), (glossy, 0.8)):
        plate, pictures = np.full((110, 190, 3), wall), []
        for exact in (rendered(Scene(plate, path, ball)).image.rgb, plate):
            seen = scipy.ndimage.gaussian_filter(exact @ [0.2126, 0.7152, 0.0722], blur)
            codes = 255 * SRGB.encode(np.clip(seen + rng.normal(0, NOISE, seen.shape), 0, 1))
            codes = np.rint(codes).astype(np.uint8)
            pictures.append(decode(np.repeat(codes[..., None], 3, axis=2), SRGB))
        image, plate = with_noise(*pictures)
        disc = fit_sweep(image, plate, require_streaks(image, plate)[0])
        assert abs(disc.radius - 13) < min(3 * disc.radius_std, 1.0)

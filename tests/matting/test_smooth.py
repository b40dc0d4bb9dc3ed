"""Smooth: all pixels of a streak together, whatever its shape."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered

from blurmatte.color.model import ColorModel
from blurmatte.errors import ConvergenceWarning
from blurmatte.matting import Pixelwise, Quality, Smooth, solve
from blurmatte.matting.maps import Grade
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.flat_bodies import Sheet, star_sprite
from blurmatte.rendering.plates import plain_plate, textured_plate
from blurmatte.rendering.pose import Change
from blurmatte.streaks import Streak
from blurmatte.trajectory import Trajectory

SIZE = (192, 144)
ORANGE, BLUE = np.array([0.8, 0.4, 0.1]), np.array([0.1, 0.2, 0.7])
PLATES = {
    "colorful": colorful_plate(SIZE, 1, tile=30),
    "textured": textured_plate(SIZE, 2),
    "plain": plain_plate(SIZE, (0.4, 0.42, 0.5), 3),
}
WAY = Trajectory.arc((60, 84), (96, 52), (132, 80))
SPOTS = np.kron(np.random.default_rng(0).uniform(0.05, 0.9, (4, 8, 3)), np.ones((8, 8, 1)))
CAMERA = Camera(code_std=2 / 255)
COMPRESSING = Camera(code_std=2 / 255, jpeg_quality=90, chroma="4:2:0")
BODIES = {
    "ball": (Ball(18, ORANGE), Change()),
    "two paints": (Ball(18, ORANGE, second_color=BLUE), Change(spin=(1, 0.5, 0))),
    "growing": (Ball(18, ORANGE), Change(scale=(0.5, 1.5))),
    "tumbling sheet": (Sheet(40, 30, ORANGE), Change(spin=(2.6, 0, 0))),
    "turning star": (star_sprite(40, ORANGE), Change(spin=(0, 0, 2))),
    "turning stick": (Sheet(50, 8, ORANGE), Change(spin=(0, 0, 2))),
    "spotted": (Ball(18, np.ones(3), texture=SPOTS), Change(spin=(0.6, 0.3, 0))),
}


@cache
def scene_of(body, plate):
    thing, change = BODIES[body]
    return Scene(PLATES[plate], WAY, thing, change)


def taken(body, plate, seed=0, camera=CAMERA):
    """The truth, image and plate."""
    scene = scene_of(body, plate)
    return rendered(scene), *photographed(scene, camera, seed, 5)


def rmse(solution, truth):
    true = truth.layer.alpha
    return np.sqrt(np.mean((solution.alpha - true)[true > 0] ** 2))


@pytest.mark.parametrize(
    ("body", "plate", "most"),
    [
        ("ball", "colorful", 0.015),
        ("ball", "textured", 0.015),
        ("two paints", "textured", 0.02),
        ("turning stick", "textured", 0.02),
    ],
)
def test_noise_is_far_below_that_of_pixels_and_errors_are_calibrated(body, plate, most):
    truth, image, without = taken(body, plate)
    model = truth.model
    together, alone = (solve(image, without, model, s) for s in (Smooth(), Pixelwise()))
    assert together.solver == repr(Smooth())
    assert rmse(together, truth) < min(most, rmse(alone, truth) / 2)
    inside = truth.layer.alpha > 0
    score = (together.alpha - truth.layer.alpha)[inside] / together.alpha_std[inside]
    assert 0.8 < np.sqrt(np.mean(score**2)) < 1.25
    assert 0.9 < np.mean(np.abs(score) < 2) < 0.98
    assert_allclose(together.alpha[together.streak].sum(), truth.layer.alpha.sum(), rtol=0.02)
    light = together.premultiplied - truth.layer.premultiplied
    assert np.sqrt(np.mean(light[inside] ** 2)) < 0.015


@pytest.mark.parametrize(
    ("body", "plate", "most", "least"),
    [
        ("ball", "colorful", 0.035, 0.8),
        ("growing", "textured", 0.022, 0.8),
        ("two paints", "textured", 0.06, 0.7),
    ],
    ids=["ball", "growing", "conservative for two paints"],
)
def test_errors_of_compressed_color_are_honest(body, plate, most, least):
    """Honest: noise in compressed color around the streak differs from that within."""
    scores = []
    for seed in range(2):
        truth, image, without = taken(body, plate, seed, COMPRESSING)
        solution = solve(image, without, truth.model, Smooth())
        assert rmse(solution, truth) < most
        inside = truth.layer.alpha > 0
        scores.append((solution.alpha - truth.layer.alpha)[inside] / solution.alpha_std[inside])
    score = np.concatenate(scores)
    assert least < np.sqrt(np.mean(score**2)) < least + 0.4
    assert 0.9 < np.mean(np.abs(score) < 2) < 0.99


def known_and_not(body, plate, seed):
    """The truth, and solutions with and without the compression metadata of the file."""
    truth, image, behind = taken(body, plate, seed, COMPRESSING)
    unknown = replace(image, meta=replace(image.meta, compression=None))
    return truth, *(solve(p, behind, truth.model, Smooth()) for p in (image, unknown))


def test_known_compression_is_corrected():
    """Honest: with the chroma subsampling of the file known."""
    errors, scores = [], []
    for seed in range(8):
        truth, *both = known_and_not("turning star", "colorful", seed)
        errors.append([rmse(solution, truth) for solution in both])
        inside = truth.layer.alpha > 0
        off = (both[0].alpha - truth.layer.alpha)[inside]
        scores.append(off / both[0].alpha_std[inside])
    known, unknown = np.mean(errors, axis=0)
    assert known < 0.92 * unknown
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25
    assert np.mean(np.abs(scores) < 2) > 0.88


def test_chroma_subsampling_does_not_bias_the_sum():
    """Invariant: blurred chroma does not enlarge a ball."""
    sums = []
    for seed in range(2):
        truth, *both = known_and_not("growing", "textured", seed)
        total = truth.layer.alpha.sum()
        sums.append([solution.alpha[solution.streak].sum() / total - 1 for solution in both])
    known, unknown = np.mean(sums, axis=0)
    assert abs(known) < min(0.5 * unknown, 0.01)


def test_chroma_subsampling_of_two_paints_is_not_corrected():
    """Invariant: the colors at rims are not known well enough to correct them."""
    _, known, unknown = known_and_not("two paints", "textured", 0)
    assert np.array_equal(known.alpha, unknown.alpha)


def test_any_colors_are_solved_before_texture():
    truth, image, plate = taken("spotted", "textured")
    solution = solve(image, plate, ColorModel.any(), Smooth())
    assert rmse(solution, truth) < 0.06
    inside = truth.layer.alpha > 0
    score = (solution.alpha - truth.layer.alpha)[inside] / solution.alpha_std[inside]
    assert 0.8 < np.sqrt(np.mean(score**2)) < 1.25


def test_errors_of_any_colors_before_a_plain_plate_are_large():
    """honest"""
    truth, image, plate = taken("spotted", "plain")
    solution = solve(image, plate, ColorModel.any(), Smooth())
    assert solution.grade is Grade.ASSUMED
    inside = (truth.layer.alpha > 0) & solution.known & solution.streak
    assert np.mean(inside[truth.layer.alpha > 0]) > 0.8
    off = (solution.alpha - truth.layer.alpha)[inside]
    claimed = np.hypot(solution.alpha_std, solution.stats.alpha_scale_std * solution.alpha)
    assert 0.8 < np.sqrt(np.mean(off**2) / np.mean(claimed[inside] ** 2)) < 1.25


def test_exact_pictures_give_the_closed_form():
    truth = rendered(scene_of("ball", "colorful"))
    together, alone = (
        solve(truth.image, truth.plate, truth.model, s) for s in (Smooth(), Pixelwise())
    )
    across = np.linalg.norm(truth.plate.rgb @ truth.model.normals, axis=-1) > 1e-3
    assert_allclose(together.alpha[across], alone.alpha[across], atol=1e-4)


def test_the_sum_has_little_bias_and_a_conservative_error():
    """Honest: over draws of noise; the error is calibrated on harder scenes than this one."""
    biases, scores = [], []
    for seed in range(32):
        truth, image, plate = taken("ball", "colorful", seed)
        stats = solve(image, plate, truth.model, Smooth()).stats
        off = stats.sum_alpha - truth.layer.alpha.sum()
        biases.append(off / truth.layer.alpha.sum())
        scores.append(off / stats.sum_alpha_std)
    assert abs(np.mean(biases)) < 0.005
    assert np.std(biases) < 0.006
    assert 0.55 < np.sqrt(np.mean(np.square(scores))) < 0.85


def test_larger_strength_gives_smoother_alpha():
    """Honest: too much smoothing increases the stated errors; with too little, alpha may be rougher
    than it is, so that they are conservative.
    """
    steps, scores = [], []
    for seed in range(8):
        truth, image, plate = taken("turning stick", "textured", seed)
        inside = truth.layer.alpha > 0.02
        found = [solve(image, plate, truth.model, Smooth(strength)) for strength in (0.2, 5.0)]
        steps.append([np.abs(np.diff(s.alpha, axis=1))[inside[:, 1:]].mean() for s in found])
        off = [(s.alpha - truth.layer.alpha)[inside] for s in found]
        scores.append(np.divide(off, [s.alpha_std[inside] for s in found]))
    rough, smooth = np.transpose(steps)
    assert np.all(smooth < rough)
    rough, smooth = np.sqrt(np.mean(np.square(scores), axis=(0, 2)))
    assert 0.46 < rough < 0.72
    assert 0.8 < smooth < 1.25
    assert np.all(np.mean(np.abs(scores) < 2, axis=(0, 2)) > 0.9)


def test_clipped_pixels_are_filled_from_their_neighbors():
    truth, image, plate = taken("ball", "colorful")
    clipped = np.zeros(image.valid.shape, bool)
    clipped[60:66, 92:98] = True
    holed = LinearImage(np.where(clipped[..., None], 1, image.rgb), image.noise, ~clipped)
    solution = solve(holed, plate, truth.model, Smooth())
    assert np.abs(solution.alpha - truth.layer.alpha)[clipped].max() < 0.1
    assert np.all(np.isfinite(solution.alpha_std[clipped]))
    assert np.all((solution.quality[clipped] & np.uint8(Quality.SATURATED)) != 0)
    assert np.all(np.isfinite(solution.premultiplied_std[clipped]))


def test_a_given_region_is_solved_exactly():
    truth, image, plate = taken("ball", "colorful")
    region = Streak.from_box((40, 30, 120, 110), SIZE)
    solution = solve(image, plate, truth.model, Smooth(), streak=region)
    assert np.array_equal(solution.streak, region.mask)


@pytest.mark.battery
def test_has_the_largest_weight_where_no_shape_explains_the_streak():
    truth, image, plate = taken("tumbling sheet", "textured")
    solution = solve(image, plate, ColorModel((ORANGE / np.linalg.norm(ORANGE))[:, None]))
    assert solution.solver == repr(Smooth())
    assert solution.stats.weights[-1] > 0.99
    assert rmse(solution, truth) < 0.03


class Unfinished(Smooth):
    """Its fit ended after the largest number of steps."""

    def fitted(self, case):
        fit = super().fitted(case)
        return replace(fit, field=replace(fit.field, steps=300, converged=False))


def test_warns_if_not_converged():
    """Door: the last iterate comes with a warning."""
    truth, image, plate = taken("ball", "colorful")
    with pytest.warns(ConvergenceWarning, match="had not converged after 300 steps"):
        solution = solve(image, plate, truth.model, Unfinished())
    assert not solution.stats.smooth.converged
    assert np.isfinite(solution.alpha).all()


def test_the_same_every_time():
    truth, image, plate = taken("ball", "colorful")
    first, second = (solve(image, plate, truth.model, Smooth()) for _ in range(2))
    assert np.array_equal(first.alpha, second.alpha)
    assert np.array_equal(first.alpha_std, second.alpha_std)


@pytest.mark.parametrize("name", ["strength", "max_alpha_std"])
@pytest.mark.parametrize("value", [0, -1, np.nan])
def test_numbers_must_be_positive(name, value):
    with pytest.raises(ValueError, match=f"{name} must be positive"):
        Smooth(**{name: value})


@pytest.mark.parametrize("value", [1e-320, 1e-7, 1e7, np.inf])
def test_strength_has_a_range(value):
    with pytest.raises(ValueError, match=r"strength must lie between 1e-06 and 1e\+06"):
        Smooth(strength=value)

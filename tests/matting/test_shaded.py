"""Shaded: a ball whose shadow is next to it and behind it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.scenes import photographed, rendered

import blurmatte as bm
from blurmatte.color.model import ColorModel
from blurmatte.matting import Pixelwise, Quality, Smooth, solve
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import two_hue_plate
from blurmatte.rendering.scene import Shadow
from blurmatte.trajectory import Trajectory

SIZE = (160, 120)
LIGHT = np.array([0.5, 0.35, 0.08])
STRENGTH = np.array([0.6, 0.45, 0.25])
NOISE = bm.NoiseModel(read_std=0.003)
COLOR = np.array([0.15, 0.43, 0.40])
GIVEN_COLOR = ColorModel.from_samples(np.array([COLOR]), std=1e-4)
PLATE = two_hue_plate((160, 120), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 3)
SCENE = Scene(PLATE, Trajectory.line((60, 45), (100, 45)), Ball(14, COLOR))


def rendering(strength):
    plate = colorful_plate(SIZE, np.random.default_rng(2))
    path = bm.Trajectory.line((60, 50), (95, 65))
    shadow = Shadow((6, 14), 3.0, tuple(strength))
    return rendered(bm.rendering.Scene(plate, path, bm.rendering.Ball(14, LIGHT), shadow=shadow))


COLORED, GRAY = rendering(STRENGTH), rendering((0.5, 0.5, 0.5))


def taken(truth, seed=None, std=0.003):
    rng = np.random.default_rng(seed)
    pictures = [truth.image.rgb, truth.plate.rgb]
    if seed is not None:
        pictures = [light + rng.normal(0, std, light.shape) for light in pictures]
    return [bm.LinearImage(light, NOISE) for light in pictures]


def in_shadow(plate):
    return replace(plate, rgb=plate.rgb * (1 - STRENGTH))


MODEL = bm.ColorModel.from_samples(LIGHT[None], std=1e-9)


def off(truth, solution):
    at = (truth.layer.alpha > 0) & solution.known
    return float(np.sqrt(np.mean((solution.alpha - truth.layer.alpha)[at] ** 2)))


def test_shaded_plate_separates_shadow_and_object():
    """Exact: alpha, light and the fraction of the exposure in shadow."""
    image, plate = (picture.with_noise(bm.NoiseModel(read_std=1e-4)) for picture in taken(COLORED))
    solver = bm.matting.Shaded(plate=in_shadow(plate))
    solution = bm.solve(image, plate, MODEL, solver, matching=bm.background.Matching.NONE)
    known = solution.known & solution.streak
    assert known.mean() > 0.05
    assert np.abs(solution.alpha - COLORED.layer.alpha)[known].max() < 1e-5
    assert np.abs(solution.premultiplied - COLORED.layer.premultiplied)[known].max() < 1e-5
    assert np.any(solution.quality & Quality.SHADOW)
    plain = bm.solve(image, plate, MODEL, bm.Pixelwise(), matching=bm.background.Matching.NONE)
    assert off(COLORED, plain) > 0.05


def test_known_light_separates_shadow_and_object():
    """Exact: a shadow without change of hue, and an object of known, uniform light."""
    flat = replace(GRAY, image=replace(GRAY.image, rgb=_even(GRAY)))
    image, plate = taken(flat)
    solver = bm.matting.Shaded(light=tuple(LIGHT))
    solution = bm.solve(image, plate, None, solver, matching=bm.background.Matching.NONE)
    known = solution.known & solution.streak
    assert np.abs(solution.alpha - GRAY.layer.alpha)[known].max() < 1e-5
    assert solution.model.rank == 1


def _even(truth):
    """The image if the ball had the same light all over."""
    return truth.image.rgb - truth.layer.premultiplied + truth.layer.alpha[..., None] * LIGHT


@pytest.mark.parametrize("case", ["plate", "light"])
def test_errors_are_honest(case):
    """Honest."""
    z = []
    truth = (
        COLORED if case == "plate" else replace(GRAY, image=replace(GRAY.image, rgb=_even(GRAY)))
    )
    for seed in range(4):
        image, plate = taken(truth, seed)
        shaded = bm.LinearImage(truth.plate.rgb * (1 - STRENGTH), NOISE)
        solver = (
            bm.matting.Shaded(plate=shaded)
            if case == "plate"
            else bm.matting.Shaded(light=tuple(LIGHT))
        )
        solution = bm.solve(image, plate, MODEL, solver, matching=bm.background.Matching.NONE)
        at = solution.known & solution.streak
        z += list((solution.alpha - truth.layer.alpha)[at] / solution.alpha_std[at])
    assert 0.85 < np.std(z) < 1.2


@pytest.mark.parametrize("given", ["plate", "light"])
def test_grade_follows_from_the_error_unless_constant_light_is_assumed(given):
    """Honest: the stated error covers alpha; with the light alone the grade is assumed, and says so."""
    image, plate = taken(COLORED, 5)
    shaded = bm.LinearImage(COLORED.plate.rgb * (1 - STRENGTH), NOISE)
    solver = (
        bm.matting.Shaded(plate=shaded)
        if given == "plate"
        else bm.matting.Shaded(light=tuple(LIGHT))
    )
    solution = bm.solve(image, plate, MODEL, solver, matching=bm.background.Matching.NONE)
    stats, sentence = solution.stats, bm.explain(solution)[0]
    if given == "light":
        assert solution.grade is bm.Grade.ASSUMED
        assert stats.grade_reasons[0] == "light"
        assert "constant light of the object is assumed" in sentence
    else:
        assert not {"light", "shadow"} & set(stats.grade_reasons)
        assert off(COLORED, solution) < 2 * stats.alpha_error


def test_plate_in_shadow_needs_the_color():
    """Exact: it is refused at once, and not answered as if there were no shadow."""
    image, plate = taken(COLORED)
    with pytest.raises(
        bm.errors.ColorModelError, match=r"give the color of the object \(--color\)"
    ):
        bm.solve(image, plate, None, bm.matting.Shaded(plate=in_shadow(plate)))


def test_rejects_wrong_arguments():
    with pytest.raises(ValueError, match="exactly one of both"):
        bm.matting.Shaded()
    with pytest.raises(ValueError, match="three finite numbers"):
        bm.matting.Shaded(light=(0, 0, 0))
    with pytest.raises(ValueError, match="max_alpha_std must be positive"):
        bm.matting.Shaded(light=(1, 1, 1), max_alpha_std=0)
    image, plate = taken(COLORED)
    plane = bm.ColorModel.from_hex("#ff8000", "#0080ff")
    with pytest.raises(ValueError, match="needs a model of rank 1, got rank 2"):
        bm.solve(image, plate, plane, bm.matting.Shaded(plate=plate))
    small = plate.crop((0, 0, 50, 50))
    with pytest.raises(ValueError, match="50x50"):
        bm.solve(image, plate, MODEL, bm.matting.Shaded(plate=small))


def solved(scene, solver):
    truth = rendered(scene)
    image, plate = photographed(scene, Camera(code_std=1 / 255), 1, plate_frames=1)
    return truth, solve(image, plate, GIVEN_COLOR, solver)


@pytest.mark.parametrize("solver", [Pixelwise(), Smooth()], ids=["pixelwise", "smooth"])
def test_error_covers_the_alpha_of_a_possible_shadow(solver):
    """honest: the errors of alpha are at most those claimed, and that of its sum is as large."""
    truth, solution = solved(replace(SCENE, shadow=Shadow((0, 34), 3, (0.5,) * 3)), solver)
    marked = (solution.quality & np.uint8(Quality.SHADOW)) != 0
    nothing = marked & (truth.layer.alpha == 0)
    off = (solution.alpha - truth.layer.alpha)[nothing]
    assert np.median(off) > 0.1
    assert np.mean(np.abs(off) < 2 * solution.alpha_std[nothing]) > 0.9
    off_sum = solution.stats.sum_alpha - truth.layer.alpha.sum()
    assert 0.8 < off_sum / solution.stats.sum_alpha_std < 1.25


def test_without_a_shadow_errors_are_those_of_the_solver():
    _, solution = solved(SCENE, Smooth())
    marked = (solution.quality & np.uint8(Quality.SHADOW)) != 0
    assert not marked.any()
    assert solution.stats.sum_alpha_std < 0.02 * solution.stats.sum_alpha


def test_plate_in_shadow_is_matched_as_the_plate_is():
    """exact"""
    light = np.random.default_rng(0).uniform(0.2, 0.7, (24, 32, 3))
    plate, brighter = bm.LinearImage(light), bm.LinearImage(1.2 * light)
    match = SimpleNamespace(apply=lambda picture: {id(plate): brighter}[id(picture)])
    assert bm.matting.Shaded(plate=plate).matched(match).plate is brighter
    lit = bm.matting.Shaded(light=(0.5, 0.4, 0.3))
    assert lit.matched(match) is lit
    assert not lit.refusal_in_clips

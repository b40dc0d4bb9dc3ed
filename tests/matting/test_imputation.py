"""solve before a guessed plate: alpha, and an error that contains that of the guess."""

from dataclasses import replace

import numpy as np
import pytest
from tests.scenes import photographed, rendered

from blurmatte.background import guess_plate
from blurmatte.color.model import ColorModel
from blurmatte.explain import explain
from blurmatte.figures import draw_overview
from blurmatte.matting import Smooth, solve
from blurmatte.matting.hypotheses import Swept
from blurmatte.matting.maps import Grade
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.rendering import Ball, Camera, Scene
from blurmatte.rendering.plates import plain_plate, textured_plate
from blurmatte.sweep.hypotheses import Disc, DiscWithShadow
from blurmatte.trajectory import Trajectory

COLOR = (0.1, 0.3, 0.8)
SCENE = Scene(
    plain_plate((144, 112), (0.5, 0.4, 0.3), 1),
    Trajectory.line((50.0, 52.0), (94.0, 60.0)),
    Ball(9.0, COLOR, ambient=1.0),
)


@pytest.fixture(scope="module")
def seen():
    """The picture, its guessed plate, and the true alpha."""
    image, _ = photographed(SCENE, Camera(code_std=1 / 255))
    alpha = rendered(SCENE).layer.alpha
    region = np.zeros(alpha.shape, bool)
    region[34:78, 32:112] = True
    return image, guess_plate(image, region), alpha


@pytest.fixture(scope="module")
def smooth(seen):
    """The solution before the guess with a known color, and that before its mean alone."""
    image, plate, _ = seen
    model, box = ColorModel.from_samples(np.array([COLOR]), std=1e-9), plate.surroundings
    part = image.with_noise(plate.image_noise).crop(box)
    mean = solve(part, plate.around_hidden(box).plates[0], model, Smooth())
    return solve(image, plate, model, Smooth()), mean.in_picture(box, image.size)


def test_ball_before_a_wall_is_solved_without_a_plate(seen, smooth):
    _, _, alpha = seen
    solution, _ = smooth
    error = (solution.alpha - alpha)[alpha > 0]
    assert np.sqrt(np.mean(error**2)) < min(0.05, 2 * solution.stats.alpha_error)
    assert abs(solution.alpha.sum() - alpha.sum()) < 3 * solution.stats.sum_alpha_std


@pytest.fixture(scope="module", params=[0, 1, 2])
def before_grass(request):
    """A solution without a plate before texture of one hue, and the true alpha."""
    texture = textured_plate((144, 112), request.param).mean(axis=-1, keepdims=True)
    scene = replace(SCENE, plate=texture * (0.35, 0.5, 0.2))
    image, _ = photographed(scene, Camera(code_std=1 / 255), seed=request.param)
    alpha = rendered(scene).layer.alpha
    region = np.zeros(alpha.shape, bool)
    region[34:78, 32:112] = True
    plate = guess_plate(image, region)
    assert plate.is_rough
    return solve(image, plate), alpha


def test_ball_of_another_hue_than_texture_is_solved_without_a_plate(before_grass):
    """oracle: each channel of the guess errs by more than a tenth, their errors are one."""
    solution, alpha = before_grass
    error = np.sqrt(np.mean((solution.alpha - alpha)[solution.streak | (alpha > 0)] ** 2))
    assert error < min(0.01, 2 * solution.stats.alpha_error)
    assert abs(solution.stats.sum_alpha - alpha.sum()) < 3 * solution.stats.sum_alpha_std
    assert solution.grade <= Grade.PLAUSIBLE
    assert solution.stats.rough_guess > 0.01


def test_error_contains_that_of_the_guess(smooth):
    solution, before_mean = smooth
    inside = solution.streak & solution.known
    assert np.array_equal(solution.alpha[inside], before_mean.alpha[inside])
    assert np.all(solution.alpha_std[inside] >= before_mean.alpha_std[inside])
    assert solution.stats.sum_alpha_std > before_mean.stats.sum_alpha_std
    assert solution.stats.alpha_error > before_mean.stats.alpha_error


def test_guess_is_never_confirmed_and_says_why(smooth):
    solution, _ = smooth
    assert solution.grade is not Grade.CONFIRMED
    assert solution.stats.grade_reasons[0] == "plate"
    assert solution.stats.match is None


@pytest.fixture(scope="module")
def cut(seen):
    """The picture, and a guess in a region that half of the object is beyond."""
    image, plate, _ = seen
    region = plate.region.copy()
    region[:, 74:] = False
    region[:40], region[72:] = False, False
    return image, guess_plate(image, region)


def test_errors_of_an_object_that_the_region_cuts_contain_its_rest(seen, cut):
    """The guess shows its rest: a path of 45 pixels was stated as 23 ± 2 without a word."""
    solution, total = solve(*cut, solver=Swept((Disc(),))), seen[2].sum()
    motion = measure_motion(solution)
    assert solution.grade is Grade.ASSUMED
    assert abs(solution.stats.sum_alpha - total) < 2 * solution.stats.sum_alpha_std
    assert abs(motion.length - SCENE.trajectory.length) < 3 * motion.length_std
    for said in explain(solution), explain(motion):
        assert any("reaches beyond the region" in line for line in said)


def test_nothing_is_outside_the_region(seen, smooth):
    """Over the guess, which is the image there, an object would be seen twice."""
    outside = ~seen[1].hidden
    assert not smooth[0].layer.alpha[outside].any()
    assert not smooth[0].streak[outside].any()
    assert smooth[1].streak[outside].any()


def test_sheet_shows_the_guess_and_its_error(seen, smooth):
    """Exact: eight panels instead of six, so at least one more row."""
    image, plate, _ = seen
    with_guess = draw_overview(image, plate, smooth[0])
    assert len(with_guess) > len(draw_overview(image, plate.plates[0], smooth[0]))


class Tried(Exception):
    """What a solver was asked to fit."""


class Asked(Swept):
    """Fits a disc, and raises what it would have fitted."""

    def answer(self, case, out):
        raise Tried([type(one) for one in self.hypotheses])


@pytest.mark.parametrize(("std", "tried"), [(0.01, [Disc, DiscWithShadow]), (0.1, [Disc])])
def test_shadows_are_sought_only_before_a_good_guess(seen, std, tried):
    image, plate, _ = seen
    variance = np.where(plate.hidden[..., None], std**2, plate.variance)
    with pytest.raises(Tried) as raised:
        solve(image, replace(plate, noise=variance), None, Asked((Disc(), DiscWithShadow())))
    assert raised.value.args[0] == tried


class OnCells(Smooth):
    """Streaks of more than 12 pixels are fitted on cells."""

    fitted_width = 12.0


def test_errors_by_the_guess_of_a_wide_streak_are_those_at_full_size(seen):
    """Oracle: the draws are solved on cells of two pixels, and on pixels."""
    image, plate, _ = seen
    model = ColorModel.from_samples(np.array([COLOR]), std=1e-9)
    whole, cells = (solve(image, plate, model, one()).stats for one in (Smooth, OnCells))
    assert cells.sum_alpha_std == pytest.approx(whole.sum_alpha_std, rel=0.25)
    assert cells.alpha_error == pytest.approx(whole.alpha_error, rel=0.25)
    assert cells.sum_alpha == whole.sum_alpha


@pytest.mark.battery
def test_path_and_radius_are_found_before_a_guess(seen):
    image, plate, alpha = seen
    solution = solve(image, plate)
    error = (solution.alpha - alpha)[alpha > 0]
    assert np.sqrt(np.mean(error**2)) < min(0.02, 2 * solution.stats.alpha_error)
    assert abs(solution.sweep.radius - 9) < 3 * solution.sweep.radius_std
    assert abs(solution.sweep.length - np.hypot(44, 8)) < 1
    assert solution.grade is Grade.PLAUSIBLE

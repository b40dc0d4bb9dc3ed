"""Sentences about solutions."""

from dataclasses import replace

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.background import PlateGuess
from blurmatte.color.model import ColorModel
from blurmatte.explain import explain
from blurmatte.explain.solution import left_out, usable_all_the_same
from blurmatte.matting import Quality
from blurmatte.matting.maps import PixelMaps
from blurmatte.matting.stats import MedianNoise
from blurmatte.radiometry import NoiseModel

NOISE = bm.NoiseModel(gain=1e-5, read_std=2e-3)


def test_the_sum_of_alpha_is_an_area(solution):
    said = " ".join(
        explain(solution(sum_alpha=np.pi * 100, sum_alpha_std=7.0, alpha_scale_std=0.02))
    )
    assert "Alpha up to 0.30." in said
    assert "Sum of alpha 314 ± 7, if the given color is right: the area" in said
    assert "radius would be 10.0 ± 0.1." in said
    assert "not explained by the color model 10.0%" in said


def test_limits_of_the_sum_are_stated(solution):
    said = " ".join(
        explain(
            solution(
                **{"sum_alpha": 100.0, "pixels": 200, "pixels_known": 150},
                **{"streak_box": (0, 5, 25, 15), "other_boxes": ((1, 1, 2, 2),)},
            )
        )
    )
    assert "50 pixels of the streak are unknown" in said
    assert "touches the border" in said
    assert "1 other thing moved" in said


def test_a_color_that_no_pixel_shows_is_stated(solution, changed):
    """color.png holds the color where alpha is above three standard deviations."""
    assert left_out(changed()) == []
    (said,) = left_out(solution(sum_alpha=100.0))
    assert said == "alpha is nowhere above three standard deviations, so that color.png is black"


def test_occluders_are_stated(changed):
    said = " ".join(explain(changed(quality=(1, Quality.OCCLUDED))))
    assert "behind something still 10.0%" in said


def test_samples_name_their_pixels_as_the_source_of_error(solution):
    picked = ColorModel.from_samples(np.array([[0.8, 0.4, 0.1], [0.81, 0.4, 0.1]]))
    said = " ".join(explain(replace(solution(sum_alpha=100.0), model=picked)))
    assert "if the sampled pixels show nothing but the object: the area" in said


def test_noise_is_stated_at_medium_light(solution):
    noise = NoiseModel(read_std=0.002)
    said = explain(solution(image_noise=noise, plate_noise=MedianNoise(0.001)))
    assert "Noise (std, white is 1): 0.002 in the image, 0.001 in the plate." in said


@pytest.fixture
def case():
    """Image, plate of one gray, and a solution of twice the alpha with a color nearer to the plate."""
    rng = np.random.default_rng(0)
    alpha = np.zeros((40, 60))
    alpha[10:30, 10:50] = 0.3
    plate = np.full((40, 60, 3), 0.2)
    light = 0.3 * np.array([0.9, 0.5, 0.1]) * (alpha > 0)[..., None]
    clean = light + (1 - alpha)[..., None] * plate
    image = clean + 2e-3 * rng.standard_normal(clean.shape)
    maps = PixelMaps.zeros(40, 60, np.float32)
    maps.alpha[...] = 2 * alpha
    maps.premultiplied[...] = light + alpha[..., None] * plate
    maps.quality[alpha == 0] = bm.matting.Quality.OUTSIDE
    stats = bm.matting.SolutionStats(grade=bm.Grade.ASSUMED, image_noise=NOISE, plate_noise=NOISE)
    solution = bm.Solution(*maps, model=bm.ColorModel.any(), solver="", stats=stats)
    return bm.LinearImage(image), bm.LinearImage(plate), solution


def test_wrong_factor_of_alpha_does_not_matter_over_the_same_plate(case):
    (line,) = usable_all_the_same(*case)
    assert "`remove`" in line
    assert "off by that factor" in line


def test_layer_that_does_not_give_back_the_image_is_not_called_usable(case):
    image, plate, solution = case
    half = replace(solution, premultiplied=0.5 * solution.premultiplied)
    assert usable_all_the_same(image, plate, half) == []


def test_noise_does_not_excuse_that_most_of_the_change_is_not_given_back(case):
    image, plate, solution = case
    rough = replace(solution.stats, plate_noise=NoiseModel(read_std=0.1))
    assert usable_all_the_same(image, plate, replace(solution, stats=rough))
    half = replace(solution, stats=rough, premultiplied=0.5 * solution.premultiplied)
    assert usable_all_the_same(image, plate, half) == []


def test_before_a_guessed_plate_no_assumed_layer_is_called_usable(case):
    """An opaque object of any form gives back the image."""
    image, plate, solution = case
    guess = PlateGuess(plate.rgb, hidden=solution.streak, image_noise=NOISE)
    assert usable_all_the_same(image, guess, solution) == []


@pytest.mark.parametrize("change", [{"grade": bm.Grade.PLAUSIBLE}, {"may_be_shadow": True}])
def test_nothing_is_said_of_better_grades_and_shadows(case, change):
    image, plate, solution = case
    stats = replace(solution.stats, **change)
    assert usable_all_the_same(image, plate, replace(solution, stats=stats)) == []

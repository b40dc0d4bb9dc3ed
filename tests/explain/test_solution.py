"""Sentences about solutions."""

from dataclasses import replace

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.explain import explain
from blurmatte.matting import Quality
from blurmatte.matting.stats import MedianNoise
from blurmatte.radiometry import NoiseModel


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

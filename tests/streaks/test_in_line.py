"""Parts of one streak are joined if they lie in line and evidence connects them."""

import numpy as np
import pytest

from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import find_streaks
from blurmatte.streaks.in_line import join_in_line

SHAPE = 120, 300


def strip(start, end, bend=0.0, offset=0.0, half_width=6):
    """Cells of a strip along a parabola between two x."""
    y, x = np.indices(SHAPE)
    center = 60 + offset + bend * (x - 150) ** 2
    return (x >= start) & (x < end) & (np.abs(y - center) <= half_width)


def evidence_of(*strips):
    """T of a picture: noise of three degrees of freedom, and 50 in the strips."""
    T = np.random.default_rng(1).chisquare(3, SHAPE)
    T[np.logical_or.reduce(strips)] = 50
    return T


@pytest.mark.parametrize("bend", [0.0, 0.0012])
def test_parts_on_one_curve_with_weak_evidence_between_are_joined(bend):
    one, other = strip(20, 100, bend), strip(200, 280, bend)
    T = evidence_of(one, other)
    T[strip(100, 200, bend)] += 8
    (whole,) = join_in_line([one, other], T)
    assert np.mean(whole[strip(20, 280, bend)]) > 0.97
    assert np.mean(whole & ~strip(20, 280, bend, half_width=8)) == 0


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (strip(20, 100), strip(200, 280, offset=20)),  # parallel
        (strip(20, 100), strip(40, 130, offset=30)),  # next to each other
        (strip(20, 100, half_width=3), strip(200, 280, half_width=10)),  # of two widths
        (strip(90, 100), strip(200, 210)),  # without a direction
    ],
)
def test_other_parts_stay_apart(one, other):
    T = evidence_of(one, other) + 8 * strip(100, 200, half_width=40)
    T[one | other] = 50
    assert len(join_in_line([one, other], T)) == 2


def test_two_objects_on_one_line_with_nothing_between_stay_apart():
    one, other = strip(20, 100), strip(200, 280)
    assert len(join_in_line([one, other], evidence_of(one, other))) == 2


def test_streak_before_a_plate_of_nearly_its_color_is_one_streak():
    noise = NoiseModel(read_std=0.004)
    rng = np.random.default_rng(2)
    plate = np.full((*SHAPE, 3), (0.3, 0.1, 0.1))
    plate[:, 100:200] = 0.78, 0.68, 0.205
    color, alpha = np.array([0.8, 0.7, 0.2]), 0.3 * strip(30, 270)[..., None]
    light = (1 - alpha) * plate + alpha * color
    image, plate = (
        LinearImage(picture + rng.normal(0, 0.004, picture.shape)).with_noise(noise)
        for picture in (light, plate)
    )
    (streak,) = find_streaks(image, plate)
    assert streak.mask[strip(40, 260, half_width=4)].all()

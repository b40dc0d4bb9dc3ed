"""Feasibility: paths, light and visibility that are physically impossible."""

from dataclasses import replace

import numpy as np
import pytest
from tests.sweep.scenes import BALL, BALLS, ONE_PAINT, disc_at, observed

from blurmatte.rendering import Ball
from blurmatte.sweep.fit.feasibility import MAX_LIGHT, inside_mask, rejection, self_overlaps
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.model.state import state_at
from blurmatte.trajectory import Trajectory

PALE = replace(BALL, body=Ball(11, np.array([0.9, 0.95, 0.7]), ambient=0.9))


def disc_on(family, path, radius=11.0, scene=BALL):
    observation = observed(scene, color=ONE_PAINT)
    return state_at(observation, family, np.array(path, float), DISC, DISC.start(radius))


@pytest.mark.parametrize("family", BALLS, ids=lambda family: family.name)
def test_the_truth_is_admissible(family):
    """exact: for every family of paths."""
    state = disc_at(observed(BALLS[family], color=ONE_PAINT), family)
    assert rejection(state) == ""


def test_a_shape_that_is_too_small_needs_more_light_than_white():
    small = disc_at(observed(PALE, color=ONE_PAINT), radius=4.0)
    assert small.mean_color.max() > MAX_LIGHT
    assert rejection(small) == "needs more light than white"
    assert not rejection(disc_at(observed(PALE, color=ONE_PAINT)))


def test_negative_light_is_rejected():
    observation = observed(BALL, color=ONE_PAINT)
    alpha = disc_at(observation).swept.alpha
    darker = observation.C - np.where(alpha > 0, 0.1, 0)[..., None] * [0, 0, 1]
    assert rejection(disc_at(observation.with_light(darker))) == "needs negative light"


def test_a_path_must_stay_in_the_streak():
    detour = disc_on(CUBIC, [44, 42, 48, 115, 78, 55, 112, 68])
    assert not inside_mask(detour)
    assert rejection(detour) == "leaves the streak"


def test_a_path_may_leave_the_picture():
    leaves = replace(BALL, trajectory=Trajectory.line((112, 42), (170, 60)))
    assert inside_mask(disc_on(LINE, [112, 42, 170, 60], scene=leaves))
    assert not inside_mask(disc_on(LINE, [112, 42, 130, 110], scene=leaves))


def test_coarse_pixels_have_the_same_mask():
    """invariant"""
    for path in ([44, 42, 112, 68], [44, 42, 112, 130]):
        state = disc_on(LINE, path)
        assert inside_mask(state.on(state.observation.coarser(3))) == inside_mask(state)


@pytest.mark.parametrize(
    ("family", "path", "radius", "overlaps"),
    [
        (CUBIC, [68, 45, 96, 57, 60, 53, 88, 65], 11, True),
        (CUBIC, [68, 45, 96, 57, 60, 53, 88, 65], 2, False),
        (ARC, [78, 46, 78.5, 46, 20], 11, True),  # a circle of radius 10
        (ARC, [78, 46, 78.5, 46, 20], 3, False),
        (PARABOLA, [60, 48, 88, 60, 60, 48], 11, False),
        (BOUNCE, [78, 55, 86, 55, 78, 55, 0.5], 11, True),
        (BOUNCE, [78, 55, 102, 55, 78, 55, 0.5], 11, False),
    ],
    ids=["Z", "wide Z", "loop", "wide loop", "back once", "short bounce", "long bounce"],
)
def test_paths_that_double_back_within_their_width_overlap(family, path, radius, overlaps):
    assert self_overlaps(disc_on(family, path, float(radius))) == overlaps


@pytest.mark.parametrize("fraction", [0.4, 0.6])
def test_most_of_a_sweep_must_be_visible(fraction):
    observation = observed(BALL, color=ONE_PAINT)
    alpha = disc_at(observation).swept.alpha
    hidden = np.cumsum(alpha.sum(axis=0)) < fraction * alpha.sum()
    valid = observation.valid & ~hidden
    state = disc_at(replace(observation, valid=valid, weight=observation.weight * valid))
    expected = "lies mostly where the pictures are clipped or hidden" if fraction > 0.5 else ""
    assert rejection(state) == expected

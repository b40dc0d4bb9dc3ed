"""Pose and Change: turning, growing and being deformed over the exposure."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.rendering.pose import AT_REST, Change

BUSY = Change(
    turned=(0.2, -0.4, 0.3),
    spin=(0.5, 1, -2),
    scale=(0.8, 1.5),
    squash=(1.3, 0.6),
    squash_angle=0.7,
    depth=(1.4, 0.7),
)


def test_no_change_is_at_rest():
    for t in (0, 0.4, 1):
        assert_allclose(Change().at(t).rotation, AT_REST.rotation)
        assert_allclose(Change().at(t).stretch, AT_REST.stretch)


def test_a_turn_about_z_takes_x_towards_y():
    pose = Change(spin=(0, 0, np.pi)).at(0.5)
    assert_allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    assert_allclose(pose.plane, [[0, -1], [1, 0]], atol=1e-15)


def test_squash_makes_longer_along_its_angle_and_keeps_the_area():
    stretch = Change(squash=(2, 2), squash_angle=np.radians(30)).at(0).stretch
    along = np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    assert_allclose(stretch @ along, 2 * along)
    assert_allclose(np.linalg.det(stretch), 1)
    assert_allclose(np.linalg.det(BUSY.at(0.5).stretch), (1.15 / 1.05) ** 2)


@pytest.mark.parametrize("t", [0, 0.3, 1])
def test_part_agrees_with_the_whole_change(t):
    part, whole = BUSY.part(0.2, 0.7).at(t), BUSY.at(0.2 + 0.5 * t)
    assert_allclose(part.rotation, whole.rotation, atol=1e-12)
    assert_allclose(part.stretch, whole.stretch, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_no_point_moves_faster_than_the_rate(seed):
    rng = np.random.default_rng(seed)
    change = Change(
        spin=tuple(rng.normal(0, 2, 3)),
        scale=tuple(rng.uniform(0.5, 2, 2)),
        squash=tuple(rng.uniform(0.5, 2, 2)),
        squash_angle=rng.uniform(0, 3),
        depth=tuple(rng.uniform(0.7, 1.3, 2)),
    )
    points = rng.normal(size=(3, 50))
    points /= np.linalg.norm(points, axis=0)
    paths = [p.stretch @ (p.rotation @ points)[:2] for p in map(change.at, np.linspace(0, 1, 1001))]
    speed = 1000 * np.linalg.norm(np.diff(paths, axis=0), axis=1)
    assert speed.max() <= change.rate
    assert speed.max() > 0.2 * change.rate


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"spin": (1, 2)}, "spin must be 3 finite numbers"),
        ({"scale": (1, np.inf)}, "scale must be 2 finite numbers"),
        ({"scale": (1, 0)}, "scale must be positive"),
        ({"squash": (-1, 1)}, "squash must be positive"),
        ({"depth": (1, 0)}, "depth must be positive"),
        ({"squash_angle": np.nan}, "squash_angle must be finite"),
    ],
)
def test_rejects_wrong_arguments(wrong, says):
    with pytest.raises(ValueError, match=says):
        Change(**wrong)

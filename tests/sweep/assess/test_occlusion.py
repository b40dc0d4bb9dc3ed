"""Occluders: found where the plate is visible in front of an object whose alpha is known."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.layer import Layer
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.rendering.plates import plain_plate
from blurmatte.sweep.assess.occlusion import mean_of_neighbors, occluded
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
ORANGE = np.array([0.9, 0.45, 0.05])
PATH = Trajectory.arc((42, 62), (80, 48), (118, 60))
SCENE = Scene(plain_plate(SIZE, (0.3, 0.33, 0.36), 1), PATH, Ball(11, ORANGE))
BEHIND = render(SCENE, 120).layer.alpha
SIGMA = 0.006


def posts(name):
    """(H, W) bool."""
    hidden = np.zeros(SIZE[::-1], bool)
    if name == "post":
        hidden[:, 74:82] = True
    else:
        hidden[:, ::16] = hidden[:, 1::16] = True
    return hidden


def light(hidden, color=(0.1, 0.25, 0.12)):
    """The truth with an object of a color in front."""
    layer = Layer(hidden.astype(float), hidden[..., None] * np.array(color))
    return render(replace(SCENE, occluder=layer), 120)


def looked_at(truth, seed=0):
    """The occluder found if alpha is known."""
    rng = np.random.default_rng(seed)
    C, B = (p.rgb + rng.normal(0, SIGMA, p.rgb.shape) for p in (truth.image, truth.plate))
    use, variance = np.ones(BEHIND.shape, bool), np.full(C.shape, 2 * SIGMA**2)
    return occluded(BEHIND, ORANGE, C, B, variance, use)


@pytest.mark.parametrize("name", ["post", "wires"])
@pytest.mark.parametrize("color", [(0.1, 0.25, 0.12), (0.03, 0.03, 0.03)], ids=["green", "black"])
def test_finds_the_occluder(name, color):
    """honest: most of it, and hardly any other pixel."""
    found = looked_at(light(posts(name), color))
    assert found[posts(name) & (BEHIND > 0.2)].mean() > 0.85
    assert found[~posts(name)].mean() < 0.002


def test_finds_nothing_without_an_occluder():
    """honest: over several pictures of one object."""
    nothing = light(np.zeros(SIZE[::-1], bool))
    assert sum(looked_at(nothing, seed).sum() for seed in range(5)) == 0


def test_plate_of_the_object_color_gives_no_occluder():
    """exact: plate and object are indistinguishable there."""
    B = np.broadcast_to(0.5 * ORANGE, (*BEHIND.shape, 3))
    use, variance = np.ones(BEHIND.shape, bool), np.full(B.shape, SIGMA**2)
    assert not occluded(BEHIND, ORANGE, B, B, variance, use).any()
    half = np.arange(SIZE[0])[:, None] < 70
    blue = np.where(half, 0.8, 1) * B[..., ::-1]  # an occluder is visible in the plate
    C = np.where(half, blue, blue + BEHIND[..., None] * (ORANGE - blue))
    assert occluded(BEHIND, ORANGE, C, blue, variance, use).any()


def test_mean_of_neighbors():
    """exact: nine pixels."""
    one = np.zeros((5, 5))
    one[2, 2] = 9
    assert mean_of_neighbors(one)[1:4, 1:4] == pytest.approx(np.ones((3, 3)))
    assert mean_of_neighbors(one).sum() == pytest.approx(9)


def test_a_sweep_that_is_mostly_hidden_has_no_occluder():
    """exact: a shape fitted to noise is absent, not hidden."""
    B = np.broadcast_to(np.array([0.3, 0.33, 0.36]), (*BEHIND.shape, 3))
    use, variance = np.ones(BEHIND.shape, bool), np.full(B.shape, SIGMA**2)
    assert not occluded(BEHIND, ORANGE, B, B, variance, use).any()
    B = np.where(posts("post")[..., None], 0.8, 1) * B
    C = np.where(posts("post")[..., None], B, B + BEHIND[..., None] * (ORANGE - B))
    assert occluded(BEHIND, ORANGE, C, B, variance, use).any()


@pytest.mark.diagonal
@pytest.mark.parametrize("radius", [18, 26])
@pytest.mark.parametrize("tile", [None, 6, 12])
def test_a_sweep_of_the_wrong_width_has_no_occluder(radius, tile):
    """honest: where the plate is visible within a sweep that is too wide, nothing hides the object."""
    scene = SCENE if tile is None else replace(SCENE, plate=colorful_plate(SIZE, 1, tile=tile))
    wrong = render(replace(scene, body=Ball(radius, ORANGE)), 120).layer.alpha
    truth = render(scene, 120)
    rng = np.random.default_rng(3)
    C, B = (p.rgb + rng.normal(0, SIGMA, p.rgb.shape) for p in (truth.image, truth.plate))
    use, variance = np.ones(wrong.shape, bool), np.full(C.shape, 2 * SIGMA**2)
    assert not occluded(wrong, ORANGE, C, B, variance, use).any()

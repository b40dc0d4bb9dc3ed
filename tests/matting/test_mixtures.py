"""The farthest mixture of a streak, and hypotheses that it makes impossible."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered

from blurmatte.matting import solve
from blurmatte.matting.mixtures import Mixtures
from blurmatte.rendering import Camera, Scene
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.pose import Change
from blurmatte.trajectory import Trajectory

RED, BLUE, GRAY = np.array([0.6, 0.06, 0.05]), np.array([0.1, 0.2, 0.7]), np.full(3, 0.45)
SIZE, STD = (20, 30), 0.003
BOX = (0, 0, SIZE[1], SIZE[0])
AT = tuple(np.indices(SIZE).reshape(2, -1))


def plates(rng):
    return {"gray": np.tile(GRAY, (600, 1)), "colored": rng.uniform(0.1, 0.6, (600, 3))}


def mixtures(plate="gray", color=RED, peak=1.0, shade=1.0):
    """A fan: alpha from 0 to its peak, which it keeps over a tenth of the streak."""
    rng = np.random.default_rng(0)
    B = plates(rng)[plate]
    alpha = np.minimum(np.linspace(0, 1.1 * peak, len(B)), peak)
    C = alpha[:, None] * color + shade * (1 - alpha)[:, None] * B
    noisy = (x + STD * rng.standard_normal(x.shape) for x in (C, B))
    variance = np.full(B.shape, STD**2)
    return Mixtures(*noisy, variance, variance, AT), alpha.reshape(SIZE)


def angle(a, b):
    return np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))


@pytest.mark.parametrize("plate", ["gray", "colored"])
@pytest.mark.parametrize("color", [RED, BLUE])
def test_farthest_mixture_is_the_color_of_an_opaque_core(plate, color):
    found = mixtures(plate, color)[0].farthest(None)
    assert found.evidence == {"mixtures": found.angle_std}
    assert angle(found.pole, color) < 1.5
    assert found.angle_std < 3


def test_single_windows_are_not_the_farthest_mixture():
    """robust: one window is purple."""
    streak, _ = mixtures()
    streak.C[7] = 0.9, 0.0, 0.9
    assert angle(streak.farthest(None).pole, RED) < 1.5


def test_mixtures_lie_beyond_a_color_that_is_too_near():
    """A pink between the wall and the red stick; not beyond the red, or a color farther off."""
    streak, _ = mixtures()
    pink = 0.3 * RED + 0.7 * GRAY
    assert streak.excess(pink / np.linalg.norm(pink)) > 0.5
    for color in (RED, np.array([1.0, 0, 0])):
        assert streak.excess(color / np.linalg.norm(color)) < 0.01


def test_alpha_that_leaves_too_much_of_the_plate_is_short():
    streak, alpha = mixtures()
    assert streak.shortage(alpha, BOX) < 0.01
    assert streak.shortage(0.3 * alpha, BOX) > 0.2
    wider = np.pad(alpha, 5, mode="edge")
    assert_allclose(
        streak.shortage(wider, (-5, -5, SIZE[1] + 5, SIZE[0] + 5)), streak.shortage(alpha, BOX)
    )


def test_a_shadow_is_no_shortage():
    """Half of the light is missing, and no object is there."""
    streak, alpha = mixtures(peak=1e-9, shade=0.5)
    assert streak.shortage(alpha + 0.03, BOX) < 0.01


def test_another_thing_in_the_streak_is_no_shortage():
    """Alpha is right, but 0 in some rows, where something else moved."""
    streak, alpha = mixtures()
    alpha[:3] = 0
    assert streak.shortage(alpha, BOX) < 0.01
    alpha[:10] = 0.03
    assert streak.shortage(alpha, BOX) > 0.05


def test_few_windows_prove_nothing():
    streak, alpha = mixtures()
    few = Mixtures(*(x[-5:] for x in (streak.C, streak.B, streak.V_C, streak.V_B)), AT)
    assert few.farthest(None) is None
    assert few.excess(GRAY / np.linalg.norm(GRAY)) == 0
    assert few.shortage(0 * alpha, BOX) == 0


@pytest.mark.battery
def test_stick_that_turns_about_its_end_has_the_color_of_its_pivot():
    """A red stick before a gray wall: its fan is pink, and its pivot hides the wall."""
    time, length, size = np.linspace(0, 1, 33), 70, (160, 120)
    turned = 0.9 * time - 0.6
    along = np.stack([np.cos(turned), np.sin(turned)], axis=1)
    path = Trajectory((45, 70) + length / 2 * along, time)
    change = Change(turned=(0, 0, turned[0]), spin=(0, 0, 0.9))
    scene = Scene(plain_plate(size, GRAY, 0), path, Sheet(length, 12, RED), change)
    solution = solve(*photographed(scene, Camera(code_std=2 / 255), plate_frames=5, substeps=None))
    truth = rendered(scene, None)
    off = solution.alpha - truth.layer.alpha
    assert np.sqrt(np.mean(off[truth.layer.alpha > 0] ** 2)) < 0.02
    assert angle(solution.model.mean, RED) < 1
    assert solution.sweep.silhouette.turns

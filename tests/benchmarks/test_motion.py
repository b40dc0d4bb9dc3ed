"""The Cramér–Rao bound of the benchmark of motion."""

import numpy as np
from benchmarks.accuracy import motion
from numpy.testing import assert_allclose

from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.trajectory import Trajectory


def test_discs_agree_with_the_renderer():
    """Oracle: the scene's own alpha."""
    truth = motion.random_scene(6, 12, 0)
    p = np.array([*truth.trajectory.xy.ravel(), truth.scene.body.radius])
    assert_allclose(motion.drawn(p, truth.image.size, 400), truth.layer.alpha, atol=1e-4)


def test_bound_is_proportional_to_the_noise():
    """Exact: rounding is noise of variance 1/12."""
    truth = motion.random_scene(6, 12, 0)
    first, second = (motion.bounds(truth, noise) for noise in (1, 2))
    assert_allclose(second / first, np.sqrt((4 + 1 / 12) / (1 + 1 / 12)), rtol=1e-6)


def test_bound_of_a_transposed_scene_is_transposed():
    """Invariant: x and y are exchanged."""
    plate, ball = colorful_plate((60, 48), 1, tile=12), Ball(7, (0.7, 0.4, 0.1), 1.0)
    ends = np.array([[20.0, 18.0], [38.0, 27.0]])
    first, second = (
        motion.bounds(render(Scene(light, Trajectory.line(*way), ball)), 1)
        for light, way in ((plate, ends), (plate.transpose(1, 0, 2).copy(), ends[:, ::-1]))
    )
    assert_allclose(second, first[[1, 0, 2, 3, 4]], rtol=1e-3)
    assert (first > 0).all()

"""solve_clip of an object that lets light through."""

import numpy as np
import pytest
from tests.scenes import on_line

from blurmatte.matting.hypotheses import Swept
from blurmatte.motion.clip.steps import solve_clip
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball
from blurmatte.rendering.plates import textured_plate
from blurmatte.sweep import OpacityPrior

SIZE, RADIUS, OPACITY, NOISE = (200, 100), 10, 0.5, 0.004
HALF = np.array([12, 3])  # of the path in an exposure


@pytest.mark.battery
def test_opacity_sum_and_size_are_within_their_errors():
    # honest: path and radius of other frames, measured of solid discs, are no prior
    rng = np.random.default_rng(0)
    plate = textured_plate(SIZE, rng)
    exact, truth = [plate], []
    for k in range(4):
        middle = np.array([35 + 40 * k, 40 + 6 * k])
        scene = on_line(plate, middle - HALF, middle + HALF, Ball(RADIUS, (0.8, 0.3, 0.1)))
        exact.append(OPACITY * scene.image.rgb + (1 - OPACITY) * plate)
        truth.append((middle, OPACITY * scene.layer.alpha.sum()))
    still, *frames = (
        LinearImage(
            np.asarray(light + rng.normal(0, NOISE, light.shape), np.float32),
            NoiseModel(read_std=NOISE),
        )
        for light in exact
    )
    z = []
    for k, solution in solve_clip(frames, still, solver=Swept(opacity=OpacityPrior.ANY)):
        (middle, total), motion = truth[k], measure_motion(solution)
        std = np.sqrt(np.diag(motion.covariance))[:2]
        z += [*((motion.center - middle) / std), (motion.radius - RADIUS) / motion.radius_std]
        z.append((solution.stats.sum_alpha - total) / solution.stats.sum_alpha_std)
    assert len(z) >= 12  # a solid disc may not explain a frame
    assert np.abs(z).max() < 3.5

"""A clip with a known answer: a ball that crosses the picture, in some of its frames."""

import numpy as np
import pytest
from tests.scenes import rendered

import blurmatte as bm
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.trajectory import Trajectory

SIZE, RADIUS, COUNT = (72, 48), 6.0, 9
FIRST, LAST = 3, 7  # frames with the ball, which the border cuts in the last
COLOR = np.array([0.7, 0.35, 0.1])
NOISE = 0.01


def path_of(k):
    """Start and end of the path in frame k."""
    x, y = 12 + 11.25 * (k - FIRST), 18 + 0.9 * (k - FIRST)
    return (x, y), (x + 10, y + 0.8)  # one line in time


@pytest.fixture(scope="session")
def truth():
    """Layers of the frames with the ball, by number."""
    plate = colorful_plate(SIZE, 1, tile=12)
    frames = range(FIRST, LAST + 1)
    scenes = {k: Scene(plate, Trajectory.line(*path_of(k)), Ball(RADIUS, COLOR)) for k in frames}
    return {k: rendered(scene).layer for k, scene in scenes.items()}


@pytest.fixture(scope="session")
def pictures(truth):
    """The frames with noise, and the plate without."""
    plate, rng = colorful_plate(SIZE, 1, tile=12), np.random.default_rng(1)
    clean = bm.LinearImage(plate)

    def picture(k):
        light = truth[k].over(clean).rgb if k in truth else plate
        return bm.LinearImage((light + rng.normal(0, NOISE, light.shape)).astype(np.float32))

    return [picture(k) for k in range(COUNT)], clean


@pytest.fixture(scope="session")
def shot(tmp_path_factory, pictures):
    """The same as files: a pattern of frames, and a plate."""
    folder = tmp_path_factory.mktemp("shot")
    bm.write_frames(folder / "shot.####.exr", pictures[0], start=0)
    bm.write(folder / "plate.exr", pictures[1].with_noise(bm.NoiseModel(read_std=1e-4)))
    return folder

"""draw_motion: path and outlines in their places."""

import numpy as np
import pytest
from tests.scenes import RED, solution_of

from blurmatte.figures import draw_motion, style
from blurmatte.motion.picture.measure import measure_motion
from blurmatte.radiometry import LinearImage
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.silhouette import DISC

SIZE = (120, 90)
SWEEP = Sweep(
    path_family("line"),
    np.array([30.0, 40, 80, 50]),
    DISC,
    np.array([6.0]),
    RED,
    1e-4 * np.eye(5),
    SIZE,
)


@pytest.mark.parametrize("sweep", [SWEEP, None], ids=["sweep", "moments"])
def test_path_and_outlines_cover_the_streak(sweep):
    """Exact: together they are as wide and as high as the streak."""
    solution = solution_of(SWEEP.alpha, sweep=sweep)
    motion = measure_motion(solution)
    image = LinearImage(np.full((SIZE[1], SIZE[0], 3), 0.1))
    sheet = draw_motion(image, solution, motion)
    assert sheet.dtype == np.uint8
    assert sheet.shape[1] == 1800
    y, x = np.nonzero((sheet == style.BRIGHT).all(axis=-1)[130:830])  # between title and words
    assert np.ptp(x) / np.ptp(y) == pytest.approx((50 + 12) / (10 + 12), rel=0.03)


def test_rejects_another_picture():
    """Door."""
    solution = solution_of(SWEEP.alpha, sweep=SWEEP)
    with pytest.raises(ValueError, match="image is 20x10 pixels and solution 120x90"):
        draw_motion(LinearImage(np.zeros((10, 20, 3))), solution, measure_motion(solution))

"""depth_from_blur: depth of an object of known speed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm

LENS = bm.Intrinsics(900, 905, 640, 360, np.array([-0.1, 0.02, 1e-3, 0]))
START, SPEED, EXPOSURE = np.array([-0.8, 0.3, 6.0]), 12.0, 1 / 60


def path_of(direction, error=0.0):
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    ends = LENS.project([START, START + SPEED * EXPOSURE * unit])
    return bm.Trajectory.line(*(ends + error))


def test_depth_of_motion_parallel_to_picture():
    """exact: f v T / L, with distortion."""
    depth = bm.motion.depth_from_blur(path_of([1, -0.3, 0]), LENS, SPEED, EXPOSURE)
    assert_allclose([depth.start, depth.end, depth.depth], 6.0)
    assert "parallel to the picture" in " ".join(bm.explain(depth))


@pytest.mark.parametrize("direction", [[1, 0.2, 0.5], [-2, 1, -3], [0, 1, 4]])
@pytest.mark.parametrize("sign", [1, -1], ids=["as given", "backwards"])
def test_depth_of_motion_in_known_direction(direction, sign):
    """exact: at both ends, for both signs of the direction."""
    shift = SPEED * EXPOSURE * np.array(direction) / np.linalg.norm(direction)
    given = sign * np.array(direction)
    depth = bm.motion.depth_from_blur(path_of(direction), LENS, SPEED, EXPOSURE, given)
    assert_allclose([depth.start, depth.end], [6, 6 + shift[2]], rtol=1e-8)
    assert_allclose(depth.off, 0, atol=1e-6)
    assert "0.0° off the plane" in " ".join(bm.explain(depth))


def test_off_is_angle_of_inconsistent_direction():
    """exact: the angle to the plane through the streak."""
    depth = bm.motion.depth_from_blur(
        path_of([1, 0, 0]), LENS, SPEED, EXPOSURE, [1, np.tan(0.1), 0]
    )
    assert 0.08 < depth.off < 0.101


@pytest.mark.parametrize("direction", [None, [1, 0.2, 0.5]])
def test_errors_have_unit_z_scores(direction):
    """honest: of picture, speed and exposure time together."""
    rng, z = np.random.default_rng(2), []
    true = START[2] + (0 if direction is None else 0.1 * 0.5 / np.linalg.norm(direction))
    for _ in range(150):
        path = path_of([1, -0.3, 0] if direction is None else direction, rng.normal(0, 0.3, (2, 2)))
        speed, time = SPEED + rng.normal(0, 0.2), EXPOSURE * (1 + rng.normal(0, 0.01))
        depth = bm.motion.depth_from_blur(
            path, LENS, speed, time, direction, 0.2, 0.01 * EXPOSURE, path_std=0.3
        )
        z.append((depth.depth - true) / depth.depth_std)
    assert abs(np.std(z) - 1) < 0.18
    assert abs(np.mean(z)) < 0.27


def test_invalid_input_is_rejected():
    """door: numbers out of range, and a streak without a length."""
    path = path_of([1, 0, 0])
    with pytest.raises(ValueError, match="speed must be finite and above 0, got 0"):
        bm.motion.depth_from_blur(path, LENS, 0, EXPOSURE)
    with pytest.raises(ValueError, match="exposure_time must be finite and above 0"):
        bm.motion.depth_from_blur(path, LENS, 1, -1)
    with pytest.raises(ValueError, match=r"direction must be \(x, y, z\)"):
        bm.motion.depth_from_blur(path, LENS, 1, 1, [0, 0, 0])
    with pytest.raises(bm.errors.MotionError, match="no motion along direction"):
        bm.motion.depth_from_blur(bm.Trajectory.line((5, 5), (5, 5)), LENS, 1, 1)

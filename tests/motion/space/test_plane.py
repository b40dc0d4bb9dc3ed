"""Plane, measure_on_plane: motion on a plane in perspective."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.silhouette import DISC

LENS = bm.Intrinsics(900, 905, 640, 360, np.array([-0.1, 0.02, 1e-3, 0]))
# x of the plane to the right, y ahead, seen from 5 m above, 20° down
TILT = np.radians(20)
ROTATION = np.array(
    [[1, 0, 0], [0, -np.sin(TILT), -np.cos(TILT)], [0, np.cos(TILT), -np.sin(TILT)]]
)
ROTATION[:, 1:] *= [1, 1]
CAMERA = np.array([0, -12.0, 5.0])  # in the plane's coordinates
TRANSLATION = -ROTATION @ CAMERA
CORNERS = np.array([[-3.0, 0], [3, 0], [4, 9], [-4, 9], [0, 5]])


def seen(points, lens=LENS):
    """Pixels of points (n, 3) in the plane's coordinates."""
    return lens.project(np.asarray(points, float) @ ROTATION.T + TRANSLATION)


def on_ground(points, height=0.0):
    return np.column_stack([points, np.full(len(points), height)])


def sweep_between(start, end, std=0.2):
    model = bm.ColorModel.from_samples(np.array([0.8, 0.3, 0.1]), std=0)
    path = np.concatenate([start, end])
    return bm.sweep.Sweep(LINE, path, DISC, np.array([9.0]), model, std**2 * np.eye(5), (1280, 720))


@pytest.mark.parametrize("by", ["pose", "vector", "points"])
def test_locate_inverts_projection(by):
    """exact: on the plane and above it, with distortion."""
    if by == "points":
        plane = bm.motion.Plane.from_points(seen(on_ground(CORNERS)), CORNERS, LENS)
    else:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(ROTATION).as_rotvec() if by == "vector" else ROTATION
        plane = bm.motion.Plane.from_pose(LENS, turn, TRANSLATION)
    there = np.array([[0.5, 1], [-2, 7], [3, 20]])
    assert_allclose(plane.locate(seen(on_ground(there))), there, atol=1e-8)
    assert_allclose(plane.locate(seen(on_ground(there, 0.8)), 0.8), there, atol=1e-8)
    assert np.isnan(plane.locate([[640.0, 5.0]])).all()  # the sky


def test_homography_agrees_with_opencv():
    """oracle: of four points."""
    cv2 = pytest.importorskip("cv2")
    pixels = seen(on_ground(CORNERS[:4]))
    H, _ = cv2.findHomography(CORNERS[:4], pixels)
    ours = bm.motion.Plane.from_points(pixels, CORNERS[:4]).homography
    assert_allclose(ours / ours[2, 2], H / H[2, 2], rtol=1e-5, atol=1e-9)


def test_speed_of_object_above_plane():
    """exact: positions and speed at a height above the plane, and the error without the height."""
    start, end, h = np.array([-2.0, 4]), np.array([1.0, 5]), 0.6
    sweep = sweep_between(*seen(on_ground([start, end], h)))
    plane = bm.motion.Plane.from_pose(LENS, ROTATION, TRANSLATION)
    motion = bm.motion.measure_on_plane(sweep, plane, 0.1, height=h)
    assert_allclose([motion.start, motion.end], [start, end], atol=1e-8)
    # A straight path in the picture is not quite one on the plane, if the lens bends it.
    assert_allclose(motion.speed, np.hypot(3, 1) / 0.1, rtol=1e-3)
    assert_allclose(motion.displacement, end - start, atol=1e-8)
    ground = bm.motion.measure_on_plane(sweep, plane, 0.1)
    assert_allclose(ground.length, motion.length * 5 / (5 - h), rtol=1e-6)  # 5 m is the camera's


def test_errors_have_unit_z_scores():
    """honest: of path, points, height and time together."""
    rng = np.random.default_rng(1)
    start, end, T = np.array([-2.0, 4]), np.array([1.0, 5]), 0.1
    corners, ends = seen(on_ground(CORNERS)), seen(on_ground([start, end], 0.6))
    z, speeds = [], []
    for _ in range(100):
        pixels = corners + rng.normal(0, 0.4, corners.shape)
        plane = bm.motion.Plane.from_points(pixels, CORNERS, LENS, pixel_std=0.4)
        path = bm.Trajectory.line(*(ends + rng.normal(0, 0.5, ends.shape)))
        motion = bm.motion.measure_on_plane(
            path, plane, T + rng.normal(0, 1e-3), 1e-3, 0.6 + rng.normal(0, 0.05), 0.05, 0.5
        )
        off = np.concatenate([motion.start - start, motion.end - end])
        z.append(off / np.sqrt(np.diag(motion.covariance)))
        speeds.append((motion.speed - np.hypot(3, 1) / T) / motion.speed_std)
    assert np.abs(np.std(z, axis=0) - 1).max() < 0.2
    assert abs(np.std(speeds) - 1) < 0.2
    assert abs(np.mean(speeds)) < 0.4
    assert set(motion.parts) == {"picture", "plane", "height", "exposure time"}
    assert motion.dominant in " ".join(bm.explain(motion)) or motion.dominant == "picture"


def test_invalid_input_is_rejected():
    """door: degenerate planes, paths beyond the horizon, and missing numbers."""
    plane = bm.motion.Plane.from_points(seen(on_ground(CORNERS)), CORNERS)
    sweep = sweep_between((300.0, 400), (500.0, 420))
    with pytest.raises(ValueError, match="pixels and meters must be four points"):
        bm.motion.Plane.from_points(np.zeros((3, 2)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="have an inverse: no three points on a line"):
        bm.motion.Plane.from_points(seen(on_ground(CORNERS[:4])), [[0, 0], [1, 0], [2, 0], [3, 0]])
    with pytest.raises(ValueError, match=r"pixels must have the shape \(..., 2\), got \(\)"):
        plane.locate(7)
    with pytest.raises(ValueError, match="a height needs intrinsics"):
        bm.motion.measure_on_plane(sweep, plane, 0.1, height=1)
    with pytest.raises(ValueError, match=r"rotation must be \(3, 3\)"):
        bm.motion.Plane.from_pose(LENS, np.eye(2), TRANSLATION)
    with pytest.raises(TypeError, match="path must be a Sweep or a Trajectory"):
        bm.motion.measure_on_plane([[0, 0], [1, 1]], plane)
    with pytest.raises(bm.errors.MotionError, match="beyond the plane's horizon"):
        bm.motion.measure_on_plane(sweep_between((300.0, 2), (500.0, 420)), plane)
    with pytest.raises(bm.errors.MotionError, match="nothing moved"):
        bm.motion.measure_on_plane(sweep_between((300.0, 400), (300.0, 400)), plane)
    with pytest.raises(bm.errors.MotionError, match="needs the exposure_time"):
        _ = bm.motion.measure_on_plane(sweep, plane).speed
    assert "The speed is not known" in " ".join(
        bm.explain(bm.motion.measure_on_plane(sweep, plane))
    )
